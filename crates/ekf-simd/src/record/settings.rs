//! The numbers that a kernel takes from a filter: noise, time step, choices, drift of the parameters.

use ekf_core::structured::gauss_markov::GaussMarkovSet;
use ekf_core::structured::number::Number;
use ekf_core::structured::row::Row;
use ekf_core::{Filter, GaussMarkov, Integrator, Interpolation, Order};

/// What a kernel needs of a system beside its sensor.
#[derive(Debug, Clone, Copy)]
pub struct Dynamics<'a> {
    /// Density of the output's noise (ACI) or of the jerk (CWPA).
    pub q: f64,
    /// Time constant in front of the output, s (ACI).
    pub tau: f64,
    /// How each parameter drifts; constant where none is given.
    pub gauss_markov: &'a [GaussMarkov],
}

/// The numbers of a filter in the arithmetic of its kernel.
#[derive(Debug, Clone, Copy)]
pub struct Settings<V: Row, const M: usize> {
    /// Time between samples, s.
    pub dt: f64,
    /// How the output continues between samples.
    pub interpolation: Interpolation,
    /// How a step is integrated.
    pub integrator: Integrator,
    /// First or second order.
    pub order: Order,
    /// Density of the output's noise (ACI) or of the jerk (CWPA).
    pub q: V::Number,
    /// Variance of a position reading, m^2.
    pub R_position: V::Number,
    /// Variance of an output reading, (m/s^2)^2.
    pub R_output: V::Number,
    /// Time constant in front of the output, s (ACI).
    pub tau: f64,
    /// How the parameters drift.
    pub drift: GaussMarkovSet<V, M>,
}

impl<V: Row, const M: usize> Settings<V, M> {
    /// The settings of a filter with samples `dt` apart; of `witness` only its type is used.
    pub fn of(filter: &Filter<Dynamics<'_>>, dt: f64, witness: V::Number) -> Self {
        let Filter { system, interpolation, integrator, order, R_position, R_output, .. } = *filter;
        let constant = GaussMarkov::CONSTANT;
        let drift = std::array::from_fn(|i| system.gauss_markov.get(i).copied().unwrap_or(constant));
        Self {
            dt,
            interpolation,
            integrator,
            order,
            q: witness.like(system.q),
            R_position: witness.like(R_position),
            R_output: witness.like(R_output),
            tau: system.tau,
            drift: GaussMarkovSet::new(witness, drift),
        }
    }
}
