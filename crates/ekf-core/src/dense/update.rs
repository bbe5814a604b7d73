//! The update by one scalar reading: `z = h(x) + noise`, first or second order, Joseph form.

use nalgebra::{RowSVector, SMatrix, SVector};

use crate::dense::belief::{Belief, symmetric_part};
use crate::error::StepError;

/// The predicted reading and its linearisation about the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading<const N: usize> {
    /// `h(x)`, and `+ 1/2 tr(h_xx P)` in second order.
    pub expected: f64,
    /// `H = dh/dx`.
    pub H: RowSVector<f64, N>,
    /// `1/2 tr(h_xx P h_xx P)`: zero in first order.
    pub curvature_variance: f64,
}

/// The innovation of one reading and its variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// `e = z - expected`, in the unit of `z`.
    pub e: f64,
    /// `S = H P H' + R + spread`, in the unit of `z` squared; positive.
    pub s: f64,
}

impl Innovation {
    /// `e` and `S`, refused if no update can be made of them.
    ///
    /// # Errors
    /// [`StepError::InnovationVariance`], [`StepError::Innovation`].
    pub fn checked(e: f64, s: f64) -> Result<Self, StepError> {
        if !(s > 0.0 && s.is_finite()) {
            return Err(StepError::InnovationVariance { s });
        }
        if !(e * e / s).is_finite() {
            return Err(StepError::Innovation { e });
        }
        Ok(Self { e, s })
    }

    /// Normalised innovation squared, `e^2 / S`: chi-square with one degree of freedom.
    #[must_use]
    pub fn nis(&self) -> f64 {
        self.e * self.e / self.s
    }

    /// `-1/2 (e^2 / S + ln(2 pi S))` (derivations 6.3).
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        -0.5 * (self.nis() + libm::log(core::f64::consts::TAU * self.s))
    }
}

/// An innovation, and the decision of the gate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GatedReading {
    /// `e` and `S`.
    pub innovation: Innovation,
    /// False if the gate rejects the reading: the belief is then the prediction.
    pub accepted: bool,
}

impl GatedReading {
    /// Accepts the innovation if `e^2 / S` is at most `gate`.
    ///
    /// # Errors
    /// [`StepError::InnovationVariance`], [`StepError::Innovation`].
    #[inline(always)]
    pub fn new(e: f64, s: f64, gate: f64) -> Result<Self, StepError> {
        let innovation = Innovation::checked(e, s)?;
        Ok(Self { innovation, accepted: innovation.nis() <= gate })
    }
}

/// The innovation of `z`, and the gain `P H' / S`.
///
/// # Errors
/// [`StepError::InnovationVariance`], [`StepError::Innovation`].
pub fn innovate<const N: usize>(
    prior: &Belief<N>,
    reading: &Reading<N>,
    R: f64,
    z: f64,
) -> Result<(Innovation, SVector<f64, N>), StepError> {
    let PHt = prior.P * reading.H.transpose();
    let s = (reading.H * PHt).to_scalar() + R + reading.curvature_variance;
    let innovation = Innovation::checked(z - reading.expected, s)?;
    Ok((innovation, PHt / s))
}

/// Updates by an innovation: x(k|k-1), P(k|k-1) become x(k|k), P(k|k).
///
/// Joseph form: `P` stays symmetric, and an error of the gain costs in second order only (Bar-Shalom, Li, Kirubarajan
/// 2001, ch. 5). In second order `spread` counts as reading noise, which keeps `P - gain S gain'`.
#[must_use]
pub fn correct<const N: usize>(
    prior: &Belief<N>,
    reading: &Reading<N>,
    R: f64,
    innovation: &Innovation,
    gain: &SVector<f64, N>,
) -> Belief<N> {
    let IKH = SMatrix::<f64, N, N>::identity() - gain * reading.H;
    let P = IKH * prior.P * IKH.transpose() + gain * gain.transpose() * (R + reading.curvature_variance);
    Belief { x: prior.x + gain * innovation.e, P: symmetric_part(&P) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, RowVector2, Vector2};

    const READING: Reading<2> = Reading { expected: 1.0, H: RowVector2::new(1.0, 0.5), curvature_variance: 0.0 };
    const R: f64 = 0.2;

    fn prior() -> Belief<2> {
        Belief { x: Vector2::new(1.0, 0.0), P: Matrix2::new(2.0, 0.3, 0.3, 1.0) }
    }

    #[test]
    fn a_log_likelihood_is_that_of_a_normal_distribution() {
        let innovation = Innovation::checked(3.0, 4.0).unwrap();
        assert!((innovation.log_likelihood() + 2.737_085_713_764_618).abs() < 1e-14); // scipy.stats.norm.logpdf(3, 0, 2)
    }

    #[test]
    fn an_update_adds_information() {
        let (innovation, gain) = innovate(&prior(), &READING, R, 1.7).unwrap();
        let posterior = correct(&prior(), &READING, R, &innovation, &gain);
        let information = prior().P.try_inverse().unwrap() + READING.H.transpose() * READING.H / R;
        assert!((posterior.P * information - Matrix2::identity()).amax() < 1e-14);
        assert!((innovation.s - (2.0 + 0.3 + 0.25 + R)).abs() < 1e-15);
    }

    #[test]
    fn a_gain_error_costs_in_second_order_only() {
        let (innovation, gain) = innovate(&prior(), &READING, R, 1.7).unwrap();
        let exact = correct(&prior(), &READING, R, &innovation, &gain).P;
        let dgain = Vector2::new(1e-4, -2e-4);
        let off = correct(&prior(), &READING, R, &innovation, &(gain + dgain)).P;
        let cost = dgain * dgain.transpose() * innovation.s;
        assert!((off - exact - cost).amax() < 1e-15); // rounding of P, cost itself is 1e-8
    }

    #[test]
    fn a_reading_without_variance_or_value_is_refused() {
        assert_eq!(
            innovate(&prior(), &READING, -10.0, 1.0).unwrap_err(),
            StepError::InnovationVariance { s: 2.0 + 0.3 + 0.25 - 10.0 }
        );
        // The square of the last one has no double, nor has its log-likelihood.
        for z in [f64::NAN, f64::INFINITY, 1e160] {
            assert!(matches!(innovate(&prior(), &READING, R, z), Err(StepError::Innovation { .. })));
        }
        assert!(innovate(&prior(), &READING, R, 1e150).unwrap().0.log_likelihood().is_finite());
    }
}
