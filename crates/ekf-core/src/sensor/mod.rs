//! The accelerometer: its polynomial, its parameters among the states, and how they drift.

pub mod polynomial;
pub mod states;
