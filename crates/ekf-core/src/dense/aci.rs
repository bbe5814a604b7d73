//! ACI, acceleration as control input (9): `p' = v, v' = g(u, theta)`, read through the encoder alone.

use nalgebra::{RowSVector, SMatrix, SVector};

use crate::dense::system::{Drive, Order, Rates, System, Transition, at_least};
use crate::dense::update::Reading;
use crate::error::{SetupError, StepError};
use crate::integration::nodes;
use crate::sensor::states::{Sensor, curvature};

/// States `p, v, k, K0` (N = 4) or `p, v, k, K0, K2, K3` (N = 6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aci {
    /// The accelerometer.
    pub sensor: Sensor,
    /// Two-sided density of the output's white noise, (m/s^2)^2 s.
    pub q: f64,
    /// Time constant of the low-pass in front of the output, s; zero for none.
    ///
    /// `p` and `v` are then the low-passed motion, and the encoder is read as `p + tau v`: exact for a linear sensor,
    /// off by `K2 (tau j)^2` for a cubic one (derivations 7.3a).
    pub tau: f64,
}

const POSITION: usize = 0;
const VELOCITY: usize = 1;
const FIRST: usize = 2;

impl<const N: usize> System<N> for Aci {
    const DRIVEN: bool = true;

    fn check(&self) -> Result<(), SetupError> {
        self.sensor.check(N, FIRST)?;
        at_least("q", self.q, 0.0)?;
        at_least("tau", self.tau, 0.0)
    }

    fn rates(&self, x: &SVector<f64, N>, P: &SMatrix<f64, N, N>, u: f64, order: Order) -> Result<Rates<N>, StepError> {
        let g = self.sensor.acceleration(FIRST, x, u)?;
        let mut f = SVector::zeros();
        let mut F = SMatrix::zeros();
        let mut DQDt = SMatrix::zeros();
        f[POSITION] = x[VELOCITY];
        f[VELOCITY] = g.value;
        if order == Order::Second {
            f[VELOCITY] += curvature(&g.hessian, P, None, FIRST).0;
        }
        F[(POSITION, VELOCITY)] = 1.0;
        DQDt[(VELOCITY, VELOCITY)] = g.gradient[0] * g.gradient[0] * self.q;
        for (i, j, gauss_markov) in self.sensor.processes::<N>(FIRST) {
            f[i] = -gauss_markov.rate * x[i];
            F[(VELOCITY, i)] = g.gradient[j];
            F[(i, i)] = -gauss_markov.rate;
            DQDt[(i, i)] = gauss_markov.q;
        }
        Ok(Rates { f, F, DQDt })
    }

    /// Integrals of `g` and its partials over the step by Gauss-Legendre quadrature.
    ///
    /// Exact to rounding while `u` is held or linear and parameters are constant (degree 9; `Phi = I + F dt + F^2 dt^2/2`
    /// under hold, derivations 3.2). Otherwise the tenth power of what changes over the step is left: `rate dt` of a drifting
    /// parameter, `K2 du` where the forward model is inverted under a moving `u`.
    fn transition(
        &self,
        x: &SVector<f64, N>,
        P: &SMatrix<f64, N, N>,
        drive: &Drive,
        order: Order,
    ) -> Result<Transition<N>, StepError> {
        let h = drive.to - drive.from;
        let mut next =
            Transition { x: self.sensor.decayed(FIRST, x, h), Phi: SMatrix::identity(), Q: SMatrix::zeros() };
        next.x[POSITION] += h * x[VELOCITY];
        next.Phi[(POSITION, VELOCITY)] = h;
        for (i, _, gauss_markov) in self.sensor.processes::<N>(FIRST) {
            next.Phi[(i, i)] = gauss_markov.decay(h);
        }
        for (s, weight) in nodes(0.0, h) {
            let at = self.sensor.decayed(FIRST, x, s);
            let g = self.sensor.acceleration(FIRST, &at, drive.segment.value(drive.from + s))?;
            let mut a = g.value;
            if order == Order::Second {
                a += curvature(&g.hessian, &self.curvature_variance(P, s), None, FIRST).0;
            }
            next.x[POSITION] += weight * (h - s) * a;
            next.x[VELOCITY] += weight * a;
            for (i, j, gauss_markov) in self.sensor.processes::<N>(FIRST) {
                let slope = weight * g.gradient[j] * gauss_markov.decay(s);
                next.Phi[(POSITION, i)] += (h - s) * slope;
                next.Phi[(VELOCITY, i)] += slope;
            }
            let pushed = weight * self.q * g.gradient[0] * g.gradient[0];
            next.Q[(POSITION, POSITION)] += pushed * (h - s) * (h - s);
            next.Q[(POSITION, VELOCITY)] += pushed * (h - s);
            next.Q[(VELOCITY, VELOCITY)] += pushed;
        }
        next.Q[(VELOCITY, POSITION)] = next.Q[(POSITION, VELOCITY)];
        for (i, j, gauss_markov) in self.sensor.processes::<N>(FIRST) {
            if gauss_markov.q > 0.0 {
                for (s, weight) in nodes(0.0, h) {
                    let b = self.influence(x, drive, s, (i, j))?;
                    next.Q += b * b.transpose() * (weight * gauss_markov.q);
                }
            }
        }
        Ok(next)
    }

    fn position(&self, x: &SVector<f64, N>) -> Reading<N> {
        let mut H = RowSVector::zeros();
        H[POSITION] = 1.0;
        H[VELOCITY] = self.tau;
        Reading { expected: x[POSITION] + self.tau * x[VELOCITY], H, curvature_variance: 0.0 }
    }

    fn output(&self, _: &SVector<f64, N>, _: &SMatrix<f64, N, N>, _: Order) -> Result<Option<Reading<N>>, StepError> {
        Ok(None)
    }
}

impl Aci {
    /// The parameters' covariance `s` seconds into the step.
    fn curvature_variance<const N: usize>(&self, P: &SMatrix<f64, N, N>, s: f64) -> SMatrix<f64, N, N> {
        let mut P = *P;
        for (i, _, gauss_markov) in self.sensor.processes::<N>(FIRST) {
            let decay = gauss_markov.decay(s);
            for k in 0..N {
                P[(i, k)] *= decay;
                P[(k, i)] *= decay;
            }
            P[(i, i)] += gauss_markov.variance(s);
        }
        P
    }

    /// Response of the state at the end of the step to a unit impulse on parameter `i` (partial `j`) at `s`.
    fn influence<const N: usize>(
        &self,
        x: &SVector<f64, N>,
        drive: &Drive,
        s: f64,
        (i, j): (usize, usize),
    ) -> Result<SVector<f64, N>, StepError> {
        let h = drive.to - drive.from;
        let gauss_markov = self.sensor.gauss_markov[i - FIRST];
        let mut b = SVector::<f64, N>::zeros();
        for (r, weight) in nodes(s, h) {
            let at = self.sensor.decayed(FIRST, x, r);
            let g = self.sensor.acceleration(FIRST, &at, drive.segment.value(drive.from + r))?;
            let dv = weight * g.gradient[j] * gauss_markov.decay(r - s);
            b[POSITION] += (h - r) * dv;
            b[VELOCITY] += dv;
        }
        b[i] = gauss_markov.decay(h - s);
        Ok(b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::system::GaussMarkov;
    use crate::sensor::polynomial::Form;
    use crate::signal::interpolation::Segment;

    fn aci(gauss_markov: [GaussMarkov; 4]) -> Aci {
        Aci { sensor: Sensor { form: Form::Inverse, gauss_markov }, q: 1e-4, tau: 0.0 }
    }

    fn state() -> SVector<f64, 6> {
        SVector::from([0.01, -0.3, 0.02, 0.1, -1e-3, 1e-4])
    }

    fn covariance() -> SMatrix<f64, 6, 6> {
        let B = SMatrix::<f64, 6, 6>::from_fn(|i, j| 0.1 / (1.0 + (i * 7 + j * 3) as f64));
        B * B.transpose()
    }

    fn drive(c: [f64; 4], from: f64, to: f64) -> Drive {
        Drive::held(Segment { c }, from, to)
    }

    #[test]
    fn under_hold_the_step_has_its_closed_form() {
        let system = aci([GaussMarkov::CONSTANT; 4]);
        let (x, h) = (state(), 6e-4);
        let step = system.transition(&x, &covariance(), &drive([9.0, 0.0, 0.0, 0.0], 0.0, h), Order::Second).unwrap();
        let rates = system.rates(&x, &covariance(), 9.0, Order::Second).unwrap();
        let F = rates.F;
        let Phi = SMatrix::<f64, 6, 6>::identity() + F * h + F * F * (h * h / 2.0);
        let push = F * rates.f * (h * h / 2.0);
        assert!((step.Phi - Phi).amax() < 1e-15);
        assert!((step.x - (x + rates.f * h + push)).amax() < 1e-16);
        let q = rates.DQDt[(VELOCITY, VELOCITY)];
        assert!((step.Q[(0, 0)] / (q * h.powi(3) / 3.0) - 1.0).abs() < 1e-14);
        assert!((step.Q[(0, 1)] / (q * h * h / 2.0) - 1.0).abs() < 1e-14);
        assert!((step.Q[(1, 1)] / (q * h) - 1.0).abs() < 1e-14);
    }

    #[test]
    fn a_step_under_a_moving_output_and_drifting_parameters_splits() {
        let drift = |rate, q| GaussMarkov { rate, q };
        let system = aci([drift(0.5, 1e-3), drift(0.0, 2e-3), GaussMarkov::CONSTANT, drift(2.0, 1e-6)]);
        let c = [9.0, -100.0, 0.0, 0.0];
        let run = |x: &SVector<f64, 6>, from, to| {
            system.transition(x, &covariance(), &drive(c, from, to), Order::First).unwrap()
        };
        let whole = run(&state(), 0.0, 1e-2);
        let one = run(&state(), 0.0, 4e-3);
        let two = run(&one.x, 4e-3, 1e-2);
        let Q = two.Phi * one.Q * two.Phi.transpose() + two.Q;
        assert!((whole.x - two.x).amax() < 1e-15);
        assert!((whole.Phi - two.Phi * one.Phi).amax() < 1e-13);
        for i in 0..6 {
            for j in 0..6 {
                let scale = libm::sqrt(Q[(i, i)] * Q[(j, j)]);
                // A drifting K3 makes the integrand one degree too high: 2e-5 (du / u)^6 of the last term.
                assert!((whole.Q - Q)[(i, j)].abs() <= 1e-12 * scale);
            }
        }
    }

    #[test]
    fn second_order_adds_its_published_term() {
        let system = aci([GaussMarkov::CONSTANT; 4]);
        let (x, P) = (state(), covariance());
        let f = |order| system.rates(&x, &P, 9.0, order).unwrap().f[VELOCITY];
        let (K2, K3, w) = (x[4], x[5], 9.0 - x[3]);
        let published = P[(2, 3)] + (K2 + 3.0 * K3 * w) * P[(3, 3)] - 2.0 * w * P[(3, 4)] - 3.0 * w * w * P[(3, 5)];
        assert!((f(Order::Second) - f(Order::First) - published).abs() < 1e-14);
    }

    #[test]
    fn behind_a_low_pass_the_encoder_reads_ahead() {
        let mut system = aci([GaussMarkov::CONSTANT; 4]);
        system.tau = 1e-3;
        let reading = system.position(&state());
        assert!((reading.expected - (0.01 - 0.3e-3)).abs() < 1e-17);
        assert!((reading.H[VELOCITY] - 1e-3).abs() < 1e-18);
    }
}
