//! The accelerometer models (1)-(6): output from acceleration, and acceleration from output.
//!
//! One cubic `G(r) = s r + K2 r^2 + K3 r^3` carries them all; the linear models have `K2 = K3 = 0`.
//! Forward (3)(4): `output = K0 + G(a)`, `s = 1 + k`. Inverse (5)(6): `a = G(output - K0)`, `s = 1 - k`.
//! Whichever direction is not the polynomial is its exact inverse, so either form serves either system.

use nalgebra::{Matrix4, SMatrix, SVector};

use crate::error::DomainError;

/// Which direction of the sensor is the polynomial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Paper (5)(6): acceleration is a polynomial of the output. Same letters, other values than `Forward`.
    Inverse,
    /// Paper (3)(4), IEEE 1293: output is a polynomial of the acceleration.
    Forward,
}

/// The parameters of one sensor, in the sense of one [`Form`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Parameters {
    /// Scale factor error, 1.
    pub k: f64,
    /// Bias, m/s^2.
    pub K0: f64,
    /// Second-order coefficient, (m/s^2)^-1.
    pub K2: f64,
    /// Third-order coefficient, (m/s^2)^-2.
    pub K3: f64,
}

/// A value with its first and second partials in the order `(input, k, K0, K2, K3)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// Acceleration or output, m/s^2.
    pub value: f64,
    /// First partials.
    pub gradient: SVector<f64, 5>,
    /// Second partials.
    pub hessian: SMatrix<f64, 5, 5>,
}

const BIAS: usize = 2;

/// A residual beyond this share of its terms is no rounding: the iteration has not found the root.
const UNSOLVED: f64 = 1e-9;

impl Form {
    /// The true acceleration behind `output`, m/s^2; the input of the partials is `output`.
    ///
    /// # Errors
    /// [`DomainError`] if the forward cubic is not monotone from zero to `output`.
    pub fn acceleration(self, output: f64, parameters: &Parameters) -> Result<Response, DomainError> {
        let curve = self.curve(parameters);
        let y = output - parameters.K0;
        let response = match self {
            Self::Inverse => curve.value(y),
            Self::Forward => curve.solve(y)?,
        };
        Ok(response.with_bias_before())
    }

    /// Output at true acceleration `a`, m/s^2; the input of the partials is `a`.
    ///
    /// # Errors
    /// [`DomainError`] if the inverse cubic is not monotone from zero to `a`.
    pub fn output(self, a: f64, parameters: &Parameters) -> Result<Response, DomainError> {
        let curve = self.curve(parameters);
        let response = match self {
            Self::Forward => curve.value(a),
            Self::Inverse => curve.solve(a)?,
        };
        Ok(response.with_bias_after(parameters.K0))
    }

    /// The same sensor in the other form, to third order in the output, with `d(other) / d(this)`.
    ///
    /// `s' = 1/s, K2' = -K2/s^3, K3' = (2 K2^2 - s K3)/s^5` (derivations 2.3): its own inverse. Left out are the terms
    /// of fourth order, up to 2e-3 m/s^2 at 20 m/s^2 for a 0.1 %FS part. A covariance travels as `J P J'`.
    ///
    /// # Errors
    /// [`DomainError::Slope`] if `s` is not positive and finite.
    pub fn swap(self, parameters: &Parameters) -> Result<(Parameters, Matrix4<f64>), DomainError> {
        let Curve { s, K2, K3, sign } = self.curve(parameters);
        if !(s > 0.0 && s.is_finite()) {
            return Err(DomainError::Slope { slope: s });
        }
        let s2 = s * s;
        let s3 = s2 * s;
        let s5 = s3 * s2;
        let other =
            Parameters { k: parameters.k / s, K0: parameters.K0, K2: -K2 / s3, K3: (2.0 * K2 * K2 - s * K3) / s5 };
        let mut jacobian = Matrix4::identity();
        jacobian[(0, 0)] = 1.0 / s2;
        jacobian[(2, 0)] = sign * 3.0 * K2 / (s3 * s);
        jacobian[(2, 2)] = -1.0 / s3;
        jacobian[(3, 0)] = sign * (4.0 * s * K3 - 10.0 * K2 * K2) / (s5 * s);
        jacobian[(3, 2)] = 4.0 * K2 / s5;
        jacobian[(3, 3)] = -1.0 / (s2 * s2);
        Ok((other, jacobian))
    }

    /// Where the polynomial of this form takes the value `y - K0`, and its first and second derivative there.
    ///
    /// # Errors
    /// [`DomainError`] if the cubic is not monotone from zero to that value.
    pub(crate) fn solved(self, y: f64, parameters: &Parameters) -> Result<(f64, f64, f64), DomainError> {
        let curve = self.curve(parameters);
        let r = curve.root(y - parameters.K0)?;
        Ok((r, curve.slope(r), curve.curvature(r)))
    }

    fn curve(self, parameters: &Parameters) -> Curve {
        let sign = match self {
            Self::Forward => 1.0,
            Self::Inverse => -1.0,
        };
        Curve { s: 1.0 + sign * parameters.k, K2: parameters.K2, K3: parameters.K3, sign }
    }
}

/// `G(r) = s r + K2 r^2 + K3 r^3`, with `ds/dk = sign`.
#[derive(Clone, Copy)]
struct Curve {
    s: f64,
    K2: f64,
    K3: f64,
    sign: f64,
}

impl Curve {
    fn at(&self, r: f64) -> f64 {
        r * (self.s + r * (self.K2 + r * self.K3))
    }

    /// `J = G'(r)`.
    fn slope(&self, r: f64) -> f64 {
        self.s + r * (2.0 * self.K2 + r * 3.0 * self.K3)
    }

    /// `C = G''(r)`.
    fn curvature(&self, r: f64) -> f64 {
        2.0 * self.K2 + 6.0 * self.K3 * r
    }

    /// `G(r)` (derivations 4.2).
    fn value(&self, r: f64) -> Response {
        let mixed = self.mixed(r);
        let mut hessian = SMatrix::<f64, 5, 5>::zeros();
        hessian.set_row(0, &mixed.transpose());
        hessian.set_column(0, &mixed);
        hessian[(0, 0)] = self.curvature(r);
        Response {
            value: self.at(r),
            gradient: SVector::from([self.slope(r), self.sign * r, 0.0, r * r, r * r * r]),
            hessian,
        }
    }

    /// `r` with `G(r) = y`, the exact inverse (derivations 2.3).
    fn solve(&self, y: f64) -> Result<Response, DomainError> {
        let r = self.root(y)?;
        let J = self.slope(r);
        let mixed = self.mixed(r);
        let gradient = SVector::from([1.0, -self.sign * r, 0.0, -r * r, -r * r * r]) / J;
        let cross = mixed * gradient.transpose();
        let hessian = -(cross + cross.transpose() + gradient * gradient.transpose() * self.curvature(r)) / J;
        Ok(Response { value: r, gradient, hessian })
    }

    /// `d^2 G / dr dq` for `q = (input, k, K0, K2, K3)`; the first is separate, [`Self::curvature`].
    fn mixed(&self, r: f64) -> SVector<f64, 5> {
        SVector::from([0.0, self.sign, 0.0, 2.0 * r, 3.0 * r * r])
    }

    /// Newton's iteration, kept inside the bracket that each residual narrows.
    fn root(&self, y: f64) -> Result<f64, DomainError> {
        let (low, high) = self.monotone()?;
        let side = if y < 0.0 { -1.0 } else { 1.0 };
        let end = if y < 0.0 { low } else { high };
        let target = y.abs();
        let outside = || DomainError::Outside { value: y, low: self.reach(low), high: self.reach(high) };
        if !(target < self.reach(end).abs()) {
            return Err(outside());
        }
        let (mut inner, mut outer) = (0.0, end.abs());
        let mut r = target / self.s;
        if r >= outer {
            r = 0.5 * outer;
        }
        for _ in 0..60 {
            let excess = side * self.at(side * r) - target;
            if excess > 0.0 {
                outer = r;
            } else {
                inner = r;
            }
            let mut next = r - excess / self.slope(side * r);
            if !(inner <= next && next <= outer) {
                next = 0.5 * (inner + outer);
            }
            let moved = (next - r).abs();
            r = next;
            if moved <= 4.0 * f64::EPSILON * r {
                break;
            }
        }
        r *= side;
        // Coefficients that are no numbers, or so large that the terms overflow, lead nowhere.
        let terms = r.abs() * (self.s + r.abs() * (self.K2.abs() + r.abs() * self.K3.abs()));
        let solved = (self.at(r) - y).abs() <= UNSOLVED * terms && terms.is_finite();
        if !(solved && self.slope(r) > 0.0) {
            return Err(outside());
        }
        Ok(r)
    }

    /// `G` at an end of the monotone interval, which may be infinite.
    fn reach(&self, end: f64) -> f64 {
        if end.is_finite() { self.at(end) } else { end }
    }

    /// The interval around zero on which `G' > 0`.
    fn monotone(&self) -> Result<(f64, f64), DomainError> {
        if !(self.s > 0.0) {
            return Err(DomainError::Slope { slope: self.s });
        }
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for root in self.turning_points() {
            if root < 0.0 {
                low = low.max(root);
            } else if root > 0.0 {
                high = high.min(root);
            }
        }
        Ok((low, high))
    }

    /// Roots of `G'`, infinite where there are none; the form that does not cancel.
    fn turning_points(&self) -> [f64; 2] {
        let discriminant = self.K2 * self.K2 - 3.0 * self.s * self.K3;
        if discriminant < 0.0 {
            return [f64::NEG_INFINITY, f64::INFINITY];
        }
        let half = -(self.K2 + libm::sqrt(discriminant).copysign(self.K2));
        [half / (3.0 * self.K3), self.s / half]
    }
}

impl Response {
    /// The input was `input - K0`.
    fn with_bias_before(mut self) -> Self {
        self.gradient[BIAS] = -self.gradient[0];
        let row = -self.hessian.row(0);
        self.hessian.set_row(BIAS, &row);
        self.hessian.set_column(BIAS, &row.transpose());
        self.hessian[(BIAS, BIAS)] = self.hessian[(0, 0)];
        self
    }

    /// `K0` is added to the value.
    fn with_bias_after(mut self, K0: f64) -> Self {
        self.value += K0;
        self.gradient[BIAS] = 1.0;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const THETA: Parameters = Parameters { k: 0.02, K0: 0.3, K2: -4e-3, K3: 2e-4 };

    fn shifted(mut parameters: Parameters, index: usize, by: f64) -> Parameters {
        match index {
            1 => parameters.k += by,
            2 => parameters.K0 += by,
            3 => parameters.K2 += by,
            4 => parameters.K3 += by,
            _ => {}
        }
        parameters
    }

    #[test]
    fn either_form_inverts_itself() {
        for form in [Form::Inverse, Form::Forward] {
            for a in [-25.0, -3.0, 0.0, 1e-9, 7.0, 30.0] {
                let output = form.output(a, &THETA).unwrap().value;
                let back = form.acceleration(output, &THETA).unwrap().value;
                assert!((back - a).abs() < 1e-13 * 30.0); // a few roundings at full scale
            }
        }
    }

    #[test]
    fn partials_equal_central_differences() {
        for form in [Form::Inverse, Form::Forward] {
            for which in [Form::acceleration, Form::output] {
                let at = |index: usize, by: f64| {
                    let input = if index == 0 { 9.0 + by } else { 9.0 };
                    which(form, input, &shifted(THETA, index, by)).unwrap()
                };
                let centre = at(0, 0.0);
                for q in 0..5 {
                    let h = [1e-4, 1e-6, 1e-4, 1e-7, 1e-8][q];
                    let (up, down) = (at(q, h), at(q, -h));
                    let slope = (up.value - down.value) / (2.0 * h);
                    let curvature = (up.gradient - down.gradient) / (2.0 * h);
                    let scale = 1.0 + centre.gradient[q].abs();
                    assert!((slope - centre.gradient[q]).abs() < 1e-6 * scale); // truncation h^2 and rounding 1e-16/h
                    let column = centre.hessian.column(q);
                    assert!((curvature - column).amax() < 1e-6 * (1.0 + column.amax()));
                }
            }
        }
    }

    #[test]
    fn the_map_between_the_forms_is_its_own_inverse() {
        for form in [Form::Inverse, Form::Forward] {
            let other = match form {
                Form::Inverse => Form::Forward,
                Form::Forward => Form::Inverse,
            };
            let (other_form, J) = form.swap(&THETA).unwrap();
            let (back, K) = other.swap(&other_form).unwrap();
            assert!((back.k - THETA.k).abs() < 1e-16);
            assert!((back.K2 - THETA.K2).abs() < 1e-17);
            assert!((back.K3 - THETA.K3).abs() < 1e-18);
            assert!((K * J - Matrix4::identity()).amax() < 1e-14);
        }
    }

    #[test]
    fn the_map_agrees_with_the_exact_inverse_to_third_order() {
        let (inverse, _) = Form::Forward.swap(&THETA).unwrap();
        let miss = |a: f64| {
            let output = Form::Forward.output(a, &THETA).unwrap().value;
            Form::Inverse.acceleration(output, &inverse).unwrap().value - a
        };
        let ratio = miss(2.0) / miss(1.0);
        assert!((ratio - 16.0).abs() < 2.0); // the first term left out is of fourth order
    }

    #[test]
    fn a_value_beyond_the_turning_point_is_refused_with_the_range() {
        let folded = Parameters { K3: -1e-3, ..Parameters::default() };
        let turn = (1.0_f64 / 3e-3).sqrt() * 2.0 / 3.0;
        match Form::Forward.acceleration(13.0, &folded) {
            Err(DomainError::Outside { value, low, high }) => {
                assert_eq!(value.to_bits(), 13.0_f64.to_bits());
                assert!((high - turn).abs() < 1e-12 && (low + turn).abs() < 1e-12);
            }
            other => panic!("{other:?}"),
        }
        assert!(Form::Forward.acceleration(f64::NAN, &folded).is_err());
        let backwards = Parameters { k: -1.5, ..Parameters::default() };
        assert_eq!(Form::Forward.acceleration(1.0, &backwards), Err(DomainError::Slope { slope: -0.5 }));
    }
}
