//! The belief about the state, mean and covariance, and the check that the covariance can be one.

use nalgebra::{SMatrix, SVector};

use crate::error::StepError;

/// Mean `x` and covariance `P`, in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Belief<const N: usize> {
    /// Mean.
    pub x: SVector<f64, N>,
    /// Covariance.
    pub P: SMatrix<f64, N, N>,
}

/// How the covariance is carried from step to step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carrier {
    /// `P` itself, updated in Joseph form.
    Dense,
    /// `P = U D U'`: cannot lose positive definiteness.
    Factored,
}

/// Rounding may push a correlation this far beyond one; RK2 exceeds it by far when it fails.
const SLACK: f64 = 1e-6;

impl<const N: usize> Belief<N> {
    /// Independent states with mean `x` and standard deviations `sigma`, SI.
    #[must_use]
    pub fn independent(x: [f64; N], sigma: [f64; N]) -> Self {
        Self { x: x.into(), P: SMatrix::from_diagonal(&SVector::from(sigma.map(|sigma| sigma * sigma))) }
    }

    /// The standard deviation of state `i`; not a number if its variance is negative.
    ///
    /// # Panics
    /// If there is no state `i`.
    #[must_use]
    pub fn sigma(&self, i: usize) -> f64 {
        libm::sqrt(self.P[(i, i)])
    }

    /// Returns the belief if `x` is finite and `P` still a covariance.
    ///
    /// The test is cheap and deterministic: every variance is non-negative and no two states correlate by more than one.
    /// A zero variance (a parameter known exactly) passes.
    ///
    /// # Errors
    /// [`StepError::Mean`], [`StepError::Variance`], [`StepError::Correlation`]. Runge-Kutta raises them under diffuse priors and over long
    /// steps, because it leaves out high powers of the step in `Phi P Phi'` (RK2 the third and fourth) and in `Q_d`.
    pub fn checked(self) -> Result<Self, StepError> {
        check_mean(N, |i| self.x[i])?;
        check_covariance(N, |i, j| self.P[(i, j)])?;
        Ok(self)
    }
}

/// Checks that the mean of each of the `n` states is a number.
///
/// # Errors
/// [`StepError::Mean`].
#[inline(always)]
pub fn check_mean(n: usize, x: impl Fn(usize) -> f64) -> Result<(), StepError> {
    match (0..n).find(|&state| !x(state).is_finite()) {
        Some(state) => Err(StepError::Mean { state }),
        None => Ok(()),
    }
}

/// Checks that no variance is negative and no two of the `n` states correlate by more than one; calls `P(i, j)` for `j <= i`.
///
/// # Errors
/// [`StepError::Variance`], [`StepError::Correlation`].
#[inline(always)]
pub fn check_covariance(n: usize, P: impl Fn(usize, usize) -> f64) -> Result<(), StepError> {
    for i in 0..n {
        let variance = P(i, i);
        if !(variance >= 0.0 && variance.is_finite()) {
            return Err(StepError::Variance { state: i, variance });
        }
        for j in 0..i {
            let product = variance * P(j, j);
            let squared = P(i, j) * P(i, j);
            if !(squared <= product * (1.0 + SLACK)) {
                return Err(StepError::Correlation { states: (j, i), squared: squared / product });
            }
        }
    }
    Ok(())
}

/// `(A + A') / 2`.
#[must_use]
pub(crate) fn symmetric_part<const N: usize>(A: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    A * 0.5 + A.transpose() * 0.5 // halves first: a sum could overflow
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    #[test]
    fn a_matrix_that_is_no_covariance_is_named() {
        let belief = |P| Belief { x: Vector2::zeros(), P };
        assert!(belief(Matrix2::new(0.0, 0.0, 0.0, 1.0)).checked().is_ok());
        assert_eq!(
            belief(Matrix2::new(1.0, 0.0, 0.0, -2.0)).checked(),
            Err(StepError::Variance { state: 1, variance: -2.0 })
        );
        assert_eq!(
            belief(Matrix2::new(1.0, 2.0, 2.0, 1.0)).checked(),
            Err(StepError::Correlation { states: (0, 1), squared: 4.0 })
        );
        assert!(belief(Matrix2::new(1.0, f64::NAN, f64::NAN, 1.0)).checked().is_err());
    }
}
