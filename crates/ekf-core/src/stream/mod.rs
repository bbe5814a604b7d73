//! Filters driven event by event: over a record, and on a stream.

pub mod engine;
pub mod live;
pub mod own_sensor;
