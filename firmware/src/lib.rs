//! A tracker of position, velocity and the sensor's `k, K0, K2, K3`, and a record that every machine draws alike.
//!
//! Device and host [`run`] equal steps and compare the [`Outcome`]; no code here depends on which of them it runs on.
#![no_std]
#![deny(unsafe_code)]
#![allow(non_snake_case)] // as in ekf-core

mod outcome;
mod panic;
mod record;
mod tracker;

pub use outcome::{Outcome, run};
pub use record::Sample;
pub use tracker::Tracker;

/// The number the tracker runs on.
#[cfg(not(feature = "double"))]
pub type Number = f32;
/// The number the tracker runs on.
#[cfg(feature = "double")]
pub type Number = f64;
