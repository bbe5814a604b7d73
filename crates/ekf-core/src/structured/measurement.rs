//! The output read as a measurement of the acceleration and the parameters, with its Hessian as two vectors.

use crate::error::DomainError;
use crate::sensor::polynomial::{Form, Parameters};
use crate::structured::number::Number;
use crate::structured::row::{Row, row};

/// The predicted output, and its partials in `a` and the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictedOutput<V: Row> {
    /// Output at the estimate, m/s^2.
    pub expected: V::Number,
    /// Its partial in `a`.
    pub slope: V::Number,
    /// Its partials in the parameters.
    pub h: V,
    /// `d` of the Hessian `d g' + g d'`: in `a` and in the parameters.
    pub curvature: (V::Number, V),
    /// `g` likewise; `None` for the unit vector of `a`, which makes the Hessian an arrow.
    pub along: Option<(V::Number, V)>,
}

/// A sensor whose output is a reading.
pub trait OutputModel<V: Row> {
    /// The output expected at `a`.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    fn predicted(&self, theta: &V, a: V::Number) -> Result<PredictedOutput<V>, DomainError>;
}

const SCALE: usize = 0;
const BIAS: usize = 1;
const SECOND: usize = 2;
const THIRD: usize = 3;

/// The forward linear sensor (3), `K0 + (1 + k) a`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadLinear;

impl<V: Row> OutputModel<V> for ReadLinear {
    #[inline(always)]
    fn predicted(&self, theta: &V, a: V::Number) -> Result<PredictedOutput<V>, DomainError> {
        let (zero, one) = (a.like(0.0), a.like(1.0));
        let slope = one + theta.at(SCALE);
        Ok(PredictedOutput {
            expected: slope.times_plus(a, theta.at(BIAS)),
            slope,
            h: row([a, one, zero, zero]),
            curvature: (zero, row([one, zero, zero, zero])),
            along: None,
        })
    }
}

/// The forward cubic sensor (4), `K0 + (1 + k) a + K2 a^2 + K3 a^3`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadCubic;

impl<V: Row> OutputModel<V> for ReadCubic {
    #[inline(always)]
    fn predicted(&self, theta: &V, a: V::Number) -> Result<PredictedOutput<V>, DomainError> {
        let c = |x: f64| a.like(x);
        let (s, K2, K3) = (c(1.0) + theta.at(SCALE), theta.at(SECOND), theta.at(THIRD));
        let (a2, threefold) = (a * a, c(3.0) * K3);
        let curved = a.times_plus(K3, K2);
        Ok(PredictedOutput {
            expected: a.times_plus(a.times_plus(curved, s), theta.at(BIAS)),
            slope: a.times_plus(a.times_plus(threefold, c(2.0) * K2), s),
            h: row([a, c(1.0), a2, a2 * a]),
            curvature: (a.times_plus(threefold, K2), row([c(1.0), c(0.0), c(2.0) * a, c(3.0) * a2])),
            along: None,
        })
    }
}

/// The inverse sensor (5)(6), whose polynomial is solved for the output; one run at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadInverse;

impl<V: Row<Number = f64>> OutputModel<V> for ReadInverse {
    /// `r` with `G(r) = a`, `J = G'(r)`, `m = dJ/d(k, K2, K3)`: `g = dr = (1, r, -r^2, -r^3) / J`, `d = -(m + C g / 2) / J`.
    #[inline(always)]
    fn predicted(&self, theta: &V, a: f64) -> Result<PredictedOutput<V>, DomainError> {
        let at = |i: usize| if i < V::LENGTH { theta.at(i) } else { 0.0 };
        let parameters = Parameters { k: at(SCALE), K0: 0.0, K2: at(SECOND), K3: at(THIRD) };
        let (r, J, C) = Form::Inverse.solved(a, &parameters)?;
        let slope = 1.0 / J;
        let g: V = row([r * slope, 0.0, -r * r * slope, -r * r * r * slope]);
        let m: V = row([-1.0, 0.0, 2.0 * r, 3.0 * r * r]);
        let half = 0.5 * C;
        Ok(PredictedOutput {
            expected: at(BIAS) + r,
            slope,
            h: g + row([0.0, 1.0, 0.0, 0.0]),
            curvature: (-slope * half * slope, m.plus(half, g).scaled(-slope)),
            along: Some((slope, g)),
        })
    }
}
