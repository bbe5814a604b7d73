//! The readable filters on whole matrices: systems, integrators, update, Joseph and UD form, smoother.

pub mod aci;
pub mod belief;
pub mod consider;
pub mod cwpa;
pub mod filter;
pub mod integrate;
pub mod smoother;
pub mod system;
pub mod ud;
pub mod update;
