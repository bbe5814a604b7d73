//! The two-state filter over several parts of a record, compiled for the widest registers of this processor.
//!
//! The operations are those of the plain loops, in their order and none of them fused, so the bits are the same.

use ekf_core::replay::parallel::{self, InterleavedReading};
use ekf_core::replay::{Noise, Prior, Readings, ReplayError};
use pulp::{Arch, NullaryFnOnce};

/// Sum over the parts of their log-likelihoods: [`parallel::log_likelihood`].
///
/// # Errors
/// Those of the plain loop.
pub fn log_likelihood<const N: usize>(
    readings: &[InterleavedReading<N>],
    noise: Noise,
    prior: Prior,
) -> Result<f64, ReplayError> {
    Arch::new().dispatch(Score { readings, noise, prior })
}

struct Score<'a, const N: usize> {
    readings: &'a [InterleavedReading<N>],
    noise: Noise,
    prior: Prior,
}

impl<const N: usize> NullaryFnOnce for Score<'_, N> {
    type Output = Result<f64, ReplayError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        parallel::log_likelihood(self.readings, self.noise, self.prior)
    }
}

/// Innovations of every part, m, one row of `rows` behind the other: [`parallel::innovations`].
///
/// # Errors
/// Those of the plain loop, and when readings are unusable or lengths differ.
pub fn innovations<const N: usize>(
    parts: [(Readings<'_>, &[bool]); N],
    noise: Noise,
    prior: Prior,
    rows: &mut [f64],
) -> Result<(), ReplayError> {
    Arch::new().dispatch(Innovations { parts, noise, prior, rows })
}

struct Innovations<'a, const N: usize> {
    parts: [(Readings<'a>, &'a [bool]); N],
    noise: Noise,
    prior: Prior,
    rows: &'a mut [f64],
}

impl<const N: usize> NullaryFnOnce for Innovations<'_, N> {
    type Output = Result<(), ReplayError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { parts, noise, prior, rows } = self;
        let n = parts[0].0.t.len();
        let mut k = 0;
        parallel::innovations(
            parallel::interleave(parts)?,
            noise,
            prior,
            #[inline(always)]
            |e| {
                for (j, value) in e.into_iter().enumerate() {
                    rows[j * n + k] = value;
                }
                k += 1;
            },
        )
    }
}
