//! A first-order low-pass at times of any spacing: the memory of a lag.

/// Writes into `x` what a low-pass `tau x' = y - x` makes of `y` at rising times `t`, from `start` on.
///
/// Exact where `y` is straight between its samples; a time that does not rise leaves `x` where it was. Times and time
/// constant in s. Writes as many samples as the shortest of the slices holds.
pub fn lagged(t: &[f64], y: &[f64], tau: f64, start: f64, x: &mut [f64]) {
    let mut held = start;
    let mut last: Option<(f64, f64)> = None;
    for ((&t, &y), x) in t.iter().zip(y).zip(x) {
        if let Some((before, from)) = last {
            let steps = (t - before) / tau;
            if steps > 0.0 {
                let settled = -libm::expm1(-steps);
                let mean = settled / steps;
                held += settled * (from - held) + (1.0 - mean) * (y - from);
            }
        }
        last = Some((t, y));
        *x = held;
    }
}

#[cfg(test)]
mod tests {
    use super::lagged;

    const TAU: f64 = 0.7;

    #[test]
    fn a_step_settles_exponentially_at_any_times() {
        let t = [0.0, 0.1, 0.15, 1.0, 9.0];
        let mut x = [0.0; 5];
        lagged(&t, &[1.0; 5], TAU, 0.0, &mut x);
        for (t, x) in t.iter().zip(x) {
            assert!((x - (1.0 - libm::exp(-t / TAU))).abs() < 1e-15);
        }
    }

    #[test]
    fn a_ramp_is_followed_a_time_constant_late() {
        let t = [0.0, 0.3, 0.4, 2.0];
        let mut x = [0.0; 4];
        lagged(&t, &t, TAU, -TAU, &mut x);
        for (t, x) in t.iter().zip(x) {
            assert!((x - (t - TAU)).abs() < 1e-15);
        }
    }

    #[test]
    fn it_holds_where_time_does_not_rise() {
        let mut x = [0.0; 3];
        lagged(&[0.0, 0.0, f64::NAN], &[1.0, 2.0, 3.0], TAU, 0.25, &mut x);
        assert!(x.iter().all(|x| (x - 0.25).abs() < 1e-15));
    }
}
