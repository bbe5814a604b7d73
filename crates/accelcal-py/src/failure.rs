//! What a failed step says besides its numbers: rate, prior, and what to choose instead.

use ekf_core::{Carrier, Integrator, RunError, StepError};
use pyo3::prelude::*;

use crate::setup::{AnySystem, FilterSetup, raise};

/// The choices and numbers on which it depends whether a filter holds its covariance.
#[derive(Debug, Clone)]
pub(crate) struct Circumstances {
    integrator: Integrator,
    carrier: Carrier,
    /// Samples of the output per second, Hz, where they are known.
    rate: Option<f64>,
    /// Names and standard deviations of the prior, SI.
    prior: Vec<(String, f64)>,
}

impl Circumstances {
    /// Of a filter with a prior of `states` and the covariance `P` by rows; `columns` where effects follow `k, K0`.
    pub(crate) fn new(setup: &FilterSetup, states: usize, P: &[f64], rate: Option<f64>, columns: bool) -> Self {
        let motion: &[&str] = match &setup.system {
            AnySystem::Aci(_) => &["p", "v"],
            AnySystem::Cwpa(system) if system.low_pass.is_some() => &["p", "v", "a", "y"],
            AnySystem::Cwpa(_) => &["p", "v", "a"],
        };
        let parameters: &[&str] = if columns { &["k", "K0"] } else { &["k", "K0", "K2", "K3"] };
        let named = motion.iter().chain(parameters).map(ToString::to_string);
        let names = named.chain((1..).map(|j| format!("c_{j}")));
        let deviations = P.iter().step_by(states + 1).map(|variance| variance.sqrt());
        Self {
            integrator: setup.choices.integrator,
            carrier: setup.choices.carrier,
            rate,
            prior: names.zip(deviations).collect(),
        }
    }

    /// The same at another rate.
    pub(crate) fn at(&self, rate: Option<f64>) -> Self {
        Self { rate, ..self.clone() }
    }

    /// The error of Python; where numbers failed, in one sentence with rate, prior and next step.
    pub(crate) fn raise(&self, py: Python<'_>, error: RunError) -> PyErr {
        let sentence = match &error {
            RunError::Step { error: step, .. } => self.sentence(&error, step),
            _ => error.to_string(),
        };
        raise(py, error, sentence)
    }

    /// `text` in one sentence with rate, prior and next step if `error` is a failure of the numbers.
    pub(crate) fn sentence(&self, text: &impl ToString, error: &StepError) -> String {
        let text = text.to_string();
        if !matches!(
            error,
            StepError::Mean { .. }
                | StepError::Variance { .. }
                | StepError::Correlation { .. }
                | StepError::InnovationVariance { .. }
        ) {
            return text;
        }
        let integrator = match self.integrator {
            Integrator::Rk2 => "RK2",
            Integrator::Rk4 => "RK4",
            Integrator::Exact => "the exact integrator",
        };
        let rate = self
            .rate
            .filter(|rate| rate.is_finite())
            .map_or_else(String::new, |rate| format!(" at {} Hz", short(rate)));
        let prior: Vec<String> = self.prior.iter().map(|(name, std)| format!("{name} {}", short(*std))).collect();
        let next = match (self.integrator, self.carrier) {
            (Integrator::Rk2 | Integrator::Rk4, _) => "integrator=\"exact\", a higher rate or a narrower prior",
            (Integrator::Exact, Carrier::Dense) => "carrier=\"factored\", a narrower prior or a larger r_position",
            (Integrator::Exact, Carrier::Factored) => "a narrower prior or a larger r_position",
        };
        format!(
            "{text}; {integrator}{rate} does not hold the prior with standard deviations {} (SI): choose {next}",
            prior.join(", ")
        )
    }
}

/// Three significant digits.
fn short(x: f64) -> String {
    let rounded: f64 = format!("{x:.2e}").parse().unwrap_or(x);
    if (1e-3..1e5).contains(&rounded.abs()) || rounded == 0.0 { format!("{rounded}") } else { format!("{rounded:e}") }
}
