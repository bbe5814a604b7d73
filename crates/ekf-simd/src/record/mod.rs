//! Uniform records: one run, several runs in lanes, many runs over threads.

pub mod batch;
pub mod block;
pub mod kernel;
pub mod likelihood;
pub mod runner;
pub mod samples;
pub mod settings;
