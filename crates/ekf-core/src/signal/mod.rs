//! Samples and their clocks: channels, the order of events, interpolation, integrals between readings.

pub mod channel;
pub mod integrals;
pub mod interpolation;
pub mod timeline;
