//! CWPA, continuous Wiener-process acceleration (10): white jerk, read through encoder and accelerometer.

use nalgebra::{RowSVector, SMatrix, SVector};

use crate::dense::system::{Drive, Order, Rates, System, Transition, at_least, mean_decay};
use crate::dense::update::Reading;
use crate::error::{SetupError, StepError};
use crate::integration::nodes;
use crate::sensor::states::{Sensor, curvature};

/// States `p, v, a, k, K0` (N = 5) or `p, v, a, k, K0, K2, K3` (N = 7).
///
/// A low-pass in front of the output adds its state `y` after `a` (N = 6, 8): `y' = (f(a) + noise - y) / tau`, and the
/// accelerometer then reads `y` (derivations 7.3a).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cwpa {
    /// The accelerometer.
    pub sensor: Sensor,
    /// Two-sided density of the jerk, m^2/s^5.
    pub q: f64,
    /// The low-pass, if one is declared.
    pub low_pass: Option<LowPass>,
}

/// One pole between the sensing element and the reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowPass {
    /// Time constant, s; positive.
    pub tau: f64,
    /// Two-sided density of the white noise in front of the pole, (m/s^2)^2 s.
    pub q: f64,
}

const POSITION: usize = 0;
const VELOCITY: usize = 1;
const ACCELERATION: usize = 2;
const OUTPUT: usize = 3;

impl Cwpa {
    fn first(&self) -> usize {
        if self.low_pass.is_some() { OUTPUT + 1 } else { ACCELERATION + 1 }
    }
}

impl<const N: usize> System<N> for Cwpa {
    const DRIVEN: bool = false;

    fn check(&self) -> Result<(), SetupError> {
        self.sensor.check(N, self.first())?;
        at_least("q", self.q, 0.0)?;
        if let Some(LowPass { tau, q }) = self.low_pass {
            at_least("tau", tau, f64::MIN_POSITIVE)?;
            at_least("low-pass q", q, 0.0)?;
            for gauss_markov in &self.sensor.gauss_markov {
                // A parameter as fast as the low-pass is indistinguishable from noise.
                at_least("1/2 - rate tau", 0.5 - gauss_markov.rate * tau, 0.0)?;
            }
        }
        Ok(())
    }

    fn rates(&self, x: &SVector<f64, N>, P: &SMatrix<f64, N, N>, _: f64, order: Order) -> Result<Rates<N>, StepError> {
        let first = self.first();
        let mut f = SVector::zeros();
        let mut F = SMatrix::zeros();
        let mut DQDt = SMatrix::zeros();
        f[POSITION] = x[VELOCITY];
        f[VELOCITY] = x[ACCELERATION];
        F[(POSITION, VELOCITY)] = 1.0;
        F[(VELOCITY, ACCELERATION)] = 1.0;
        DQDt[(ACCELERATION, ACCELERATION)] = self.q;
        for (i, _, gauss_markov) in self.sensor.processes::<N>(first) {
            f[i] = -gauss_markov.rate * x[i];
            F[(i, i)] = -gauss_markov.rate;
            DQDt[(i, i)] = gauss_markov.q;
        }
        if let Some(LowPass { tau, q }) = self.low_pass {
            let r = self.sensor.output(first, x, x[ACCELERATION])?;
            let mut output = r.value;
            if order == Order::Second {
                output += curvature(&r.hessian, P, Some(ACCELERATION), first).0;
            }
            f[OUTPUT] = (output - x[OUTPUT]) / tau;
            F[(OUTPUT, ACCELERATION)] = r.gradient[0] / tau;
            F[(OUTPUT, OUTPUT)] = -1.0 / tau;
            for (i, j, _) in self.sensor.processes::<N>(first) {
                F[(OUTPUT, i)] = r.gradient[j] / tau;
            }
            DQDt[(OUTPUT, OUTPUT)] = q / (tau * tau);
        }
        Ok(Rates { f, F, DQDt })
    }

    /// Closed form (derivations 4.1); the low-pass is linearised about the estimate at the start of the step.
    fn transition(
        &self,
        x: &SVector<f64, N>,
        P: &SMatrix<f64, N, N>,
        drive: &Drive,
        order: Order,
    ) -> Result<Transition<N>, StepError> {
        let T = drive.to - drive.from;
        let first = self.first();
        let mut next =
            Transition { x: self.sensor.decayed(first, x, T), Phi: SMatrix::identity(), Q: SMatrix::zeros() };
        next.x[POSITION] += T * (x[VELOCITY] + 0.5 * T * x[ACCELERATION]);
        next.x[VELOCITY] += T * x[ACCELERATION];
        next.Phi[(POSITION, VELOCITY)] = T;
        next.Phi[(POSITION, ACCELERATION)] = 0.5 * T * T;
        next.Phi[(VELOCITY, ACCELERATION)] = T;
        let T2 = T * T;
        let T3 = T2 * T;
        set(&mut next.Q, POSITION, POSITION, self.q * T3 * T2 / 20.0);
        set(&mut next.Q, POSITION, VELOCITY, self.q * T2 * T2 / 8.0);
        set(&mut next.Q, POSITION, ACCELERATION, self.q * T3 / 6.0);
        set(&mut next.Q, VELOCITY, VELOCITY, self.q * T3 / 3.0);
        set(&mut next.Q, VELOCITY, ACCELERATION, self.q * T2 / 2.0);
        set(&mut next.Q, ACCELERATION, ACCELERATION, self.q * T);
        for (i, _, gauss_markov) in self.sensor.processes::<N>(first) {
            next.Phi[(i, i)] = gauss_markov.decay(T);
            next.Q[(i, i)] = gauss_markov.variance(T);
        }
        match self.low_pass {
            Some(low_pass) => self.filter_output(&low_pass, x, P, T, order, next),
            None => Ok(next),
        }
    }

    fn position(&self, x: &SVector<f64, N>) -> Reading<N> {
        read(x, POSITION)
    }

    fn output(
        &self,
        x: &SVector<f64, N>,
        P: &SMatrix<f64, N, N>,
        order: Order,
    ) -> Result<Option<Reading<N>>, StepError> {
        if self.low_pass.is_some() {
            return Ok(Some(read(x, OUTPUT)));
        }
        let first = self.first();
        let r = self.sensor.output(first, x, x[ACCELERATION])?;
        let mut reading = Reading { expected: r.value, H: RowSVector::zeros(), curvature_variance: 0.0 };
        reading.H[ACCELERATION] = r.gradient[0];
        for (i, j, _) in self.sensor.processes::<N>(first) {
            reading.H[i] = r.gradient[j];
        }
        if order == Order::Second {
            let (curvature_mean, curvature_variance) = curvature(&r.hessian, P, Some(ACCELERATION), first);
            reading.expected += curvature_mean;
            reading.curvature_variance = curvature_variance;
        }
        Ok(Some(reading))
    }
}

impl Cwpa {
    /// Adds the rows and columns of `y`, with `b = T / tau` and everything frozen at the start of the step.
    fn filter_output<const N: usize>(
        &self,
        &LowPass { tau, q }: &LowPass,
        x: &SVector<f64, N>,
        P: &SMatrix<f64, N, N>,
        T: f64,
        order: Order,
        mut next: Transition<N>,
    ) -> Result<Transition<N>, StepError> {
        let first = self.first();
        let b = T / tau;
        let rise = -libm::expm1(-b);
        let r = self.sensor.output(first, x, x[ACCELERATION])?;
        let mut output = r.value;
        if order == Order::Second {
            output += curvature(&r.hessian, P, Some(ACCELERATION), first).0;
        }
        next.x[OUTPUT] = x[OUTPUT] + rise * (output - x[OUTPUT]);
        next.Phi[(OUTPUT, OUTPUT)] = libm::exp(-b);
        next.Phi[(OUTPUT, ACCELERATION)] = r.gradient[0] * rise;

        let [m0, m1, m2] = rise_moments(b);
        let jerk = self.q * r.gradient[0] * T;
        set(&mut next.Q, POSITION, OUTPUT, jerk * T * T * 0.5 * m2);
        set(&mut next.Q, VELOCITY, OUTPUT, jerk * T * m1);
        set(&mut next.Q, ACCELERATION, OUTPUT, jerk * m0);
        next.Q[(OUTPUT, OUTPUT)] =
            jerk * r.gradient[0] * lagged_moments(0.0, b).1 + q * T * mean_decay(2.0 * b) / (tau * tau);

        for (i, j, gauss_markov) in self.sensor.processes::<N>(first) {
            let a = gauss_markov.rate * T;
            let carried = lagged(a, b, 1.0);
            next.x[OUTPUT] += r.gradient[j] * x[i] * (carried - rise);
            next.Phi[(OUTPUT, i)] = r.gradient[j] * carried;
            let (once, twice) = lagged_moments(a, b);
            let pushed = gauss_markov.q * r.gradient[j] * T;
            set(&mut next.Q, OUTPUT, i, pushed * once);
            next.Q[(OUTPUT, OUTPUT)] += pushed * r.gradient[j] * twice;
        }
        Ok(next)
    }
}

/// A reading of one state.
fn read<const N: usize>(x: &SVector<f64, N>, state: usize) -> Reading<N> {
    let mut H = RowSVector::zeros();
    H[state] = 1.0;
    Reading { expected: x[state], H, curvature_variance: 0.0 }
}

fn set<const N: usize>(Q: &mut SMatrix<f64, N, N>, i: usize, j: usize, value: f64) {
    Q[(i, j)] = value;
    Q[(j, i)] = value;
}

/// Below this `T / tau` the closed forms cancel and the quadrature is exact to rounding.
const SHORT: f64 = 0.25;

/// `int_0^1 s^n (1 - exp(-b s)) ds` for n = 0, 1, 2.
fn rise_moments(b: f64) -> [f64; 3] {
    if b < SHORT {
        let mut m = [0.0; 3];
        for (s, weight) in nodes(0.0, 1.0) {
            let rise = -libm::expm1(-b * s) * weight;
            m[0] += rise;
            m[1] += rise * s;
            m[2] += rise * s * s;
        }
        return m;
    }
    let e = libm::exp(-b);
    let g0 = mean_decay(b);
    let g1 = (g0 - e) / b;
    let g2 = (2.0 * g1 - e) / b;
    [1.0 - g0, 0.5 - g1, 1.0 / 3.0 - g2]
}

/// What the low-pass shows at `s` of a parameter that decays as `exp(-a s)`: `b (exp(-a s) - exp(-b s)) / (b - a)`.
fn lagged(a: f64, b: f64, s: f64) -> f64 {
    if b == 0.0 {
        return 0.0;
    }
    -libm::exp(-a * s) * libm::expm1(-(b - a) * s) * b / (b - a)
}

/// `int_0^1 exp(-a s) lagged ds` and `int_0^1 lagged^2 ds`.
fn lagged_moments(a: f64, b: f64) -> (f64, f64) {
    if b < SHORT {
        return nodes(0.0, 1.0).fold((0.0, 0.0), |(once, twice), (s, weight)| {
            let y = lagged(a, b, s);
            (once + weight * libm::exp(-a * s) * y, twice + weight * y * y)
        });
    }
    let ratio = b / (b - a);
    let (aa, ab, bb) = (mean_decay(2.0 * a), mean_decay(a + b), mean_decay(2.0 * b));
    (ratio * (aa - ab), ratio * ratio * (aa - 2.0 * ab + bb))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::system::GaussMarkov;
    use crate::sensor::polynomial::Form;
    use crate::signal::interpolation::Segment;

    const TAU: f64 = 1e-3;

    fn cwpa(low_pass: Option<LowPass>) -> Cwpa {
        let drift = |rate, q| GaussMarkov { rate, q };
        Cwpa {
            sensor: Sensor {
                form: Form::Forward,
                gauss_markov: [drift(0.5, 2.0), drift(0.0, 3.0), GaussMarkov::CONSTANT, GaussMarkov::CONSTANT],
            },
            q: 7.0,
            low_pass,
        }
    }

    fn step<const N: usize>(system: &Cwpa, x: &SVector<f64, N>, T: f64) -> Transition<N> {
        let drive = Drive::held(Segment { c: [0.0; 4] }, 0.0, T);
        system.transition(x, &SMatrix::identity(), &drive, Order::First).unwrap()
    }

    /// One step equals two, the second from where the first one ended.
    fn assert_semigroup<const N: usize>(system: &Cwpa, x: &SVector<f64, N>, T1: f64, T2: f64) {
        let whole = step(system, x, T1 + T2);
        let one = step(system, x, T1);
        let two = step(system, &one.x, T2);
        let Phi = two.Phi * one.Phi;
        let Q = two.Phi * one.Q * two.Phi.transpose() + two.Q;
        assert!((whole.x - two.x).amax() < 1e-13 * whole.x.amax());
        assert!((whole.Phi - Phi).amax() < 1e-13);
        for i in 0..N {
            for j in 0..N {
                let scale = libm::sqrt(Q[(i, i)] * Q[(j, j)]);
                // The closed forms cancel by up to (tau / T)^2 = 16.
                assert!((whole.Q - Q)[(i, j)].abs() <= 1e-13 * scale);
            }
        }
    }

    #[test]
    fn white_jerk_has_its_published_determinant_and_splits() {
        let system = cwpa(None);
        let x = SVector::from([0.1, 0.2, 3.0, 0.01, 0.05]);
        let Q = step(&system, &x, 0.3).Q;
        let motion = Q.fixed_view::<3, 3>(0, 0).determinant();
        let published = 7.0_f64.powi(3) * 0.3_f64.powi(9) / 8640.0;
        assert!((motion / published - 1.0).abs() < 1e-11); // the determinant cancels by 2000
        assert_semigroup(&system, &x, 0.1, 0.2);
    }

    #[test]
    fn the_low_pass_splits_on_both_sides_of_its_short_step() {
        let low_pass = LowPass { tau: TAU, q: 1e-6 };
        let system = cwpa(Some(low_pass));
        // Without drift of k, f(a) is equal at every start: the linearisation does not move.
        let mut fixed = system;
        fixed.sensor.gauss_markov[0] = GaussMarkov::CONSTANT;
        let x = SVector::from([0.1, 0.2, 3.0, -1.0, 0.01, 0.05]);
        for (T1, T2) in [(0.1, 0.1), (0.2, 0.2), (0.2, 0.6), (1.0, 5.0)] {
            assert_semigroup(&fixed, &x, T1 * TAU, T2 * TAU);
        }
    }

    #[test]
    fn a_decaying_parameter_reaches_the_output_through_the_low_pass() {
        let system = cwpa(Some(LowPass { tau: TAU, q: 1e-6 }));
        let x = SVector::from([0.0, 0.0, 3.0, 0.0, 0.0, 0.0]);
        for T in [0.1 * TAU, 0.6 * TAU, 8.0 * TAU] {
            let Phi = step(&system, &x, T).Phi;
            let rate = 0.5;
            let carried = (libm::exp(-rate * T) - libm::exp(-T / TAU)) / (1.0 - rate * TAU);
            assert!((Phi[(OUTPUT, 4)] - 3.0 * carried).abs() < 1e-14);
        }
    }

    /// `exp(A)`: the series of `A / 64`, squared six times.
    fn exponential(A: &SMatrix<f64, 12, 12>) -> SMatrix<f64, 12, 12> {
        let (mut term, mut sum) = (SMatrix::identity(), SMatrix::identity());
        for k in 1..=16 {
            term = term * A / (64.0 * f64::from(k));
            sum += term;
        }
        (0..6).fold(sum, |power, _| power * power)
    }

    /// The linear system in one matrix exponential (Van Loan, IEEE Trans. Autom. Control 23(3), 1978).
    #[test]
    fn a_step_is_that_of_the_linear_system() {
        let system = cwpa(Some(LowPass { tau: TAU, q: 1e-6 }));
        let x = SVector::from([0.1, 0.2, 3.0, -1.0, 0.05, 0.3]);
        let r = system.sensor.output(4, &x, x[ACCELERATION]).unwrap();
        let (mut A, mut G) = (SMatrix::<f64, 6, 6>::zeros(), SMatrix::<f64, 6, 6>::zeros());
        A[(POSITION, VELOCITY)] = 1.0;
        A[(VELOCITY, ACCELERATION)] = 1.0;
        A[(OUTPUT, ACCELERATION)] = r.gradient[0] / TAU;
        A[(OUTPUT, OUTPUT)] = -1.0 / TAU;
        G[(ACCELERATION, ACCELERATION)] = 7.0;
        G[(OUTPUT, OUTPUT)] = 1e-6 / (TAU * TAU);
        let mut constant = r.value - r.gradient[0] * x[ACCELERATION];
        for (i, j, gauss_markov) in system.sensor.processes::<6>(4) {
            A[(OUTPUT, i)] = r.gradient[j] / TAU;
            A[(i, i)] = -gauss_markov.rate;
            G[(i, i)] = gauss_markov.q;
            constant -= r.gradient[j] * x[i];
        }
        for T in [0.1 * TAU, 0.6 * TAU, 4.0 * TAU] {
            let mut joint = SMatrix::<f64, 12, 12>::zeros();
            joint.fixed_view_mut::<6, 6>(0, 0).copy_from(&(-A * T));
            joint.fixed_view_mut::<6, 6>(0, 6).copy_from(&(G * T));
            joint.fixed_view_mut::<6, 6>(6, 6).copy_from(&(A.transpose() * T));
            let joint = exponential(&joint);
            let Phi = joint.fixed_view::<6, 6>(6, 6).transpose();
            let Q = Phi * joint.fixed_view::<6, 6>(0, 6);
            let mut mean = Phi * x;
            mean[OUTPUT] -= libm::expm1(-T / TAU) * constant;
            let stepped = step(&system, &x, T);
            assert!((stepped.x - mean).amax() < 1e-11);
            assert!((stepped.Phi - Phi).amax() < 1e-11);
            for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
                let error = (stepped.Q - Q)[(i, j)].abs();
                assert!(error <= 1e-9 * libm::sqrt(Q[(i, i)] * Q[(j, j)]), "{i} {j} {error}");
            }
        }
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let size = System::<6>::check(&cwpa(None));
        assert_eq!(size, Err(SetupError::Size { given: 6 }));
        let slow = cwpa(Some(LowPass { tau: 2.0, q: 0.0 }));
        assert!(matches!(System::<6>::check(&slow), Err(SetupError::Setting { .. })));
    }
}
