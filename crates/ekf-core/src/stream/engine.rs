//! A filter as a record and a stream drive it: one event after the other, on whatever carries its belief.

use crate::dense::belief::Belief;
use crate::dense::filter::{Filter, Outcome, Track};
use crate::dense::system::System;
use crate::error::{RunError, SetupError};
use crate::signal::interpolation::{Interpolation, Segment};
use crate::signal::timeline::{Channel, Event, Samples, Timeline};
use crate::structured::filter::{GatedReading, Structured, StructuredTrack};

/// A filter of `N` states that goes from event to event.
pub trait Engine<const N: usize> {
    /// Where the filter is, when, and what it has met.
    type Track: Copy;
    /// What one event led to.
    type Outcome;

    /// Whether the output drives the state.
    const DRIVEN: bool;

    /// The output between its samples.
    fn interpolation(&self) -> Interpolation;

    /// The track at its beginning.
    ///
    /// # Errors
    /// [`SetupError`] if a setting or the prior is unusable.
    fn begin(&self, prior: &Belief<N>) -> Result<Self::Track, SetupError>;

    /// Events that a track has behind it.
    fn events(track: &Self::Track) -> usize;

    /// Processes the next event, `piece` being the output since the one before.
    ///
    /// # Errors
    /// [`RunError::Step`] with the event; `track` is untouched.
    fn advance(
        &self,
        track: &Self::Track,
        event: &Event,
        piece: (Segment, f64),
    ) -> Result<(Self::Track, Self::Outcome), RunError>;

    /// Runs over a whole record; `keep` sees every track and outcome in time order.
    ///
    /// # Errors
    /// [`RunError::Setup`] for an unusable filter, prior or record; [`RunError::Step`] with the event that failed.
    fn over(
        &self,
        prior: &Belief<N>,
        output: Samples<'_>,
        position: Samples<'_>,
        mut keep: impl FnMut(&Self::Track, &Self::Outcome),
    ) -> Result<Self::Track, RunError> {
        let mut track = self.begin(prior)?;
        output.check(Channel::Output, 2)?;
        position.check(Channel::Position, 1)?;
        let mut taken = 0;
        for event in Timeline::new(output, position) {
            let piece = output.piece(taken, self.interpolation());
            let outcome;
            (track, outcome) = self.advance(&track, &event, piece)?;
            keep(&track, &outcome);
            if event.channel == Channel::Output {
                taken += 1;
            }
        }
        Ok(track)
    }
}

impl<S: System<N>, const N: usize> Engine<N> for Filter<S> {
    type Track = Track<N>;
    type Outcome = Outcome<N>;

    const DRIVEN: bool = S::DRIVEN;

    fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    fn begin(&self, prior: &Belief<N>) -> Result<Track<N>, SetupError> {
        self.start(prior)
    }

    fn events(track: &Track<N>) -> usize {
        track.events
    }

    fn advance(
        &self,
        track: &Track<N>,
        event: &Event,
        piece: (Segment, f64),
    ) -> Result<(Track<N>, Outcome<N>), RunError> {
        self.follow(track, event, piece)
    }
}

/// The same filter on its structured kernel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InBlocks<S>(pub Filter<S>);

impl<S: System<N>, const N: usize> Engine<N> for InBlocks<S>
where
    Filter<S>: Structured<N>,
{
    type Track = StructuredTrack<<Filter<S> as Structured<N>>::Block>;
    type Outcome = (Event, Option<GatedReading>);

    const DRIVEN: bool = S::DRIVEN;

    fn interpolation(&self) -> Interpolation {
        self.0.interpolation
    }

    fn begin(&self, prior: &Belief<N>) -> Result<Self::Track, SetupError> {
        self.0.start(prior)?;
        let block = self.0.block(prior);
        Ok(StructuredTrack { block, t: None, events: 0, rejected: 0, log_likelihood: 0.0 })
    }

    fn events(track: &Self::Track) -> usize {
        track.events
    }

    fn advance(
        &self,
        track: &Self::Track,
        event: &Event,
        piece: (Segment, f64),
    ) -> Result<(Self::Track, Self::Outcome), RunError> {
        let (track, taken) = self.0.follow_in_blocks(track, event, piece)?;
        Ok((track, (*event, taken)))
    }
}
