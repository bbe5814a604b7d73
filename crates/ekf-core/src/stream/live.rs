//! The filter as a stream: the steps over a record, bit for bit, each as soon as its output is known.

use crate::dense::belief::Belief;
use crate::error::{RunError, SetupError, StepError};
use crate::signal::channel::{Channel, Event};
use crate::signal::interpolation::Interpolation;
use crate::signal::timeline::Samples;
use crate::stream::engine::{Engine, Track};

/// Events that may wait for the output samples after them.
pub const CAPACITY: usize = 256;

/// Output samples that an interpolation can reach.
const REACH: usize = 4;

/// A filter fed event by event.
///
/// Held output needs no future; a line needs the next sample, a cubic the one after it (and four in all). Events wait
/// that long, so the belief lags by as many samples. A system that reads the output never waits.
///
/// Behind a gap that no interpolation bridges, or a stamp so far ahead that all that follow are
/// [`StepError::TimeOrder`], begin anew with what is known of the parameters:
///
/// ```
/// use ekf_core::{Aci, Belief, Channel, Event, Filter, Form, Live, Sensor};
///
/// let filter = Filter::new(Aci { sensor: Sensor::constant(Form::Forward), q: 1e-6, tau: 0.0 }, 1e-12, 0.0);
/// let start = Belief::independent([0.0; 4], [1e-5, 1e-2, 0.1, 1.0]); // p, v, k, K0
/// let mut live = Live::new(filter, &start)?;
/// live.push(Event { t: 0.0, channel: Channel::Output, value: 0.1 }, |_| ())?;
/// live.push(Event { t: 1e6, channel: Channel::Output, value: 0.1 }, |_| ())?; // a wrong stamp
/// assert!(live.push(Event { t: 1e-3, channel: Channel::Output, value: 0.1 }, |_| ()).is_err());
///
/// let known = live.belief();
/// let mut prior = start; // of the motion; parameters keep their mean and covariance
/// for i in 2..4 {
///     prior.x[i] = known.x[i];
///     for j in 2..4 {
///         prior.P[(i, j)] = known.P[(i, j)];
///     }
/// }
/// live = Live::new(filter, &prior)?;
/// live.push(Event { t: 1e-3, channel: Channel::Output, value: 0.1 }, |_| ())?;
/// # Ok::<(), ekf_core::RunError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Live<E: Engine<N>, const N: usize> {
    filter: E,
    track: Track<E::State>,
    last: Option<Event>,
    last_output: Option<f64>,
    t: [f64; REACH],
    u: [f64; REACH],
    /// Outputs in the window, and how many of them were processed.
    held: usize,
    processed: usize,
    queue: [Option<Event>; CAPACITY],
    waiting: usize,
}

impl<E: Engine<N>, const N: usize> Live<E, N> {
    /// A filter before its first event, to which `prior` belongs.
    ///
    /// # Errors
    /// [`SetupError`] if a setting or the prior is unusable.
    pub fn new(filter: E, prior: &Belief<N>) -> Result<Self, SetupError> {
        Ok(Self {
            track: filter.start(prior)?,
            filter,
            last: None,
            last_output: None,
            t: [0.0; REACH],
            u: [0.0; REACH],
            held: 0,
            processed: 0,
            queue: [None; CAPACITY],
            waiting: 0,
        })
    }

    /// The state of the filter after the events processed so far.
    #[must_use]
    pub fn track(&self) -> &Track<E::State> {
        &self.track
    }

    /// The belief after them.
    #[must_use]
    pub fn belief(&self) -> Belief<N> {
        self.filter.belief(&self.track.state)
    }

    /// Events received and not yet processed.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.waiting
    }

    /// Receives one event and processes all that are ready; at a tie push the output first, as in a record.
    ///
    /// # Errors
    /// [`RunError::Step`]: [`StepError::TimeOrder`] and [`StepError::Backlog`] leave the filter as it was; any other is that
    /// of the first event that failed. Events that fail are dropped: what follows is as if the record had lacked them.
    pub fn push(&mut self, event: Event, keep: impl FnMut(&E::Outcome)) -> Result<(), RunError> {
        self.admit(&event).map_err(|error| RunError::Step {
            event: self.track.events + self.waiting,
            t: event.t,
            error,
        })?;
        self.last = Some(event);
        self.queue[self.waiting] = Some(event);
        self.waiting += 1;
        if event.channel == Channel::Output {
            self.last_output = Some(event.t);
            self.extend(&event);
        }
        self.drain(false, keep)
    }

    /// Processes what still waits, as at the end of a record.
    ///
    /// # Errors
    /// [`RunError::Step`] with the first event that failed; [`SetupError::TooFew`] where readings wait for a first output.
    pub fn finish(&mut self, keep: impl FnMut(&E::Outcome)) -> Result<(), RunError> {
        if E::DRIVEN && self.held == 0 && self.waiting > 0 {
            return Err(SetupError::TooFew { channel: Channel::Output, count: 0, needed: 1 }.into());
        }
        self.drain(true, keep)
    }

    fn admit(&self, event: &Event) -> Result<(), StepError> {
        if !event.value.is_finite() {
            return Err(StepError::Innovation { e: event.value });
        }
        let previous = match (event.channel, self.last_output, self.last) {
            (Channel::Output, Some(t), _) if event.t <= t => Some(t),
            (_, _, Some(last)) if event.t < last.t => Some(last.t),
            _ if !event.t.is_finite() => Some(f64::NAN),
            _ => None,
        };
        if let Some(previous) = previous {
            return Err(StepError::TimeOrder { t: event.t, previous });
        }
        // Readings leave room for the outputs that end their waiting.
        let capacity = if event.channel == Channel::Output { CAPACITY } else { CAPACITY - REACH };
        if self.waiting >= capacity {
            return Err(StepError::Backlog { capacity });
        }
        Ok(())
    }

    /// Puts an output at the end of the window; the oldest leaves it.
    fn extend(&mut self, event: &Event) {
        if self.held == REACH {
            self.t.copy_within(1.., 0);
            self.u.copy_within(1.., 0);
            self.held -= 1;
            self.processed = self.processed.saturating_sub(1);
        }
        self.t[self.held] = event.t;
        self.u[self.held] = event.value;
        self.held += 1;
    }

    fn drain(&mut self, ended: bool, mut keep: impl FnMut(&E::Outcome)) -> Result<(), RunError> {
        let mut drained = Ok(());
        while let Some(event) = self.queue[0].filter(|_| ended || self.ready()) {
            let how = self.filter.interpolation();
            let piece = Samples { t: &self.t[..self.held], y: &self.u[..self.held] }.piece(self.processed, how);
            let step = self.filter.process(&self.track, &event, piece);
            self.queue.copy_within(1..self.waiting, 0);
            self.waiting -= 1;
            self.queue[self.waiting] = None;
            // What holds the output before it has not used this one yet.
            if event.channel == Channel::Output && (step.is_ok() || how == Interpolation::Hold) {
                self.processed += 1;
            } else if event.channel == Channel::Output {
                self.forget();
            }
            match step {
                Ok((track, outcome)) => {
                    self.track = track;
                    keep(&outcome);
                }
                Err(error) => drained = drained.and(Err(error)),
            }
        }
        drained
    }

    /// Takes the next output out of the window: no polynomial of a later step is to go through it.
    fn forget(&mut self) {
        self.t.copy_within(self.processed + 1..self.held, self.processed);
        self.u.copy_within(self.processed + 1..self.held, self.processed);
        self.held -= 1;
    }

    /// Whether the window already determines the output up to the next event, as a whole record would.
    fn ready(&self) -> bool {
        if !E::DRIVEN {
            return true;
        }
        match self.filter.interpolation() {
            Interpolation::Hold => self.held > 0,
            Interpolation::Linear => self.held > self.processed && self.held > 0,
            Interpolation::Cubic => {
                self.processed == 0 && self.held > 0 || self.held == REACH && self.processed + 1 < self.held
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::aci::Aci;
    use crate::dense::filter::Filter;
    use crate::sensor::polynomial::Form;
    use crate::sensor::states::Sensor;

    const COUNT: usize = 300;

    /// A stream of outputs and, at the same stamps, positions, of which some outputs have no acceleration.
    fn events() -> impl Iterator<Item = Event> {
        (0..COUNT).flat_map(|i| {
            let t = i as f64 * 6e-4;
            let impossible = i == 100 || (150..155).contains(&i);
            let a = 8.0 * libm::cos(200.0 * t);
            let output = if impossible { 60.0 } else { a - 1e-3 * a * a * a };
            let position = 2e-4 * (1.0 - libm::cos(200.0 * t));
            [(Channel::Output, output), (Channel::Position, position)].map(|(channel, value)| Event {
                t,
                channel,
                value,
            })
        })
    }

    #[test]
    fn readings_without_an_output_are_refused_at_the_end() {
        let filter = Filter::new(Aci { sensor: Sensor::constant(Form::Forward), q: 1e-6, tau: 0.0 }, 1e-12, 0.0);
        let mut live = Live::new(filter, &Belief::independent([0.0; 4], [1.0; 4])).unwrap();
        for t in [0.0, 1.0] {
            live.push(Event { t, channel: Channel::Position, value: 0.0 }, |_| ()).unwrap();
        }
        let error = SetupError::TooFew { channel: Channel::Output, count: 0, needed: 1 };
        assert_eq!(live.finish(|_| ()), Err(RunError::Setup(error)));
        assert_eq!((live.waiting(), live.track().t), (2, None));
    }

    #[test]
    fn behind_steps_that_failed_a_stream_is_that_without_their_events() {
        // From a K3 of -1e-3 on no acceleration gives more than 12 m/s^2.
        let aci = Aci { sensor: Sensor::constant(Form::Forward), q: 1e-6, tau: 0.0 };
        let prior = Belief::independent([0.0, 0.0, 0.0, 0.0, 0.0, -1e-3], [1e-5, 1e-2, 0.05, 0.5, 1e-3, 1e-6]);
        for interpolation in [Interpolation::Hold, Interpolation::Linear, Interpolation::Cubic] {
            let filter = Filter { interpolation, ..Filter::new(aci, 1e-12, 0.0) };
            let mut live = Live::new(filter, &prior).unwrap();
            let ([mut t, mut u, mut s, mut z], mut outputs, mut positions) = ([[0.0; COUNT]; 4], 0, 0);
            let mut keep = |event: Event| match event.channel {
                Channel::Output => (t[outputs], u[outputs], outputs) = (event.t, event.value, outputs + 1),
                Channel::Position => (s[positions], z[positions], positions) = (event.t, event.value, positions + 1),
            };
            let failures = events().filter(|&event| live.push(event, |outcome| keep(outcome.event)).is_err()).count();
            live.finish(|outcome| keep(outcome.event)).unwrap();
            assert!(failures <= 10 && outputs == COUNT - 6);
            assert_eq!(live.track().t, Some((COUNT - 1) as f64 * 6e-4));
            if interpolation != Interpolation::Linear {
                continue; // a cubic has seen them in the steps before; what is held moves a step after its event
            }
            let (output, position) =
                (Samples { t: &t[..outputs], y: &u[..outputs] }, Samples { t: &s[..positions], y: &z[..positions] });
            assert_eq!(live.track(), &filter.run(&prior, output, position, |_, _| ()).unwrap());
        }
    }
}
