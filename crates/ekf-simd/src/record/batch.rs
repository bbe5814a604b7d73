//! Many runs of one filter: lanes side by side, groups of lanes over threads.
#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code, unused_imports))] // elsewhere every run goes portable

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use ekf_core::dense::belief::{check_covariance, check_mean};
use ekf_core::dense::system::System;
use ekf_core::error::{SetupError, StepError};
use ekf_core::structured::acceleration::{ForwardCubic, ForwardLinear, InverseCubic, InverseLinear};
use ekf_core::structured::measurement::{ReadCubic, ReadInverse, ReadLinear};
use ekf_core::structured::number::Number;
use ekf_core::structured::row::{Plain, Row};
use ekf_core::{Aci, Channel, Cwpa, Filter, Form};
#[cfg(target_arch = "x86_64")]
use pulp::x86::{V3, V4};
use pulp::{NullaryFnOnce, Simd, WithSimd};

#[cfg(target_arch = "x86_64")]
use crate::arch::fma::Fused;
use crate::arch::instruction_set::InstructionSet;
use crate::arch::lanes::Lanes;
#[cfg(target_arch = "x86_64")]
use crate::arch::row2::Row2;
#[cfg(target_arch = "x86_64")]
use crate::arch::row4::Row4;
use crate::record::block::Block;
use crate::record::kernel::{AciWith, CwpaWith, Kernel, runner};
use crate::record::likelihood::Logarithm;
use crate::record::samples::{LaneWindow, Rows, WINDOW};
use crate::record::settings::{Dynamics, Settings};

/// Uniform records of several runs, one row per run, samples `dt` apart.
#[derive(Debug, Clone, Copy)]
pub struct Batch<'a> {
    /// Time between samples, s.
    pub dt: f64,
    /// Samples of a run.
    pub samples: usize,
    /// Runs.
    pub runs: usize,
    /// Output, m/s^2: one row per run, or one for all; not a number where missing (CWPA).
    pub output: &'a [f64],
    /// Position, m: likewise; not a number where missing.
    pub position: &'a [f64],
}

/// Priors at sample 0: one per run, or one for all.
#[derive(Debug, Clone, Copy)]
pub struct Prior<'a> {
    /// Number of states.
    pub states: usize,
    /// Means, one row per run.
    pub x: &'a [f64],
    /// Covariances, `states^2` numbers per run.
    pub P: &'a [f64],
}

/// Where one run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Final {
    /// Mean.
    pub x: Vec<f64>,
    /// Covariance by rows.
    pub P: Vec<f64>,
    /// Log-likelihood of all readings; zero if it is not computed.
    pub log_likelihood: f64,
    /// Why the numbers are not to be used.
    pub fault: Option<StepError>,
}

/// A row of `width` numbers for every run, or one for all.
fn row(all: &[f64], width: usize, run: usize) -> &[f64] {
    if all.len() == width { all } else { &all[run * width..(run + 1) * width] }
}

/// Index of the first unusable value.
fn first(values: &[f64], unusable: impl Fn(f64) -> bool) -> Option<usize> {
    // Chunks without an early exit compile to vector instructions.
    let any = |stretch: &[f64]| stretch.iter().fold(false, |any, x| any | unusable(*x));
    let stretch = values.chunks(WINDOW).position(any)?;
    (stretch * WINDOW..values.len()).find(|&index| unusable(values[index]))
}

impl Batch<'_> {
    fn check(&self, driven: bool) -> Result<(), SetupError> {
        for (channel, values, needed) in [(Channel::Output, self.output, 2), (Channel::Position, self.position, 1)] {
            let (times, count) = (self.samples, values.len());
            if times < needed {
                return Err(SetupError::TooFew { channel, count: times, needed });
            }
            if count != times && count != times * self.runs {
                return Err(SetupError::Lengths { channel, times: times * self.runs, values: count });
            }
            let index = if driven && channel == Channel::Output {
                first(values, |x| !x.is_finite())
            } else {
                first(values, f64::is_infinite)
            };
            if let Some(index) = index {
                return Err(SetupError::NotFinite { channel, index });
            }
        }
        if !(self.dt > 0.0 && self.dt.is_finite()) {
            return Err(SetupError::Setting { name: "dt", value: self.dt });
        }
        Ok(())
    }
}

impl Prior<'_> {
    fn check(&self, runs: usize) -> Result<(), SetupError> {
        let given = self.states;
        let fits = |length: usize, width: usize| length == width || length == width * runs;
        if !fits(self.x.len(), given) || !fits(self.P.len(), given * given) {
            return Err(SetupError::Size { given });
        }
        Ok(())
    }
}

/// What a worker needs for any group of runs.
struct Job<'a> {
    batch: Batch<'a>,
    prior: Prior<'a>,
    filter: Filter<Dynamics<'a>>,
    counted: bool,
}

impl Job<'_> {
    fn x(&self, run: usize, i: usize) -> f64 {
        row(self.prior.x, self.prior.states, run)[i]
    }

    fn P(&self, run: usize, i: usize, j: usize) -> f64 {
        let N = self.prior.states;
        row(self.prior.P, N * N, run)[i * N + j]
    }

    fn rows(&self, run: usize) -> (&[f64], &[f64]) {
        let width = self.batch.samples;
        (row(self.batch.output, width, run), row(self.batch.position, width, run))
    }

    /// Why a belief on the way, or the lowest variance of the motion so far, cannot be used.
    fn fault(
        &self,
        motion: usize,
        lowest: f64,
        x: impl Fn(usize) -> f64,
        P: impl Fn(usize, usize) -> f64,
    ) -> Option<StepError> {
        let N = self.prior.states;
        if lowest < 0.0 {
            let state = (0..motion).min_by(|&i, &j| P(i, i).total_cmp(&P(j, j))).unwrap_or_default();
            return Some(StepError::Variance { state, variance: lowest });
        }
        check_mean(N, x).and_then(|()| check_covariance(N, P)).err()
    }

    fn ended(&self, x: impl Fn(usize) -> f64, P: impl Fn(usize, usize) -> f64, log_likelihood: f64) -> Final {
        let N = self.prior.states;
        // The likelihood is not a number where an innovation variance was negative.
        let unlikely =
            (self.counted && !log_likelihood.is_finite()).then_some(StepError::InnovationVariance { s: f64::NAN });
        let fault = check_mean(N, &x).and_then(|()| check_covariance(N, &P)).err().or(unlikely);
        let P = (0..N * N).map(|at| P(at / N, at % N)).collect();
        let log_likelihood = if self.counted { log_likelihood } else { 0.0 };
        Final { x: (0..N).map(x).collect(), P, log_likelihood, fault }
    }
}

/// One run in any arithmetic of one number.
#[inline(always)]
fn run_single<K: Kernel<V, M>, V: Row<Number: Logarithm>, const M: usize>(
    job: &Job<'_>,
    kernel: K,
    run: usize,
    witness: V::Number,
    value: impl Fn(V::Number) -> f64,
) -> Final {
    let settings = Settings::<V, M>::of(&job.filter, job.batch.dt, witness);
    let mut runner =
        runner::<K, V, M>(witness, job.counted, |i| witness.like(job.x(run, i)), |i, j| witness.like(job.P(run, i, j)));
    let (output, position) = job.rows(run);
    let record = Rows { output, position, witness };
    let mut went = kernel.start(&mut runner, &settings, &record);
    let mut fault = None;
    let mut from = 0;
    while from + 1 < job.batch.samples && went.is_ok() && fault.is_none() {
        let to = (from + WINDOW).min(job.batch.samples - 1);
        went = kernel.process(&mut runner, &settings, &record, (from, to));
        let block = &runner.block;
        let lowest = value(runner.lowest);
        fault = job.fault(K::Block::MOTION, lowest, |i| value(block.x(i)), |i, j| value(block.P(i, j)));
        from = to;
    }
    let block = &runner.block;
    let mut ended = job.ended(|i| value(block.x(i)), |i, j| value(block.P(i, j)), value(runner.score.value()));
    ended.fault = went.err().map(StepError::from).or(fault).or(ended.fault);
    ended
}

/// A group of runs side by side, as many as `S` has lanes; the last run fills what is left over.
#[inline(always)]
fn in_lanes<K: Kernel<Plain<Lanes<S>, M>, M>, S: Simd, const M: usize>(
    job: &Job<'_>,
    kernel: K,
    first: usize,
    simd: S,
) -> Vec<Final> {
    let count = Lanes::<S>::COUNT;
    let witness = Lanes::from_fn(simd, |_| 0.0);
    let run = |lane: usize| (first + lane).min(job.batch.runs - 1);
    let settings = Settings::<Plain<Lanes<S>, M>, M>::of(&job.filter, job.batch.dt, witness);
    let mut runner = runner::<K, _, M>(
        witness,
        job.counted,
        |i| Lanes::from_fn(simd, |lane| job.x(run(lane), i)),
        |i, j| Lanes::from_fn(simd, |lane| job.P(run(lane), i, j)),
    );
    let (output, position): (Vec<_>, Vec<_>) = (0..count).map(|lane| job.rows(run(lane))).unzip();
    let mut window = LaneWindow::new(simd);
    let N = job.prior.states;
    let mut P = vec![witness; N * N];
    let mut faults: Vec<Option<StepError>> = vec![None; count];
    let (mut from, mut begun) = (0, false);
    while from + 1 < job.batch.samples {
        let to = (from + WINDOW).min(job.batch.samples - 1);
        window.transpose(&output, &position, (from, to));
        let mut went = if begun { Ok(()) } else { kernel.start(&mut runner, &settings, &window) };
        begun = true;
        went = went.and_then(|()| kernel.process(&mut runner, &settings, &window, (from, to)));
        // Every covariance is taken out once, not once per lane.
        for (i, row) in P.chunks_mut(N).enumerate() {
            for (j, at) in row.iter_mut().enumerate().take(i + 1) {
                *at = runner.block.P(i, j);
            }
        }
        for (lane, fault) in faults.iter_mut().enumerate() {
            let (x, lowest) = (|i| runner.block.x(i).lane(lane), runner.lowest.lane(lane));
            *fault = fault
                .or_else(|| went.err().map(StepError::from))
                .or_else(|| job.fault(K::Block::MOTION, lowest, x, |i, j| P[i * N + j].lane(lane)));
        }
        from = to;
    }
    let (block, likelihood) = (&runner.block, runner.score.value());
    (0..count)
        .map(|lane| {
            let mut ended =
                job.ended(|i| block.x(i).lane(lane), |i, j| block.P(i, j).lane(lane), likelihood.lane(lane));
            ended.fault = faults[lane].or(ended.fault);
            ended
        })
        .collect()
}

/// A kernel that runs in lanes, and alone with or without the vector unit.
trait Dispatch<const M: usize>: Copy + Send + Sync {
    fn in_lanes<S: Simd>(self, job: &Job<'_>, first: usize, simd: S) -> Vec<Final>;
    #[cfg(target_arch = "x86_64")]
    fn fused(self, job: &Job<'_>, run: usize, simd: V3) -> Final;
    fn portable(self, job: &Job<'_>, run: usize) -> Final;
}

macro_rules! dispatch_kernels {
    ($($kernel:ty, $M:literal, $row:ty;)*) => {
        $(impl Dispatch<$M> for $kernel {
            #[inline(always)]
            fn in_lanes<S: Simd>(self, job: &Job<'_>, first: usize, simd: S) -> Vec<Final> {
                in_lanes::<Self, S, $M>(job, self, first, simd)
            }

            #[cfg(target_arch = "x86_64")]
            #[inline(always)]
            fn fused(self, job: &Job<'_>, run: usize, simd: V3) -> Final {
                run_single::<Self, $row, $M>(job, self, run, Fused { x: 0.0, simd }, |x| x.x)
            }

            fn portable(self, job: &Job<'_>, run: usize) -> Final {
                run_single::<Self, Plain<f64, $M>, $M>(job, self, run, 0.0, |x| x)
            }
        })*
    };
}

dispatch_kernels!(
    AciWith<InverseLinear>, 2, Plain<Fused<V3>, 2>;
    AciWith<InverseCubic>, 4, Row4<1>;
    AciWith<ForwardLinear>, 2, Plain<Fused<V3>, 2>;
    CwpaWith<ReadLinear>, 2, Row2;
    CwpaWith<ReadCubic>, 4, Row4<1>;
);

/// One group, to be compiled for the instructions it is given.
struct Group<'a, K, const M: usize> {
    job: &'a Job<'a>,
    kernel: K,
    first: usize,
}

impl<K: Dispatch<M>, const M: usize> WithSimd for Group<'_, K, M> {
    type Output = Vec<Final>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<Final> {
        self.kernel.in_lanes(self.job, self.first, simd)
    }
}

#[cfg(target_arch = "x86_64")]
struct SingleRun<'a, K, const M: usize>(V3, Group<'a, K, M>);

#[cfg(target_arch = "x86_64")]
impl<K: Dispatch<M>, const M: usize> NullaryFnOnce for SingleRun<'_, K, M> {
    type Output = Vec<Final>;

    #[inline(always)]
    fn call(self) -> Vec<Final> {
        let Self(simd, Group { job, kernel, first }) = self;
        vec![kernel.fused(job, first, simd)]
    }
}

fn group<K: Dispatch<M>, const M: usize>(job: &Job<'_>, kernel: K, path: InstructionSet, first: usize) -> Vec<Final> {
    match path {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Fused => {
            // The same operations in the same order; with twice the registers less goes through the stack.
            if let Some(simd) = V4::try_new() {
                return simd.vectorize(SingleRun::<K, M>(*simd, Group { job, kernel, first }));
            }
            if let Some(simd) = V3::try_new() {
                return simd.vectorize(SingleRun::<K, M>(simd, Group { job, kernel, first }));
            }
        }
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Four => {
            if let Some(simd) = V3::try_new() {
                return Simd::vectorize(simd, Group::<K, M> { job, kernel, first });
            }
        }
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Eight => {
            if let Some(simd) = V4::try_new() {
                return Simd::vectorize(simd, Group::<K, M> { job, kernel, first });
            }
        }
        _ => {}
    }
    vec![kernel.portable(job, first)]
}

/// All groups over `threads` workers; the order of the answer is that of the runs.
fn over_threads(runs: usize, width: usize, threads: usize, one: impl Fn(usize) -> Vec<Final> + Sync) -> Vec<Final> {
    let groups = runs.div_ceil(width);
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::with_capacity(groups));
    let work = || {
        loop {
            let at = next.fetch_add(1, Ordering::Relaxed);
            if at >= groups {
                return;
            }
            let finals = one(at * width);
            done.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push((at, finals));
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.clamp(1, groups.max(1)) {
            scope.spawn(work);
        }
        work();
    });
    let mut done = done.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    done.sort_unstable_by_key(|(at, _)| *at);
    let mut finals: Vec<Final> = done.into_iter().flat_map(|(_, finals)| finals).collect();
    finals.truncate(runs);
    finals
}

fn dispatch<K: Dispatch<M>, const M: usize>(
    job: &Job<'_>,
    kernel: K,
    path: InstructionSet,
    threads: usize,
) -> Vec<Final> {
    let path = match path.or_narrower() {
        InstructionSet::Four | InstructionSet::Eight if job.batch.runs == 1 => InstructionSet::Fused,
        path => path,
    };
    over_threads(job.batch.runs, path.lanes(), threads, |first| group::<K, M>(job, kernel, path, first))
}

fn portable_runs<K, const M: usize>(job: &Job<'_>, kernel: K, threads: usize) -> Vec<Final>
where
    K: Kernel<Plain<f64, M>, M> + Sync,
{
    over_threads(job.batch.runs, 1, threads, |run| {
        vec![run_single::<K, Plain<f64, M>, M>(job, kernel, run, 0.0, |x| x)]
    })
}

/// Runs ACI over all records; `counted` asks for the log-likelihood.
///
/// The forward cubic sensor must be solved at every instant, so it runs alone; all others run in lanes. Gates and the
/// factored carrier have no place here, and consider states are refused.
///
/// # Errors
/// [`SetupError`] for shapes and values that cannot be used.
pub fn run_aci(
    filter: &Filter<Aci>,
    prior: Prior<'_>,
    batch: Batch<'_>,
    counted: bool,
    path: InstructionSet,
    threads: usize,
) -> Result<Vec<Final>, SetupError> {
    filter.check()?;
    System::<4>::check(&filter.system)?; // its numbers; how many states there are is seen below
    batch.check(true)?;
    prior.check(batch.runs)?;
    filter.consider.refused()?;
    let Aci { sensor, q, tau } = filter.system;
    let dynamics = Dynamics { q, tau, gauss_markov: &sensor.gauss_markov };
    let job = Job { batch, prior, filter: filter.with_system(dynamics), counted };
    match (sensor.form, prior.states) {
        (Form::Inverse, 4) => Ok(dispatch::<_, 2>(&job, AciWith { effect: InverseLinear }, path, threads)),
        (Form::Inverse, 6) => Ok(dispatch::<_, 4>(&job, AciWith { effect: InverseCubic }, path, threads)),
        (Form::Forward, 4) => Ok(dispatch::<_, 2>(&job, AciWith { effect: ForwardLinear }, path, threads)),
        (Form::Forward, 6) => Ok(portable_runs::<_, 4>(&job, AciWith { effect: ForwardCubic }, threads)),
        (_, given) => Err(SetupError::Size { given }),
    }
}

/// Runs CWPA without a low-pass over all records; the inverse sensor runs alone.
///
/// # Errors
/// [`SetupError`] for shapes and values that cannot be used.
pub fn run_cwpa(
    filter: &Filter<Cwpa>,
    prior: Prior<'_>,
    batch: Batch<'_>,
    counted: bool,
    path: InstructionSet,
    threads: usize,
) -> Result<Vec<Final>, SetupError> {
    filter.check()?;
    batch.check(false)?;
    prior.check(batch.runs)?;
    filter.consider.refused()?;
    let Cwpa { sensor, q, low_pass } = filter.system;
    if let Some(low_pass) = low_pass {
        return Err(SetupError::Setting { name: "tau", value: low_pass.tau });
    }
    System::<5>::check(&filter.system)?;
    let dynamics = Dynamics { q, tau: 0.0, gauss_markov: &sensor.gauss_markov };
    let job = Job { batch, prior, filter: filter.with_system(dynamics), counted };
    match (sensor.form, prior.states) {
        (Form::Forward, 5) => Ok(dispatch::<_, 2>(&job, CwpaWith { sensor: ReadLinear }, path, threads)),
        (Form::Forward, 7) => Ok(dispatch::<_, 4>(&job, CwpaWith { sensor: ReadCubic }, path, threads)),
        (Form::Inverse, 5) => Ok(portable_runs::<_, 2>(&job, CwpaWith { sensor: ReadInverse }, threads)),
        (Form::Inverse, 7) => Ok(portable_runs::<_, 4>(&job, CwpaWith { sensor: ReadInverse }, threads)),
        (_, given) => Err(SetupError::Size { given }),
    }
}
