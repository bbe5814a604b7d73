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

/// A recursive filter of second order, `a[0] = 1` left out of `a`, and its state; one of first order has `b2 = a2 = 0`.
///
/// Transposed direct form II (Oppenheim and Schafer 2010, section 6.3): `y = b0 x + s0`, `s0 = b1 x - a1 y + s1`,
/// `s1 = b2 x - a2 y`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// Coefficients of the numerator.
    pub b: [f64; 3],
    /// Coefficients of the denominator behind the first.
    pub a: [f64; 2],
    /// The state; it goes on from call to call.
    pub state: [f64; 2],
}

impl Section {
    #[inline]
    fn pass(&mut self, x: f64) -> f64 {
        let Self { b, a, state: [first, second] } = *self;
        let y = b[0] * x + first;
        self.state = [b[1] * x - a[0] * y + second, b[2] * x - a[1] * y];
        y
    }

    /// Ends a decay that is nothing, before it becomes subnormal: processors and products of columns slow down there.
    fn settle(&mut self) {
        if self.state.iter().all(|held| held.abs() < NOTHING) {
            self.state = [0.0; 2];
        }
    }
}

/// A state that is none, whatever its unit: its products with others of the same size are still normal numbers.
const NOTHING: f64 = 1e-100;
/// Samples between two looks at the states.
const LOOK: usize = 64;

/// Passes uniform samples through sections, one behind the other; four at a time in one pass, where they overlap.
///
/// A decay ends where both states of a section have fallen below 1e-100, at the next of every 64 samples.
pub fn cascade(sections: &mut [Section], y: &mut [f64]) {
    let (fours, others) = sections.as_chunks_mut::<4>();
    for four in fours {
        together(four, y);
    }
    for section in others {
        together(core::array::from_mut(section), y);
    }
}

fn together<const N: usize>(sections: &mut [Section; N], y: &mut [f64]) {
    let mut held = *sections; // in registers
    for part in y.chunks_mut(LOOK) {
        for y in part {
            *y = held.iter_mut().fold(*y, |x, section| section.pass(x));
        }
        held.iter_mut().for_each(Section::settle);
    }
    *sections = held;
}

#[cfg(test)]
mod tests {
    use super::{Section, cascade, lagged};

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
        let section = Section { b: [0.5, -0.25, 0.125], a: [-1.5, 0.6], state: [0.0; 2] };
        let mut whole = [1.0, 0.0, 0.0, 0.0, 0.0];
        cascade(&mut [section], &mut whole);
        let mut expected = [0.0; 5];
        for n in 0..5 {
            let past = |k: usize| if n >= k { expected[n - k] } else { 0.0 };
            expected[n] = section.b.get(n).copied().unwrap_or(0.0) - section.a[0] * past(1) - section.a[1] * past(2);
        }
        assert!(whole.iter().zip(expected).all(|(y, expected)| (y - expected).abs() < 1e-15));
        let mut parts = [1.0, 0.0, 0.0, 0.0, 0.0];
        let mut sections = [section];
        let (before, after) = parts.split_at_mut(2);
        cascade(&mut sections, before);
        cascade(&mut sections, after);
        assert_eq!(parts.map(f64::to_bits), whole.map(f64::to_bits));
    }

    #[test]
    fn a_decay_ends_before_it_is_subnormal() {
        let section = Section { b: [1.0, 0.0, 0.0], a: [-0.5, 0.0], state: [0.0; 2] };
        let mut y = [0.0; 2000];
        y[0] = 1.0;
        let mut recursion = y;
        (1..2000).for_each(|n| recursion[n] = 0.5 * recursion[n - 1]);
        cascade(&mut [section], &mut y);
        assert!(y.iter().zip(recursion).all(|(y, expected)| (y - expected).abs() < 1e-100));
        assert!(y[1999] == 0.0 && !y.iter().any(|y| y.is_subnormal()));
        assert!(recursion.iter().any(|y| y.is_subnormal())); // the twin, without an end
    }

    #[test]
    fn a_cascade_is_its_sections_one_behind_the_other() {
        let mut sections: [Section; 6] = core::array::from_fn(|k| {
            let pole = 0.1 * k as f64;
            Section { b: [1.0, pole, -0.5], a: [-pole, 0.2], state: [pole, -1.0] }
        });
        let mut expected: [f64; 40] = core::array::from_fn(|n| libm::sin(0.3 * n as f64));
        let (mut y, singly) = (expected, sections);
        for section in singly {
            cascade(&mut [section], &mut expected);
        }
        cascade(&mut sections, &mut y);
        assert_eq!(y.map(f64::to_bits), expected.map(f64::to_bits));
    }
}
