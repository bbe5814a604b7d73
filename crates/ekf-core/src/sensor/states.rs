//! The accelerometer inside a state vector: which states are its parameters, and how they drift.

use nalgebra::{SMatrix, SVector};

use crate::dense::system::GaussMarkov;
use crate::error::{DomainError, SetupError};
use crate::sensor::polynomial::{Form, Parameters, Response};

/// A sensor whose parameters are the last states: `k, K0` (linear) or `k, K0, K2, K3` (cubic).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Which direction is the polynomial.
    pub form: Form,
    /// How `k, K0, K2, K3` drift.
    pub gauss_markov: [GaussMarkov; 4],
}

impl Sensor {
    /// A sensor whose parameters are unknown constants.
    #[must_use]
    pub const fn constant(form: Form) -> Self {
        Self { form, gauss_markov: [GaussMarkov::CONSTANT; 4] }
    }

    pub(crate) fn check(&self, given: usize, motion: usize) -> Result<(), SetupError> {
        if given != motion + 2 && given != motion + 4 {
            return Err(SetupError::Size { given });
        }
        self.gauss_markov.iter().try_for_each(GaussMarkov::check)
    }

    /// The parameters held by the states from `first` on.
    pub(crate) fn parameters<const N: usize>(first: usize, x: &SVector<f64, N>) -> Parameters {
        let at = |j: usize| if first + j < N { x[first + j] } else { 0.0 };
        Parameters { k: at(0), K0: at(1), K2: at(2), K3: at(3) }
    }

    /// `(state, partial index in Response, process)` of every parameter.
    pub(crate) fn processes<const N: usize>(
        &self,
        first: usize,
    ) -> impl Iterator<Item = (usize, usize, GaussMarkov)> + '_ {
        (first..N).map(move |i| (i, i - first + 1, self.gauss_markov[i - first]))
    }

    /// `x` with its parameters decayed over `h` seconds.
    pub(crate) fn decayed<const N: usize>(&self, first: usize, x: &SVector<f64, N>, h: f64) -> SVector<f64, N> {
        let mut x = *x;
        for (i, _, gauss_markov) in self.processes::<N>(first) {
            x[i] *= gauss_markov.decay(h);
        }
        x
    }

    /// True acceleration from output.
    pub(crate) fn acceleration<const N: usize>(
        &self,
        first: usize,
        x: &SVector<f64, N>,
        output: f64,
    ) -> Result<Response, DomainError> {
        self.form.acceleration(output, &Self::parameters(first, x))
    }

    /// Output from true acceleration.
    pub(crate) fn output<const N: usize>(
        &self,
        first: usize,
        x: &SVector<f64, N>,
        a: f64,
    ) -> Result<Response, DomainError> {
        self.form.output(a, &Self::parameters(first, x))
    }
}

/// `1/2 tr(A P)` and `1/2 tr(A P A P)`, where `A` is a Hessian in `(input, k, K0, K2, K3)`.
///
/// `input` is the state that is the input; `None` if the input is no state.
pub(crate) fn curvature<const N: usize>(
    hessian: &SMatrix<f64, 5, 5>,
    P: &SMatrix<f64, N, N>,
    input: Option<usize>,
    first: usize,
) -> (f64, f64) {
    let mut A = *hessian;
    let mut C = SMatrix::<f64, 5, 5>::zeros();
    let state = |q: usize| match q {
        0 => input,
        q => Some(first + q - 1).filter(|&i| i < N),
    };
    for q in 0..5 {
        for r in 0..5 {
            match (state(q), state(r)) {
                (Some(i), Some(j)) => C[(q, r)] = P[(i, j)],
                _ => A[(q, r)] = 0.0,
            }
        }
    }
    let AC = A * C;
    (0.5 * AC.trace(), 0.5 * (AC * AC).trace())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curvature_has_its_published_terms() {
        // Derivations 4.2, second order of the reading f(a), for the state (a, k, K0, K2, K3).
        let (a, K2, K3) = (6.0, -2e-3, 3e-4);
        let theta = Parameters { k: 0.01, K0: 0.2, K2, K3 };
        let B = SMatrix::<f64, 5, 5>::from_fn(|i, j| 1.0 / (1.0 + (i * 3 + j * 5) as f64));
        let P = B * B.transpose();
        let hessian = Form::Forward.output(a, &theta).unwrap().hessian;
        let (curvature_mean, curvature_variance) = curvature(&hessian, &P, Some(0), 1);

        let c = 2.0 * K2 + 6.0 * K3 * a;
        let b = SVector::<f64, 5>::from([0.0, 1.0, 0.0, 2.0 * a, 3.0 * a * a]);
        let y = P * b;
        let mean = c * P[(0, 0)] / 2.0 + y[0];
        let variance =
            c * c * P[(0, 0)] * P[(0, 0)] / 2.0 + 2.0 * c * P[(0, 0)] * y[0] + y[0] * y[0] + P[(0, 0)] * b.dot(&y);
        assert!((curvature_mean / mean - 1.0).abs() < 1e-14);
        assert!((curvature_variance / variance - 1.0).abs() < 1e-14);
    }
}
