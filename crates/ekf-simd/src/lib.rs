#![doc = include_str!("../README.md")]
//! The structured kernels of `ekf-core` on the processor's vector unit: many runs side by side, over threads.
//!
//! The instruction set is detected once per run.
#![forbid(unsafe_code)]
#![allow(non_snake_case)] // x, P, R, S as in ekf-core
#![allow(clippy::inline_always)] // a kernel must be compiled into the run that calls it, with that run's instructions
#![allow(clippy::float_cmp)] // 0.0 and 1.0 are written down, not computed

pub mod arch;
pub mod fixed_rate;
pub mod record;
pub mod replay;

pub use arch::instruction_set::InstructionSet;
pub use record::batch::{Batch, Final, Prior, run_aci, run_cwpa};
