//! The two channels of a record, and one sample of either.

use core::fmt;

/// The instrument of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// The accelerometer.
    Output,
    /// The encoder.
    Position,
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Output => "accelerometer",
            Self::Position => "position",
        })
    }
}

/// One sample at its instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// Stamp, s.
    pub t: f64,
    /// The instrument.
    pub channel: Channel,
    /// Its reading, m/s^2 or m.
    pub value: f64,
}
