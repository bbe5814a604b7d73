//! The memory of a lag: a first-order low-pass at times of any spacing, and recursive filters of uniform samples.

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

/// Passes uniform samples through a filter of second order, `a[0] = 1` left out of `a`; the state goes on from call to
/// call.
///
/// Transposed direct form II (Oppenheim and Schafer 2010, section 6.3): `y = b0 x + s0`, `s0 = b1 x - a1 y + s1`,
/// `s1 = b2 x - a2 y`. A filter of first order has `b2 = a2 = 0`.
pub fn section(b: [f64; 3], a: [f64; 2], state: &mut [f64; 2], y: &mut [f64]) {
    let [mut first, mut second] = *state;
    for y in y {
        let x = *y;
        *y = b[0] * x + first;
        first = b[1] * x - a[0] * *y + second;
        second = b[2] * x - a[1] * *y;
    }
    *state = [first, second];
}

#[cfg(test)]
mod tests {
    use super::{lagged, section};

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

    #[test]
    fn a_section_answers_an_impulse_by_its_recursion_and_goes_on_from_its_state() {
        let (b, a) = ([0.5, -0.25, 0.125], [-1.5, 0.6]);
        let mut whole = [1.0, 0.0, 0.0, 0.0, 0.0];
        section(b, a, &mut [0.0; 2], &mut whole);
        let mut expected = [0.0; 5];
        for n in 0..5 {
            let past = |k: usize| if n >= k { expected[n - k] } else { 0.0 };
            expected[n] = b.get(n).copied().unwrap_or(0.0) - a[0] * past(1) - a[1] * past(2);
        }
        assert!(whole.iter().zip(expected).all(|(y, expected)| (y - expected).abs() < 1e-15));
        let mut parts = [1.0, 0.0, 0.0, 0.0, 0.0];
        let mut state = [0.0; 2];
        let (before, after) = parts.split_at_mut(2);
        section(b, a, &mut state, before);
        section(b, a, &mut state, after);
        assert_eq!(parts.map(f64::to_bits), whole.map(f64::to_bits));
    }
}
