//! The replay, Friedland's separate-bias filter run offline: one two-state filter over the encoder, columns through its gains.
//!
//! State (p, v) with `p'' = input + w`, `E w w' = q`, reading `z = p + e`, `var e = R`. The gains depend on the
//! noise and on the times alone, so any column that adds to the acceleration or to the reading can be replayed
//! afterwards; whitened innovations `y` and columns `X` obey `y = X beta + N(0, I)`.

pub mod columns;
pub mod dead_reckoning;
pub mod filter;
pub mod grid;
pub mod smoother;
#[cfg(all(test, feature = "std"))]
mod tests;

use crate::signal::integrals::{ConditionError, check_samples};

/// Intensity of the two noises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Two-sided density of the process noise on acceleration, (m/s^2)^2/Hz; half the square of a data sheet's density.
    pub q: f64,
    /// Variance of one encoder reading, m^2.
    pub R: f64,
}

/// Covariance of (p, v), stored as its three different entries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionCovariance {
    /// var p, m^2.
    pub pp: f64,
    /// cov(p, v), m^2/s.
    pub pv: f64,
    /// var v, (m/s)^2.
    pub vv: f64,
}

/// What is known of (p, v) before the first reading, and again after each break of the record.
///
/// The expected position is the first reading itself, whose innovation is therefore zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Expected velocity, m/s.
    pub v: f64,
    /// Covariance of the expectation.
    pub P: MotionCovariance,
}

/// Encoder readings and what drives the motion between them.
#[derive(Debug, Clone, Copy)]
pub struct Readings<'a> {
    /// Reading times, s, strictly rising.
    pub t: &'a [f64],
    /// Readings, m.
    pub z: &'a [f64],
    /// Integral of the input over the interval that ends at each reading, m/s.
    pub first: &'a [f64],
    /// Double integral of the input over that interval, m.
    pub second: &'a [f64],
    /// Where the chain of inputs is broken before the reading: the filter starts again there.
    pub restart: &'a [bool],
    /// Density of the process noise of that interval beyond `Noise::q`, (m/s^2)^2/Hz: what sampling or a hole hides.
    pub extra_q: &'a [f64],
    /// Variance of each reading beyond `Noise::R`, m^2; empty where all readings are alike.
    pub extra_R: &'a [f64],
}

/// Why a replay stopped.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum ReplayError {
    /// The signals themselves are unusable.
    Condition(ConditionError),
    /// A noise intensity that is not positive and finite.
    Noise {
        /// Process density as given, (m/s^2)^2/Hz.
        q: f64,
        /// Reading variance as given, m^2.
        R: f64,
    },
    /// A process noise of an interval that is negative or not finite.
    ExtraNoise {
        /// Index of the reading that ends the interval.
        index: usize,
        /// Density as given, (m/s^2)^2/Hz.
        q: f64,
    },
    /// A variance of a reading that is negative or not finite.
    ExtraVariance {
        /// Index of the reading.
        index: usize,
        /// Variance as given, m^2.
        R: f64,
    },
    /// The innovation variance stopped being positive.
    InnovationVariance {
        /// Index of the reading.
        index: usize,
        /// The variance, m^2.
        S: f64,
    },
    /// The log-likelihood is not finite: innovations or variances are too large or too small for doubles.
    LogLikelihood {
        /// The log-likelihood.
        value: f64,
    },
    /// A reading lies outside the grid that carries the columns.
    Grid {
        /// Index of the reading.
        index: usize,
        /// Its time, s.
        t: f64,
    },
}

impl core::fmt::Display for ReplayError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Condition(error) => error.fmt(f),
            Self::Noise { q, R } => write!(f, "noise must be positive and finite: q = {q}, R = {R}"),
            Self::ExtraNoise { index, q } => {
                write!(f, "process noise {q} before reading {index} is negative or not finite")
            }
            Self::ExtraVariance { index, R } => write!(f, "variance {R} of reading {index} is negative or not finite"),
            Self::InnovationVariance { index, S } => {
                write!(f, "innovation variance {S} at reading {index} is not positive")
            }
            Self::LogLikelihood { value } => {
                write!(f, "the log-likelihood is {value}: check the units of the readings and of their noise")
            }
            Self::Grid { index, t } => write!(f, "reading {index} at {t} s lies outside the grid of the columns"),
        }
    }
}

impl core::error::Error for ReplayError {}

impl From<ConditionError> for ReplayError {
    fn from(error: ConditionError) -> Self {
        Self::Condition(error)
    }
}

impl Noise {
    /// Refuses what is not positive and finite.
    pub(crate) fn check(self) -> Result<(), ReplayError> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        if positive(self.q) && positive(self.R) { Ok(()) } else { Err(ReplayError::Noise { q: self.q, R: self.R }) }
    }
}

impl Readings<'_> {
    pub(crate) fn check(&self, noise: Noise) -> Result<(), ReplayError> {
        self.check_samples()?;
        noise.check()
    }

    /// Refuses unusable readings and slices of different lengths.
    pub(crate) fn check_samples(&self) -> Result<(), ReplayError> {
        check_samples(self.t, self.z)?;
        for length in [self.first.len(), self.second.len(), self.restart.len(), self.extra_q.len()] {
            same_length(self.t.len(), length)?;
        }
        if !self.extra_R.is_empty() {
            same_length(self.t.len(), self.extra_R.len())?;
        }
        let unusable = |variances: &[f64]| variances.iter().position(|x| !(x.is_finite() && *x >= 0.0));
        if let Some(index) = unusable(self.extra_q) {
            return Err(ReplayError::ExtraNoise { index, q: self.extra_q[index] });
        }
        match unusable(self.extra_R) {
            Some(index) => Err(ReplayError::ExtraVariance { index, R: self.extra_R[index] }),
            None => Ok(()),
        }
    }

    /// Variance of reading `k` beyond that of all, m^2.
    pub(crate) fn extra_variance(&self, k: usize) -> f64 {
        self.extra_R.get(k).copied().unwrap_or(0.0)
    }

    /// True where the filter starts at `k` with the prior.
    pub(crate) fn starts(&self, k: usize) -> bool {
        k == 0 || self.restart[k]
    }
}

pub(crate) fn same_length(expected: usize, actual: usize) -> Result<(), ConditionError> {
    if expected == actual { Ok(()) } else { Err(ConditionError::Length { expected, actual }) }
}

impl MotionCovariance {
    /// `Phi P Phi' + Q_d` over `h` seconds, exact for white acceleration noise.
    #[must_use]
    pub fn predict(self, h: f64, q: f64) -> Self {
        Self {
            pp: self.pp + h * (2.0 * self.pv + h * (self.vv + h * q / 3.0)),
            pv: self.pv + h * (self.vv + h * q / 2.0),
            vv: self.vv + h * q,
        }
    }
}
