//! The workloads W1 to W4: 1667 Hz output, position at every second sample, three sinusoids; structured and dense.
//!
//! W1: ACI linear, first order, RK2. W2: ACI cubic, second order, RK4. W3: CWPA linear, first order. W4: CWPA cubic, second
//! order. The noise acts on the acceleration, not on the output: `q` alone, whatever the slope.
#![allow(dead_code, non_snake_case, missing_docs, clippy::inline_always)] // shared by benches and examples

use std::marker::PhantomData;

use ekf_core::dense::system::{Drive, Rates, System, Transition};
use ekf_core::dense::update::{Reading, correct, innovate};
use ekf_core::error::{DomainError, SetupError, StepError};
use ekf_core::structured::acceleration::{
    AccelerationModel, AccelerationPartials, Driven, InverseCubic, InverseLinear, WithEffects,
};
use ekf_core::structured::aci::AciBlock;
use ekf_core::structured::gauss_markov::GaussMarkovSet;
use ekf_core::structured::measurement::{ReadCubic, ReadLinear};
use ekf_core::structured::number::Number;
use ekf_core::structured::row::{Plain, Row};
use ekf_core::{
    Aci, Belief, Carrier, Consider, Cwpa, Filter, Form, GaussMarkov, Integrator, Interpolation, Order, Segment, Sensor,
};
use ekf_simd::arch::fma::Fused;
use ekf_simd::arch::row2::Row2;
use ekf_simd::arch::row4::Row4;
use ekf_simd::record::block::Block;
use ekf_simd::record::kernel::{AciWith, CwpaWith, Kernel, runner};
use ekf_simd::record::likelihood::Logarithm;
use ekf_simd::record::samples::Rows;
use ekf_simd::record::settings::Settings;
use ekf_simd::{Batch, Final, InstructionSet, Prior, run_aci};
use nalgebra::{SMatrix, SVector};
use pulp::NullaryFnOnce;
use pulp::x86::{V3, V4};

pub const DT: f64 = 1.0 / 1667.0;
pub const QV: f64 = 1e-4 * DT;
pub const JERK: f64 = 25.0;
pub const R_POSITION: f64 = 1e-12;
pub const R_OUTPUT: f64 = 1e-4;
const PARAMETERS: [f64; 4] = [1e-4, 1e-2, 1e-6, 1e-8];

/// A record of `steps + 1` samples; positions that are not measured are not numbers.
pub struct Data {
    pub u: Vec<f64>,
    pub z: Vec<f64>,
}

pub fn data(steps: usize, seed: u64) -> Data {
    let mut state = seed;
    let mut noise = move || {
        let mut sum = -6.0;
        for _ in 0..12 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum += (state >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum
    };
    let tones = [(5.0, 7.3), (3.0, 19.1), (2.0, 41.7)];
    let (mut u, mut z) = (Vec::new(), Vec::new());
    for j in 0..=steps {
        let t = j as f64 * DT;
        let a: f64 = tones.iter().map(|(a, w)| a * (w * t).sin()).sum();
        let p: f64 = tones.iter().map(|(a, w)| -a / (w * w) * (w * t).sin()).sum();
        u.push(0.05 + 1.01 * a + 1e-2 * noise());
        let read = p + 1e-6 * noise();
        z.push(if j % 2 == 0 && j > 0 { read } else { f64::NAN });
    }
    Data { u, z }
}

/// Records of several runs, row by row.
pub fn many(runs: usize, steps: usize) -> Data {
    let (mut u, mut z) = (Vec::new(), Vec::new());
    for run in 0..runs {
        let one = data(steps, 1 + run as u64);
        u.extend(one.u);
        z.extend(one.z);
    }
    Data { u, z }
}

/// `W2` over the records of several runs.
pub fn batch(data: &Data, runs: usize, path: InstructionSet, threads: usize) -> Vec<Final> {
    let sensor = Sensor { form: Form::Inverse, gauss_markov: [GaussMarkov::CONSTANT; 4] };
    let filter = Filter {
        system: Aci { sensor, q: QV, tau: 0.0 },
        interpolation: Interpolation::Linear,
        integrator: Integrator::Rk4,
        order: Order::Second,
        carrier: Carrier::Dense,
        consider: Consider::NONE,
        R_position: R_POSITION,
        R_output: R_OUTPUT,
        gate: f64::INFINITY,
    };
    let P: Vec<f64> = (0..36).map(|at| if at % 7 == 0 { variance(2, at / 7) } else { 0.0 }).collect();
    let prior = Prior { states: 6, x: &[0.0; 6], P: &P };
    let batch = Batch { dt: DT, samples: data.u.len() / runs, runs, output: &data.u, position: &data.z };
    run_aci(&filter, prior, batch, false, path, threads).expect("a batch")
}

pub fn variance(motion: usize, i: usize) -> f64 {
    match i {
        0 => 1e-10,
        1 => 1e-2,
        2 if motion == 3 => 1.0,
        i => PARAMETERS[i - motion],
    }
}

/// The noise at the acceleration.
#[derive(Debug, Clone, Copy)]
pub struct AtAcceleration<E>(pub E);

impl<V: Row, const M: usize, E: AccelerationModel<V, M>> AccelerationModel<V, M> for AtAcceleration<E> {
    type Input = E::Input;
    type Table = E::Table;

    #[inline(always)]
    fn table(&self, theta: &V, P_theta: &[V; M], order: Order) -> E::Table {
        self.0.table(theta, P_theta, order)
    }

    #[inline(always)]
    fn at(&self, table: &E::Table, input: E::Input) -> Result<AccelerationPartials<V>, DomainError> {
        let at = self.0.at(table, input)?;
        Ok(AccelerationPartials { slope: at.a.like(1.0), ..at })
    }
}

/// One structured run, to be compiled for the instructions it is given.
struct Run<'a, K, V, const M: usize, const COUNTED: bool> {
    kernel: K,
    integrator: Integrator,
    order: Order,
    data: &'a Data,
    simd: V3,
    row: PhantomData<V>,
}

#[inline(always)]
fn go<K: Kernel<V, M>, V: Row<Number: Logarithm>, const M: usize>(
    kernel: K,
    integrator: Integrator,
    order: Order,
    data: &Data,
    counted: bool,
    witness: V::Number,
    value: impl Fn(V::Number) -> f64,
) -> Vec<f64> {
    let c = |x: f64| witness.like(x);
    let settings = Settings::<V, M> {
        dt: DT,
        interpolation: Interpolation::Linear,
        integrator,
        order,
        q: c(if K::Block::MOTION == 3 { JERK } else { QV }),
        R_position: c(R_POSITION),
        R_output: c(R_OUTPUT),
        tau: 0.0,
        drift: GaussMarkovSet::new(witness, [GaussMarkov::CONSTANT; M]),
    };
    let mut runner = runner::<K, V, M>(
        witness,
        counted,
        |_| c(0.0),
        |i, j| c(if i == j { variance(K::Block::MOTION, i) } else { 0.0 }),
    );
    let record = Rows { output: &data.u, position: &data.z, witness };
    let went = kernel.process(&mut runner, &settings, &record, (0, data.u.len() - 1));
    assert!(went.is_ok() && value(runner.lowest) >= 0.0);
    (0..K::Block::MOTION + M)
        .map(|i| value(runner.block.x(i)))
        .chain((0..K::Block::MOTION + M).map(|i| value(runner.block.P(i, i))))
        .chain([value(runner.score.value())])
        .collect()
}

impl<K, V, const M: usize, const COUNTED: bool> NullaryFnOnce for Run<'_, K, V, M, COUNTED>
where
    K: Kernel<V, M>,
    V: Row<Number = Fused<V3>>,
{
    type Output = Vec<f64>;

    #[inline(always)]
    fn call(self) -> Vec<f64> {
        let witness = Fused { x: 0.0, simd: self.simd };
        go::<K, V, M>(self.kernel, self.integrator, self.order, self.data, COUNTED, witness, |x| x.x)
    }
}

/// Whether single runs are measured as the product has them on AVX-512VL. One version to a program: a second one moves
/// what the first keeps in registers.
const WIDE: bool = option_env!("WORKLOADS_FOR_AVX512VL").is_some();

fn vectorized<F: NullaryFnOnce>(simd: V3, run: F) -> F::Output {
    if WIDE { V4::try_new().expect("AVX-512VL").vectorize(run) } else { simd.vectorize(run) }
}

fn fused<K, V, const M: usize>(kernel: K, integrator: Integrator, order: Order, data: &Data, counted: bool) -> Vec<f64>
where
    K: Kernel<V, M>,
    V: Row<Number = Fused<V3>>,
{
    let simd = V3::try_new().expect("AVX2 and FMA");
    if counted {
        return vectorized(simd, Run::<K, V, M, true> { kernel, integrator, order, data, simd, row: PhantomData });
    }
    vectorized(simd, Run::<K, V, M, false> { kernel, integrator, order, data, simd, row: PhantomData })
}

/// `W1`..`W4` structured, with the processor's own instructions.
pub fn structured(workload: u32, data: &Data, counted: bool) -> Vec<f64> {
    let (first, second) = (Order::First, Order::Second);
    match workload {
        1 => {
            let kernel = AciWith { effect: AtAcceleration(InverseLinear) };
            fused::<_, Plain<Fused<V3>, 2>, 2>(kernel, Integrator::Rk2, first, data, counted)
        }
        2 => {
            let kernel = AciWith { effect: AtAcceleration(InverseCubic) };
            fused::<_, Row4<1>, 4>(kernel, Integrator::Rk4, second, data, counted)
        }
        3 => fused::<_, Row2, 2>(CwpaWith { sensor: ReadLinear }, Integrator::Exact, first, data, counted),
        _ => fused::<_, Row4<1>, 4>(CwpaWith { sensor: ReadCubic }, Integrator::Exact, second, data, counted),
    }
}

/// The same with rows in plain arrays: what any number of parameters costs.
pub fn arrays(workload: u32, data: &Data) -> Vec<f64> {
    let second = Order::Second;
    if workload == 2 {
        let kernel = AciWith { effect: AtAcceleration(InverseCubic) };
        fused::<_, Plain<Fused<V3>, 4>, 4>(kernel, Integrator::Rk4, second, data, false)
    } else {
        let kernel = CwpaWith { sensor: ReadCubic };
        fused::<_, Plain<Fused<V3>, 4>, 4>(kernel, Integrator::Exact, second, data, false)
    }
}

/// ACI with effects beside its sensor, second order, RK4, over a record whose columns are given with it.
struct Wide<'a, V, const M: usize> {
    data: &'a Data,
    columns: &'a [[f64; M]],
    simd: V3,
    row: PhantomData<V>,
}

impl<V: Row<Number = Fused<V3>>, const M: usize> NullaryFnOnce for Wide<'_, V, M> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn call(self) -> Vec<f64> {
        let witness = Fused { x: 0.0, simd: self.simd };
        let c = |x: f64| witness.like(x);
        let effect = WithEffects { rest: 0.0 };
        let mut block = AciBlock::<V, M>::new(|_| c(0.0), |i, j| c(if i == j { P_theta(i) } else { 0.0 }));
        let mut table = effect.table(&block.theta, &block.P_theta, Order::Second);
        for ((u, z), columns) in self.data.u.windows(2).zip(&self.data.z[1..]).zip(self.columns.windows(2)) {
            let given = |f: f64| Driven {
                u: c(u[0] + f * (u[1] - u[0])),
                columns: V::from_fn(witness, |i| c(columns[0][i] + f * (columns[1][i] - columns[0][i]))),
            };
            let [start, middle, end] = [0.0, 0.5, 1.0].map(|f| effect.at(&table, given(f)).expect("a sensor"));
            block.rk4(DT, c(QV), &start, &middle, &end);
            if !z.is_nan() {
                block.correct(0.0, c(R_POSITION), &block.innovate(0.0, c(*z), c(R_POSITION)));
                table = effect.table(&block.theta, &block.P_theta, Order::Second);
            }
        }
        (0..M).map(|i| block.theta.at(i).x).collect()
    }
}

/// Variance of state `i` of a model with any number of parameters.
fn P_theta(i: usize) -> f64 {
    if i < 4 { variance(2, i) } else { 1e-6 }
}

fn wide<V: Row<Number = Fused<V3>>, const M: usize>(data: &Data) -> impl Fn() -> Vec<f64> {
    let column = |u: f64, i: usize| if i < 2 { 0.0 } else { (u * (i as f64 - 1.0)).sin() };
    let columns: Vec<[f64; M]> = data.u.iter().map(|u| std::array::from_fn(|i| column(*u, i))).collect();
    let simd = V3::try_new().expect("AVX2 and FMA");
    move || simd.vectorize(Wide::<V, M> { data, columns: &columns, simd, row: PhantomData })
}

/// Numbers of parameters whose cost is measured.
pub const WIDTHS: [usize; 5] = [2, 4, 8, 12, 16];

/// RK4 with `parameters` parameters, two of the sensor and one for each further effect.
pub fn with_effects(parameters: usize, data: &Data) -> Box<dyn Fn() -> Vec<f64> + '_> {
    match parameters {
        2 => Box::new(wide::<Row2, 2>(data)),
        4 => Box::new(wide::<Row4<1>, 4>(data)),
        8 => Box::new(wide::<Row4<2>, 8>(data)),
        12 => Box::new(wide::<Row4<3>, 12>(data)),
        _ => Box::new(wide::<Row4<4>, 16>(data)),
    }
}

/// The same on plain numbers, nothing fused.
pub fn portable(workload: u32, data: &Data) -> Vec<f64> {
    let (first, second) = (Order::First, Order::Second);
    let id = |x: f64| x;
    match workload {
        1 => {
            let kernel = AciWith { effect: AtAcceleration(InverseLinear) };
            go::<_, Plain<f64, 2>, 2>(kernel, Integrator::Rk2, first, data, false, 0.0, id)
        }
        2 => {
            let kernel = AciWith { effect: AtAcceleration(InverseCubic) };
            go::<_, Plain<f64, 4>, 4>(kernel, Integrator::Rk4, second, data, false, 0.0, id)
        }
        3 => {
            let kernel = CwpaWith { sensor: ReadLinear };
            go::<_, Plain<f64, 2>, 2>(kernel, Integrator::Exact, first, data, false, 0.0, id)
        }
        _ => {
            let kernel = CwpaWith { sensor: ReadCubic };
            go::<_, Plain<f64, 4>, 4>(kernel, Integrator::Exact, second, data, false, 0.0, id)
        }
    }
}

/// The dense twin with the noise at the acceleration.
#[derive(Clone, Copy)]
struct DenseAtAcceleration(Aci);

impl<const N: usize> System<N> for DenseAtAcceleration {
    const DRIVEN: bool = true;

    fn check(&self) -> Result<(), SetupError> {
        System::<N>::check(&self.0)
    }

    fn rates(&self, x: &SVector<f64, N>, P: &SMatrix<f64, N, N>, u: f64, order: Order) -> Result<Rates<N>, StepError> {
        let mut rates = self.0.rates(x, P, u, order)?;
        rates.DQDt[(1, 1)] = self.0.q;
        Ok(rates)
    }

    fn transition(
        &self,
        x: &SVector<f64, N>,
        P: &SMatrix<f64, N, N>,
        drive: &Drive,
        order: Order,
    ) -> Result<Transition<N>, StepError> {
        self.0.transition(x, P, drive, order)
    }

    fn position(&self, x: &SVector<f64, N>) -> Reading<N> {
        self.0.position(x)
    }

    fn output(
        &self,
        x: &SVector<f64, N>,
        P: &SMatrix<f64, N, N>,
        order: Order,
    ) -> Result<Option<Reading<N>>, StepError> {
        self.0.output(x, P, order)
    }
}

fn dense_run<S: System<N>, const N: usize>(system: &S, integrator: Integrator, order: Order, data: &Data) -> Vec<f64> {
    let motion = if S::DRIVEN { 2 } else { 3 };
    let diagonal = SVector::<f64, N>::from_fn(|i, _| variance(motion, i));
    let mut belief = Belief { x: SVector::zeros(), P: SMatrix::from_diagonal(&diagonal) };
    for j in 0..data.u.len() - 1 {
        let (u0, u1) = (data.u[j], data.u[j + 1]);
        let drive = Drive::held(Segment { c: [u0, (u1 - u0) / DT, 0.0, 0.0] }, 0.0, DT);
        belief = integrator.step(system, &belief, &drive, order).expect("a covariance").0;
        if let Some(reading) = system.output(&belief.x, &belief.P, order).expect("a sensor") {
            let (innovation, gain) = innovate(&belief, &reading, R_OUTPUT, u1).expect("S");
            belief = correct(&belief, &reading, R_OUTPUT, &innovation, &gain);
        }
        if !data.z[j + 1].is_nan() {
            let reading = system.position(&belief.x);
            let (innovation, gain) = innovate(&belief, &reading, R_POSITION, data.z[j + 1]).expect("S");
            belief = correct(&belief, &reading, R_POSITION, &innovation, &gain);
        }
    }
    belief.x.iter().chain(belief.P.diagonal().iter()).copied().collect()
}

/// `W1`..`W4` with the dense nalgebra filters.
pub fn dense(workload: u32, data: &Data) -> Vec<f64> {
    let gauss_markov = [GaussMarkov::CONSTANT; 4];
    let aci = DenseAtAcceleration(Aci { sensor: Sensor { form: Form::Inverse, gauss_markov }, q: QV, tau: 0.0 });
    let cwpa = Cwpa { sensor: Sensor { form: Form::Forward, gauss_markov }, q: JERK, low_pass: None };
    match workload {
        1 => dense_run::<_, 4>(&aci, Integrator::Rk2, Order::First, data),
        2 => dense_run::<_, 6>(&aci, Integrator::Rk4, Order::Second, data),
        3 => dense_run::<_, 5>(&cwpa, Integrator::Exact, Order::First, data),
        _ => dense_run::<_, 7>(&cwpa, Integrator::Exact, Order::Second, data),
    }
}

/// Largest difference of two runs' states, in sigma of the second.
pub fn apart(one: &[f64], other: &[f64]) -> f64 {
    let states = other.len() / 2;
    (0..states).map(|i| (one[i] - other[i]).abs() / other[states + i].sqrt()).fold(0.0, f64::max)
}
