//! ACI with any [`AccelerationModel`] as its sensor, in UD form, over a record and on a stream.

use crate::dense::belief::{Belief, check_covariance, check_mean};
use crate::dense::filter::checked_start;
use crate::dense::system::{Drive, GaussMarkov, Order, at_least};
use crate::dense::update::GatedReading;
use crate::error::{SetupError, StepError};
use crate::signal::channel::{Channel, Event};
use crate::signal::interpolation::Interpolation;
use crate::stream::engine::Engine;
use crate::structured::acceleration::AccelerationModel;
use crate::structured::aci_step::StepInput;
use crate::structured::aci_ud::AciFactored;
use crate::structured::gauss_markov::GaussMarkovSet;
use crate::structured::row::Plain;

/// A filter of `p, v` and the `M` parameters of a sensor model, hence of `N = M + 2` states; steps without integration error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OwnSensor<E, const M: usize> {
    /// How acceleration follows from the output and the parameters.
    pub model: E,
    /// How the parameters drift.
    pub gauss_markov: [GaussMarkov; M],
    /// Two-sided density of the output's white noise, (m/s^2)^2 s.
    pub q: f64,
    /// The output between its samples.
    pub interpolation: Interpolation,
    /// First or second order.
    pub order: Order,
    /// Variance of a position reading, m^2.
    pub R_position: f64,
    /// Readings with `e^2 / S` above this are rejected and reported; infinite for none.
    pub gate: f64,
}

impl<E, const M: usize> OwnSensor<E, M> {
    /// Constant parameters, a line between outputs, first order, no gate; `q` and `R_position` as the fields.
    #[must_use]
    pub const fn new(model: E, q: f64, R_position: f64) -> Self {
        Self {
            model,
            gauss_markov: [GaussMarkov::CONSTANT; M],
            q,
            interpolation: Interpolation::Linear,
            order: Order::First,
            R_position,
            gate: f64::INFINITY,
        }
    }
}

fn checked<const N: usize, const M: usize>(state: &AciFactored<f64, N, M>) -> Result<(), StepError> {
    check_mean(N, |i| state.x(i))?;
    check_covariance(N, |i, j| state.P(i, j))
}

impl<E, const N: usize, const M: usize> Engine<N> for OwnSensor<E, M>
where
    E: AccelerationModel<Plain<f64, M>, M, Input = f64>,
{
    type State = AciFactored<f64, N, M>;
    type Outcome = (Event, Option<GatedReading>);

    const DRIVEN: bool = true;

    fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    fn initial(&self, prior: &Belief<N>) -> Result<Self::State, SetupError> {
        const { assert!(M > 0, "a sensor has parameters") };
        at_least("q", self.q, 0.0)?;
        self.gauss_markov.iter().try_for_each(GaussMarkov::check)?;
        let start = checked_start(prior, self.R_position, 0.0, self.gate)?;
        let state = AciFactored::new(|i| start.x[i], |i, j| start.U[(i, j)], |i| start.D[i]);
        checked(&state).map_err(SetupError::Belief)?;
        Ok(state)
    }

    fn belief(&self, state: &Self::State) -> Belief<N> {
        Belief { x: nalgebra::SVector::from_fn(|i, _| state.x(i)), P: nalgebra::SMatrix::from_fn(|i, j| state.P(i, j)) }
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
        let mut state = *state;
        if let Some(&Drive { segment, from, to, .. }) = drive {
            let input = |s: f64| segment.value(from + s);
            let step = StepInput { model: self.model, order: self.order, input, dt: to - from };
            state.exact(self.q, &GaussMarkovSet::new(0.0, self.gauss_markov), &step)?;
        }
        let mut reading = None;
        if event.channel == Channel::Position {
            let innovation = state.innovate(event.value, self.R_position);
            let gated = GatedReading::new(innovation.e, innovation.s, self.gate)?;
            if gated.accepted {
                state.correct(self.R_position, &innovation);
            }
            reading = Some(gated);
        }
        checked(&state)?;
        Ok((state, (*event, reading)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::aci::Aci;
    use crate::dense::belief::Carrier;
    use crate::dense::filter::Filter;
    use crate::sensor::polynomial::Form;
    use crate::sensor::states::Sensor;
    use crate::signal::timeline::Samples;
    use crate::structured::acceleration::InverseCubic;

    const COUNT: usize = 200;

    fn prior() -> Belief<6> {
        Belief::independent([0.0; 6], [1e-5, 1e-2, 0.05, 0.5, 1e-2, 1e-3])
    }

    #[test]
    fn the_catalogue_s_cubic_as_an_own_sensor_equals_the_dense_factored_filter() {
        let t: [f64; COUNT] = core::array::from_fn(|i| i as f64 * 6e-4);
        let u = t.map(|t| 0.1 + 8.0 * libm::sin(200.0 * t));
        let z = t.map(|t| -2e-4 * libm::sin(200.0 * t));
        let (output, position) = (Samples { t: &t, y: &u }, Samples { t: &t, y: &z });
        let drifting = [GaussMarkov { rate: 0.5, q: 1e-4 }, GaussMarkov::CONSTANT];
        for k in drifting {
            let mut gauss_markov = [GaussMarkov::CONSTANT; 4];
            gauss_markov[0] = k;
            let own = OwnSensor { gauss_markov, gate: 9.0, ..OwnSensor::<_, 4>::new(InverseCubic, 1e-6, 1e-12) };
            let aci = Aci { sensor: Sensor { form: Form::Inverse, gauss_markov }, q: 1e-6, tau: 0.0 };
            let dense = Filter { carrier: Carrier::Factored, gate: 9.0, ..Filter::new(aci, 1e-12, 0.0) };
            let track = own.run(&prior(), output, position, |_, _| ()).unwrap();
            let expected = dense.run(&prior(), output, position, |_, _| ()).unwrap();
            let (actual, twin) = (own.belief(&track.state), Engine::belief(&dense, &expected.state));
            assert_eq!((track.events, track.rejected), (expected.events, expected.rejected));
            for i in 0..6 {
                // A few hundred steps of about a thousand roundings each.
                assert!((actual.x[i] - twin.x[i]).abs() < 1e-8 * twin.sigma(i));
                assert!((actual.P[(i, i)] / twin.P[(i, i)] - 1.0).abs() < 1e-8);
            }
            assert!((track.log_likelihood - expected.log_likelihood).abs() < 1e-7);
        }
    }

    #[test]
    fn what_no_filter_could_use_is_refused() {
        let own = OwnSensor::<_, 4>::new(InverseCubic, 1e-6, 1e-12);
        let refused = |own: OwnSensor<InverseCubic, 4>, prior: Belief<6>| own.initial(&prior).is_err();
        assert!(!refused(own, prior()));
        assert!(refused(OwnSensor { q: -1.0, ..own }, prior()));
        assert!(refused(OwnSensor { gate: 0.0, ..own }, prior()));
        assert!(refused(OwnSensor { R_position: f64::NAN, ..own }, prior()));
        assert!(refused(OwnSensor { gauss_markov: [GaussMarkov { rate: -1.0, q: 0.0 }; 4], ..own }, prior()));
        let mut negative = prior();
        negative.P[(3, 3)] = -1.0;
        assert!(refused(own, negative));
    }
}
