//! Many runs of one filter: lanes side by side, groups of lanes over threads.
#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code, unused_imports))] // elsewhere every run goes alone

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use ekf_core::error::{SetupError, StepError};
use ekf_core::structured::acceleration::{ForwardCubic, ForwardLinear, InverseCubic, InverseLinear};
use ekf_core::structured::gauss_markov::Wandering;
use ekf_core::structured::measurement::{ReadCubic, ReadInverse, ReadLinear};
use ekf_core::structured::number::Number;
use ekf_core::structured::row::{Plain, Row};
use ekf_core::{Aci, Channel, Cwpa, Filter, Form, Wander};
#[cfg(target_arch = "x86_64")]
use pulp::x86::{V3, V4};
use pulp::{NullaryFnOnce, Simd, WithSimd};

#[cfg(target_arch = "x86_64")]
use crate::arch::fma::Fused;
use crate::arch::instruction_set::Path;
use crate::arch::lanes::Lanes;
#[cfg(target_arch = "x86_64")]
use crate::arch::row2::Pair;
#[cfg(target_arch = "x86_64")]
use crate::arch::row4::Quads;
use crate::record::block::Block;
use crate::record::kernel::{AciWith, CwpaWith, Kernel, runner};
use crate::record::likelihood::{Likelihood, NotAsked, Score};
use crate::record::runner::Settings;
use crate::record::samples::{Rows, STRETCH, Stretch};

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
    /// Of all readings; zero if it was not asked for.
    pub log_likelihood: f64,
    /// Why the numbers are not to be used.
    pub fault: Option<StepError>,
}

/// A row of `width` numbers for every run, or one for all.
fn row(all: &[f64], width: usize, run: usize) -> &[f64] {
    if all.len() == width { all } else { &all[run * width..(run + 1) * width] }
}

/// Where the first value is that `unusable` names.
fn first(values: &[f64], unusable: impl Fn(f64) -> bool) -> Option<usize> {
    // A stretch is asked as a whole: what never leaves early runs in vectors.
    let any = |stretch: &[f64]| stretch.iter().fold(false, |found, x| found | unusable(*x));
    let stretch = values.chunks(STRETCH).position(any)?;
    (stretch * STRETCH..values.len()).find(|&index| unusable(values[index]))
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
            let found = if driven && channel == Channel::Output {
                first(values, |x| !x.is_finite())
            } else {
                first(values, f64::is_infinite)
            };
            if let Some(index) = found {
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
    filter: Filter<()>,
    q: f64,
    tau: f64,
    wander: [Wander; 4],
    counted: bool,
}

impl Job<'_> {
    fn settings<V: Row, const M: usize>(&self, kind: V::Number) -> Settings<V, M> {
        let Filter { interpolation, integrator, order, R_position, R_output, .. } = self.filter;
        Settings {
            dt: self.batch.dt,
            samples: self.batch.samples,
            interpolation,
            integrator,
            order,
            q: kind.like(self.q),
            R_position: kind.like(R_position),
            R_output: kind.like(R_output),
            tau: self.tau,
            wandering: Wandering::new(kind, std::array::from_fn(|i| self.wander[i])),
        }
    }

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

    fn ended(&self, x: impl Fn(usize) -> f64, P: impl Fn(usize, usize) -> f64, log_likelihood: f64) -> Final {
        let N = self.prior.states;
        let fault = ekf_core::dense::belief::plausible(N, &P).err();
        let P = (0..N * N).map(|at| P(at / N, at % N)).collect();
        let log_likelihood = if self.counted { log_likelihood } else { 0.0 };
        Final { x: (0..N).map(x).collect(), P, log_likelihood, fault }
    }
}

/// One run in any arithmetic of one number.
#[inline(always)]
fn single<K: Kernel<V, M>, V: Row, L: Score<V::Number>, const M: usize>(
    job: &Job<'_>,
    kernel: K,
    run: usize,
    kind: V::Number,
    value: impl Fn(V::Number) -> f64,
) -> Final {
    let settings = job.settings::<V, M>(kind);
    let mut runner = runner::<K, V, L, M>(kind, |i| kind.like(job.x(run, i)), |i, j| kind.like(job.P(run, i, j)));
    let (output, position) = job.rows(run);
    let record = Rows { output, position, kind };
    let mut went = kernel.begin(&mut runner, &settings, &record);
    let mut fault = None;
    let mut from = 0;
    while from + 1 < job.batch.samples && went.is_ok() && fault.is_none() {
        let to = (from + STRETCH).min(job.batch.samples - 1);
        went = kernel.follow(&mut runner, &settings, &record, (from, to));
        fault = ekf_core::dense::belief::plausible(job.prior.states, |i, j| value(runner.block.P(i, j))).err();
        from = to;
    }
    let block = &runner.block;
    let mut ended = job.ended(|i| value(block.x(i)), |i, j| value(block.P(i, j)), value(runner.score.value()));
    ended.fault = went.err().map(StepError::from).or(fault).or(ended.fault);
    ended
}

/// A group of runs side by side, as many as `S` has lanes; the last run fills what is left over.
#[inline(always)]
fn together<K: Kernel<Plain<Lanes<S>, M>, M>, L: Score<Lanes<S>>, S: Simd, const M: usize>(
    job: &Job<'_>,
    kernel: K,
    first: usize,
    simd: S,
) -> Vec<Final> {
    let count = Lanes::<S>::COUNT;
    let kind = Lanes::from_fn(simd, |_| 0.0);
    let run = |lane: usize| (first + lane).min(job.batch.runs - 1);
    let settings = job.settings::<Plain<Lanes<S>, M>, M>(kind);
    let mut runner = runner::<K, _, L, M>(
        kind,
        |i| Lanes::from_fn(simd, |lane| job.x(run(lane), i)),
        |i, j| Lanes::from_fn(simd, |lane| job.P(run(lane), i, j)),
    );
    let (output, position): (Vec<_>, Vec<_>) = (0..count).map(|lane| job.rows(run(lane))).unzip();
    let mut stretch = Stretch::new(simd);
    let N = job.prior.states;
    let mut P = vec![kind; N * N];
    let mut faults: Vec<Option<StepError>> = vec![None; count];
    let (mut from, mut begun) = (0, false);
    while from + 1 < job.batch.samples {
        let to = (from + STRETCH).min(job.batch.samples - 1);
        stretch.turn(&output, &position, (from, to));
        let mut went = if begun { Ok(()) } else { kernel.begin(&mut runner, &settings, &stretch) };
        begun = true;
        went = went.and_then(|()| kernel.follow(&mut runner, &settings, &stretch, (from, to)));
        // Every covariance is taken out once, not once per lane.
        for (i, row) in P.chunks_mut(N).enumerate() {
            for (j, at) in row.iter_mut().enumerate().take(i + 1) {
                *at = runner.block.P(i, j);
            }
        }
        for (lane, fault) in faults.iter_mut().enumerate() {
            *fault = fault
                .or_else(|| went.err().map(StepError::from))
                .or_else(|| ekf_core::dense::belief::plausible(N, |i, j| P[i * N + j].lane(lane)).err());
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
trait Everywhere<const M: usize>: Copy + Send + Sync {
    fn together<S: Simd>(self, job: &Job<'_>, first: usize, simd: S) -> Vec<Final>;
    #[cfg(target_arch = "x86_64")]
    fn fused(self, job: &Job<'_>, run: usize, simd: V3) -> Final;
    fn alone(self, job: &Job<'_>, run: usize) -> Final;
}

macro_rules! everywhere {
    ($($kernel:ty, $M:literal, $row:ty;)*) => {
        $(impl Everywhere<$M> for $kernel {
            #[inline(always)]
            fn together<S: Simd>(self, job: &Job<'_>, first: usize, simd: S) -> Vec<Final> {
                if job.counted {
                    together::<Self, Likelihood<_>, S, $M>(job, self, first, simd)
                } else {
                    together::<Self, NotAsked<_>, S, $M>(job, self, first, simd)
                }
            }

            #[cfg(target_arch = "x86_64")]
            #[inline(always)]
            fn fused(self, job: &Job<'_>, run: usize, simd: V3) -> Final {
                let kind = Fused { x: 0.0, simd };
                if job.counted {
                    single::<Self, $row, Likelihood<_>, $M>(job, self, run, kind, |x| x.x)
                } else {
                    single::<Self, $row, NotAsked<_>, $M>(job, self, run, kind, |x| x.x)
                }
            }

            fn alone(self, job: &Job<'_>, run: usize) -> Final {
                single::<Self, Plain<f64, $M>, Likelihood<f64>, $M>(job, self, run, 0.0, |x| x)
            }
        })*
    };
}

everywhere!(
    AciWith<InverseLinear>, 2, Pair;
    AciWith<InverseCubic>, 4, Quads<1>;
    AciWith<ForwardLinear>, 2, Pair;
    CwpaWith<ReadLinear>, 2, Pair;
    CwpaWith<ReadCubic>, 4, Quads<1>;
);

/// One group, to be compiled for the instructions it is given.
struct Group<'a, K, const M: usize> {
    job: &'a Job<'a>,
    kernel: K,
    first: usize,
}

impl<K: Everywhere<M>, const M: usize> WithSimd for Group<'_, K, M> {
    type Output = Vec<Final>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<Final> {
        self.kernel.together(self.job, self.first, simd)
    }
}

#[cfg(target_arch = "x86_64")]
struct One<'a, K, const M: usize>(V3, Group<'a, K, M>);

#[cfg(target_arch = "x86_64")]
impl<K: Everywhere<M>, const M: usize> NullaryFnOnce for One<'_, K, M> {
    type Output = Vec<Final>;

    #[inline(always)]
    fn call(self) -> Vec<Final> {
        let Self(simd, Group { job, kernel, first }) = self;
        vec![kernel.fused(job, first, simd)]
    }
}

fn group<K: Everywhere<M>, const M: usize>(job: &Job<'_>, kernel: K, path: Path, first: usize) -> Vec<Final> {
    match path {
        #[cfg(target_arch = "x86_64")]
        Path::Fused => {
            if let Some(simd) = V3::try_new() {
                return simd.vectorize(One::<K, M>(simd, Group { job, kernel, first }));
            }
        }
        #[cfg(target_arch = "x86_64")]
        Path::Four => {
            if let Some(simd) = V3::try_new() {
                return Simd::vectorize(simd, Group::<K, M> { job, kernel, first });
            }
        }
        #[cfg(target_arch = "x86_64")]
        Path::Eight => {
            if let Some(simd) = V4::try_new() {
                return Simd::vectorize(simd, Group::<K, M> { job, kernel, first });
            }
        }
        _ => {}
    }
    vec![kernel.alone(job, first)]
}

/// All groups over `threads` workers; the order of the answer is that of the runs.
fn spread(runs: usize, width: usize, threads: usize, one: impl Fn(usize) -> Vec<Final> + Sync) -> Vec<Final> {
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

fn in_lanes<K: Everywhere<M>, const M: usize>(job: &Job<'_>, kernel: K, path: Path, threads: usize) -> Vec<Final> {
    let path = match path {
        path if !path.is_open() => Path::Portable,
        Path::Four | Path::Eight if job.batch.runs == 1 => Path::Fused,
        path => path,
    };
    spread(job.batch.runs, path.lanes(), threads, |first| group::<K, M>(job, kernel, path, first))
}

fn one_by_one<K, const M: usize>(job: &Job<'_>, kernel: K, threads: usize) -> Vec<Final>
where
    K: Kernel<Plain<f64, M>, M> + Sync,
{
    spread(job.batch.runs, 1, threads, |run| {
        vec![single::<K, Plain<f64, M>, Likelihood<f64>, M>(job, kernel, run, 0.0, |x| x)]
    })
}

fn without<S>(filter: &Filter<S>) -> Filter<()> {
    let Filter { interpolation, integrator, order, carrier, R_position, R_output, gate, .. } = *filter;
    Filter { system: (), interpolation, integrator, order, carrier, R_position, R_output, gate }
}

/// Runs ACI over all records; `counted` asks for the log-likelihood.
///
/// The forward cubic sensor must be solved at every instant, so it runs alone; all others run in lanes. Gates and the
/// factored carrier have no place here.
///
/// # Errors
/// [`SetupError`] for shapes and values that cannot be used.
pub fn run_aci(
    filter: &Filter<Aci>,
    prior: Prior<'_>,
    batch: Batch<'_>,
    counted: bool,
    path: Path,
    threads: usize,
) -> Result<Vec<Final>, SetupError> {
    batch.check(true)?;
    prior.check(batch.runs)?;
    let Aci { sensor, q, tau } = filter.system;
    let job = Job { batch, prior, filter: without(filter), q, tau, wander: sensor.wander, counted };
    match (sensor.form, prior.states) {
        (Form::Inverse, 4) => Ok(in_lanes::<_, 2>(&job, AciWith { effect: InverseLinear }, path, threads)),
        (Form::Inverse, 6) => Ok(in_lanes::<_, 4>(&job, AciWith { effect: InverseCubic }, path, threads)),
        (Form::Forward, 4) => Ok(in_lanes::<_, 2>(&job, AciWith { effect: ForwardLinear }, path, threads)),
        (Form::Forward, 6) => Ok(one_by_one::<_, 4>(&job, AciWith { effect: ForwardCubic }, threads)),
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
    path: Path,
    threads: usize,
) -> Result<Vec<Final>, SetupError> {
    batch.check(false)?;
    prior.check(batch.runs)?;
    let Cwpa { sensor, q, low_pass } = filter.system;
    if let Some(low_pass) = low_pass {
        return Err(SetupError::Setting { name: "tau", value: low_pass.tau });
    }
    let job = Job { batch, prior, filter: without(filter), q, tau: 0.0, wander: sensor.wander, counted };
    match (sensor.form, prior.states) {
        (Form::Forward, 5) => Ok(in_lanes::<_, 2>(&job, CwpaWith { sensor: ReadLinear }, path, threads)),
        (Form::Forward, 7) => Ok(in_lanes::<_, 4>(&job, CwpaWith { sensor: ReadCubic }, path, threads)),
        (Form::Inverse, 5) => Ok(one_by_one::<_, 2>(&job, CwpaWith { sensor: ReadInverse }, threads)),
        (Form::Inverse, 7) => Ok(one_by_one::<_, 4>(&job, CwpaWith { sensor: ReadInverse }, threads)),
        (_, given) => Err(SetupError::Size { given }),
    }
}
