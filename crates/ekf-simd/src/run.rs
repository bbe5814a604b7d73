//! One filter over a uniform record: predict, read, again; in any number type.
//!
//! Sample `j` stands at `j dt`. The prior belongs to sample 0, which is read like all others; at each instant the output
//! comes first, as in [`ekf_core::Filter::run`].

use ekf_core::aci_block::{AciBlock, Surprise};
use ekf_core::aci_staged::Course;
use ekf_core::cwpa_block::CwpaBlock;
use ekf_core::effect::{Effect, Instant};
use ekf_core::error::DomainError;
use ekf_core::number::Number;
use ekf_core::output::Output;
use ekf_core::row::Row;
use ekf_core::wandering::Wandering;
use ekf_core::{Integrator, Interpolation, Order};

use crate::likelihood::{Likelihood, Logarithm};

/// One sample of one channel, in every lane.
#[derive(Debug, Clone, Copy)]
pub enum Sample<T> {
    /// Missing in all lanes.
    None,
    /// There in all lanes.
    All(T),
    /// There where the weight is one, missing where it is zero (the value is then any finite number).
    Some(T, T),
}

/// A uniform record as a run sees it.
pub trait Record<T> {
    /// Whether sample `j` and all before it can be asked for; asked once, so that the loops need not ask again.
    fn reaches(&self, j: usize) -> bool;
    /// The output at sample `j`; always there.
    fn output(&self, j: usize) -> T;
    /// The output at sample `j` as a reading.
    fn reading(&self, j: usize) -> Sample<T>;
    /// The position at sample `j`.
    fn position(&self, j: usize) -> Sample<T>;
}

/// What all runs of a batch share.
#[derive(Debug, Clone, Copy)]
pub struct Settings<V: Row, const M: usize> {
    /// Time between samples, s.
    pub dt: f64,
    /// Samples of the whole record.
    pub samples: usize,
    /// How the output continues between samples.
    pub interpolation: Interpolation,
    /// How a step is integrated.
    pub integrator: Integrator,
    /// First or second order.
    pub order: Order,
    /// Density of the output's noise (ACI) or of the jerk (CWPA).
    pub q: V::Number,
    /// Variance of a position reading, m^2.
    pub R_position: V::Number,
    /// Variance of an output reading, (m/s^2)^2.
    pub R_output: V::Number,
    /// Time constant in front of the output, s (ACI).
    pub tau: f64,
    /// How the parameters move.
    pub wandering: Wandering<V, M>,
}

/// A filter on its way through its record.
#[derive(Debug, Clone, Copy)]
pub struct Runner<B, T> {
    /// Mean and covariance.
    pub block: B,
    /// Of the readings so far.
    pub likelihood: Likelihood<T>,
}

/// The output between samples `j` and `j + 1`, at `f` of the way.
#[inline(always)]
fn between<T: Number>(record: &impl Record<T>, samples: usize, how: Interpolation, j: usize, f: f64) -> T {
    let (u0, u1) = (record.output(j), record.output(j + 1));
    match how {
        Interpolation::Hold => u0,
        _ if f == 0.0 => u0,
        _ if f == 1.0 => u1,
        Interpolation::Cubic if samples >= 4 => {
            let first = j.saturating_sub(1).min(samples - 4);
            let x = (j - first) as f64 + f;
            // Lagrange's weights on 0, 1, 2, 3.
            let (a, b, c, d) = (x, x - 1.0, x - 2.0, x - 3.0);
            let weights = [b * c * d / -6.0, a * c * d / 2.0, a * b * d / -2.0, a * b * c / 6.0];
            let mut u = u0.like(weights[0]) * record.output(first);
            for (k, weight) in weights.iter().enumerate().skip(1) {
                u = u0.like(*weight).times_plus(record.output(first + k), u);
            }
            u
        }
        _ => u0.like(f).times_plus(u1 - u0, u0),
    }
}

/// Whole blocks mixed.
pub trait Blend<T> {
    /// `weight self + (1 - weight) old`.
    #[must_use]
    fn blended(&self, old: &Self, weight: T) -> Self;
}

#[inline(always)]
fn mix<T: Number>(weight: T, new: T, old: T) -> T {
    weight.times_plus(new, (weight.like(1.0) - weight) * old)
}

#[inline(always)]
fn mix_row<V: Row>(weight: V::Number, new: V, old: V) -> V {
    new.scaled(weight).plus(weight.like(1.0) - weight, old)
}

impl<V: Row, const M: usize> Blend<V::Number> for AciBlock<V, M> {
    #[inline(always)]
    fn blended(&self, old: &Self, w: V::Number) -> Self {
        Self {
            p: mix(w, self.p, old.p),
            v: mix(w, self.v, old.v),
            theta: mix_row(w, self.theta, old.theta),
            ppp: mix(w, self.ppp, old.ppp),
            ppv: mix(w, self.ppv, old.ppv),
            pvv: mix(w, self.pvv, old.pvv),
            c1: mix_row(w, self.c1, old.c1),
            c2: mix_row(w, self.c2, old.c2),
            spread: std::array::from_fn(|i| mix_row(w, self.spread[i], old.spread[i])),
        }
    }
}

impl<V: Row, const M: usize> Blend<V::Number> for CwpaBlock<V, M> {
    #[inline(always)]
    fn blended(&self, old: &Self, w: V::Number) -> Self {
        Self {
            p: mix(w, self.p, old.p),
            v: mix(w, self.v, old.v),
            a: mix(w, self.a, old.a),
            theta: mix_row(w, self.theta, old.theta),
            ppp: mix(w, self.ppp, old.ppp),
            ppv: mix(w, self.ppv, old.ppv),
            ppa: mix(w, self.ppa, old.ppa),
            pvv: mix(w, self.pvv, old.pvv),
            pva: mix(w, self.pva, old.pva),
            paa: mix(w, self.paa, old.paa),
            cp: mix_row(w, self.cp, old.cp),
            cv: mix_row(w, self.cv, old.cv),
            ca: mix_row(w, self.ca, old.ca),
            spread: std::array::from_fn(|i| mix_row(w, self.spread[i], old.spread[i])),
        }
    }
}

/// How a block takes a number in; a type, because a closure would be compiled without the run's instructions.
trait Reading<B, T> {
    fn take(&self, block: &mut B, z: T) -> Result<Surprise<T>, DomainError>;
}

/// Of position, variance `R`.
struct Position<T> {
    R: T,
}

/// Of `p + tau v`, variance `R`.
struct Ahead<T> {
    tau: T,
    R: T,
}

/// Of the output, variance `R`.
struct OfOutput<'a, O, T> {
    sensor: &'a O,
    order: Order,
    R: T,
}

impl<V: Row, const M: usize> Reading<AciBlock<V, M>, V::Number> for Position<V::Number> {
    #[inline(always)]
    fn take(&self, block: &mut AciBlock<V, M>, z: V::Number) -> Result<Surprise<V::Number>, DomainError> {
        let taken = block.innovate(z, self.R);
        block.correct(self.R, &taken);
        Ok(taken)
    }
}

impl<V: Row, const M: usize> Reading<AciBlock<V, M>, V::Number> for Ahead<V::Number> {
    #[inline(always)]
    fn take(&self, block: &mut AciBlock<V, M>, z: V::Number) -> Result<Surprise<V::Number>, DomainError> {
        let taken = block.innovate_ahead(self.tau, z, self.R);
        block.correct_ahead(self.tau, &taken);
        Ok(taken)
    }
}

impl<V: Row, const M: usize> Reading<CwpaBlock<V, M>, V::Number> for Position<V::Number> {
    #[inline(always)]
    fn take(&self, block: &mut CwpaBlock<V, M>, z: V::Number) -> Result<Surprise<V::Number>, DomainError> {
        let taken = block.innovate_position(z, self.R);
        block.correct_position(self.R, &taken);
        Ok(taken)
    }
}

impl<V: Row, const M: usize, O: Output<V>> Reading<CwpaBlock<V, M>, V::Number> for OfOutput<'_, O, V::Number> {
    #[inline(always)]
    fn take(&self, block: &mut CwpaBlock<V, M>, z: V::Number) -> Result<Surprise<V::Number>, DomainError> {
        let taken = block.innovate_output(self.sensor, self.order, z, self.R)?;
        block.correct_output(&taken);
        Ok(taken.surprise)
    }
}

impl<B: Copy + Blend<T>, T: Logarithm> Runner<B, T> {
    /// Takes a sample in where it is there; whether there was any.
    #[inline(always)]
    fn take(&mut self, sample: Sample<T>, counted: bool, reading: &impl Reading<B, T>) -> Result<bool, DomainError> {
        match sample {
            Sample::None => return Ok(false),
            Sample::All(z) => {
                let taken = reading.take(&mut self.block, z)?;
                if counted {
                    self.likelihood.add(&taken);
                }
            }
            Sample::Some(z, weight) => {
                let old = self.block;
                let taken = reading.take(&mut self.block, z)?;
                self.block = self.block.blended(&old, weight);
                if counted {
                    self.likelihood.add_some(&taken, weight);
                }
            }
        }
        Ok(true)
    }
}

impl<V: Row, const M: usize> Runner<AciBlock<V, M>, V::Number>
where
    V::Number: Logarithm,
{
    /// Goes from sample `from` to sample `to`, reading positions after `from` up to `to`; with `counted` the log-likelihood
    /// is gathered.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    #[inline(always)]
    pub fn follow<E: Effect<V, M, Input = V::Number>>(
        &mut self,
        effect: &E,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
        (from, to): (usize, usize),
        counted: bool,
    ) -> Result<(), DomainError> {
        let &Settings { dt, samples, interpolation, integrator, order, q, .. } = settings;
        if !record.reaches(to) {
            return Ok(());
        }
        if integrator == Integrator::Exact || !settings.wandering.still() {
            for j in from..to {
                let course = Course {
                    effect: *effect,
                    order,
                    input: |s: f64| between(record, samples, interpolation, j, s / dt),
                    dt,
                };
                self.block.step(integrator, q, &settings.wandering, &course)?;
                self.read_position(settings, record.position(j + 1), counted)?;
            }
            return Ok(());
        }
        let mut table = effect.table(&self.block.theta, &self.block.spread, order);
        if integrator == Integrator::Rk2 {
            for j in from..to {
                let start = effect.at(&table, between(record, samples, interpolation, j, 0.0))?;
                let middle = effect.at(&table, between(record, samples, interpolation, j, 0.5))?;
                self.block.rk2(dt, q, &start, &middle);
                if self.read_position(settings, record.position(j + 1), counted)? {
                    table = effect.table(&self.block.theta, &self.block.spread, order);
                }
            }
            return Ok(());
        }
        // Neighbouring steps share an instant, unless a reading between them moved the parameters or the output jumps.
        let shared = interpolation != Interpolation::Hold;
        let mut start: Option<Instant<V>> = None;
        for j in from..to {
            let first = match start {
                Some(first) => first,
                None => effect.at(&table, between(record, samples, interpolation, j, 0.0))?,
            };
            let middle = effect.at(&table, between(record, samples, interpolation, j, 0.5))?;
            let end = effect.at(&table, between(record, samples, interpolation, j, 1.0))?;
            self.block.rk4(dt, q, &first, &middle, &end);
            start = shared.then_some(end);
            if self.read_position(settings, record.position(j + 1), counted)? {
                table = effect.table(&self.block.theta, &self.block.spread, order);
                start = None;
            }
        }
        Ok(())
    }

    /// Takes a position in, if there is one.
    ///
    /// # Errors
    /// None of its own.
    #[inline(always)]
    pub fn read_position(
        &mut self,
        settings: &Settings<V, M>,
        sample: Sample<V::Number>,
        counted: bool,
    ) -> Result<bool, DomainError> {
        let R = settings.R_position;
        if settings.tau == 0.0 {
            return self.take(sample, counted, &Position { R });
        }
        self.take(sample, counted, &Ahead { tau: R.like(settings.tau), R })
    }
}

impl<V: Row, const M: usize> Runner<CwpaBlock<V, M>, V::Number>
where
    V::Number: Logarithm,
{
    /// Goes from sample `from` to sample `to`, reading both channels after `from` up to `to`.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    #[inline(always)]
    pub fn follow<O: Output<V>>(
        &mut self,
        sensor: &O,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
        (from, to): (usize, usize),
        counted: bool,
    ) -> Result<(), DomainError> {
        if !record.reaches(to) {
            return Ok(());
        }
        if settings.integrator == Integrator::Exact && settings.wandering.still() {
            for j in from..to {
                self.block.exact(settings.dt, settings.q);
                self.read(sensor, settings, record, j + 1, counted)?;
            }
            return Ok(());
        }
        for j in from..to {
            self.block.step(settings.integrator, settings.dt, settings.q, &settings.wandering);
            self.read(sensor, settings, record, j + 1, counted)?;
        }
        Ok(())
    }

    /// Takes what stands at sample `j` in.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    #[inline(always)]
    pub fn read<O: Output<V>>(
        &mut self,
        sensor: &O,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
        j: usize,
        counted: bool,
    ) -> Result<(), DomainError> {
        let &Settings { order, R_output, R_position, .. } = settings;
        self.take(record.reading(j), counted, &OfOutput { sensor, order, R: R_output })?;
        self.take(record.position(j), counted, &Position { R: R_position })?;
        Ok(())
    }
}
