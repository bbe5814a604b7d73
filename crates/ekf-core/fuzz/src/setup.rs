//! Filters and priors from bytes: every choice that a filter has.

use arbitrary::{Result, Unstructured};
use ekf_core::{
    Aci, Belief, Carrier, Consider, Cwpa, Filter, Form, GaussMarkov, Integrator, Interpolation, LowPass, Order, Sensor,
};
use nalgebra::{SMatrix, SVector};

use crate::numbers::{any, size};

/// A system for a filter.
pub trait Drawn: Sized {
    /// Standard deviations that a prior of it may have: motion first, then k, K0, K2, K3.
    const SIGMA: [f64; 8];

    /// Draws one for a number of states.
    ///
    /// # Errors
    /// If no bytes are left.
    fn draw(u: &mut Unstructured<'_>, states: usize) -> Result<Self>;
}

impl Drawn for Aci {
    const SIGMA: [f64; 8] = [1e-4, 1e-2, 1e-2, 0.1, 1e-3, 1e-4, 0.0, 0.0];

    fn draw(u: &mut Unstructured<'_>, _: usize) -> Result<Self> {
        Ok(Self { sensor: sensor(u)?, q: size(u, 1e-6)?, tau: if u.arbitrary()? { size(u, 1e-3)? } else { 0.0 } })
    }
}

impl Drawn for Cwpa {
    const SIGMA: [f64; 8] = [1e-4, 1e-2, 1.0, 1e-2, 0.1, 1e-3, 1e-4, 1e-4];

    fn draw(u: &mut Unstructured<'_>, states: usize) -> Result<Self> {
        let low_pass =
            if states.is_multiple_of(2) { Some(LowPass { tau: size(u, 1e-3)?, q: size(u, 1e-6)? }) } else { None };
        Ok(Self { sensor: sensor(u)?, q: size(u, 10.0)?, low_pass })
    }
}

fn sensor(u: &mut Unstructured<'_>) -> Result<Sensor> {
    let form = *u.choose(&[Form::Inverse, Form::Forward])?;
    let mut gauss_markov = [GaussMarkov::CONSTANT; 4];
    for (process, sigma) in gauss_markov.iter_mut().zip([1e-2, 0.1, 1e-3, 1e-4]) {
        if u.ratio(1, 3)? {
            *process = GaussMarkov { rate: size(u, 1.0)?, q: size(u, sigma * sigma)? };
        }
    }
    Ok(Sensor { form, gauss_markov })
}

/// A filter with drawn settings.
///
/// # Errors
/// If no bytes are left.
pub fn filter<S: Drawn>(u: &mut Unstructured<'_>, states: usize) -> Result<Filter<S>> {
    let considered = if u.ratio(1, 8)? { vec![u.int_in_range(0..=40)?] } else { vec![] };
    Ok(Filter {
        system: S::draw(u, states)?,
        interpolation: *u.choose(&[Interpolation::Hold, Interpolation::Linear, Interpolation::Cubic])?,
        integrator: *u.choose(&[Integrator::Rk2, Integrator::Rk4, Integrator::Exact])?,
        order: *u.choose(&[Order::First, Order::Second])?,
        carrier: *u.choose(&[Carrier::Dense, Carrier::Dense, Carrier::Factored])?,
        consider: Consider::states(&considered).unwrap_or(Consider::NONE),
        R_position: size(u, 1e-12)?,
        R_output: size(u, 1e-4)?,
        gate: if u.arbitrary()? { f64::INFINITY } else { size(u, 9.0)? },
    })
}

/// A prior around the standard deviations of a system, correlated or not, sometimes no covariance at all.
///
/// # Errors
/// If no bytes are left.
pub fn prior<const N: usize>(u: &mut Unstructured<'_>, scale: &[f64; 8]) -> Result<Belief<N>> {
    let mut sigma = [0.0; N];
    for (i, process) in sigma.iter_mut().enumerate() {
        *process = size(u, scale[i])?;
    }
    let correlated = u.ratio(1, 3)?;
    let mut B = SMatrix::<f64, N, N>::identity();
    for i in 0..N {
        for j in 0..i {
            if correlated {
                B[(i, j)] = any(u, 0.2)?;
            }
        }
    }
    let C = B * B.transpose();
    let mut P = SMatrix::<f64, N, N>::from_fn(|i, j| C[(i, j)] * sigma[i] * sigma[j]);
    for i in 0..N {
        for j in 0..i {
            P[(j, i)] = P[(i, j)];
        }
    }
    if u.ratio(1, 32)? {
        P[(u.int_in_range(0..=N - 1)?, u.int_in_range(0..=N - 1)?)] = any(u, 1.0)?;
    }
    let mut x = SVector::<f64, N>::zeros();
    for i in 0..N {
        x[i] = any(u, scale[i])?;
    }
    Ok(Belief { x, P })
}
