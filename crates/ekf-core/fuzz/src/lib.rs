//! Fuzz targets of ekf-core, each a function of some bytes that panics where a promise is broken.
//!
//! The promises: no panic and no endless loop on any numbers; an error, or a finite mean and a covariance; a filter that
//! refuses a step is left as it was.
#![allow(non_snake_case)] // as in ekf-core

pub mod judge;
pub mod numbers;
pub mod record;
pub mod replay;
pub mod sensor;
pub mod setup;
pub mod signal;
pub mod stream;

/// A target: its name, which is that of its folder in `corpus/`, and what it does with bytes.
pub type Target = (&'static str, fn(&[u8]));

/// Every target.
pub const TARGETS: [Target; 5] = [
    ("sensor", sensor::run),
    ("signal", signal::run),
    ("stream", stream::run),
    ("record", record::run),
    ("replay", replay::run),
];
