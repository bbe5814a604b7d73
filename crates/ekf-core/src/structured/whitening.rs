//! White scores of a filter's innovations, where the noise of its output is not that of its model.
//!
//! A filter of `p, v` takes the output's noise for white between its samples; a curve between samples correlates it, so
//! innovations are correlated and smaller or larger than `S` (derivations 6.18). A second Kalman filter with the noise of
//! the samples as states predicts each innovation from those before it; what is left is white, with a known variance.

use crate::structured::errors_in_variables::{TAPS, Taps};
use crate::structured::number::Number;

/// Error of `p`, of `v`, and the noise of each sample that still drives.
const STATES: usize = 2 + TAPS;

/// The filter of a filter's own errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Whitening<T> {
    mean: [T; STATES],
    P: [[T; STATES]; STATES],
}

/// One innovation as its monitors see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score<T> {
    /// What its predecessors do not predict: white while the model holds.
    pub left: T,
    /// Variance of that.
    pub variance: T,
    /// Slope of the log-likelihood by the first two parameters, and the variance of either.
    pub parameters: [[T; 2]; 2],
}

impl<T: Copy> Score<T> {
    /// In another arithmetic.
    pub fn map<U>(self, convert: impl Fn(T) -> U + Copy) -> Score<U> {
        let parameters = self.parameters.map(|pair| pair.map(convert));
        Score { left: convert(self.left), variance: convert(self.variance), parameters }
    }
}

impl<T: Number> Whitening<T> {
    /// From the covariance of `p` and `v` with known parameters, in the order `pp, pv, vv`, and the variance of a sample.
    #[must_use]
    pub fn new([pp, pv, vv]: [T; 3], sample: T) -> Self {
        let zero = pp.like(0.0);
        let mut P = [[zero; STATES]; STATES];
        (P[0][0], P[0][1], P[1][0], P[1][1]) = (pp, pv, pv, vv);
        for i in 2..STATES {
            P[i][i] = sample;
        }
        Self { mean: [zero; STATES], P }
    }

    /// `dt` seconds of a segment that is `length` seconds long; `slope` is `da/du`.
    #[inline(always)]
    pub fn predict(&mut self, dt: T, length: f64, taps: &Taps, slope: T) {
        let gains = taps.weights.map(|weight| {
            [slope * dt.like(weight[0] * length * length), slope * dt.like(weight[1] * length)]
        });
        let Self { mean, P } = self;
        (mean[0], mean[1]) = moved(dt, &gains, |i| mean[i]);
        for j in 0..STATES {
            (P[0][j], P[1][j]) = moved(dt, &gains, |i| P[i][j]);
        }
        for row in P {
            (row[0], row[1]) = moved(dt, &gains, |i| row[i]);
        }
    }

    /// A sample has passed: the oldest of a curve drives no more, and one of `variance` comes.
    #[inline(always)]
    pub fn shift(&mut self, variance: T) {
        let Self { mean, P } = self;
        let zero = variance.like(0.0);
        mean.copy_within(3.., 2);
        P.copy_within(3.., 2);
        for row in P.iter_mut() {
            row.copy_within(3.., 2);
            row[STATES - 1] = zero;
        }
        mean[STATES - 1] = zero;
        P[STATES - 1] = [zero; STATES];
        P[STATES - 1][STATES - 1] = variance;
    }

    /// What is left of an innovation `e` of `p + tau v`, and its variance; `gain` is what the filter with known parameters
    /// does with it.
    #[inline(always)]
    pub fn correct(&mut self, tau: T, R: T, e: T, gain: [T; 2]) -> (T, T) {
        let Self { mean, P } = self;
        let mut PH = [e.like(0.0); STATES];
        for (PH, row) in PH.iter_mut().zip(P.iter()) {
            *PH = tau.times_plus(row[1], row[0]);
        }
        let s = tau.times_plus(PH[1], PH[0]) + R;
        let left = e - tau.times_plus(mean[1], mean[0]);
        let over = e.like(1.0) / s;
        for i in 0..STATES {
            mean[i] = (PH[i] * over).times_plus(left, mean[i]);
            for j in 0..STATES {
                P[i][j] = P[i][j] - PH[i] * PH[j] * over;
            }
        }
        (mean[0], mean[1]) = (mean[0] - gain[0] * e, mean[1] - gain[1] * e);
        (left, s)
    }
}

/// `p` and `v` after `dt`, driven by what the samples have.
#[inline(always)]
fn moved<T: Number>(dt: T, gains: &[[T; 2]; TAPS], at: impl Fn(usize) -> T) -> (T, T) {
    let (mut p, mut v) = (dt.times_plus(at(1), at(0)), at(1));
    for (k, [gp, gv]) in gains.iter().enumerate() {
        (p, v) = (gp.times_plus(at(2 + k), p), gv.times_plus(at(2 + k), v));
    }
    (p, v)
}
