//! States that are considered and not estimated: the Schmidt-Kalman filter.

use nalgebra::SVector;

use crate::error::SetupError;

/// The consider states of a filter, by index: their mean never follows a reading, while their uncertainty counts in
/// every `S`, in the gains of the other states and, through Joseph's form, in the covariance (derivations 5.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Consider(u32);

impl Consider {
    /// Every state is estimated.
    pub const NONE: Self = Self(0);

    /// The states with these indices.
    ///
    /// # Errors
    /// [`SetupError::Setting`] for an index beyond 31.
    pub fn states(indices: &[usize]) -> Result<Self, SetupError> {
        let mut bits = 0;
        for &index in indices {
            if index >= u32::BITS as usize {
                return Err(SetupError::Setting { name: "consider state", value: index as f64 });
            }
            bits |= 1 << index;
        }
        Ok(Self(bits))
    }

    /// Whether every state is estimated.
    #[must_use]
    pub fn is_none(self) -> bool {
        self.0 == 0
    }

    /// Whether a state is considered and not estimated.
    #[must_use]
    pub fn contains(self, state: usize) -> bool {
        state < u32::BITS as usize && self.0 >> state & 1 == 1
    }

    /// Refuses indices that `n` states do not have.
    ///
    /// # Errors
    /// [`SetupError::Setting`].
    pub(crate) fn check(self, n: usize) -> Result<(), SetupError> {
        match (n..u32::BITS as usize).find(|&state| self.contains(state)) {
            Some(state) => Err(SetupError::Setting { name: "consider state", value: state as f64 }),
            None => Ok(()),
        }
    }

    /// Refuses consider states where the covariance is not updated in Joseph's form on whole matrices.
    ///
    /// # Errors
    /// [`SetupError::Consider`].
    pub fn refused(self) -> Result<(), SetupError> {
        if self.is_none() { Ok(()) } else { Err(SetupError::Consider { state: self.0.trailing_zeros() as usize }) }
    }

    /// The optimal gain with zero rows for the consider states, which is optimal among the gains that have them.
    #[must_use]
    pub fn gain<const N: usize>(self, optimal: &SVector<f64, N>) -> SVector<f64, N> {
        SVector::from_fn(|i, _| if self.contains(i) { 0.0 } else { optimal[i] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::belief::Belief;
    use crate::dense::update::{Reading, correct, innovate};
    use nalgebra::{Matrix2, RowVector2, Vector2};

    const B: f64 = 0.09;
    const R: f64 = 0.5;
    const BIAS: f64 = 0.2;

    /// One reading of `x + b`, `b` considered.
    fn read(prior: &Belief<2>, z: f64) -> Belief<2> {
        let H = RowVector2::new(1.0, 1.0);
        let reading = Reading { expected: (H * prior.x).to_scalar(), H, curvature_variance: 0.0 };
        let (innovation, optimal) = innovate(prior, &reading, R, z).unwrap();
        let gain = Consider::states(&[1]).unwrap().gain(&optimal);
        correct(prior, &reading, R, &innovation, &gain)
    }

    #[test]
    fn one_reading_with_a_considered_bias_is_a_scalar_filter_with_more_noise() {
        let P0 = 4.0;
        let posterior = read(&Belief { x: Vector2::new(0.0, BIAS), P: Matrix2::new(P0, 0.0, 0.0, B) }, 1.0);
        let gain = P0 / (P0 + B + R);
        assert!((posterior.x - Vector2::new(gain * (1.0 - BIAS), BIAS)).amax() < 1e-15);
        assert!((posterior.P - Matrix2::new(P0 * (1.0 - gain), -gain * B, -gain * B, B)).amax() < 1e-15);
    }

    #[test]
    fn no_number_of_readings_goes_below_the_variance_of_a_considered_bias() {
        // Derivations 5.2: from a diffuse x the first reading gives this, and n of them B + R/n.
        let z = [1.0, 1.4, 0.3, 0.9, 1.1, 0.8];
        let mut belief = Belief { x: Vector2::new(z[0] - BIAS, BIAS), P: Matrix2::new(B + R, -B, -B, B) };
        let (mut sum, mut n) = (z[0], 1.0);
        for &z in &z[1..] {
            belief = read(&belief, z);
            (sum, n) = (sum + z, n + 1.0);
            assert!((belief.x[0] - (sum / n - BIAS)).abs() < 1e-15);
            assert!((belief.P - Matrix2::new(B + R / n, -B, -B, B)).amax() < 1e-15);
            assert_eq!((belief.x[1].to_bits(), belief.P[(1, 1)].to_bits()), (BIAS.to_bits(), B.to_bits()));
        }
    }

    #[test]
    fn a_state_beyond_the_set_is_refused() {
        assert!(Consider::states(&[3, 32]).is_err());
        assert!(!Consider::NONE.contains(40));
        assert_eq!(Consider::states(&[5, 3]).unwrap().refused(), Err(SetupError::Consider { state: 3 }));
    }
}
