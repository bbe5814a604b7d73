//! A filter fed one sample per call at a fixed rate, or a record per call with equal bits.
//!
//! No queue, no stamps, no allocation: the output over a step is taken from samples that are there.

use ekf_core::dense::belief::{check_covariance, check_mean};
use ekf_core::dense::system::System;
use ekf_core::dense::ud::factorise;
use ekf_core::dense::update::Innovation;
use ekf_core::error::{SetupError, StepError};
use ekf_core::nalgebra::SMatrix;
use ekf_core::structured::acceleration::{ForwardCubic, ForwardLinear, InverseCubic, InverseLinear};
use ekf_core::structured::errors_in_variables::Correction;
use ekf_core::structured::measurement::{ReadCubic, ReadInverse, ReadLinear};
use ekf_core::structured::number::Number;
use ekf_core::structured::row::{Plain, Row};
use ekf_core::structured::taps::Taps;
use ekf_core::structured::watch::{Evidence, Passage, Suspect, SuspectColumn, Watch};
use ekf_core::structured::whitening::Score;
use ekf_core::{Aci, Carrier, Cwpa, Filter, Form, GaussMarkov};
use pulp::NullaryFnOnce;
#[cfg(target_arch = "x86_64")]
use pulp::x86::V3;

#[cfg(target_arch = "x86_64")]
use crate::arch::fma::Fused;
use crate::arch::fma::Scalar;
#[cfg(target_arch = "x86_64")]
use crate::arch::row4::Row4;
use crate::fixed_rate::step::{
    AciWithEffects, FactoredAci, FactoredAciWithEffects, FixedRateStep, OutputHistory, ReadingGate, SampleInput,
};
use crate::record::batch::Prior;
use crate::record::block::Block;
use crate::record::kernel::{AciWith, CwpaWith};
use crate::record::likelihood::LogLikelihood;
use crate::record::settings::{Dynamics, Settings};

/// Steps between two checks of the whole covariance.
const EVERY: u32 = 64;

/// Effects that a filter can track beside `k, K0`.
pub const EFFECTS: usize = 14;

/// A filter at a fixed rate, whatever its system, size and arithmetic.
pub trait FixedRate: Send + Sync {
    /// Processes one sample and returns the newest innovation.
    ///
    /// The prior belongs to the first sample. States and variances are checked at every step, the whole covariance every 64
    /// steps, the innovation variance at every reading.
    ///
    /// # Errors
    /// [`StepError`]; the filter is then as it was before the step.
    fn step(&mut self, sample: &SampleInput<'_>) -> Result<Option<Innovation>, StepError>;

    /// Processes a record of outputs `u` and positions `z`, and writes the histories that are present.
    ///
    /// # Errors
    /// The sample that failed and [`StepError`], as in [`FixedRate::step`].
    fn over(&mut self, u: &[f64], z: &[f64], histories: &mut Histories<'_>) -> Result<(), (usize, StepError)>;

    /// Number of states.
    fn states(&self) -> usize;

    /// State `i`.
    fn x(&self, i: usize) -> f64;

    /// Covariance of states `i` and `j`.
    fn P(&self, i: usize, j: usize) -> f64;

    /// Begins anew with another prior; suspects keep what they have gathered.
    ///
    /// # Errors
    /// [`SetupError`] for a prior that cannot be used.
    fn begin(&mut self, prior: Prior<'_>) -> Result<(), SetupError>;

    /// Watches suspects of these typical sizes (SI) from the next sample on, with starts `least` samples apart or more; false
    /// where the filter has no factors.
    fn watch(&mut self, scales: &[f64], least: u64) -> bool;

    /// What suspect `j` has gathered, its `b` and `G`, and the samples of the watch; `None` without it.
    fn evidence(&self, j: usize) -> Option<(Evidence, [f64; 2], u64)>;

    /// The newest innovation of all.
    fn innovation(&self) -> Option<Innovation>;

    /// Of that innovation; `None` of a filter without the correction, and before its whitening begins.
    fn score(&self) -> Option<Score<f64>>;

    /// Samples processed.
    fn samples(&self) -> usize;

    /// Readings that the gate rejected.
    fn rejected(&self) -> usize;

    /// Log-likelihood of the accepted readings.
    fn log_likelihood(&self) -> f64;
}

/// Buffers for the history of a record, one row per sample; `None` where it is not wanted.
/// One that is too short keeps the first rows.
#[derive(Debug, Default)]
pub struct Histories<'a> {
    /// States, `N` a row.
    pub states: Option<&'a mut [f64]>,
    /// Diagonals of the covariance, `N` a row.
    pub variances: Option<&'a mut [f64]>,
    /// `e` of the newest reading of the sample; not a number where nothing was read.
    pub innovations: Option<&'a mut [f64]>,
    /// `S` likewise.
    pub innovation_variances: Option<&'a mut [f64]>,
}

impl Histories<'_> {
    /// Writes row `j`.
    #[inline(always)]
    fn keep(
        &mut self,
        j: usize,
        N: usize,
        innovation: Option<Innovation>,
        x: impl Fn(usize) -> f64,
        variance: impl Fn(usize) -> f64,
    ) {
        let row = N * j..N * (j + 1);
        if let Some(states) = self.states.as_deref_mut().and_then(|all| all.get_mut(row.clone())) {
            states.iter_mut().enumerate().for_each(|(i, to)| *to = x(i));
        }
        if let Some(variances) = self.variances.as_deref_mut().and_then(|all| all.get_mut(row)) {
            variances.iter_mut().enumerate().for_each(|(i, to)| *to = variance(i));
        }
        if let Some(e) = self.innovations.as_deref_mut().and_then(|all| all.get_mut(j)) {
            *e = innovation.map_or(f64::NAN, |innovation| innovation.e);
        }
        if let Some(S) = self.innovation_variances.as_deref_mut().and_then(|all| all.get_mut(j)) {
            *S = innovation.map_or(f64::NAN, |innovation| innovation.s);
        }
    }
}

/// The instructions that a step is compiled for.
trait Arithmetic: Copy + Send + Sync {
    type Number: Scalar;

    fn witness(self) -> Self::Number;

    fn compile_and_run<F: NullaryFnOnce>(self, work: F) -> F::Output;
}

/// Plain numbers, nothing fused: any processor, equal bits on all.
#[derive(Clone, Copy)]
struct Portable;

impl Arithmetic for Portable {
    type Number = f64;

    fn witness(self) -> f64 {
        0.0
    }

    fn compile_and_run<F: NullaryFnOnce>(self, work: F) -> F::Output {
        work.call()
    }
}

#[cfg(target_arch = "x86_64")]
impl Arithmetic for V3 {
    type Number = Fused<V3>;

    #[inline(always)]
    fn witness(self) -> Fused<V3> {
        Fused { x: 0.0, simd: self }
    }

    #[inline(always)]
    fn compile_and_run<F: NullaryFnOnce>(self, work: F) -> F::Output {
        self.vectorize(work)
    }
}

struct Stepper<W: Arithmetic, K: FixedRateStep<V, M>, V: Row<Number = W::Number>, const M: usize> {
    arithmetic: W,
    kernel: K,
    settings: Settings<V, M>,
    states: usize,
    drifting: bool,
    at: FilterState<K::Block, W::Number>,
    watch: Option<Watch<Vec<Suspect<W::Number, M>>>>,
}

/// The state of a filter between two samples.
struct FilterState<B, T> {
    block: B,
    gate: ReadingGate<T>,
    history: OutputHistory,
    innovation: Option<Innovation>,
    unchecked: u32,
}

impl<B, T: Scalar> FilterState<B, T> {
    /// Before the first sample.
    fn new<V: Row<Number = T>, const M: usize>(prior: &Prior<'_>, witness: T, threshold: f64) -> Self
    where
        B: Block<V, M>,
    {
        // Places beyond the states hold zeros: a row may be wider than the filter.
        let N = prior.states;
        let x = |i: usize| witness.like(if i < N { prior.x[i] } else { 0.0 });
        let P = |i: usize, j: usize| witness.like(if i < N && j < N { prior.P[i * N + j] } else { 0.0 });
        let gate = ReadingGate { threshold, likelihood: LogLikelihood::new(witness, true), rejected: 0 };
        Self { block: B::new(x, P), gate, history: OutputHistory::default(), innovation: None, unchecked: 0 }
    }
}

/// Whether a block can still be a belief; by value, so that the block of a step stays in registers.
#[inline(never)]
fn checked<B: Block<V, M>, V: Row, const M: usize>(block: B, states: usize) -> Result<(), StepError>
where
    V::Number: Scalar,
{
    check_mean(states, |i| block.x(i).value())?;
    check_covariance(states, |i, j| block.P(i, j).value())
}

impl<W: Arithmetic, K: FixedRateStep<V, M>, V: Row<Number = W::Number>, const M: usize> Stepper<W, K, V, M> {
    /// Whether the block records what its steps do to errors of the mean, as it is asked to from here on.
    fn record_passages(&mut self) -> bool {
        let witness = self.arithmetic.witness();
        self.at.block.passage().map(|passage| *passage = Some(Passage::none(witness))).is_some()
    }

    /// One sample, in place.
    #[inline(always)]
    fn next(&mut self, sample: &SampleInput<'_>) -> Result<Option<Innovation>, StepError> {
        let Self { kernel, settings, states, drifting, at, watch, .. } = self;
        for reading in [sample.u, sample.z] {
            if reading.is_infinite() || K::DRIVEN && sample.u.is_nan() {
                return Err(StepError::Innovation { e: reading });
            }
        }
        // The step works in place, its copy is read after a failure alone: nothing waits for the copy to be written.
        let (block, gate) = (at.block, at.gate);
        let stepped = kernel.step(&mut at.block, settings, &mut at.gate, &at.history, sample);
        let sound = |(least, sum): (W::Number, W::Number)| least.value() >= 0.0 && sum.value().is_finite();
        let due = at.unchecked + 1 == EVERY;
        let innovation = stepped.and_then(|innovation| {
            // Constant parameters are changed by readings alone.
            let changed = innovation.is_some() || *drifting;
            let now = &at.block;
            if due || !sound(now.motion_least_and_sum()) || changed && !sound(now.parameters_least_and_sum()) {
                checked::<_, V, M>(at.block, *states)?;
            }
            Ok(innovation)
        });
        let innovation = match innovation {
            Ok(innovation) => innovation,
            Err(error) => {
                (at.block, at.gate) = (block, gate);
                return Err(error);
            }
        };
        at.unchecked = if due { 0 } else { at.unchecked + 1 };
        at.history.push(sample.u);
        at.innovation = innovation.or(at.innovation);
        if let Some((watch, passage)) = watch.as_mut().zip(at.block.passage().and_then(|passage| passage.as_ref())) {
            let witness = passage.dt;
            let columns = sample.suspects.copied().unwrap_or_default();
            let at = |values: &[f64], j: usize| witness.like(values.get(j).copied().unwrap_or(0.0));
            let column = |j: usize| SuspectColumn {
                over: columns.over.map(|values| at(values, j)),
                position: at(columns.position, j),
                slope: at(columns.slopes, j),
            };
            watch.advance(passage, column, Scalar::value);
        }
        Ok(innovation)
    }
}

/// One step, to be compiled for its instructions.
struct OneStep<'a, 'b, S>(&'a mut S, &'a SampleInput<'b>);

impl<W: Arithmetic, K: FixedRateStep<V, M>, V: Row<Number = W::Number>, const M: usize> NullaryFnOnce
    for OneStep<'_, '_, Stepper<W, K, V, M>>
{
    type Output = Result<Option<Innovation>, StepError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        self.0.next(self.1)
    }
}

impl<W, K, V, const M: usize> FixedRate for Stepper<W, K, V, M>
where
    W: Arithmetic,
    K: FixedRateStep<V, M>,
    V: Row<Number = W::Number> + Send + Sync,
{
    fn step(&mut self, sample: &SampleInput<'_>) -> Result<Option<Innovation>, StepError> {
        self.arithmetic.compile_and_run(OneStep(self, sample))
    }

    fn over(&mut self, u: &[f64], z: &[f64], histories: &mut Histories<'_>) -> Result<(), (usize, StepError)> {
        for (j, (&u, &z)) in u.iter().zip(z).enumerate() {
            let innovation =
                self.step(&SampleInput { u, z, effects: None, suspects: None }).map_err(|error| (j, error))?;
            let block = &self.at.block;
            histories.keep(j, self.states, innovation, |i| block.x(i).value(), |i| block.P(i, i).value());
        }
        Ok(())
    }

    fn states(&self) -> usize {
        self.states
    }

    fn x(&self, i: usize) -> f64 {
        self.at.block.x(i).value()
    }

    fn P(&self, i: usize, j: usize) -> f64 {
        self.at.block.P(i, j).value()
    }

    fn begin(&mut self, prior: Prior<'_>) -> Result<(), SetupError> {
        if prior.states != self.states {
            return Err(SetupError::Size { given: prior.states });
        }
        checked_prior(&prior, self.settings.dt, self.states)?;
        let witness = self.arithmetic.witness();
        self.at = FilterState::new(&prior, witness, self.at.gate.threshold);
        if let Some(watch) = &mut self.watch {
            watch.suspects.iter_mut().for_each(Suspect::interrupt);
            self.record_passages();
        }
        Ok(())
    }

    fn watch(&mut self, scales: &[f64], least: u64) -> bool {
        let suspects = scales.iter().map(|&scale| Suspect::new(self.arithmetic.witness(), scale)).collect();
        let recorded = self.record_passages();
        self.watch = recorded.then(|| Watch::new(suspects, least));
        recorded
    }

    fn evidence(&self, j: usize) -> Option<(Evidence, [f64; 2], u64)> {
        let watch = self.watch.as_ref()?;
        let sums = watch.suspects.get(j)?.sums().map(Scalar::value);
        Some((watch.evidence(j, Scalar::value)?, sums, watch.steps()))
    }

    fn innovation(&self) -> Option<Innovation> {
        self.at.innovation
    }

    fn score(&self) -> Option<Score<f64>> {
        self.at.block.score().map(|score| score.map(Scalar::value))
    }

    fn samples(&self) -> usize {
        self.at.history.samples
    }

    fn rejected(&self) -> usize {
        self.at.gate.rejected
    }

    fn log_likelihood(&self) -> f64 {
        self.at.gate.likelihood.value().value()
    }
}

/// The numbers that every kernel is built from.
struct Construction<'a> {
    filter: Filter<Dynamics<'a>>,
    dt: f64,
    prior: Prior<'a>,
}

impl Construction<'_> {
    fn build<W, K, V, const M: usize>(&self, arithmetic: W, kernel: K) -> Box<dyn FixedRate>
    where
        W: Arithmetic + 'static,
        K: FixedRateStep<V, M> + 'static,
        K::Block: 'static,
        V: Row<Number = W::Number> + Send + Sync + 'static,
    {
        let witness = arithmetic.witness();
        let settings = Settings::of(&self.filter, self.dt, witness);
        let at = FilterState::new(&self.prior, witness, self.filter.gate);
        let drifting = !settings.drift.is_constant();
        Box::new(Stepper { arithmetic, kernel, settings, states: self.prior.states, drifting, at, watch: None })
    }
}

/// The kernel on the processor's own instructions where it has them, on plain numbers otherwise.
macro_rules! fastest {
    ($plan:expr, $kernel:expr, $row:ty, $M:literal) => {{
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = V3::try_new() {
            return Ok($plan.build::<V3, _, $row, $M>(simd, $kernel));
        }
        Ok(portable::<_, $M>(&$plan, $kernel))
    }};
}

fn portable<K, const M: usize>(plan: &Construction<'_>, kernel: K) -> Box<dyn FixedRate>
where
    K: FixedRateStep<Plain<f64, M>, M> + 'static,
    K::Block: 'static,
{
    plan.build::<Portable, K, Plain<f64, M>, M>(Portable, kernel)
}

fn construction<'a, S>(
    filter: Filter<S>,
    dynamics: Dynamics<'a>,
    dt: f64,
    prior: Prior<'a>,
    least: usize,
) -> Result<Construction<'a>, SetupError> {
    filter.check()?;
    dynamics.gauss_markov.iter().try_for_each(GaussMarkov::check)?;
    filter.consider.refused()?;
    checked_prior(&prior, dt, least)?;
    Ok(Construction { filter: filter.with_system(dynamics), dt, prior })
}

/// Refuses a prior that no filter can use.
fn checked_prior(prior: &Prior<'_>, dt: f64, least: usize) -> Result<(), SetupError> {
    let &Prior { states, x, P } = prior;
    if x.len() != states || P.len() != states * states || states < least {
        return Err(SetupError::Size { given: states });
    }
    if !(dt > 0.0 && dt.is_finite()) {
        return Err(SetupError::Setting { name: "dt", value: dt });
    }
    if let Some(&value) = x.iter().chain(P).find(|value| !value.is_finite()) {
        return Err(SetupError::Setting { name: "prior", value });
    }
    check_covariance(states, |i, j| P[i * states + j]).map_err(SetupError::Belief)?;
    let at = |i: usize, j: usize| if i < states && j < states { P[i.max(j) * states + i.min(j)] } else { 0.0 };
    factorise(&SMatrix::<f64, { EFFECTS + 4 }, { EFFECTS + 4 }>::from_fn(at)).map(|_| ())
}

/// What a sample adds over a whole step.
fn whole(filter: &Filter<Aci>, correction: Correction) -> Result<Taps, SetupError> {
    if correction != Correction::None && filter.carrier == Carrier::Dense {
        return Err(SetupError::Setting { name: "corrected", value: 1.0 });
    }
    Ok(Taps::even(filter.interpolation, true))
}

/// ACI at a fixed rate, samples `dt` apart; a correction needs factors.
///
/// # Errors
/// [`SetupError`] for settings, sizes and a prior that cannot be used.
pub fn aci(
    filter: &Filter<Aci>,
    correction: Correction,
    dt: f64,
    prior: Prior<'_>,
) -> Result<Box<dyn FixedRate>, SetupError> {
    System::<4>::check(&filter.system)?; // its numbers; how many states there are is seen below
    let Aci { sensor, q, tau } = filter.system;
    let dynamics = Dynamics { q, tau, gauss_markov: &sensor.gauss_markov };
    let plan = construction(*filter, dynamics, dt, prior, 4)?;
    let taps = whole(filter, correction)?;
    if filter.carrier == Carrier::Factored {
        return match (sensor.form, prior.states) {
            (Form::Inverse, 4) => {
                Ok(portable::<_, 2>(&plan, FactoredAci::<_, 4> { effect: InverseLinear, taps, correction }))
            }
            (Form::Inverse, 6) => {
                Ok(portable::<_, 4>(&plan, FactoredAci::<_, 6> { effect: InverseCubic, taps, correction }))
            }
            (Form::Forward, 4) => {
                Ok(portable::<_, 2>(&plan, FactoredAci::<_, 4> { effect: ForwardLinear, taps, correction }))
            }
            (Form::Forward, 6) => {
                Ok(portable::<_, 4>(&plan, FactoredAci::<_, 6> { effect: ForwardCubic, taps, correction }))
            }
            (_, given) => Err(SetupError::Size { given }),
        };
    }
    match (sensor.form, prior.states) {
        (Form::Inverse, 4) => fastest!(plan, AciWith { effect: InverseLinear }, Plain<Fused<V3>, 2>, 2),
        (Form::Inverse, 6) => fastest!(plan, AciWith { effect: InverseCubic }, Row4<1>, 4),
        (Form::Forward, 4) => fastest!(plan, AciWith { effect: ForwardLinear }, Plain<Fused<V3>, 2>, 2),
        (Form::Forward, 6) => Ok(portable::<_, 4>(&plan, AciWith { effect: ForwardCubic })),
        (_, given) => Err(SetupError::Size { given }),
    }
}

/// ACI with a forward linear sensor and effects given at every step; `gauss_markov` holds all parameters, `k` and `K0` first.
///
/// # Errors
/// [`SetupError`] likewise; at most [`EFFECTS`] effects.
pub fn aci_with_effects(
    filter: &Filter<Aci>,
    correction: Correction,
    dt: f64,
    rest: f64,
    gauss_markov: &[GaussMarkov],
    prior: Prior<'_>,
) -> Result<Box<dyn FixedRate>, SetupError> {
    System::<4>::check(&filter.system)?;
    let Aci { q, tau, .. } = filter.system;
    let plan = construction(*filter, Dynamics { q, tau, gauss_markov }, dt, prior, 4)?;
    let taps = whole(filter, correction)?;
    if filter.carrier == Carrier::Factored {
        return match prior.states - 2 {
            0..=4 => Ok(portable::<_, 4>(&plan, FactoredAciWithEffects::<6> { rest, taps, correction })),
            5..=8 => Ok(portable::<_, 8>(&plan, FactoredAciWithEffects::<10> { rest, taps, correction })),
            9..=16 => Ok(portable::<_, 16>(&plan, FactoredAciWithEffects::<18> { rest, taps, correction })),
            _ => Err(SetupError::Size { given: prior.states }),
        };
    }
    let kernel = AciWithEffects { rest };
    match prior.states - 2 {
        0..=4 => fastest!(plan, kernel, Row4<1>, 4),
        5..=8 => fastest!(plan, kernel, Row4<2>, 8),
        9..=16 => fastest!(plan, kernel, Row4<4>, 16),
        _ => Err(SetupError::Size { given: prior.states }),
    }
}

/// CWPA without a low-pass at a fixed rate.
///
/// # Errors
/// [`SetupError`] likewise.
pub fn cwpa(filter: &Filter<Cwpa>, dt: f64, prior: Prior<'_>) -> Result<Box<dyn FixedRate>, SetupError> {
    let Cwpa { sensor, q, low_pass } = filter.system;
    if let Some(low_pass) = low_pass {
        return Err(SetupError::Setting { name: "tau", value: low_pass.tau });
    }
    System::<5>::check(&filter.system)?;
    let dynamics = Dynamics { q, tau: 0.0, gauss_markov: &sensor.gauss_markov };
    let plan = construction(*filter, dynamics, dt, prior, 5)?;
    match (sensor.form, prior.states) {
        (Form::Forward, 5) => fastest!(plan, CwpaWith { sensor: ReadLinear }, Plain<Fused<V3>, 2>, 2),
        (Form::Forward, 7) => fastest!(plan, CwpaWith { sensor: ReadCubic }, Row4<1>, 4),
        (Form::Inverse, 5) => Ok(portable::<_, 2>(&plan, CwpaWith { sensor: ReadInverse })),
        (Form::Inverse, 7) => Ok(portable::<_, 4>(&plan, CwpaWith { sensor: ReadInverse })),
        (_, given) => Err(SetupError::Size { given }),
    }
}
