//! What a belief and a likelihood must be after every step.

use ekf_core::Belief;
use ekf_core::dense::belief::{check_covariance, check_mean};

/// Panics unless the mean is finite and the covariance can be one.
///
/// # Panics
/// If it is none.
pub fn require_belief<const N: usize>(belief: &Belief<N>) {
    check_mean(N, |i| belief.x[i]).expect("a mean that is a number");
    check_covariance(N, |i, j| belief.P[(i, j)]).expect("a covariance");
}

/// Panics unless every number is finite.
///
/// # Panics
/// If one is not.
pub fn require_finite(what: &str, numbers: &[f64]) {
    for (index, number) in numbers.iter().enumerate() {
        assert!(number.is_finite(), "{what} {index} is {number}");
    }
}
