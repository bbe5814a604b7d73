//! The filters of [`crate::dense::filter`] on structured kernels: the same choices, events, checks and errors.
//!
//! A step in place, no matrices and no outcome of its own: what a stream needs. Smoothing needs `Phi` and gains, which the
//! dense twin keeps; so does a low-pass in CWPA and the factored carrier.

use crate::dense::aci::Aci;
use crate::dense::belief::{Belief, Carrier};
use crate::dense::cwpa::Cwpa;
use crate::dense::filter::Filter;
use crate::dense::system::{Drive, System};
use crate::dense::update::Innovation;
use crate::error::{RunError, StepError};
use crate::sensor::polynomial::Form;
use crate::sensor::states::Sensor;
use crate::signal::interpolation::Segment;
use crate::signal::timeline::{Channel, Event};
use crate::structured::acceleration::{AccelerationModel, ForwardCubic, ForwardLinear, InverseCubic, InverseLinear};
use crate::structured::aci::{AciBlock, MaskedInnovation};
use crate::structured::aci_step::StepInput;
use crate::structured::cwpa::CwpaBlock;
use crate::structured::gauss_markov::GaussMarkovSet;
use crate::structured::measurement::{OutputModel, ReadCubic, ReadInverse, ReadLinear};
use crate::structured::row::Plain;

/// What one reading brought, and whether the gate let it in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GatedReading {
    /// `e` and `S`.
    pub innovation: Innovation,
    /// False if the gate rejected it: the belief is then the prediction.
    pub accepted: bool,
}

/// A system whose blocks carry the belief of `N` states.
pub trait Structured<const N: usize> {
    /// Mean and covariance.
    type Block: Copy + Send + Sync;

    /// Whether this filter has a structured kernel.
    fn has_kernel(&self) -> bool;

    /// The blocks of a belief.
    fn block(&self, belief: &Belief<N>) -> Self::Block;

    /// The belief of the blocks.
    fn belief(&self, block: &Self::Block) -> Belief<N>;

    /// One step of the output, in place.
    ///
    /// # Errors
    /// [`StepError`]; the block is then to be dropped.
    fn predict(&self, block: &mut Self::Block, drive: &Drive) -> Result<(), StepError>;

    /// Takes one sample in, unless it drives the state.
    ///
    /// # Errors
    /// [`StepError`]; the block is then to be dropped.
    fn take(&self, block: &mut Self::Block, event: &Event) -> Result<Option<GatedReading>, StepError>;
}

/// A filter in blocks on its way; see [`crate::Track`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StructuredTrack<B> {
    /// The belief at the last event.
    pub block: B,
    /// Time of the last event, s; `None` before the first.
    pub t: Option<f64>,
    /// Events processed.
    pub events: usize,
    /// Readings rejected by the gate.
    pub rejected: usize,
    /// Sum over the accepted readings.
    pub log_likelihood: f64,
}

impl<S> Filter<S> {
    /// Processes the next event, `piece` being the output since the one before.
    ///
    /// # Errors
    /// [`RunError::Step`] with the event; `track` is untouched.
    pub fn follow_in_blocks<const N: usize>(
        &self,
        track: &StructuredTrack<<Self as Structured<N>>::Block>,
        event: &Event,
        piece: (Segment, f64),
    ) -> Result<(StructuredTrack<<Self as Structured<N>>::Block>, Option<GatedReading>), RunError>
    where
        S: System<N>,
        Self: Structured<N>,
    {
        let at_event = |error| RunError::Step { event: track.events, t: event.t, error };
        let mut next = *track;
        if let Some(previous) = track.t.filter(|&previous| previous < event.t) {
            let (segment, start) = if S::DRIVEN { piece } else { (Segment { c: [0.0; 4] }, previous) };
            let drive = Drive { segment, from: previous - start, to: event.t - start };
            Structured::predict(self, &mut next.block, &drive).map_err(at_event)?;
        }
        let taken = self.take(&mut next.block, event).map_err(at_event)?;
        if let Some(taken) = &taken {
            if taken.accepted {
                next.log_likelihood += taken.innovation.log_likelihood();
            } else {
                next.rejected += 1;
            }
        }
        next.t = Some(event.t);
        next.events += 1;
        Ok((next, taken))
    }

    /// `e` and `S` checked, and what the gate says.
    fn gated(&self, innovation: &MaskedInnovation<f64>) -> Result<GatedReading, StepError> {
        let innovation = Innovation::checked(innovation.e, innovation.s)?;
        Ok(GatedReading { innovation, accepted: innovation.nis() <= self.gate })
    }
}

fn drift<const M: usize>(sensor: &Sensor) -> GaussMarkovSet<Plain<f64, M>, M> {
    GaussMarkovSet::new(0.0, core::array::from_fn(|i| sensor.gauss_markov[i]))
}

impl Filter<Aci> {
    fn aci_step<E, const M: usize>(
        &self,
        block: &mut AciBlock<Plain<f64, M>, M>,
        effect: E,
        drive: &Drive,
    ) -> Result<(), StepError>
    where
        E: AccelerationModel<Plain<f64, M>, M, Input = f64>,
    {
        let &Drive { segment, from, to } = drive;
        let input = |s: f64| Segment::value(&segment, from + s);
        let course = StepInput { effect, order: self.order, input, dt: to - from };
        block.step(self.integrator, self.system.q, &drift(&self.system.sensor), &course)?;
        block.checked()
    }

    fn aci_update<const M: usize>(
        &self,
        block: &mut AciBlock<Plain<f64, M>, M>,
        event: &Event,
    ) -> Result<Option<GatedReading>, StepError> {
        if event.channel == Channel::Output {
            return Ok(None);
        }
        let (R, tau) = (self.R_position, self.system.tau);
        let ahead = tau != 0.0;
        let innovation = if ahead { block.innovate_ahead(tau, event.value, R) } else { block.innovate(event.value, R) };
        let taken = self.gated(&innovation)?;
        if taken.accepted {
            if ahead {
                block.correct_ahead(tau, &innovation);
            } else {
                block.correct(R, &innovation);
            }
            block.checked()?;
        }
        Ok(Some(taken))
    }
}

impl Filter<Cwpa> {
    fn cwpa_update<O: OutputModel<Plain<f64, M>>, const M: usize>(
        &self,
        block: &mut CwpaBlock<Plain<f64, M>, M>,
        sensor: &O,
        event: &Event,
    ) -> Result<Option<GatedReading>, StepError> {
        let taken = match event.channel {
            Channel::Output => {
                let innovation = block.innovate_output(sensor, self.order, event.value, self.R_output)?;
                let taken = self.gated(&innovation.innovation)?;
                if taken.accepted {
                    block.correct_output(&innovation);
                }
                taken
            }
            Channel::Position => {
                let innovation = block.innovate_position(event.value, self.R_position);
                let taken = self.gated(&innovation)?;
                if taken.accepted {
                    block.correct_position(self.R_position, &innovation);
                }
                taken
            }
        };
        block.checked()?;
        Ok(Some(taken))
    }
}

macro_rules! aci {
    ($N:literal, $M:literal, $inverse:ident, $forward:ident) => {
        impl Structured<$N> for Filter<Aci> {
            type Block = AciBlock<Plain<f64, $M>, $M>;

            fn has_kernel(&self) -> bool {
                self.carrier == Carrier::Dense
            }

            fn block(&self, belief: &Belief<$N>) -> Self::Block {
                AciBlock::new(|i| belief.x[i], |i, j| belief.P[(i, j)])
            }

            fn belief(&self, block: &Self::Block) -> Belief<$N> {
                Belief {
                    x: nalgebra::SVector::from_fn(|i, _| block.x(i)),
                    P: nalgebra::SMatrix::from_fn(|i, j| block.P(i, j)),
                }
            }

            fn predict(&self, block: &mut Self::Block, drive: &Drive) -> Result<(), StepError> {
                match self.system.sensor.form {
                    Form::Inverse => self.aci_step(block, $inverse, drive),
                    Form::Forward => self.aci_step(block, $forward, drive),
                }
            }

            fn take(&self, block: &mut Self::Block, event: &Event) -> Result<Option<GatedReading>, StepError> {
                self.aci_update(block, event)
            }
        }
    };
}

macro_rules! cwpa {
    ($N:literal, $M:literal, $forward:ident) => {
        impl Structured<$N> for Filter<Cwpa> {
            type Block = CwpaBlock<Plain<f64, $M>, $M>;

            fn has_kernel(&self) -> bool {
                self.carrier == Carrier::Dense && self.system.low_pass.is_none()
            }

            fn block(&self, belief: &Belief<$N>) -> Self::Block {
                CwpaBlock::new(|i| belief.x[i], |i, j| belief.P[(i, j)])
            }

            fn belief(&self, block: &Self::Block) -> Belief<$N> {
                Belief {
                    x: nalgebra::SVector::from_fn(|i, _| block.x(i)),
                    P: nalgebra::SMatrix::from_fn(|i, j| block.P(i, j)),
                }
            }

            fn predict(&self, block: &mut Self::Block, drive: &Drive) -> Result<(), StepError> {
                block.step(self.integrator, drive.to - drive.from, self.system.q, &drift(&self.system.sensor));
                block.checked()
            }

            fn take(&self, block: &mut Self::Block, event: &Event) -> Result<Option<GatedReading>, StepError> {
                match self.system.sensor.form {
                    Form::Inverse => self.cwpa_update(block, &ReadInverse, event),
                    Form::Forward => self.cwpa_update(block, &$forward, event),
                }
            }
        }
    };
}

aci!(4, 2, InverseLinear, ForwardLinear);
aci!(6, 4, InverseCubic, ForwardCubic);
cwpa!(5, 2, ReadLinear);
cwpa!(7, 4, ReadCubic);
