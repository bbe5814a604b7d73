//! The covariance as `P = U D U'`: Thornton's prediction and Bierman's update (Bierman 1977, ch. V and VI).

use nalgebra::{SMatrix, SVector};

use crate::dense::belief::Belief;
use crate::dense::update::{Innovation, Reading};
use crate::error::{SetupError, StepError};

/// Mean `x` and covariance `U D U'`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factored<const N: usize> {
    /// Mean.
    pub x: SVector<f64, N>,
    /// Unit upper triangular factor.
    pub U: SMatrix<f64, N, N>,
    /// Diagonal factor, non-negative.
    pub D: SVector<f64, N>,
}

/// A pivot below this fraction of its variance is rounding, and counts as zero.
const ROUNDING: f64 = 1e-14;
/// A pivot more negative than this fraction of its variance is no rounding.
const SLACK: f64 = 1e-9;

/// `U, D` with `U D U' = P` for a non-negative definite `P`.
///
/// # Errors
/// [`SetupError::Prior`] with the first pivot that is negative beyond rounding, or not finite.
pub fn factorise<const N: usize>(P: &SMatrix<f64, N, N>) -> Result<(SMatrix<f64, N, N>, SVector<f64, N>), SetupError> {
    factorise_within(P, SLACK).map_err(|(state, pivot)| SetupError::Prior { state, pivot })
}

/// As [`factorise`], where a pivot may be `slack` of its variance below zero.
///
/// # Errors
/// The index and value of the pivot.
pub(crate) fn factorise_within<const N: usize>(
    P: &SMatrix<f64, N, N>,
    slack: f64,
) -> Result<(SMatrix<f64, N, N>, SVector<f64, N>), (usize, f64)> {
    let mut U = SMatrix::<f64, N, N>::identity();
    let mut D = SVector::<f64, N>::zeros();
    for j in (0..N).rev() {
        let rest = |i: usize| -> f64 { P[(i, j)] - (j + 1..N).map(|k| D[k] * U[(i, k)] * U[(j, k)]).sum::<f64>() };
        let pivot = rest(j);
        let variance = P[(j, j)].abs();
        if !(pivot >= -slack * variance && pivot.is_finite()) {
            return Err((j, pivot));
        }
        if pivot <= ROUNDING * variance {
            continue;
        }
        let column: [f64; N] = core::array::from_fn(|i| if i < j { rest(i) / pivot } else { 0.0 });
        for i in 0..j {
            U[(i, j)] = column[i];
        }
        D[j] = pivot;
    }
    Ok((U, D))
}

impl<const N: usize> Factored<N> {
    /// The factors of a belief.
    ///
    /// # Errors
    /// [`SetupError::Prior`] with the pivot that is negative: `P` is no covariance.
    pub fn new(belief: &Belief<N>) -> Result<Self, SetupError> {
        let (U, D) = factorise(&belief.P)?;
        Ok(Self { x: belief.x, U, D })
    }

    /// The same belief with `P` multiplied out.
    #[must_use]
    pub fn belief(&self) -> Belief<N> {
        let P = self.U * SMatrix::from_diagonal(&self.D) * self.U.transpose();
        Belief { x: self.x, P: crate::dense::belief::symmetric_part(&P) }
    }

    /// `P = Phi P Phi' + Q` by modified weighted Gram-Schmidt on the rows of `[Phi U, G]`, `Q = G Dq G'`.
    ///
    /// # Errors
    /// [`StepError::Variance`] if `Q` is not non-negative definite or the result is not finite.
    pub fn predict(
        &self,
        x: SVector<f64, N>,
        Phi: &SMatrix<f64, N, N>,
        Q: &SMatrix<f64, N, N>,
    ) -> Result<Self, StepError> {
        let (mut G, Dq) =
            factorise_within(Q, SLACK).map_err(|(state, variance)| StepError::Variance { state, variance })?;
        let mut W = Phi * self.U;
        let mut U = SMatrix::<f64, N, N>::identity();
        let mut D = SVector::<f64, N>::zeros();
        for j in (0..N).rev() {
            let dot = |W: &SMatrix<f64, N, N>, G: &SMatrix<f64, N, N>, i: usize| -> f64 {
                (0..N).map(|k| W[(i, k)] * W[(j, k)] * self.D[k] + G[(i, k)] * G[(j, k)] * Dq[k]).sum()
            };
            let variance = dot(&W, &G, j);
            if !variance.is_finite() {
                return Err(StepError::Variance { state: j, variance });
            }
            D[j] = variance;
            if variance == 0.0 {
                continue;
            }
            for i in 0..j {
                let u = dot(&W, &G, i) / variance;
                U[(i, j)] = u;
                for k in 0..N {
                    W[(i, k)] -= u * W[(j, k)];
                    G[(i, k)] -= u * G[(j, k)];
                }
            }
        }
        Ok(Self { x, U, D })
    }

    /// The innovation of `z`, and the belief and gain after taking it in.
    ///
    /// # Errors
    /// [`StepError::InnovationVariance`], [`StepError::Innovation`].
    pub fn update(
        &self,
        reading: &Reading<N>,
        R: f64,
        z: f64,
    ) -> Result<(Self, Innovation, SVector<f64, N>), StepError> {
        let f = self.U.transpose() * reading.H.transpose();
        let g = self.D.component_mul(&f);
        let mut gain = SVector::<f64, N>::zeros();
        let mut next = *self;
        let mut s = R + reading.curvature_variance;
        for j in 0..N {
            let before = s;
            s += f[j] * g[j];
            if s > 0.0 {
                next.D[j] = self.D[j] * before / s;
            }
            gain[j] = g[j];
            let lambda = if before > 0.0 { f[j] / before } else { 0.0 };
            for i in 0..j {
                let u = self.U[(i, j)];
                next.U[(i, j)] = u - lambda * gain[i];
                gain[i] += u * g[j];
            }
        }
        let innovation = Innovation::checked(z - reading.expected, s)?;
        gain /= s;
        next.x = self.x + gain * innovation.e;
        Ok((next, innovation, gain))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::update::{correct, innovate};
    use nalgebra::{Matrix3, RowVector3, Vector3};

    fn prior() -> Belief<3> {
        Belief { x: Vector3::new(0.1, -2.0, 0.4), P: Matrix3::new(2.0, 0.3, -0.4, 0.3, 1.0, 0.2, -0.4, 0.2, 0.5) }
    }

    #[test]
    fn factors_multiply_back() {
        let factored = Factored::new(&prior()).unwrap();
        assert!((factored.belief().P - prior().P).amax() < 1e-15);
        let exact = Matrix3::from_diagonal(&Vector3::new(1.0, 0.0, 2.0));
        assert!(factorise(&exact).is_ok());
        assert_eq!(factorise(&-exact).unwrap_err(), SetupError::Prior { state: 2, pivot: -2.0 });
    }

    #[test]
    fn factored_prediction_and_update_equal_the_dense_ones() {
        let Phi = Matrix3::new(1.0, 0.1, 0.005, 0.0, 1.0, 0.1, 0.0, 0.0, 0.9);
        let g = Vector3::new(0.01, 0.1, 1.0);
        let Q = g * g.transpose();
        let reading = Reading { expected: 0.3, H: RowVector3::new(1.0, 0.0, -0.7), curvature_variance: 0.05 };
        let dense = Belief { x: prior().x, P: Phi * prior().P * Phi.transpose() + Q };
        let (innovation, gain) = innovate(&dense, &reading, 0.1, 1.0).unwrap();
        let dense = correct(&dense, &reading, 0.1, &innovation, &gain);

        let factored = Factored::new(&prior()).unwrap();
        let factored = factored.predict(prior().x, &Phi, &Q).unwrap();
        let (factored, same, same_gain) = factored.update(&reading, 0.1, 1.0).unwrap();

        assert!((innovation.s - same.s).abs() < 1e-14); // about fifty operations on numbers near one
        assert!((gain - same_gain).amax() < 1e-14);
        assert!((factored.belief().P - dense.P).amax() < 1e-14);
        assert!((factored.x - dense.x).amax() < 1e-14);
    }

    #[test]
    fn a_perfect_reading_of_a_known_state_is_refused() {
        let exact = Belief { x: Vector3::zeros(), P: Matrix3::zeros() };
        let reading = Reading { expected: 0.0, H: RowVector3::new(1.0, 0.0, 0.0), curvature_variance: 0.0 };
        let update = Factored::new(&exact).unwrap().update(&reading, 0.0, 1.0);
        assert_eq!(update.unwrap_err(), StepError::InnovationVariance { s: 0.0 });
    }
}
