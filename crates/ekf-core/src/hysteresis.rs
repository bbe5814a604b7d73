//! The play operator: the memory behind hysteresis and backlash.
//!
//! `y` follows `x` at a distance of at most half the width and is constant inside it: rate independent, and kept
//! through rests (Krasnosel'skii, Pokrovskii 1989, ch. 1).

/// Writes into `y` what a slack of full `width` lets through of `x`, starting from `start`.
///
/// `y_k = min(max(y_(k-1), x_k - width/2), x_k + width/2)`; a sample that is not a number leaves `y` where it was.
/// Writes as many samples as the shorter of both slices holds.
pub fn play(x: &[f64], width: f64, start: f64, y: &mut [f64]) {
    let reach = 0.5 * width;
    let mut held = start;
    for (x, y) in x.iter().zip(y) {
        held = held.max(x - reach).min(x + reach);
        *y = held;
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // sums and differences of small halves are exact
mod tests {
    use super::play;

    #[test]
    fn output_is_constant_inside_the_slack_and_follows_at_its_edge() {
        let x = [0.0, 1.0, 3.0, 2.0, 1.5, -1.0, -0.5];
        let mut y = [0.0; 7];
        play(&x, 2.0, 0.0, &mut y);
        assert_eq!(y, [0.0, 0.0, 2.0, 2.0, 2.0, 0.0, 0.0]);
    }

    #[test]
    fn no_width_lets_everything_through() {
        let x = [0.3, -2.0, 5.0];
        let mut y = [0.0; 3];
        play(&x, 0.0, 9.0, &mut y);
        assert_eq!(y, x);
    }

    #[test]
    fn it_holds_over_what_is_not_a_number() {
        let mut y = [0.0; 3];
        play(&[2.0, f64::NAN, 2.0], 2.0, 0.0, &mut y);
        assert_eq!(y, [1.0; 3]);
    }
}
