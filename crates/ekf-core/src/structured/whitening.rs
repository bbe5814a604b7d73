//! White scores of a filter's innovations, where the noise of its output is not that of its model.
//!
//! A filter of `p, v` takes the output's noise for white between its samples; a curve between samples correlates it, so
//! innovations are correlated and smaller or larger than `S` (derivations 6.18). A second Kalman filter with the noise of
//! the samples as states predicts each innovation from those before it; what is left is white, with a known variance.

use crate::structured::number::Number;
use crate::structured::taps::{TAPS, Taps};

/// Error of `p`, of `v`, and the noise of each sample that still drives.
pub const STATES: usize = 2 + TAPS;

/// One number for each of them.
pub type Vector<T> = [T; STATES];

/// The filter of a filter's own errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Whitening<T> {
    /// Of the errors, and what a unit of the first two parameters adds to it.
    means: [Vector<T>; 3],
    P: [Vector<T>; STATES],
    /// What the noise of the readings has in `P`.
    of_readings: [Vector<T>; STATES],
}

/// One innovation as its monitors see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score<T> {
    /// What its predecessors do not predict: white while the model holds.
    pub left: T,
    /// Variance of that.
    pub variance: T,
    /// Share of the noise of the readings in it.
    pub of_readings: T,
    /// Slopes of the log-likelihood by the first two parameters.
    pub slopes: [T; 2],
    /// Their variances, and their covariance.
    pub informations: [T; 3],
}

/// An innovation and what its filter did with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Whitened<T> {
    /// The innovation, and its slope by the first two parameters.
    pub innovation: [T; 3],
    /// Of the filter with known parameters.
    pub gain: [T; 2],
    /// What unknown parameters add to its variance.
    pub others: T,
    /// `d2a/(du dtheta)` by the first two parameters over `da/du`.
    pub slopes: [T; 2],
}

/// How an innovation was whitened.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct White<T> {
    /// Gains of the whitening.
    pub L: Vector<T>,
    /// What is left of the innovation, over its variance.
    pub scaled: T,
    /// One over that variance.
    pub over: T,
    /// Share of the output's noise in it.
    pub share: T,
}

impl<T: Copy> Score<T> {
    /// In another arithmetic.
    pub fn map<U>(self, convert: impl Fn(T) -> U + Copy) -> Score<U> {
        let Self { left, variance, of_readings, slopes, informations } = self;
        Score {
            left: convert(left),
            variance: convert(variance),
            of_readings: convert(of_readings),
            slopes: slopes.map(convert),
            informations: informations.map(convert),
        }
    }
}

impl<T: Number> Whitening<T> {
    /// From the covariance of `p` and `v` with known parameters, in the order `pp, pv, vv`, and the variance of a sample.
    #[must_use]
    pub fn new([pp, pv, vv]: [T; 3], sample: T) -> Self {
        let none = [pp.like(0.0); STATES];
        let mut P = [none; STATES];
        (P[0][0], P[0][1], P[1][0], P[1][1]) = (pp, pv, pv, vv);
        for (i, row) in P.iter_mut().enumerate().skip(2) {
            row[i] = sample;
        }
        Self { means: [none; 3], P, of_readings: [none; STATES] }
    }

    /// `dt` seconds of a segment that is `length` seconds long; `slope` is `da/du`.
    #[inline(always)]
    pub fn predict(&mut self, dt: T, length: f64, taps: &Taps, slope: T) {
        let gains = taps.gains(slope, length);
        let moved = |at: &Vector<T>| {
            let (mut p, mut v) = (dt.times_plus(at[1], at[0]), at[1]);
            for (noise, [gp, gv]) in at[2..].iter().zip(&gains) {
                (p, v) = (gp.times_plus(*noise, p), gv.times_plus(*noise, v));
            }
            [p, v]
        };
        for mean in &mut self.means {
            [mean[0], mean[1]] = moved(mean);
        }
        for covariance in [&mut self.P, &mut self.of_readings] {
            for j in 0..STATES {
                [covariance[0][j], covariance[1][j]] = moved(&covariance.map(|row| row[j]));
            }
            for row in covariance {
                [row[0], row[1]] = moved(row);
            }
        }
    }

    /// A sample has passed: the oldest of a curve drives no more, and one of `variance` comes.
    #[inline(always)]
    pub fn shift(&mut self, variance: T) {
        let zero = variance.like(0.0);
        for mean in &mut self.means {
            mean.copy_within(3.., 2);
            mean[STATES - 1] = zero;
        }
        for covariance in [&mut self.P, &mut self.of_readings] {
            covariance.copy_within(3.., 2);
            for row in covariance.iter_mut() {
                row.copy_within(3.., 2);
                row[STATES - 1] = zero;
            }
            covariance[STATES - 1] = [zero; STATES];
        }
        self.P[STATES - 1][STATES - 1] = variance;
    }

    /// Takes in the innovation of a reading of `p + tau v` with variance `R`; its score, and how it came about.
    #[inline(always)]
    pub fn correct(&mut self, tau: T, R: T, whitened: &Whitened<T>) -> (Score<T>, White<T>) {
        let Whitened { innovation, gain, others, slopes } = *whitened;
        let read = |at: &Vector<T>| tau.times_plus(at[1], at[0]);
        let (PH, WH) = (self.P.map(|row| read(&row)), self.of_readings.map(|row| read(&row)));
        let (s, noise) = (read(&PH) + R, read(&WH) + R);
        let over = R.like(1.0) / s;
        let L = PH.map(|x| x * over);
        let mut left = innovation;
        for (mean, left) in self.means.iter_mut().zip(&mut left) {
            let e = *left;
            *left = e - read(mean);
            for (mean, L) in mean.iter_mut().zip(L) {
                *mean = L.times_plus(*left, *mean);
            }
            (mean[0], mean[1]) = (mean[0] - gain[0] * e, mean[1] - gain[1] * e);
        }
        for i in 0..STATES {
            for j in 0..STATES {
                self.P[i][j] = self.P[i][j] - L[i] * PH[j];
                let both = L[i] * L[j] * noise;
                self.of_readings[i][j] = self.of_readings[i][j] - (L[i] * WH[j] + WH[i] * L[j]) + both;
            }
        }
        let variance = s + others;
        let share = (s - noise) / variance;
        // The output's noise is in the slopes and in what is left: its mean is taken out, its variance counted.
        let [left, first, second] = left;
        let slope = |h: T, of_noise: T| h.times_plus(left / variance, share * of_noise);
        let both = |h: T, g: T, of_noise: T| h.times_plus(g / variance, share * of_noise);
        let score = Score {
            left,
            variance,
            of_readings: noise / variance,
            slopes: [slope(first, slopes[0]), slope(second, slopes[1])],
            informations: [
                both(first, first, slopes[0] * slopes[0]),
                both(second, second, slopes[1] * slopes[1]),
                both(first, second, slopes[0] * slopes[1]),
            ],
        };
        (score, White { L, scaled: left / variance, over: R.like(1.0) / variance, share })
    }
}
