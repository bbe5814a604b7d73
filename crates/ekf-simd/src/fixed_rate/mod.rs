//! Filters fed one sample per call at a fixed rate.

pub mod filter;
pub mod step;
