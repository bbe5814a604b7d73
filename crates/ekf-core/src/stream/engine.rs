//! The loop over events, shared by records and streams: predict to the event, read it, gate it, sum the likelihood.

use crate::dense::belief::Belief;
use crate::dense::system::Drive;
use crate::dense::update::GatedReading;
use crate::error::{RunError, SetupError, StepError};
use crate::signal::channel::{Channel, Event};
use crate::signal::interpolation::{Interpolation, Segment};
use crate::signal::timeline::{Piece, Samples, Timeline};
use crate::structured::whitening::Score;

/// The state of a filter between two events.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track<B> {
    /// The belief after the last event, in the engine's own form.
    pub state: B,
    /// Time of the last event, s; `None` before the first, to which the prior belongs.
    pub t: Option<f64>,
    /// Events processed.
    pub events: usize,
    /// Readings rejected by the gate.
    pub rejected: usize,
    /// Sum over the accepted readings (derivations 6.3).
    pub log_likelihood: f64,
}

/// A filter of `N` states, driven event by event.
pub trait Engine<const N: usize> {
    /// Mean and covariance in the form that this engine propagates.
    type State: Copy;
    /// What is reported of one event.
    type Outcome;

    /// Whether the output drives the state.
    const DRIVEN: bool;

    /// The output between its samples.
    fn interpolation(&self) -> Interpolation;

    /// The prior in the engine's own form.
    ///
    /// # Errors
    /// [`SetupError`] if a setting, the number of states or the prior is unusable.
    fn initial(&self, prior: &Belief<N>) -> Result<Self::State, SetupError>;

    /// Mean and covariance of a state.
    fn belief(&self, state: &Self::State) -> Belief<N>;

    /// The event of an outcome.
    fn event(outcome: &Self::Outcome) -> Event;

    /// The reading of an outcome; `None` where an output drives the state.
    fn reading(outcome: &Self::Outcome) -> Option<GatedReading>;

    /// The innovation of an outcome as monitors see it; `None` of an engine that has no whitening, and before it begins.
    #[must_use]
    fn score(_outcome: &Self::Outcome) -> Option<Score<f64>> {
        None
    }

    /// Predicts over `drive`, if time has passed, and takes in the event.
    ///
    /// # Errors
    /// [`StepError`]; `state` is untouched.
    fn step(
        &self,
        state: &Self::State,
        drive: Option<&Drive>,
        event: &Event,
    ) -> Result<(Self::State, Self::Outcome), StepError>;

    /// The track at its start.
    ///
    /// # Errors
    /// [`SetupError`] if a setting, the number of states or the prior is unusable.
    fn start(&self, prior: &Belief<N>) -> Result<Track<Self::State>, SetupError> {
        let state = self.initial(prior)?;
        Ok(Track { state, t: None, events: 0, rejected: 0, log_likelihood: 0.0 })
    }

    /// Processes the next event; `piece` is the output since the event before.
    ///
    /// # Errors
    /// [`RunError::Step`] with the event, [`StepError::TimeOrder`] where it is older than the one before; `track` is untouched.
    fn process(
        &self,
        track: &Track<Self::State>,
        event: &Event,
        piece: Piece,
    ) -> Result<(Track<Self::State>, Self::Outcome), RunError> {
        let failed = |error| RunError::Step { event: track.events, t: event.t, error };
        let previous = track.t.unwrap_or(f64::NEG_INFINITY);
        if !(previous <= event.t && event.t.is_finite()) {
            return Err(failed(StepError::TimeOrder { t: event.t, previous }));
        }
        let drive = track.t.filter(|&previous| previous < event.t).map(|previous| {
            if !Self::DRIVEN {
                return Drive::held(Segment { c: [0.0; 4] }, 0.0, event.t - previous);
            }
            let Piece { segment, start, length, nodes } = piece;
            Drive { segment, from: previous - start, to: event.t - start, length, nodes }
        });
        let (state, outcome) = self.step(&track.state, drive.as_ref(), event).map_err(failed)?;
        let mut next = Track { state, t: Some(event.t), events: track.events + 1, ..*track };
        match Self::reading(&outcome) {
            Some(reading) if reading.accepted => next.log_likelihood += reading.innovation.log_likelihood(),
            Some(_) => next.rejected += 1,
            None => {}
        }
        Ok((next, outcome))
    }

    /// Runs over a whole record; `keep` receives every track and outcome in time order.
    ///
    /// # Errors
    /// [`RunError::Setup`] for an unusable filter, prior or record; [`RunError::Step`] with the event that failed.
    fn run(
        &self,
        prior: &Belief<N>,
        output: Samples<'_>,
        position: Samples<'_>,
        mut keep: impl FnMut(&Track<Self::State>, &Self::Outcome),
    ) -> Result<Track<Self::State>, RunError> {
        let mut track = self.start(prior)?;
        output.check(Channel::Output, 2)?;
        position.check(Channel::Position, 1)?;
        let mut processed = 0;
        for event in Timeline::new(output, position) {
            let piece = output.piece(processed, self.interpolation());
            let outcome;
            (track, outcome) = self.process(&track, &event, piece)?;
            keep(&track, &outcome);
            if event.channel == Channel::Output {
                processed += 1;
            }
        }
        Ok(track)
    }

    /// The outcomes of all events of a record in time order, as [`crate::smooth`] takes them.
    ///
    /// ```
    /// use ekf_core::{Aci, Belief, Engine, Filter, Form, Samples, Sensor, smooth};
    ///
    /// fn smoothed() -> std::io::Result<f64> {
    ///     let filter = Filter::new(Aci { sensor: Sensor::constant(Form::Forward), q: 1e-6, tau: 0.0 }, 1e-12, 0.0);
    ///     let prior = Belief::independent([0.0; 4], [1e-3, 0.1, 0.05, 0.5]);
    ///     let (output, position) = (Samples { t: &[0.0, 0.1], y: &[1.0, 1.0] }, Samples { t: &[0.0, 0.1], y: &[0.0, 0.005] });
    ///     let mut outcomes = filter.collect(&prior, output, position)?;
    ///     let filtered = outcomes[0].belief.sigma(1);
    ///     smooth(&filter, &prior, &mut outcomes)?;
    ///     Ok(outcomes[0].belief.sigma(1) / filtered)
    /// }
    /// assert!(smoothed().unwrap() < 0.9); // the velocity at the start is known better from both ends
    /// ```
    ///
    /// # Errors
    /// As [`Engine::run`].
    #[cfg(feature = "std")]
    fn collect(
        &self,
        prior: &Belief<N>,
        output: Samples<'_>,
        position: Samples<'_>,
    ) -> Result<Vec<Self::Outcome>, RunError>
    where
        Self::Outcome: Clone,
    {
        let mut outcomes = Vec::with_capacity(output.t.len() + position.t.len());
        self.run(prior, output, position, |_, outcome| outcomes.push(outcome.clone()))?;
        Ok(outcomes)
    }
}
