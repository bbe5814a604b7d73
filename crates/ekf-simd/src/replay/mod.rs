//! The loops of [`ekf_core::replay`] compiled for the widest registers of the processor.

pub mod columns;
pub mod parallel;
