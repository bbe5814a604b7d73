//! The fast kernels: the equations of [`crate::dense`] on blocks of the covariance, generic over number and row type.

pub mod acceleration;
pub mod aci;
pub mod aci_exact;
pub mod aci_step;
pub mod aci_ud;
pub mod cwpa;
pub mod errors_in_variables;
pub mod filter;
pub mod gauss_markov;
pub mod measurement;
pub mod number;
pub mod row;
pub mod taps;
pub mod watch;
pub mod whitening;
