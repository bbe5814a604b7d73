//! The filters of [`crate::dense::filter`] on structured kernels, with equal choices, events, checks and errors.
//!
//! A step in place, without matrices: what a stream needs. Smoothing needs `Phi` and gains, which the
//! dense twin keeps; so does a low-pass in CWPA, the factored carrier and consider states.

use crate::dense::aci::Aci;
use crate::dense::belief::{Belief, Carrier};
use crate::dense::cwpa::Cwpa;
use crate::dense::filter::Filter;
use crate::dense::system::{Drive, System};
use crate::dense::update::GatedReading;
use crate::error::{DomainError, SetupError, StepError};
use crate::sensor::polynomial::Form;
use crate::sensor::states::Sensor;
use crate::signal::channel::{Channel, Event};
use crate::signal::interpolation::{Interpolation, Segment};
use crate::stream::engine::Engine;
use crate::structured::acceleration::{
    AccelerationModel, ForwardCubic, ForwardLinear, InverseCubic, InverseLinear, MixedPartials,
};
use crate::structured::aci::AciBlock;
use crate::structured::aci_step::StepInput;
use crate::structured::aci_ud::AciFactored;
use crate::structured::cwpa::CwpaBlock;
use crate::structured::errors_in_variables::{AciCorrected, Correction};
use crate::structured::gauss_markov::GaussMarkovSet;
use crate::structured::measurement::{OutputModel, ReadCubic, ReadInverse, ReadLinear};
use crate::structured::row::Plain;
use crate::structured::taps::{Taps, even};
use crate::structured::whitening::Score;

/// A system whose blocks carry the belief of `N` states.
pub trait Structured<const N: usize> {
    /// Mean and covariance.
    type Block: Copy + Send + Sync;

    /// Whether this filter has a structured kernel.
    fn has_kernel(&self) -> bool;

    /// The blocks of a belief.
    fn block(&self, belief: &Belief<N>) -> Self::Block;

    /// The belief of the blocks.
    fn belief_of(&self, block: &Self::Block) -> Belief<N>;

    /// One step of the output, in place.
    ///
    /// # Errors
    /// [`StepError`]; the block is then to be dropped.
    fn predict(&self, block: &mut Self::Block, drive: &Drive) -> Result<(), StepError>;

    /// Updates by one sample, unless it drives the state.
    ///
    /// # Errors
    /// [`StepError`]; the block is then to be dropped.
    fn update(&self, block: &mut Self::Block, event: &Event) -> Result<Option<GatedReading>, StepError>;
}

/// The filter on its structured kernel, if it has one: not with [`Carrier::Factored`], for which there is [`crate::OwnSensor`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InBlocks<S>(pub Filter<S>);

impl<S: System<N>, const N: usize> Engine<N> for InBlocks<S>
where
    Filter<S>: Structured<N>,
{
    type State = <Filter<S> as Structured<N>>::Block;
    type Outcome = (Event, Option<GatedReading>);

    const DRIVEN: bool = S::DRIVEN;

    fn interpolation(&self) -> Interpolation {
        self.0.interpolation
    }

    fn initial(&self, prior: &Belief<N>) -> Result<Self::State, SetupError> {
        self.0.initial(prior)?;
        self.0.consider.refused()?;
        if !self.0.has_kernel() {
            return Err(SetupError::NoKernel);
        }
        Ok(self.0.block(prior))
    }

    fn belief(&self, state: &Self::State) -> Belief<N> {
        self.0.belief_of(state)
    }

    fn event(outcome: &Self::Outcome) -> Event {
        outcome.0
    }

    fn reading(outcome: &Self::Outcome) -> Option<GatedReading> {
        outcome.1
    }

    fn step(
        &self,
        state: &Self::State,
        drive: Option<&Drive>,
        event: &Event,
    ) -> Result<(Self::State, Self::Outcome), StepError> {
        let mut block = *state;
        if let Some(drive) = drive {
            Structured::predict(&self.0, &mut block, drive)?;
        }
        let reading = Structured::update(&self.0, &mut block, event)?;
        Ok((block, (*event, reading)))
    }
}

fn drift<const M: usize>(sensor: &Sensor) -> GaussMarkovSet<Plain<f64, M>, M> {
    GaussMarkovSet::new(0.0, core::array::from_fn(|i| sensor.gauss_markov[i]))
}

/// Refuses a scale factor under which the output of the forward sensor does not rise, as the dense filter does.
fn rising<const M: usize>(theta: &Plain<f64, M>) -> Result<(), StepError> {
    let slope = 1.0 + theta.0[0];
    if slope > 0.0 { Ok(()) } else { Err(DomainError::Slope { slope }.into()) }
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
        let &Drive { segment, from, to, .. } = drive;
        let input = |s: f64| Segment::value(&segment, from + s);
        let step_input = StepInput { model: effect, order: self.order, input, dt: to - from };
        block.step(self.integrator, self.system.q, &drift(&self.system.sensor), &step_input)?;
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
        let innovation = block.innovate(tau, event.value, R);
        let reading = GatedReading::new(innovation.e, innovation.s, self.gate)?;
        if reading.accepted {
            block.correct(tau, R, &innovation);
            block.checked()?;
        }
        Ok(Some(reading))
    }
}

impl Filter<Cwpa> {
    fn cwpa_update<O: OutputModel<Plain<f64, M>>, const M: usize>(
        &self,
        block: &mut CwpaBlock<Plain<f64, M>, M>,
        sensor: &O,
        event: &Event,
    ) -> Result<Option<GatedReading>, StepError> {
        let reading = match event.channel {
            Channel::Output => {
                let innovation = block.innovate_output(sensor, self.order, event.value, self.R_output)?;
                let reading = GatedReading::new(innovation.innovation.e, innovation.innovation.s, self.gate)?;
                if reading.accepted {
                    block.correct_output(&innovation);
                }
                reading
            }
            Channel::Position => {
                let innovation = block.innovate_position(event.value, self.R_position);
                let reading = GatedReading::new(innovation.e, innovation.s, self.gate)?;
                if reading.accepted {
                    block.correct_position(self.R_position, &innovation);
                }
                reading
            }
        };
        block.checked()?;
        Ok(Some(reading))
    }
}

macro_rules! aci {
    ($N:literal, $M:literal, $inverse:ident, $forward:ident) => {
        impl Structured<$N> for Filter<Aci> {
            type Block = AciBlock<Plain<f64, $M>, $M>;

            fn has_kernel(&self) -> bool {
                self.carrier == Carrier::Dense && self.consider.is_none()
            }

            fn block(&self, belief: &Belief<$N>) -> Self::Block {
                AciBlock::new(|i| belief.x[i], |i, j| belief.P[(i, j)])
            }

            fn belief_of(&self, block: &Self::Block) -> Belief<$N> {
                Belief {
                    x: nalgebra::SVector::from_fn(|i, _| block.x(i)),
                    P: nalgebra::SMatrix::from_fn(|i, j| block.P(i, j)),
                }
            }

            fn predict(&self, block: &mut Self::Block, drive: &Drive) -> Result<(), StepError> {
                match self.system.sensor.form {
                    Form::Inverse => self.aci_step(block, $inverse, drive),
                    Form::Forward => rising(&block.theta).and_then(|()| self.aci_step(block, $forward, drive)),
                }
            }

            fn update(&self, block: &mut Self::Block, event: &Event) -> Result<Option<GatedReading>, StepError> {
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
                self.carrier == Carrier::Dense && self.consider.is_none() && self.system.low_pass.is_none()
            }

            fn block(&self, belief: &Belief<$N>) -> Self::Block {
                CwpaBlock::new(|i| belief.x[i], |i, j| belief.P[(i, j)])
            }

            fn belief_of(&self, block: &Self::Block) -> Belief<$N> {
                Belief {
                    x: nalgebra::SVector::from_fn(|i, _| block.x(i)),
                    P: nalgebra::SMatrix::from_fn(|i, j| block.P(i, j)),
                }
            }

            fn predict(&self, block: &mut Self::Block, drive: &Drive) -> Result<(), StepError> {
                block.step(self.integrator, drive.to - drive.from, self.system.q, &drift(&self.system.sensor));
                block.checked()
            }

            fn update(&self, block: &mut Self::Block, event: &Event) -> Result<Option<GatedReading>, StepError> {
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

/// ACI on factors without integration error, the output's noise in the gradient taken out: the filter of a live view.
///
/// A start from nothing may pass through scale factors under which the output of a linear forward sensor falls; it goes on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corrected {
    filter: Filter<Aci>,
    whole: Taps,
    correction: Correction,
}

/// A reading, and its score where there is one.
pub type ScoredReading = (GatedReading, Option<Score<f64>>);

/// Shares of a segment by which stamps that count as even may be off.
const EVEN: f64 = 1e-3;

impl Corrected {
    /// The filter with a correction; integrator and carrier are those of [`AciFactored`].
    #[must_use]
    pub fn new(filter: Filter<Aci>, correction: Correction) -> Self {
        Self { filter, whole: Taps::even(filter.interpolation, false), correction }
    }

    fn predict<E, const N: usize, const M: usize>(
        &self,
        state: &mut AciCorrected<f64, N, M>,
        effect: E,
        drive: &Drive,
    ) -> Result<(), StepError>
    where
        E: MixedPartials<Plain<f64, M>, M, Input = f64>,
    {
        let &Drive { segment, from, to, length, nodes } = drive;
        let Filter { system, order, interpolation, .. } = self.filter;
        let shares = nodes.map(|node| node / length);
        let near = |(share, usual): (&f64, f64)| (share - usual).abs() < EVEN || share.is_nan() && usual.is_nan();
        let whole = from <= 0.0 && to >= length && shares.iter().zip(even(interpolation, false)).all(near);
        let taps = if whole { self.whole } else { Taps::over(shares, (from / length, to / length)) };
        let input = |s: f64| Segment::value(&segment, from + s);
        let step_input = StepInput { model: effect, order, input, dt: to - from };
        state.exact(system.q, &drift(&system.sensor), &step_input, Some((&taps, length)))?;
        state.filter.checked()
    }

    fn update<const N: usize, const M: usize>(
        &self,
        state: &mut AciCorrected<f64, N, M>,
        event: &Event,
    ) -> Result<Option<ScoredReading>, StepError> {
        if event.channel == Channel::Output {
            state.passed();
            return Ok(None);
        }
        let (R, tau) = (self.filter.R_position, self.filter.system.tau);
        let (innovation, row) = state.filter.innovate_with_effects(tau, &Plain([0.0; M]), event.value, R);
        let reading = GatedReading::new(innovation.e, innovation.s, self.filter.gate)?;
        if reading.accepted {
            state.correct_with(tau, R, &row, &innovation, self.correction);
            state.filter.checked()?;
        }
        Ok(Some((reading, state.score.filter(|_| reading.accepted))))
    }
}

macro_rules! corrected {
    ($N:literal, $M:literal, $inverse:ident, $forward:ident) => {
        impl Engine<$N> for Corrected {
            type State = AciCorrected<f64, $N, $M>;
            type Outcome = (Event, Option<ScoredReading>);

            const DRIVEN: bool = true;

            fn interpolation(&self) -> Interpolation {
                self.filter.interpolation
            }

            fn initial(&self, prior: &Belief<$N>) -> Result<Self::State, SetupError> {
                self.filter.initial(prior)?;
                self.filter.consider.refused()?;
                AciFactored::factored(|i| prior.x[i], |i, j| prior.P[(i, j)]).map(AciCorrected::new)
            }

            fn belief(&self, state: &Self::State) -> Belief<$N> {
                Belief {
                    x: nalgebra::SVector::from_fn(|i, _| state.filter.x(i)),
                    P: nalgebra::SMatrix::from_fn(|i, j| state.filter.P(i, j)),
                }
            }

            fn event(outcome: &Self::Outcome) -> Event {
                outcome.0
            }

            fn reading(outcome: &Self::Outcome) -> Option<GatedReading> {
                outcome.1.map(|(reading, _)| reading)
            }

            fn score(outcome: &Self::Outcome) -> Option<Score<f64>> {
                outcome.1.and_then(|(_, score)| score)
            }

            fn step(
                &self,
                state: &Self::State,
                drive: Option<&Drive>,
                event: &Event,
            ) -> Result<(Self::State, Self::Outcome), StepError> {
                let mut next = *state;
                if let Some(drive) = drive {
                    match self.filter.system.sensor.form {
                        Form::Inverse => self.predict(&mut next, $inverse, drive)?,
                        Form::Forward => self.predict(&mut next, $forward, drive)?,
                    }
                }
                let reading = self.update(&mut next, event)?;
                Ok((next, (*event, reading)))
            }
        }
    };
}

corrected!(4, 2, InverseLinear, ForwardLinear);
corrected!(6, 4, InverseCubic, ForwardCubic);
