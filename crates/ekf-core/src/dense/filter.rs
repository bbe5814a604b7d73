//! The dense filter: a system and the five choices, from one event to the next.

use nalgebra::{RowSVector, SMatrix, SVector};

use crate::dense::belief::{Belief, Carrier};
use crate::dense::consider::Consider;
use crate::dense::system::{Drive, Order, System, at_least};
use crate::dense::ud::Factored;
use crate::dense::update::{GatedReading, correct, innovate};
use crate::error::{SetupError, StepError};
use crate::integration::Integrator;
use crate::signal::channel::{Channel, Event};
use crate::signal::interpolation::Interpolation;
use crate::stream::engine::Engine;

/// A system with its sensor form, and the other four choices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filter<S> {
    /// [`crate::Aci`] or [`crate::Cwpa`].
    pub system: S,
    /// The output between its samples; without effect unless the output drives the state.
    pub interpolation: Interpolation,
    /// How a step is integrated.
    pub integrator: Integrator,
    /// First or second order.
    pub order: Order,
    /// How the covariance is carried.
    pub carrier: Carrier,
    /// States that are considered and not estimated; Joseph's form only.
    pub consider: Consider,
    /// Variance of a position reading, m^2.
    pub R_position: f64,
    /// Variance of an accelerometer reading, (m/s^2)^2; without effect if the output drives the state.
    pub R_output: f64,
    /// Readings with `e^2 / S` above this are rejected and reported; infinite for none.
    pub gate: f64,
}

/// The belief in the form of its carrier.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CarriedBelief<const N: usize> {
    /// `P`.
    Dense(Belief<N>),
    /// `U D U'`.
    Factored(Factored<N>),
}

impl<const N: usize> CarriedBelief<N> {
    /// Mean and covariance.
    #[must_use]
    pub fn belief(&self) -> Belief<N> {
        match self {
            Self::Dense(belief) => *belief,
            Self::Factored(factored) => factored.belief(),
        }
    }
}

/// How one reading changed the belief.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction<const N: usize> {
    /// `e`, `S`, and the decision of the gate.
    pub reading: GatedReading,
    /// `H`.
    pub H: RowSVector<f64, N>,
    /// `P H' / S`, zero for consider states.
    pub gain: SVector<f64, N>,
    /// Variance of the reading's noise, and in second order of its curvature.
    pub R: f64,
}

/// What one event led to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome<const N: usize> {
    /// The event.
    pub event: Event,
    /// The belief after it.
    pub belief: Belief<N>,
    /// The step from the event before; `None` where it has the same time.
    pub drive: Option<Drive>,
    /// Its transition.
    pub Phi: SMatrix<f64, N, N>,
    /// The reading; `None` where an output drives the state.
    pub correction: Option<Correction<N>>,
}

impl<S> Filter<S> {
    /// A filter with the usual choices: a line between outputs, exact steps, first order, whole matrices, no gate.
    ///
    /// `R_position` and `R_output` are the variances of a reading, m^2 and (m/s^2)^2. Other choices are fields:
    /// `Filter { order: Order::Second, ..Filter::new(aci, 1e-12, 0.0) }`.
    #[must_use]
    pub const fn new(system: S, R_position: f64, R_output: f64) -> Self {
        Self {
            system,
            interpolation: Interpolation::Linear,
            integrator: Integrator::Exact,
            order: Order::First,
            carrier: Carrier::Dense,
            consider: Consider::NONE,
            R_position,
            R_output,
            gate: f64::INFINITY,
        }
    }

    /// Refuses variances of readings and a gate that no filter can use; [`System::check`] does so for the system.
    ///
    /// # Errors
    /// [`SetupError::Setting`].
    pub fn check(&self) -> Result<(), SetupError> {
        checked_readings(self.R_position, self.R_output, self.gate)
    }

    /// This filter with another system.
    #[must_use]
    pub fn with_system<T>(self, system: T) -> Filter<T> {
        let Self { system: _, interpolation, integrator, order, carrier, consider, R_position, R_output, gate } = self;
        Filter { system, interpolation, integrator, order, carrier, consider, R_position, R_output, gate }
    }

    /// Moves the belief over one step of the output; also the transition matrix.
    ///
    /// # Errors
    /// [`StepError`]; `carried` is untouched.
    pub fn predict<const N: usize>(
        &self,
        carried: &CarriedBelief<N>,
        drive: &Drive,
    ) -> Result<(CarriedBelief<N>, SMatrix<f64, N, N>), StepError>
    where
        S: System<N>,
    {
        match carried {
            CarriedBelief::Dense(belief) => {
                let (belief, Phi) = self.integrator.step(&self.system, belief, drive, self.order)?;
                Ok((CarriedBelief::Dense(belief), Phi))
            }
            CarriedBelief::Factored(factored) => {
                let belief = factored.belief();
                let step = self.integrator.transition(&self.system, &belief, drive, self.order)?;
                let factored = factored.predict(step.x, &step.Phi, &step.Q)?;
                factored.belief().checked()?;
                Ok((CarriedBelief::Factored(factored), step.Phi))
            }
        }
    }

    /// Updates by one sample, unless it drives the state.
    ///
    /// # Errors
    /// [`StepError`]; `carried` is untouched.
    pub fn update<const N: usize>(
        &self,
        carried: &CarriedBelief<N>,
        event: &Event,
    ) -> Result<(CarriedBelief<N>, Option<Correction<N>>), StepError>
    where
        S: System<N>,
    {
        let belief = carried.belief();
        let (reading, R) = match event.channel {
            Channel::Position => (Some(self.system.position(&belief.x)), self.R_position),
            Channel::Output => (self.system.output(&belief.x, &belief.P, self.order)?, self.R_output),
        };
        let Some(reading) = reading else {
            return Ok((*carried, None));
        };
        let (updated, innovation, gain) = match carried {
            CarriedBelief::Dense(prior) => {
                let (innovation, optimal) = innovate(prior, &reading, R, event.value)?;
                let gain = self.consider.gain(&optimal);
                (CarriedBelief::Dense(correct(prior, &reading, R, &innovation, &gain)), innovation, gain)
            }
            CarriedBelief::Factored(prior) => {
                let (factored, innovation, gain) = prior.update(&reading, R, event.value)?;
                (CarriedBelief::Factored(factored), innovation, gain)
            }
        };
        let gated = GatedReading::new(innovation.e, innovation.s, self.gate)?;
        let correction = Correction { reading: gated, H: reading.H, gain, R: R + reading.curvature_variance };
        if !gated.accepted {
            return Ok((*carried, Some(correction))); // what a rejected reading would have done is no failure
        }
        updated.belief().checked()?;
        Ok((updated, Some(correction)))
    }
}

fn checked_readings(R_position: f64, R_output: f64, gate: f64) -> Result<(), SetupError> {
    at_least("r_position", R_position, 0.0)?;
    at_least("r_accel", R_output, 0.0)?;
    if gate > 0.0 { Ok(()) } else { Err(SetupError::Setting { name: "gate", value: gate }) }
}

/// The factors of a prior, if it can be one and if readings with these variances and this gate can correct it.
///
/// # Errors
/// [`SetupError::Setting`], [`SetupError::Prior`], [`SetupError::Belief`].
pub(crate) fn checked_start<const N: usize>(
    prior: &Belief<N>,
    R_position: f64,
    R_output: f64,
    gate: f64,
) -> Result<Factored<N>, SetupError> {
    checked_readings(R_position, R_output, gate)?;
    for &x in prior.x.iter() {
        at_least("x0", x, f64::MIN)?;
    }
    let factored = Factored::new(prior)?;
    let asymmetry = (prior.P - prior.P.transpose()).amax();
    if !(asymmetry <= 1e-12 * prior.P.amax()) {
        return Err(SetupError::Setting { name: "asymmetry of P0", value: asymmetry });
    }
    // A pivot that counts as zero hides the covariances beside it.
    prior.checked().map_err(SetupError::Belief)?;
    Ok(factored)
}

impl<S: System<N>, const N: usize> Engine<N> for Filter<S> {
    type State = CarriedBelief<N>;
    type Outcome = Outcome<N>;

    const DRIVEN: bool = S::DRIVEN;

    fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    fn initial(&self, prior: &Belief<N>) -> Result<CarriedBelief<N>, SetupError> {
        System::check(&self.system)?;
        if self.carrier == Carrier::Factored {
            self.consider.refused()?;
        }
        self.consider.check(N)?;
        let factored = checked_start(prior, self.R_position, self.R_output, self.gate)?;
        if self.carrier == Carrier::Dense {
            return Ok(CarriedBelief::Dense(*prior));
        }
        factored.belief().checked().map_err(SetupError::Belief)?;
        Ok(CarriedBelief::Factored(factored))
    }

    fn belief(&self, state: &CarriedBelief<N>) -> Belief<N> {
        state.belief()
    }

    fn event(outcome: &Outcome<N>) -> Event {
        outcome.event
    }

    fn reading(outcome: &Outcome<N>) -> Option<GatedReading> {
        outcome.correction.map(|correction| correction.reading)
    }

    fn step(
        &self,
        state: &CarriedBelief<N>,
        drive: Option<&Drive>,
        event: &Event,
    ) -> Result<(CarriedBelief<N>, Outcome<N>), StepError> {
        let (predicted, Phi) = match drive {
            Some(drive) => self.predict(state, drive)?,
            None => (*state, SMatrix::identity()),
        };
        let (state, correction) = self.update(&predicted, event)?;
        Ok((state, Outcome { event: *event, belief: state.belief(), drive: drive.copied(), Phi, correction }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::aci::Aci;
    use crate::dense::smoother::smooth;
    use crate::dense::system::GaussMarkov;
    use crate::error::RunError;
    use crate::sensor::polynomial::Form;
    use crate::sensor::states::Sensor;
    use crate::signal::timeline::Samples;

    const COUNT: usize = 20;
    const DT: f64 = 6e-4;

    fn filter(integrator: Integrator, carrier: Carrier) -> Filter<Aci> {
        Filter {
            system: Aci {
                sensor: Sensor { form: Form::Inverse, gauss_markov: [GaussMarkov::CONSTANT; 4] },
                q: 1e-6,
                tau: 0.0,
            },
            interpolation: Interpolation::Linear,
            integrator,
            order: Order::First,
            carrier,
            consider: Consider::NONE,
            R_position: 1e-12,
            R_output: 0.0,
            gate: f64::INFINITY,
        }
    }

    fn prior() -> Belief<4> {
        Belief { x: SVector::zeros(), P: SMatrix::from_diagonal(&SVector::from([1e-8, 1e-2, 1e-2, 1e-2])) }
    }

    #[allow(clippy::large_stack_arrays)] // the core has no heap
    fn outcomes(filter: &Filter<Aci>) -> [Outcome<4>; 2 * COUNT] {
        let t: [f64; COUNT] = core::array::from_fn(|i| i as f64 * DT);
        let u = t.map(|t| 0.1 + 8.0 * libm::sin(200.0 * t));
        let z = t.map(|t| -2e-4 * libm::sin(200.0 * t));
        let empty = Outcome {
            event: Event { t: 0.0, channel: Channel::Output, value: 0.0 },
            belief: prior(),
            drive: None,
            Phi: SMatrix::identity(),
            correction: None,
        };
        let mut outcomes = [empty; 2 * COUNT];
        let mut next = outcomes.iter_mut();
        let (output, position) = (Samples { t: &t, y: &u }, Samples { t: &t, y: &z });
        let run = filter.run(&prior(), output, position, |_, outcome| {
            if let Some(slot) = next.next() {
                *slot = *outcome;
            }
        });
        assert!(run.is_ok());
        outcomes
    }

    #[test]
    fn the_carriers_agree() {
        let [dense, factored] = [Carrier::Dense, Carrier::Factored]
            .map(|carrier| outcomes(&filter(Integrator::Exact, carrier))[2 * COUNT - 1].belief);
        for i in 0..4 {
            let sigma = libm::sqrt(dense.P[(i, i)]);
            assert!((dense.x[i] - factored.x[i]).abs() < 1e-9 * sigma); // P cancels by 1e4 at the first reading
            assert!((factored.P[(i, i)] / dense.P[(i, i)] - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn constant_parameters_are_smoothed_to_their_last_filtered_value() {
        let filter = filter(Integrator::Exact, Carrier::Dense);
        let mut all = outcomes(&filter);
        let last = all[2 * COUNT - 1].belief;
        smooth(&filter, &prior(), &mut all).unwrap();
        for outcome in &all {
            for i in 2..4 {
                let sigma = libm::sqrt(last.P[(i, i)]);
                assert!((outcome.belief.x[i] - last.x[i]).abs() < 1e-6 * sigma); // 1e-2 moved to 1e-8 and back
                assert!((outcome.belief.P[(i, i)] / last.P[(i, i)] - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_rejected_reading_cannot_fail() {
        // Three states that correlate by -0.6 with each other are no covariance, which pairs do not show; a correction does.
        let mut belief = prior();
        belief.P = SMatrix::from_fn(|i, j| {
            if i == j {
                1.0
            } else if i < 3 && j < 3 {
                -0.6
            } else {
                0.0
            }
        });
        assert!(belief.checked().is_ok());
        let state = CarriedBelief::Dense(belief);
        let filter = Filter { gate: 9.0, ..filter(Integrator::Exact, Carrier::Dense) };
        let event = |value| Event { t: 0.0, channel: Channel::Position, value };
        assert!(matches!(filter.update(&state, &event(0.0)), Err(StepError::Correlation { .. })));
        let (unchanged, correction) = filter.update(&state, &event(100.0)).unwrap();
        assert_eq!((unchanged, correction.map(|correction| correction.reading.accepted)), (state, Some(false)));
    }

    #[test]
    fn a_prior_with_a_covariance_beside_no_variance_is_refused_by_either_carrier() {
        let mut hidden = prior();
        hidden.P = SMatrix::from_fn(|i, j| if i + j == 1 { 5.0 } else { f64::from(u8::from(i == j && i != 1)) });
        let error = StepError::Correlation { states: (0, 1), squared: f64::INFINITY };
        for carrier in [Carrier::Dense, Carrier::Factored] {
            let refused = filter(Integrator::Exact, carrier).start(&hidden).err();
            assert_eq!(refused, Some(SetupError::Belief(error)));
        }
    }

    #[test]
    fn a_consider_state_that_there_is_not_is_refused() {
        let considering = |state| Filter {
            consider: Consider::states(&[state]).unwrap(),
            ..filter(Integrator::Exact, Carrier::Dense)
        };
        assert!(considering(3).start(&prior()).is_ok());
        let error = SetupError::Setting { name: "consider state", value: 4.0 };
        assert_eq!(considering(4).start(&prior()).err(), Some(error));
    }

    #[test]
    fn an_event_before_the_last_one_or_without_a_time_is_refused() {
        let filter = filter(Integrator::Exact, Carrier::Dense);
        let samples = Samples { t: &[0.0, DT], y: &[1.0, 1.0] };
        let step = |track: &_, t| {
            let event = Event { t, channel: Channel::Position, value: 0.0 };
            filter.process(track, &event, samples.piece(1, filter.interpolation)).map(|(track, _)| track)
        };
        let track = step(&filter.start(&prior()).unwrap(), DT).unwrap();
        assert!(step(&track, DT).is_ok());
        for t in [0.0, f64::NAN, f64::INFINITY] {
            let actual = step(&track, t);
            assert!(matches!(actual, Err(RunError::Step { event: 1, error: StepError::TimeOrder { .. }, .. })));
        }
    }

    #[test]
    fn a_failed_run_names_its_event() {
        let mut filter = filter(Integrator::Exact, Carrier::Dense);
        filter.R_position = 0.0;
        let exact = Belief { x: SVector::zeros(), P: SMatrix::<f64, 4, 4>::zeros() };
        let samples = Samples { t: &[0.0, 1.0], y: &[0.0, 0.0] };
        let run = filter.run(&exact, samples, samples, |_, _| ());
        assert_eq!(run, Err(RunError::Step { event: 1, t: 0.0, error: StepError::InnovationVariance { s: 0.0 } }));
    }
}
