//! The interface between a system and the integrators and updates, and the Gauss-Markov process of a parameter.

use nalgebra::{SMatrix, SVector};

use crate::dense::update::Reading;
use crate::error::{SetupError, StepError};
use crate::signal::interpolation::Segment;

/// How far the mean is expanded about the estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Slopes only (Bar-Shalom, Li, Kirubarajan 2001, sec. 10.3).
    First,
    /// And curvature: `1/2 tr(f_xx P)` in the mean, `1/2 tr(h_xx P h_xx P)` in `S` (Gelb 1974, sec. 6.1).
    Second,
}

/// The drift of one sensor parameter: `theta' = -rate theta + white noise of density q` (paper II-D).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussMarkov {
    /// Inverse correlation time, 1/s; zero for a constant or a random walk.
    pub rate: f64,
    /// Two-sided density of the noise, unit of the parameter squared per second.
    pub q: f64,
}

impl GaussMarkov {
    /// An unknown constant.
    pub const CONSTANT: Self = Self { rate: 0.0, q: 0.0 };

    /// The fraction of the parameter left after `h` seconds.
    #[must_use]
    pub fn decay(&self, h: f64) -> f64 {
        if self.rate == 0.0 {
            return 1.0; // equals exp(0) to the last bit, without its cost at every node
        }
        libm::exp(-self.rate * h)
    }

    /// Refuses a rate or a density that is negative or not finite.
    ///
    /// # Errors
    /// [`SetupError::Setting`].
    pub fn check(&self) -> Result<(), SetupError> {
        at_least("parameter rate", self.rate, 0.0)?;
        at_least("parameter q", self.q, 0.0)
    }

    /// The variance gathered in `h` seconds, `q (1 - exp(-2 rate h)) / (2 rate)`.
    #[must_use]
    pub fn variance(&self, h: f64) -> f64 {
        self.q * h * mean_decay(2.0 * self.rate * h)
    }
}

/// `(1 - exp(-x)) / x`, one at zero.
pub(crate) fn mean_decay(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { -libm::expm1(-x) / x }
}

/// The accelerometer output over one step: `u(s)`, `s` from `from` to `to` seconds after the segment's start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// `u(s)`, m/s^2.
    pub segment: Segment,
    /// Start of the step, s.
    pub from: f64,
    /// End of the step, s.
    pub to: f64,
    /// Between the samples of the output that the segment joins, s; zero where the output is held outside of them.
    pub length: f64,
    /// Stamps of the samples that the segment depends on, as in [`crate::signal::timeline::Piece`].
    pub nodes: [f64; 4],
}

impl Drive {
    /// A segment of which nothing is known but itself.
    #[must_use]
    pub fn held(segment: Segment, from: f64, to: f64) -> Self {
        Self { segment, from, to, length: 0.0, nodes: [f64::NAN; 4] }
    }
}

/// Time derivatives at one instant, linearised about the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates<const N: usize> {
    /// `f(x, u)`, and `+ 1/2 tr(f_xx P)` in second order.
    pub f: SVector<f64, N>,
    /// `F = df/dx`.
    pub F: SMatrix<f64, N, N>,
    /// `D Q D'`.
    pub DQDt: SMatrix<f64, N, N>,
}

/// A whole step: the mean at its end, the transition matrix and the noise gathered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transition<const N: usize> {
    /// Mean at the end.
    pub x: SVector<f64, N>,
    /// `Phi`.
    pub Phi: SMatrix<f64, N, N>,
    /// `Q_d`.
    pub Q: SMatrix<f64, N, N>,
}

/// A state-space model: dynamics and readings; [`crate::Aci`] and [`crate::Cwpa`].
pub trait System<const N: usize> {
    /// Whether the accelerometer output drives the state, rather than being a reading of it.
    const DRIVEN: bool;

    /// Checks settings and number of states.
    ///
    /// # Errors
    /// [`SetupError::Size`], [`SetupError::Setting`].
    fn check(&self) -> Result<(), SetupError>;

    /// Derivatives at `x`, `P` under output `u`.
    ///
    /// # Errors
    /// [`StepError::Domain`] where the sensor has no inverse.
    fn rates(&self, x: &SVector<f64, N>, P: &SMatrix<f64, N, N>, u: f64, order: Order) -> Result<Rates<N>, StepError>;

    /// The step without integration error.
    ///
    /// # Errors
    /// [`StepError::Domain`] where the sensor has no inverse.
    fn transition(
        &self,
        x: &SVector<f64, N>,
        P: &SMatrix<f64, N, N>,
        drive: &Drive,
        order: Order,
    ) -> Result<Transition<N>, StepError>;

    /// The predicted reading of the encoder.
    fn position(&self, x: &SVector<f64, N>) -> Reading<N>;

    /// The predicted reading of the accelerometer; `None` if its output drives the state.
    ///
    /// # Errors
    /// [`StepError::Domain`] where the sensor has no inverse.
    fn output(
        &self,
        x: &SVector<f64, N>,
        P: &SMatrix<f64, N, N>,
        order: Order,
    ) -> Result<Option<Reading<N>>, StepError>;
}

/// Refuses a setting that is not finite or falls below `least`.
pub(crate) fn at_least(name: &'static str, value: f64, least: f64) -> Result<(), SetupError> {
    if value >= least && value.is_finite() { Ok(()) } else { Err(SetupError::Setting { name, value }) }
}
