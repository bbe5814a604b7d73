//! What a sampled output adds to velocity and position between two encoder instants.
//!
//! Integrals of an interpolant, not samples: holding samples is a delay of half a sample, and that delay
//! alone looks like a missing effect.

use crate::signal::interpolation::{Interpolation, Segment};
use crate::signal::timeline::Samples;

/// How samples become a continuous signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditioning {
    /// The curve between samples.
    pub interpolation: Interpolation,
    /// Time constant of a known RC low-pass that is undone, s; 0 = none.
    pub tau: f64,
    /// How late the samples are, s: a sample stamped `t` shows the motion at `t - delay`.
    pub delay: f64,
    /// A spacing of samples beyond this is a hole that no interpolant may bridge, s.
    pub hole: f64,
}

/// Why a signal cannot be conditioned.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum ConditionError {
    /// Two slices that belong together differ in length.
    Length {
        /// Length that was expected.
        expected: usize,
        /// Length that was found.
        actual: usize,
    },
    /// Fewer than two samples: there is no interval to integrate over.
    TooFew {
        /// Number of samples found.
        actual: usize,
    },
    /// Times that do not rise strictly, or are not finite.
    Time {
        /// Index of the offending time.
        index: usize,
        /// The time, s.
        t: f64,
    },
    /// A sample that is not finite.
    Sample {
        /// Index of the offending sample.
        index: usize,
    },
}

impl core::fmt::Display for ConditionError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Length { expected, actual } => write!(f, "expected {expected} values, found {actual}"),
            Self::TooFew { actual } => write!(f, "at least 2 samples are needed, found {actual}"),
            Self::Time { index, t } => write!(f, "times must be finite and rise strictly; time {index} is {t} s"),
            Self::Sample { index } => write!(f, "sample {index} is not finite"),
        }
    }
}

impl core::error::Error for ConditionError {}

/// Checks that `t` is finite and rises strictly and that `u` is finite and of equal length.
///
/// # Errors
/// The first broken promise, with its index.
pub fn check_samples(t: &[f64], u: &[f64]) -> Result<(), ConditionError> {
    if t.len() != u.len() {
        return Err(ConditionError::Length { expected: t.len(), actual: u.len() });
    }
    check_times(t)?;
    match u.iter().position(|x| !x.is_finite()) {
        Some(index) => Err(ConditionError::Sample { index }),
        None => Ok(()),
    }
}

/// Checks that `t` is finite and rises strictly.
///
/// # Errors
/// [`ConditionError::Time`] at the first time that is not finite or not later than the one before.
fn check_times(t: &[f64]) -> Result<(), ConditionError> {
    for (index, &now) in t.iter().enumerate() {
        if !now.is_finite() || (index > 0 && now <= t[index - 1]) {
            return Err(ConditionError::Time { index, t: now });
        }
    }
    Ok(())
}

/// Integrates the conditioned signal between successive instants `at`.
///
/// With `a(t)` the interpolant of the samples, inverse low-pass and delay applied:
/// `first[k] = int a`, `second[k] = int (at[k] - s) a(s) ds` over `[at[k-1], at[k]]`. The inverse of the RC
/// filter, `a = u + tau du/dt`, needs no derivative here: `int a = int u + tau (u_end - u_start)`.
/// `covered[k]` is false where the interval leaves the record or crosses a hole (the integrals are then 0),
/// and for `k = 0`, which ends no interval.
///
/// # Errors
/// [`ConditionError`] when lengths differ, fewer than two samples exist, or times do not rise.
pub fn drive(
    samples: Samples<'_>,
    conditioning: Conditioning,
    at: &[f64],
    first: &mut [f64],
    second: &mut [f64],
    covered: &mut [bool],
) -> Result<(), ConditionError> {
    check_samples(samples.t, samples.y)?;
    check_times(at)?;
    for actual in [first.len(), second.len(), covered.len()] {
        if actual != at.len() {
            return Err(ConditionError::Length { expected: at.len(), actual });
        }
    }
    if samples.t.len() < 2 {
        return Err(ConditionError::TooFew { actual: samples.t.len() });
    }
    let mut cursor = Cursor::new(samples, conditioning);
    for k in 0..at.len() {
        let whole = if k == 0 { None } else { cursor.advance(at[k - 1], at[k]) };
        (first[k], second[k]) = whole.unwrap_or((0.0, 0.0));
        covered[k] = whole.is_some();
    }
    Ok(())
}

/// Iterates once over the samples while intervals advance.
struct Cursor<'a> {
    samples: Samples<'a>,
    conditioning: Conditioning,
    i: usize,
    segment: Segment,
}

impl<'a> Cursor<'a> {
    fn new(samples: Samples<'a>, conditioning: Conditioning) -> Self {
        let segment = Segment::between(samples.t, samples.y, 0, conditioning.interpolation);
        Self { samples, conditioning, i: 0, segment }
    }

    /// Both integrals over `[from, to]`, or `None` where the record does not cover it.
    fn advance(&mut self, from: f64, to: f64) -> Option<(f64, f64)> {
        let Samples { t, .. } = self.samples;
        let (start, end) = (from + self.conditioning.delay, to + self.conditioning.delay);
        let last = t.len() - 2;
        self.seek(start);
        if !(start >= t[0] && end <= t[last + 1]) {
            return None;
        }
        let (mut velocity, mut position, mut a) = (0.0, 0.0, start);
        loop {
            if t[self.i + 1] - t[self.i] > self.conditioning.hole {
                return None;
            }
            let b = end.min(t[self.i + 1]);
            let (dv, dp) = self.piece(a - t[self.i], b - t[self.i]);
            position += velocity * (b - a) + dp;
            velocity += dv;
            if b >= end || self.i == last {
                return Some((velocity, position));
            }
            a = b;
            self.enter(self.i + 1);
        }
    }

    fn piece(&self, a: f64, b: f64) -> (f64, f64) {
        let (dv, dp) = self.segment.integrals(a, b);
        let tau = self.conditioning.tau;
        if tau == 0.0 {
            return (dv, dp);
        }
        let start = self.segment.value(a);
        (dv + tau * (self.segment.value(b) - start), dp + tau * (dv - (b - a) * start))
    }

    fn seek(&mut self, time: f64) {
        let mut i = self.i;
        while i + 2 < self.samples.t.len() && self.samples.t[i + 1] <= time {
            i += 1;
        }
        if i != self.i {
            self.enter(i);
        }
    }

    fn enter(&mut self, i: usize) {
        self.i = i;
        self.segment = Segment::between(self.samples.t, self.samples.y, i, self.conditioning.interpolation);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;

    const PLAIN: Conditioning =
        Conditioning { interpolation: Interpolation::Cubic, tau: 0.0, delay: 0.0, hole: f64::INFINITY };

    /// `drive` with arrays of its own.
    #[allow(clippy::type_complexity)] // the three outputs of `drive`
    fn driven<const M: usize>(
        t: &[f64],
        u: &[f64],
        conditioning: Conditioning,
        at: [f64; M],
    ) -> Result<([f64; M], [f64; M], [bool; M]), ConditionError> {
        let (mut first, mut second, mut covered) = ([9.0; M], [9.0; M], [true; M]);
        drive(Samples { t, y: u }, conditioning, &at, &mut first, &mut second, &mut covered)?;
        Ok((first, second, covered))
    }

    /// A sine behind an RC of time constant `tau`, after its start has died away.
    fn low_passed_sine(w: f64, tau: f64, t: f64) -> f64 {
        libm::sin(w * t - libm::atan(w * tau)) / libm::sqrt(1.0 + (w * tau) * (w * tau))
    }

    /// Integral of sin(w t) over `[a, b]`, and that of `(b - t) sin(w t)`.
    fn sine_integrals(w: f64, a: f64, b: f64) -> (f64, f64) {
        let (cos_a, sin_a, sin_b) = (libm::cos(w * a), libm::sin(w * a), libm::sin(w * b));
        ((cos_a - libm::cos(w * b)) / w, (b - a) * cos_a / w - (sin_b - sin_a) / (w * w))
    }

    #[test]
    fn a_cubic_on_an_uneven_clock_is_integrated_exactly() {
        let t: [f64; 9] = core::array::from_fn(|i| 0.1 * i as f64 + 0.03 * libm::sin(3.0 * i as f64));
        let u = t.map(|x| 2.0 - 3.0 * x + 4.0 * x * x - 5.0 * x * x * x);
        let once = |x: f64| 2.0 * x - 1.5 * x * x + 4.0 / 3.0 * x.powi(3) - 1.25 * x.powi(4);
        let twice = |x: f64| x * x - 0.5 * x.powi(3) + x.powi(4) / 3.0 - 0.25 * x.powi(5);
        let at = [0.02, 0.021, 0.3, 0.31, 0.75]; // inside one segment, over many, ends on neither's grid
        let (first, second, covered) = driven(&t, &u, PLAIN, at).unwrap();
        assert_eq!(covered, [false, true, true, true, true]);
        assert_eq!((first[0], second[0]), (0.0, 0.0));
        for k in 1..5 {
            let (a, b) = (at[k - 1], at[k]);
            assert!((first[k] - (once(b) - once(a))).abs() < 1e-14); // some ten operations on numbers near 2
            assert!((second[k] - (twice(b) - twice(a) - (b - a) * once(a))).abs() < 1e-14);
        }
    }

    #[test]
    fn held_samples_are_a_staircase() {
        let hold = Conditioning { interpolation: Interpolation::Hold, ..PLAIN };
        let (first, second, _) = driven(&[0.0, 1.0, 2.0, 3.0], &[1.0, -2.0, 4.0, 8.0], hold, [0.5, 2.5]).unwrap();
        assert!((first[1] - (0.5 - 2.0 + 2.0)).abs() < 1e-15);
        // velocity 0.5 after the first half second, -1.5 after the next second
        assert!((second[1] - (0.125 + (0.5 - 1.0) + (-0.75 + 0.5))).abs() < 1e-15);
    }

    #[test]
    fn the_low_pass_of_a_sine_is_undone() {
        let (w, tau, h) = (TAU * 5.0, 1e-3, 6e-4);
        let t: [f64; 200] = core::array::from_fn(|i| i as f64 * h);
        let u = t.map(|x| low_passed_sine(w, tau, x));
        let at: [f64; 60] = core::array::from_fn(|k| 2.1e-3 + 1.37e-3 * k as f64);
        let aware = Conditioning { tau, ..PLAIN };
        let (first, second, covered) = driven(&t, &u, aware, at).unwrap();
        let (blind, _, _) = driven(&t, &u, PLAIN, at).unwrap();
        let mut worst = 0.0_f64;
        for k in 1..60 {
            assert!(covered[k]);
            let step = at[k] - at[k - 1];
            let (once, twice) = sine_integrals(w, at[k - 1], at[k]);
            // Four-point interpolation errs by 3/128 (w h)^4 = 3e-9 of the amplitude; tau du/dt by 2 tau/h of that.
            assert!((first[k] - once).abs() < 2e-8 * step);
            assert!((second[k] - twice).abs() < 2e-8 * step * step);
            worst = worst.max((blind[k] - once).abs() / step);
        }
        assert!(worst > 0.9 * w * tau); // the twin: left undone, the low-pass is a lag of w tau = 3 %
    }

    #[test]
    fn delay_moves_the_clock_of_the_samples() {
        let t: [f64; 40] = core::array::from_fn(|i| 0.01 * i as f64);
        let late = t.map(|x| x + 0.0037);
        let u = t.map(|x| libm::sin(20.0 * x));
        let at = [0.05, 0.061, 0.1, 0.2];
        let (first, second, _) = driven(&t, &u, PLAIN, at).unwrap();
        let (again, twice, _) = driven(&late, &u, Conditioning { delay: 0.0037, ..PLAIN }, at).unwrap();
        for k in 1..4 {
            assert!((first[k] - again[k]).abs() < 1e-15); // rounding of times alone
            assert!((second[k] - twice[k]).abs() < 1e-15);
        }
    }

    #[test]
    fn integrals_over_neighbours_compose() {
        let t: [f64; 30] = core::array::from_fn(|i| 0.01 * i as f64);
        let u = t.map(|x| libm::cos(31.0 * x));
        let how = Conditioning { tau: 2e-3, delay: 1e-3, ..PLAIN };
        let (whole, double, _) = driven(&t, &u, how, [0.0333, 0.1234]).unwrap();
        let (part, piece, _) = driven(&t, &u, how, [0.0333, 0.07, 0.0711, 0.1234]).unwrap();
        let (mut v, mut p) = (0.0, 0.0);
        for (k, h) in [(1, 0.07 - 0.0333), (2, 0.0011), (3, 0.1234 - 0.0711)] {
            p += h * v + piece[k];
            v += part[k];
        }
        assert!((whole[1] - v).abs() < 1e-15 && (double[1] - p).abs() < 1e-15); // two dozen operations on 1e-2
    }

    #[test]
    fn what_the_record_does_not_cover_is_said() {
        let t = [0.0, 0.1, 0.2, 0.3, 0.8, 0.9, 1.0, 1.1]; // a hole of 0.5 s
        let u = [1.0; 8];
        let careful = Conditioning { hole: 0.2, ..PLAIN };
        let at = [-0.05, 0.05, 0.15, 0.29, 0.5, 0.85, 0.95, 1.1, 1.15];
        let (first, second, covered) = driven(&t, &u, careful, at).unwrap();
        assert_eq!(covered, [false, false, true, true, false, false, true, true, false]);
        for k in 0..at.len() {
            let h = if covered[k] { at[k] - at[k - 1] } else { 0.0 };
            assert!((first[k] - h).abs() < 1e-15 && (second[k] - h * h / 2.0).abs() < 1e-15);
        }
        let (bridged, _, covered) = driven(&t, &u, PLAIN, at).unwrap();
        assert!(covered[4] && (bridged[4] - 0.21).abs() < 1e-15);
        let (_, _, covered) = driven(&t, &u, Conditioning { delay: 0.1, ..careful }, at).unwrap();
        assert_eq!(covered, [false, true, true, false, false, false, true, false, false]);
    }

    #[test]
    fn unusable_signals_are_refused_with_the_place() {
        let (t, u) = ([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.0, 1.0]);
        let at = [0.5, 1.5];
        assert_eq!(driven(&t, &u[..3], PLAIN, at), Err(ConditionError::Length { expected: 4, actual: 3 }));
        assert_eq!(driven(&t[..1], &u[..1], PLAIN, at), Err(ConditionError::TooFew { actual: 1 }));
        assert_eq!(
            driven(&[0.0, 1.0, 1.0, 2.0], &u, PLAIN, at),
            Err(ConditionError::Time { index: 2, t: 1.0 }) // equal is not rising
        );
        assert_eq!(driven(&t, &u, PLAIN, [1.5, 0.5]), Err(ConditionError::Time { index: 1, t: 0.5 }));
        assert!(
            matches!(driven(&t, &u, PLAIN, [0.5, f64::NAN]), Err(ConditionError::Time { index: 1, t }) if t.is_nan())
        );
        assert_eq!(driven(&t, &[0.0, 1.0, f64::INFINITY, 1.0], PLAIN, at), Err(ConditionError::Sample { index: 2 }));
        let (mut first, mut second, mut covered) = ([0.0; 2], [0.0; 1], [false; 2]);
        assert_eq!(
            drive(Samples { t: &t, y: &u }, PLAIN, &at, &mut first, &mut second, &mut covered),
            Err(ConditionError::Length { expected: 2, actual: 1 })
        );
    }
}
