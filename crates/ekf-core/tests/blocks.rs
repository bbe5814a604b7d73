//! Structured kernels against the dense filters: the same belief after a stretch with missing samples.
#![allow(non_snake_case)] // as in the crate

mod common;

use common::{DT, Draw, cases, distance, drawn_processes, integrators, orders, prior, read};
use ekf_core::dense::system::{Drive, Rates, System, Transition};
use ekf_core::dense::update::{Reading, correct, innovate};
use ekf_core::structured::acceleration::{
    AccelerationModel, Driven, ForwardCubic, ForwardLinear, InverseCubic, InverseLinear, WithEffects,
};
use ekf_core::structured::aci::AciBlock;
use ekf_core::structured::aci_step::StepInput;
use ekf_core::structured::cwpa::CwpaBlock;
use ekf_core::structured::gauss_markov::GaussMarkovSet;
use ekf_core::structured::measurement::{OutputModel, ReadCubic, ReadInverse, ReadLinear};
use ekf_core::structured::row::Plain;
use ekf_core::{
    Aci, Belief, Cwpa, DomainError, Engine, Filter, Form, GaussMarkov, InBlocks, Integrator, Order, RunError, Samples,
    Segment, Sensor, SetupError, StepError,
};
use nalgebra::{RowSVector, SMatrix, SVector};
use proptest::prelude::*;

/// State in sigma, covariance in `sigma_i sigma_j`.
const TOLERANCE: f64 = 1e-10;
const STEPS: usize = 60;
const R: f64 = 1e-12;
const MEAN: [f64; 4] = [0.01, 0.05, -1e-3, 1e-4];
const SIGMA: [f64; 4] = [1e-2, 0.1, 1e-3, 1e-4];

#[derive(Debug, Clone, Copy)]
struct Choice {
    seed: u64,
    integrator: Integrator,
    order: Order,
    gauss_markov: u8,
    tau: f64,
}

fn choices() -> impl Strategy<Value = Choice> {
    (any::<u64>(), integrators(), orders(), 0..3u8, prop_oneof![Just(0.0), Just(1e-3)])
        .prop_map(|(seed, integrator, order, gauss_markov, tau)| Choice { seed, integrator, order, gauss_markov, tau })
}

fn four(draw: &mut Draw, kind: u8) -> [GaussMarkov; 4] {
    drawn_processes(draw, kind, &SIGMA).try_into().unwrap()
}

fn aci_agrees<const N: usize, const M: usize, E>(form: Form, effect: E, choice: Choice)
where
    E: AccelerationModel<Plain<f64, M>, M, Input = f64>,
{
    let mut draw = Draw(choice.seed);
    let gauss_markov = four(&mut draw, choice.gauss_markov);
    let q = 1e-6;
    let system = Aci { sensor: Sensor { form, gauss_markov }, q, tau: choice.tau };
    let pick = |head: [f64; 2], tail: [f64; 4]| core::array::from_fn(|i| if i < 2 { head[i] } else { tail[i - 2] });
    let mut dense = prior::<N>(&mut draw, pick([1e-5, 3e-3], SIGMA), pick([0.0, 0.1], MEAN));
    let mut block = AciBlock::<Plain<f64, M>, M>::new(|i| dense.x[i], |i, j| dense.P[(i, j)]);
    let drift = GaussMarkovSet::new(0.0, core::array::from_fn(|i| gauss_markov[i]));
    for _ in 0..STEPS {
        let dt = DT * (1.0 + 0.5 * draw.next());
        let segment = Segment { c: [8.0 * draw.next(), 500.0 * draw.next(), 0.0, 0.0] };
        let drive = Drive::held(segment, 0.0, dt);
        dense = choice.integrator.step(&system, &dense, &drive, choice.order).unwrap().0;
        let step_input = StepInput { model: effect, order: choice.order, input: |s| segment.value(s), dt };
        block.step(choice.integrator, q, &drift, &step_input).unwrap();
        if draw.next() > 0.0 {
            let z = dense.x[0] + choice.tau * dense.x[1] + 1e-6 * draw.next();
            dense = read(&system, &dense, R, z);
            block.correct(choice.tau, R, &block.innovate(choice.tau, z, R));
        }
    }
    let off = distance(&dense, |i| block.x(i), |i, j| block.P(i, j));
    assert!(off < TOLERANCE, "{off}");
    assert!(block.checked().is_ok());
}

fn cwpa_agrees<const N: usize, const M: usize, O>(form: Form, sensor: &O, choice: Choice)
where
    O: OutputModel<Plain<f64, M>>,
{
    let mut draw = Draw(choice.seed);
    let gauss_markov = four(&mut draw, choice.gauss_markov);
    let q = 25.0;
    let system = Cwpa { sensor: Sensor { form, gauss_markov }, q, low_pass: None };
    let pick = |head: [f64; 3], tail: [f64; 4]| core::array::from_fn(|i| if i < 3 { head[i] } else { tail[i - 3] });
    let mut dense = prior::<N>(&mut draw, pick([1e-5, 3e-3, 0.5], SIGMA), pick([0.0, 0.1, 3.0], MEAN));
    let mut block = CwpaBlock::<Plain<f64, M>, M>::new(|i| dense.x[i], |i, j| dense.P[(i, j)]);
    let drift = GaussMarkovSet::new(0.0, core::array::from_fn(|i| gauss_markov[i]));
    for _ in 0..STEPS {
        let dt = DT * (1.0 + 0.5 * draw.next());
        let drive = Drive::held(Segment { c: [0.0; 4] }, 0.0, dt);
        block.step(choice.integrator, dt, q, &drift);
        match choice.integrator.step(&system, &dense, &drive, choice.order) {
            Ok((stepped, _)) => dense = stepped,
            // RK2 leaves out two powers of the step: where one kernel sees that it failed, so does the other.
            Err(lost) => {
                assert_eq!(choice.integrator, Integrator::Rk2);
                assert_eq!(block.checked().unwrap_err().name(), lost.name());
                return;
            }
        }
        assert!(block.checked().is_ok());
        if draw.next() > -0.8 {
            let reading = System::<N>::output(&system, &dense.x, &dense.P, choice.order).unwrap().unwrap();
            let z = reading.expected + 1e-2 * draw.next();
            let (innovation, gain) = innovate(&dense, &reading, 1e-4, z).unwrap();
            dense = correct(&dense, &reading, 1e-4, &innovation, &gain);
            let taken = block.innovate_output(sensor, choice.order, z, 1e-4).unwrap();
            block.correct_output(&taken);
        }
        if draw.next() > 0.0 {
            let z = dense.x[0] + 1e-6 * draw.next();
            dense = read(&system, &dense, R, z);
            block.correct_position(R, &block.innovate_position(z, R));
        }
    }
    let off = distance(&dense, |i| block.x(i), |i, j| block.P(i, j));
    assert!(off < TOLERANCE, "{off}");
}

/// Effects as columns, for the dense twin: `a = (u - K0 - sum c_j e_j(u)) / (1 + k) - rest`, constant parameters.
///
/// The columns are functions of `u`, which names the instant while `u` is a line.
#[derive(Clone, Copy)]
struct Dense {
    q: f64,
}

const REST: f64 = 9.8;

fn column(j: usize, u: f64) -> f64 {
    3.0 * (j as f64 + 0.1 * u).sin()
}

impl<const N: usize> System<N> for Dense {
    const DRIVEN: bool = true;

    fn check(&self) -> Result<(), SetupError> {
        Ok(())
    }

    fn rates(&self, x: &SVector<f64, N>, P: &SMatrix<f64, N, N>, u: f64, order: Order) -> Result<Rates<N>, StepError> {
        let e = SVector::<f64, N>::from_fn(|j, _| if j < 4 { 0.0 } else { column(j, u) });
        let s = 1.0 + x[2];
        let a = (u - x[3] - e.dot(x)) / s;
        let mut g = -e / s;
        g[2] = -a / s;
        g[3] = -1.0 / s;
        // 1/2 tr(a_xx P): only partials with k are not zero, a_kk = 2 a / s^2, a_k,K0 = 1 / s^2, a_k,j = e_j / s^2.
        let curvature_mean = (a * P[(2, 2)] + P[(2, 3)] + (P.row(2) * e)[0]) / (s * s);
        let mut f = SVector::zeros();
        let mut F = SMatrix::<f64, N, N>::zeros();
        let mut DQDt = SMatrix::zeros();
        f[0] = x[1];
        f[1] = a - REST + if order == Order::Second { curvature_mean } else { 0.0 };
        F[(0, 1)] = 1.0;
        F.set_row(1, &g.transpose());
        DQDt[(1, 1)] = self.q / (s * s);
        Ok(Rates { f, F, DQDt })
    }

    fn transition(
        &self,
        _: &SVector<f64, N>,
        _: &SMatrix<f64, N, N>,
        _: &Drive,
        _: Order,
    ) -> Result<Transition<N>, StepError> {
        unreachable!("the exact step is compared with many short ones")
    }

    fn position(&self, x: &SVector<f64, N>) -> Reading<N> {
        let mut H = RowSVector::zeros();
        H[0] = 1.0;
        Reading { expected: x[0], H, curvature_variance: 0.0 }
    }

    fn output(&self, _: &SVector<f64, N>, _: &SMatrix<f64, N, N>, _: Order) -> Result<Option<Reading<N>>, StepError> {
        Ok(None)
    }
}
fn columns_agree<const N: usize, const M: usize>(choice: Choice) {
    let mut draw = Draw(choice.seed);
    let system = Dense { q: 1e-6 };
    let sigma = core::array::from_fn(|i| [1e-5, 3e-3, 1e-2, 0.1].get(i).copied().unwrap_or(1e-3));
    let mut dense = prior::<N>(&mut draw, sigma, [0.0; N]);
    let mut block = AciBlock::<Plain<f64, M>, M>::new(|i| dense.x[i], |i, j| dense.P[(i, j)]);
    let drift = GaussMarkovSet::new(0.0, [GaussMarkov::CONSTANT; M]);
    // The exact step has no dense twin here: Runge-Kutta in 32 pieces leaves 1e-6 of its error.
    let (twin, pieces) = match choice.integrator {
        Integrator::Exact => (Integrator::Rk4, 32),
        other => (other, 1),
    };
    for _ in 0..STEPS {
        let segment = Segment { c: [8.0 * draw.next(), 500.0 * draw.next(), 0.0, 0.0] };
        for piece in 0..pieces {
            let at = |i: i32| DT * f64::from(i) / f64::from(pieces);
            let drive = Drive::held(segment, at(piece), at(piece + 1));
            dense = twin.step(&system, &dense, &drive, choice.order).unwrap().0;
        }
        let input = |s: f64| {
            let u = segment.value(s);
            let columns = Plain(core::array::from_fn(|i| if i < 2 { 0.0 } else { column(i + 2, u) }));
            Driven { u, columns }
        };
        let step_input = StepInput { model: WithEffects { rest: REST }, order: choice.order, input, dt: DT };
        block.step(choice.integrator, system.q, &drift, &step_input).unwrap();
        if draw.next() > 0.0 {
            // An encoder that half of the effects act on, as much as position is unknown; behind a low-pass or not.
            let mut H =
                RowSVector::<f64, N>::from_fn(|_, i| if i > 3 && i % 2 == 0 { 1e-2 * draw.next() } else { 0.0 });
            (H[0], H[1]) = (1.0, choice.tau);
            let reading = Reading { expected: (H * dense.x)[0], H, curvature_variance: 0.0 };
            let z = reading.expected + 1e-6 * draw.next();
            let (innovation, gain) = innovate(&dense, &reading, R, z).unwrap();
            dense = correct(&dense, &reading, R, &innovation, &gain);
            let b = Plain(core::array::from_fn(|i| H[i + 2]));
            let (innovation, along) = block.innovate_with_effects(choice.tau, &b, z, R);
            block.correct_with(&along, &innovation);
        }
    }
    let off = distance(&dense, |i| block.x(i), |i, j| block.P(i, j));
    assert!(off < TOLERANCE, "{off}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(cases()) })]

    #[test]
    fn effects_enter_as_columns(choice in choices()) {
        columns_agree::<5, 3>(choice);
        columns_agree::<7, 5>(choice);
        columns_agree::<8, 6>(choice);
        columns_agree::<10, 8>(choice);
    }

    #[test]
    fn aci_equals_its_dense_twin(choice in choices()) {
        aci_agrees::<4, 2, _>(Form::Inverse, InverseLinear, choice);
        aci_agrees::<6, 4, _>(Form::Inverse, InverseCubic, choice);
        aci_agrees::<4, 2, _>(Form::Forward, ForwardLinear, choice);
        aci_agrees::<6, 4, _>(Form::Forward, ForwardCubic, choice);
    }

    #[test]
    fn cwpa_equals_its_dense_twin(choice in choices()) {
        cwpa_agrees::<5, 2, _>(Form::Forward, &ReadLinear, choice);
        cwpa_agrees::<7, 4, _>(Form::Forward, &ReadCubic, choice);
        cwpa_agrees::<5, 2, _>(Form::Inverse, &ReadInverse, choice);
        cwpa_agrees::<7, 4, _>(Form::Inverse, &ReadInverse, choice);
    }
}

#[test]
fn an_output_that_falls_with_the_acceleration_is_refused_in_blocks_as_on_matrices() {
    let filter = Filter::new(Aci { sensor: Sensor::constant(Form::Forward), q: 1e-6, tau: 0.0 }, R, 0.0);
    let prior = Belief::independent([0.0, 0.0, -2.0, 0.0], [1e-3, 0.1, 0.05, 0.5]);
    let samples = Samples { t: &[0.0, DT], y: &[0.0, 0.0] };
    let error = StepError::Domain(DomainError::Slope { slope: -1.0 });
    let refused = Some(RunError::Step { event: 2, t: DT, error });
    assert_eq!(filter.run(&prior, samples, samples, |_, _| ()).err(), refused);
    assert_eq!(Engine::<4>::run(&InBlocks(filter), &prior, samples, samples, |_, _| ()).err(), refused);
}
