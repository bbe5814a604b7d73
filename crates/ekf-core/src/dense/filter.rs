//! The five choices put together: from one event to the next, over a record.

use nalgebra::{RowSVector, SMatrix, SVector};

use crate::dense::belief::{Belief, Carrier};
use crate::dense::integrate::Integrator;
use crate::dense::system::{Drive, Order, System, at_least};
use crate::dense::ud::Factored;
use crate::dense::update::{Innovation, correct, innovate};
use crate::error::{RunError, SetupError, StepError};
use crate::signal::interpolation::{Interpolation, Segment};
use crate::signal::timeline::{Channel, Event, Samples};
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
    /// Variance of a position reading, m^2.
    pub R_position: f64,
    /// Variance of an accelerometer reading, (m/s^2)^2; without effect if the output drives the state.
    pub R_output: f64,
    /// Readings with `e^2 / S` above this are rejected and reported; infinite for none.
    pub gate: f64,
}

/// The belief in the form its carrier keeps it.
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
    /// `e` and `S`.
    pub innovation: Innovation,
    /// `H`.
    pub H: RowSVector<f64, N>,
    /// `P H' / S`.
    pub gain: SVector<f64, N>,
    /// False if the gate rejected it: the belief is then the prediction.
    pub accepted: bool,
}

/// What one event led to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome<const N: usize> {
    /// The event.
    pub event: Event,
    /// The belief after it.
    pub belief: Belief<N>,
    /// Transition from the event before.
    pub Phi: SMatrix<f64, N, N>,
    /// The reading; `None` where an output drives the state.
    pub correction: Option<Correction<N>>,
}

/// A filter on its way: where it is, when, and what it has met.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track<const N: usize> {
    /// The belief at the last event.
    pub carried: CarriedBelief<N>,
    /// Time of the last event, s; `None` before the first, to which the prior belongs.
    pub t: Option<f64>,
    /// Events processed.
    pub events: usize,
    /// Readings rejected by the gate.
    pub rejected: usize,
    /// Sum over the accepted readings, physics 6.3.
    pub log_likelihood: f64,
}

impl<S> Filter<S> {
    /// The track at its beginning.
    ///
    /// # Errors
    /// [`SetupError`] if a setting, the number of states or the prior covariance is unusable.
    pub fn start<const N: usize>(&self, prior: &Belief<N>) -> Result<Track<N>, SetupError>
    where
        S: System<N>,
    {
        self.system.check()?;
        at_least("r_position", self.R_position, 0.0)?;
        at_least("r_accel", self.R_output, 0.0)?;
        if !(self.gate > 0.0) {
            return Err(SetupError::Setting { name: "gate", value: self.gate });
        }
        for &x in prior.x.iter() {
            at_least("x0", x, f64::MIN)?;
        }
        let factored = Factored::new(prior).map_err(|(state, pivot)| SetupError::Prior { state, pivot })?;
        let asymmetry = (prior.P - prior.P.transpose()).amax();
        if !(asymmetry <= 1e-12 * prior.P.amax()) {
            return Err(SetupError::Setting { name: "asymmetry of P0", value: asymmetry });
        }
        Ok(Track {
            carried: match self.carrier {
                Carrier::Dense => CarriedBelief::Dense(*prior),
                Carrier::Factored => CarriedBelief::Factored(factored),
            },
            t: None,
            events: 0,
            rejected: 0,
            log_likelihood: 0.0,
        })
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
                Ok((CarriedBelief::Factored(factored), step.Phi))
            }
        }
    }

    /// Takes one sample in, unless it drives the state.
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
                let (innovation, gain) = innovate(prior, &reading, R, event.value)?;
                let belief = correct(prior, &reading, R, &innovation, &gain).checked()?;
                (CarriedBelief::Dense(belief), innovation, gain)
            }
            CarriedBelief::Factored(prior) => {
                let (factored, innovation, gain) = prior.update(&reading, R, event.value)?;
                (CarriedBelief::Factored(factored), innovation, gain)
            }
        };
        let accepted = innovation.nis() <= self.gate;
        let correction = Correction { innovation, H: reading.H, gain, accepted };
        Ok((if accepted { updated } else { *carried }, Some(correction)))
    }

    /// Processes the next event, `piece` being the output since the one before.
    ///
    /// # Errors
    /// [`RunError::Step`] with the event; `track` is untouched.
    pub fn follow<const N: usize>(
        &self,
        track: &Track<N>,
        event: &Event,
        piece: (Segment, f64),
    ) -> Result<(Track<N>, Outcome<N>), RunError>
    where
        S: System<N>,
    {
        let at_event = |error| RunError::Step { event: track.events, t: event.t, error };
        let mut next = *track;
        let mut Phi = SMatrix::identity();
        if let Some(previous) = track.t.filter(|&previous| previous < event.t) {
            let (segment, start) = if S::DRIVEN { piece } else { (Segment { c: [0.0; 4] }, previous) };
            let drive = Drive { segment, from: previous - start, to: event.t - start };
            (next.carried, Phi) = self.predict(&track.carried, &drive).map_err(at_event)?;
        }
        let correction;
        (next.carried, correction) = self.update(&next.carried, event).map_err(at_event)?;
        if let Some(correction) = &correction {
            if correction.accepted {
                next.log_likelihood += correction.innovation.log_likelihood();
            } else {
                next.rejected += 1;
            }
        }
        next.t = Some(event.t);
        next.events += 1;
        let outcome = Outcome { event: *event, belief: next.carried.belief(), Phi, correction };
        Ok((next, outcome))
    }

    /// Runs over a whole record; `keep` sees every outcome in time order.
    ///
    /// # Errors
    /// [`RunError::Setup`] for an unusable filter, prior or record; [`RunError::Step`] with the event that failed.
    pub fn run<const N: usize>(
        &self,
        prior: &Belief<N>,
        output: Samples<'_>,
        position: Samples<'_>,
        mut keep: impl FnMut(&Outcome<N>),
    ) -> Result<Track<N>, RunError>
    where
        S: System<N>,
    {
        self.over(prior, output, position, |_, outcome| keep(outcome))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::aci::Aci;
    use crate::dense::smoother::smooth;
    use crate::dense::system::GaussMarkov;
    use crate::sensor::polynomial::Form;
    use crate::sensor::states::Sensor;

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
            R_position: 1e-12,
            R_output: 0.0,
            gate: f64::INFINITY,
        }
    }

    fn prior() -> Belief<4> {
        Belief { x: SVector::zeros(), P: SMatrix::from_diagonal(&SVector::from([1e-8, 1e-2, 1e-2, 1e-2])) }
    }

    fn outcomes(filter: &Filter<Aci>) -> [Outcome<4>; 2 * COUNT] {
        let t: [f64; COUNT] = core::array::from_fn(|i| i as f64 * DT);
        let u = t.map(|t| 0.1 + 8.0 * libm::sin(200.0 * t));
        let z = t.map(|t| -2e-4 * libm::sin(200.0 * t));
        let empty = Outcome {
            event: Event { t: 0.0, channel: Channel::Output, value: 0.0 },
            belief: prior(),
            Phi: SMatrix::identity(),
            correction: None,
        };
        let mut outcomes = [empty; 2 * COUNT];
        let mut next = outcomes.iter_mut();
        let (output, position) = (Samples { t: &t, y: &u }, Samples { t: &t, y: &z });
        let run = filter.run(&prior(), output, position, |outcome| {
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
        let mut all = outcomes(&filter(Integrator::Exact, Carrier::Dense));
        let last = all[2 * COUNT - 1].belief;
        smooth(&mut all);
        for outcome in &all {
            for i in 2..4 {
                let sigma = libm::sqrt(last.P[(i, i)]);
                assert!((outcome.belief.x[i] - last.x[i]).abs() < 1e-6 * sigma); // 1e-2 moved to 1e-8 and back
                assert!((outcome.belief.P[(i, i)] / last.P[(i, i)] - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_failed_run_names_its_event() {
        let mut filter = filter(Integrator::Exact, Carrier::Dense);
        filter.R_position = 0.0;
        let known = Belief { x: SVector::zeros(), P: SMatrix::<f64, 4, 4>::zeros() };
        let samples = Samples { t: &[0.0, 1.0], y: &[0.0, 0.0] };
        let run = filter.run(&known, samples, samples, |_| ());
        assert_eq!(run, Err(RunError::Step { event: 1, t: 0.0, error: StepError::InnovationVariance { s: 0.0 } }));
    }
}
