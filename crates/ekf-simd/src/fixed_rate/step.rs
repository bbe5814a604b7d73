//! One step at a fixed rate: predict from the sample before to this one, then update by its readings.

use ekf_core::dense::update::{GatedReading, Innovation};
use ekf_core::error::StepError;
use ekf_core::structured::acceleration::{AccelerationModel, Driven, MixedPartials, WithEffects, WithNoisyEffects};
use ekf_core::structured::aci::{AciBlock, MaskedInnovation};
use ekf_core::structured::aci_step::StepInput;
use ekf_core::structured::cwpa::CwpaBlock;
use ekf_core::structured::errors_in_variables::{AciCorrected, Correction};
use ekf_core::structured::measurement::OutputModel;
use ekf_core::structured::number::Number;
use ekf_core::structured::row::{Plain, Row};
use ekf_core::structured::taps::Taps;
use ekf_core::{Integrator, Interpolation};

use crate::arch::fma::Scalar;
use crate::record::block::Block;
use crate::record::kernel::{AciWith, CwpaWith};
use crate::record::likelihood::LogLikelihood;
use crate::record::settings::Settings;

/// The input of one step: a sample of both channels, and effects over the step.
#[derive(Debug, Clone, Copy)]
pub struct SampleInput<'a> {
    /// The output, m/s^2; not a number where missing (CWPA).
    pub u: f64,
    /// The position, m; not a number where missing.
    pub z: f64,
    /// What the caller gives of effects.
    pub effects: Option<&'a EffectColumns<'a>>,
    /// And of the suspects of a watch.
    pub suspects: Option<&'a EffectColumns<'a>>,
}

/// Effects over a step, one number for each.
#[derive(Debug, Clone, Copy, Default)]
pub struct EffectColumns<'a> {
    /// Per unit of their coefficients, m/s^2: at the sample before, half-way, and here.
    pub over: [&'a [f64]; 3],
    /// Response of the position reading to a unit of each coefficient, m. Empty where there is none.
    pub position: &'a [f64],
    /// What a unit of the output adds to each effect over the step. Empty where noise of the output reaches none.
    pub slopes: &'a [f64],
}

/// The gate, and sums over the readings that it accepts.
#[derive(Debug, Clone, Copy)]
pub struct ReadingGate<T> {
    /// Readings with `e^2 / S` above this are rejected.
    pub threshold: f64,
    /// Log-likelihood of the accepted readings.
    pub likelihood: LogLikelihood<T>,
    /// Readings rejected.
    pub rejected: usize,
}

impl<T: Scalar> ReadingGate<T> {
    /// Checks `e` and `S`, and decides whether the reading is accepted.
    #[inline(always)]
    fn admit(&mut self, innovation: &MaskedInnovation<T>) -> Result<GatedReading, StepError> {
        let reading = GatedReading::new(innovation.e.value(), innovation.s.value(), self.threshold)?;
        if reading.accepted {
            self.likelihood.add(innovation);
        } else {
            self.rejected += 1;
        }
        Ok(reading)
    }
}

/// The last three outputs, the newest first, and the number of samples so far.
#[derive(Debug, Clone, Copy, Default)]
pub struct OutputHistory {
    u: [f64; 3],
    /// Samples processed.
    pub samples: usize,
}

impl OutputHistory {
    /// Appends an output.
    #[inline(always)]
    pub fn push(&mut self, u: f64) {
        self.u = [u, self.u[0], self.u[1]];
        self.samples += 1;
    }

    /// The output over the step to `u`: held, a line, or the cubic through the last four samples once there are four.
    #[inline(always)]
    fn until(&self, u: f64, how: Interpolation) -> BackwardCubic {
        let [u0, u1, u2] = self.u;
        match how {
            Interpolation::Hold => BackwardCubic { end: u0, d: [0.0; 3] },
            Interpolation::Cubic if self.samples > 2 => {
                BackwardCubic { end: u, d: [u - u0, u - 2.0 * u0 + u1, u - 3.0 * (u0 - u1) - u2] }
            }
            _ => BackwardCubic { end: u, d: [u - u0, 0.0, 0.0] },
        }
    }
}

/// A polynomial over one step, by Newton's backward differences at its end.
#[derive(Debug, Clone, Copy)]
struct BackwardCubic {
    end: f64,
    d: [f64; 3],
}

impl BackwardCubic {
    /// The output at the fraction `x` of the step.
    #[inline(always)]
    fn at(&self, x: f64) -> f64 {
        let [d1, d2, d3] = self.d;
        self.end + (x - 1.0) * (d1 + 0.5 * x * (d2 + (x + 1.0) / 3.0 * d3))
    }
}

/// A system that steps from sample to sample.
pub trait FixedRateStep<V: Row, const M: usize>: Copy + Send + Sync
where
    V::Number: Scalar,
{
    /// Mean and covariance.
    type Block: Block<V, M> + Send + Sync;

    /// Whether the output drives the state.
    const DRIVEN: bool;

    /// Predicts to the sample from the one before it, if there was one, and reads it; the newest innovation.
    ///
    /// # Errors
    /// [`StepError`]; the block is then to be dropped.
    fn step(
        &self,
        block: &mut Self::Block,
        settings: &Settings<V, M>,
        gate: &mut ReadingGate<V::Number>,
        history: &OutputHistory,
        sample: &SampleInput<'_>,
    ) -> Result<Option<Innovation>, StepError>;
}

impl<V, E, const M: usize> FixedRateStep<V, M> for AciWith<E>
where
    V: Row + Send + Sync,
    V::Number: Scalar,
    E: AccelerationModel<V, M, Input = V::Number> + Send + Sync,
{
    type Block = AciBlock<V, M>;

    const DRIVEN: bool = true;

    #[inline(always)]
    fn step(
        &self,
        block: &mut Self::Block,
        settings: &Settings<V, M>,
        gate: &mut ReadingGate<V::Number>,
        history: &OutputHistory,
        sample: &SampleInput<'_>,
    ) -> Result<Option<Innovation>, StepError> {
        let &Settings { dt, integrator, interpolation, order, q, R_position: R, tau, .. } = settings;
        if history.samples > 0 {
            let curve = history.until(sample.u, interpolation);
            if integrator == Integrator::Rk4 && settings.drift.is_constant() {
                let table = self.effect.table(&block.theta, &block.P_theta, order);
                let start = self.effect.at(&table, q.like(history.u[0]))?;
                let middle = self.effect.at(&table, q.like(curve.at(0.5)))?;
                let end = self.effect.at(&table, q.like(curve.end))?;
                block.rk4(dt, q, &start, &middle, &end);
            } else {
                let input = |s: f64| q.like(curve.at(s / dt));
                block.step(integrator, q, &settings.drift, &StepInput { model: self.effect, order, input, dt })?;
            }
        }
        if sample.z.is_nan() {
            return Ok(None);
        }
        let innovation = block.innovate(tau, q.like(sample.z), R);
        let read = gate.admit(&innovation)?;
        if read.accepted {
            block.correct(tau, R, &innovation);
        }
        Ok(Some(read.innovation))
    }
}

/// ACI whose sensor has further effects.
#[derive(Debug, Clone, Copy)]
pub struct AciWithEffects {
    /// Specific force while the stage is at rest, m/s^2.
    pub rest: f64,
}

/// One number per effect as a row of all parameters: behind the sensor's own two, zero where there is none.
#[inline(always)]
fn placed<V: Row>(witness: V::Number, entries: &[f64]) -> V {
    V::from_fn(witness, |i| witness.like(if i < 2 { 0.0 } else { entries.get(i - 2).copied().unwrap_or(0.0) }))
}

impl<'a> EffectColumns<'a> {
    /// Output and effects `s` seconds into the step: the effects on the parabola through their three instants.
    #[inline(always)]
    fn columns_over<V: Row, const M: usize>(
        &self,
        q: V::Number,
        dt: f64,
        curve: &'a BackwardCubic,
    ) -> impl Fn(f64) -> Driven<V> + use<'a, V, M> {
        let [start, middle, end] = self.over.map(|entries| placed::<V>(q, entries));
        move |s: f64| {
            let x = s / dt;
            let weights = [(2.0 * x - 1.0) * (x - 1.0), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)].map(|w| q.like(w));
            let columns = start.scaled(weights[0]).plus(weights[1], middle).plus(weights[2], end);
            Driven { u: q.like(curve.at(x)), columns }
        }
    }
}

impl<V, const M: usize> FixedRateStep<V, M> for AciWithEffects
where
    V: Row + Send + Sync,
    V::Number: Scalar,
{
    type Block = AciBlock<V, M>;

    const DRIVEN: bool = true;

    #[inline(always)]
    fn step(
        &self,
        block: &mut Self::Block,
        settings: &Settings<V, M>,
        gate: &mut ReadingGate<V::Number>,
        history: &OutputHistory,
        sample: &SampleInput<'_>,
    ) -> Result<Option<Innovation>, StepError> {
        let &Settings { dt, integrator, interpolation, order, q, R_position: R, tau, .. } = settings;
        if history.samples > 0 {
            let curve = history.until(sample.u, interpolation);
            let input = sample.effects.copied().unwrap_or_default().columns_over::<V, M>(q, dt, &curve);
            let model = WithEffects { rest: self.rest };
            block.step(integrator, q, &settings.drift, &StepInput { model, order, input, dt })?;
        }
        if sample.z.is_nan() {
            return Ok(None);
        }
        let b = placed(q, sample.effects.map_or(&[], |effects| effects.position));
        let (innovation, cross) = block.innovate_with_effects(q.like(tau), &b, q.like(sample.z), R);
        let read = gate.admit(&innovation)?;
        if read.accepted {
            block.correct_with(&cross, &innovation);
        }
        Ok(Some(read.innovation))
    }
}

/// ACI with a sensor, covariance as `U D U'`; `N = M + 2`.
#[derive(Debug, Clone, Copy)]
pub struct FactoredAci<E, const N: usize> {
    /// How acceleration follows from the output.
    pub effect: E,
    /// What a sample adds over a step.
    pub taps: Taps,
    /// What is done about the output's noise.
    pub correction: Correction,
}

impl<E, const N: usize, const M: usize> FixedRateStep<Plain<f64, M>, M> for FactoredAci<E, N>
where
    E: MixedPartials<Plain<f64, M>, M, Input = f64> + Send + Sync,
{
    type Block = AciCorrected<f64, N, M>;

    const DRIVEN: bool = true;

    fn step(
        &self,
        block: &mut Self::Block,
        settings: &Settings<Plain<f64, M>, M>,
        gate: &mut ReadingGate<f64>,
        history: &OutputHistory,
        sample: &SampleInput<'_>,
    ) -> Result<Option<Innovation>, StepError> {
        let &Settings { dt, interpolation, order, q, .. } = settings;
        if history.samples > 0 {
            let curve = history.until(sample.u, interpolation);
            let input = |s: f64| curve.at(s / dt);
            let taps = (self.correction != Correction::None).then_some((&self.taps, dt));
            block.exact(q, &settings.drift, &StepInput { model: self.effect, order, input, dt }, taps)?;
            block.passed();
        }
        read_factored(block, settings, gate, sample, self.correction)
    }
}

/// ACI whose sensor has further effects, covariance as `U D U'`; `N = M + 2`.
#[derive(Debug, Clone, Copy)]
pub struct FactoredAciWithEffects<const N: usize> {
    /// Specific force while the stage is at rest, m/s^2.
    pub rest: f64,
    /// What a sample adds over a step.
    pub taps: Taps,
    /// What is done about the output's noise.
    pub correction: Correction,
}

impl<const N: usize, const M: usize> FixedRateStep<Plain<f64, M>, M> for FactoredAciWithEffects<N> {
    type Block = AciCorrected<f64, N, M>;

    const DRIVEN: bool = true;

    fn step(
        &self,
        block: &mut Self::Block,
        settings: &Settings<Plain<f64, M>, M>,
        gate: &mut ReadingGate<f64>,
        history: &OutputHistory,
        sample: &SampleInput<'_>,
    ) -> Result<Option<Innovation>, StepError> {
        let &Settings { dt, interpolation, order, q, .. } = settings;
        if history.samples > 0 {
            let curve = history.until(sample.u, interpolation);
            let input = sample.effects.copied().unwrap_or_default().columns_over::<Plain<f64, M>, M>(q, dt, &curve);
            let effects = WithEffects { rest: self.rest };
            let model = WithNoisyEffects {
                effects,
                slopes: placed::<Plain<f64, M>>(0.0, sample.effects.map_or(&[], |effects| effects.slopes)),
            };
            let taps = (self.correction != Correction::None).then_some((&self.taps, dt));
            block.exact(q, &settings.drift, &StepInput { model, order, input, dt }, taps)?;
            block.passed();
        }
        read_factored(block, settings, gate, sample, self.correction)
    }
}

/// Updates the factors by the position of a sample, if there is one.
fn read_factored<const N: usize, const M: usize>(
    block: &mut AciCorrected<f64, N, M>,
    settings: &Settings<Plain<f64, M>, M>,
    gate: &mut ReadingGate<f64>,
    sample: &SampleInput<'_>,
    correction: Correction,
) -> Result<Option<Innovation>, StepError> {
    if sample.z.is_nan() {
        return Ok(None);
    }
    let &Settings { R_position: R, tau, .. } = settings;
    let b = placed(0.0, sample.effects.map_or(&[], |effects| effects.position));
    let (innovation, reading) = block.filter.innovate_with_effects(tau, &b, sample.z, R);
    let read = gate.admit(&innovation)?;
    if read.accepted {
        block.correct_with(tau, R, &reading, &innovation, correction);
    } else {
        block.score = None;
    }
    Ok(Some(read.innovation))
}

impl<V, O, const M: usize> FixedRateStep<V, M> for CwpaWith<O>
where
    V: Row + Send + Sync,
    V::Number: Scalar,
    O: OutputModel<V> + Copy + Send + Sync,
{
    type Block = CwpaBlock<V, M>;

    const DRIVEN: bool = false;

    #[inline(always)]
    fn step(
        &self,
        block: &mut Self::Block,
        settings: &Settings<V, M>,
        gate: &mut ReadingGate<V::Number>,
        history: &OutputHistory,
        sample: &SampleInput<'_>,
    ) -> Result<Option<Innovation>, StepError> {
        let &Settings { dt, integrator, order, q, R_position, R_output, .. } = settings;
        if history.samples > 0 {
            block.step(integrator, dt, q, &settings.drift);
        }
        let mut newest = None;
        if !sample.u.is_nan() {
            let innovation = block.innovate_output(&self.sensor, order, q.like(sample.u), R_output)?;
            let read = gate.admit(&innovation.innovation)?;
            if read.accepted {
                block.correct_output(&innovation);
            }
            newest = Some(read.innovation);
        }
        if !sample.z.is_nan() {
            let innovation = block.innovate_position(q.like(sample.z), R_position);
            let read = gate.admit(&innovation)?;
            if read.accepted {
                block.correct_position(R_position, &innovation);
            }
            newest = Some(read.innovation);
        }
        Ok(newest)
    }
}
