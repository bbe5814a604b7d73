//! Two clocks merged into one order of events. No ratio of rates is assumed; a missing sample is an absent event.

use crate::error::SetupError;
use crate::signal::channel::{Channel, Event};
use crate::signal::interpolation::{Interpolation, Segment};

/// The samples of one channel on its own clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Samples<'a> {
    /// Stamps, s, strictly rising.
    pub t: &'a [f64],
    /// Samples, as many.
    pub y: &'a [f64],
}

impl Samples<'_> {
    /// Checks number, order and finiteness.
    ///
    /// # Errors
    /// [`SetupError::Lengths`], [`SetupError::TooFew`], [`SetupError::NotFinite`], [`SetupError::NotRising`].
    pub fn check(&self, channel: Channel, needed: usize) -> Result<(), SetupError> {
        let count = self.t.len();
        if count != self.y.len() {
            return Err(SetupError::Lengths { channel, times: count, values: self.y.len() });
        }
        if count < needed {
            return Err(SetupError::TooFew { channel, count, needed });
        }
        let mut previous = f64::NEG_INFINITY;
        for (index, (&t, &y)) in self.t.iter().zip(self.y).enumerate() {
            if !(t.is_finite() && y.is_finite()) {
                return Err(SetupError::NotFinite { channel, index });
            }
            if t <= previous {
                return Err(SetupError::NotRising { channel, index, t });
            }
            previous = t;
        }
        Ok(())
    }

    fn event(&self, channel: Channel, index: usize) -> Option<Event> {
        Some(Event { t: *self.t.get(index)?, channel, value: *self.y.get(index)? })
    }

    /// The output between its samples once `passed` of them lie in the past.
    ///
    /// Outside the samples the nearest one is held.
    #[must_use]
    pub fn piece(&self, passed: usize, how: Interpolation) -> Piece {
        let last = self.t.len().min(self.y.len());
        if passed > 0 && passed < last {
            let segment = Segment::between(self.t, self.y, passed - 1, how);
            let start = self.t[passed - 1];
            let nodes = Segment::nodes(self.t, passed - 1, how);
            return Piece { segment, start, length: self.t[passed] - start, nodes };
        }
        let nearest = passed.min(last.saturating_sub(1));
        let held = self.y.get(nearest).copied().unwrap_or(0.0);
        let start = self.t.get(nearest).copied().unwrap_or(0.0);
        Piece { segment: Segment { c: [held, 0.0, 0.0, 0.0] }, start, length: 0.0, nodes: [f64::NAN; 4] }
    }
}

/// The output between two of its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Its polynomial.
    pub segment: Segment,
    /// Stamp of the sample at its start, s.
    pub start: f64,
    /// To the sample at its end, s; zero where there is none and the output is held.
    pub length: f64,
    /// Stamps since its start, s, of the sample before, at its start, at its end and the next one; not a number where the
    /// polynomial does not depend on one.
    pub nodes: [f64; 4],
}

/// The events of both channels in time order; at a tie the output comes first.
#[derive(Debug, Clone)]
pub struct Timeline<'a> {
    output: Samples<'a>,
    position: Samples<'a>,
    outputs: usize,
    positions: usize,
}

impl<'a> Timeline<'a> {
    /// Both channels from their beginning.
    #[must_use]
    pub fn new(output: Samples<'a>, position: Samples<'a>) -> Self {
        Self { output, position, outputs: 0, positions: 0 }
    }
}

impl Iterator for Timeline<'_> {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        let output = self.output.event(Channel::Output, self.outputs);
        let position = self.position.event(Channel::Position, self.positions);
        let first = match (output, position) {
            (Some(u), Some(z)) if z.t < u.t => z,
            (Some(u), _) => u,
            (None, position) => position?,
        };
        match first.channel {
            Channel::Output => self.outputs += 1,
            Channel::Position => self.positions += 1,
        }
        Some(first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_come_in_time_order_and_outputs_first_at_a_tie() {
        let output = Samples { t: &[0.0, 1.0, 2.0], y: &[10.0, 11.0, 12.0] };
        let position = Samples { t: &[-0.5, 1.0, 1.5, 9.0], y: &[0.1, 0.2, 0.3, 0.4] };
        let mut values = [0.0; 7];
        for (slot, event) in values.iter_mut().zip(Timeline::new(output, position)) {
            *slot = event.value;
        }
        assert_eq!(values.map(f64::to_bits), [0.1, 10.0, 11.0, 0.2, 0.3, 12.0, 0.4].map(f64::to_bits));
    }

    #[test]
    fn unusable_samples_are_named() {
        let check = |t: &[f64], y: &[f64]| Samples { t, y }.check(Channel::Position, 1);
        let channel = Channel::Position;
        assert_eq!(check(&[], &[]), Err(SetupError::TooFew { channel, count: 0, needed: 1 }));
        assert_eq!(check(&[0.0, 1.0], &[0.0]), Err(SetupError::Lengths { channel, times: 2, values: 1 }));
        assert_eq!(check(&[0.0, 0.0], &[0.0, 0.0]), Err(SetupError::NotRising { channel, index: 1, t: 0.0 }));
        assert_eq!(check(&[0.0, 1.0], &[0.0, f64::NAN]), Err(SetupError::NotFinite { channel, index: 1 }));
    }
}
