//! One filter over a uniform record: predict, read, again; in any number type.
//!
//! Sample `j` belongs to the time `j dt`. The prior belongs to sample 0, which is read like all others; at each instant the output
//! comes first, as in [`ekf_core::Engine::run`].

use ekf_core::error::DomainError;
use ekf_core::structured::acceleration::AccelerationModel;
use ekf_core::structured::aci::{AciBlock, MaskedInnovation};
use ekf_core::structured::aci_step::StepInput;
use ekf_core::structured::cwpa::CwpaBlock;
use ekf_core::structured::measurement::OutputModel;
use ekf_core::structured::number::Number;
use ekf_core::structured::row::Row;
use ekf_core::{Integrator, Interpolation, Order};

use crate::record::likelihood::{LogLikelihood, Logarithm};
use crate::record::settings::Settings;

/// One sample of one channel, in every lane.
#[derive(Debug, Clone, Copy)]
pub enum Sample<T> {
    /// Missing in all lanes.
    None,
    /// Present in all lanes.
    All(T),
    /// Present where the second number is one, missing where it is zero (the first is then any finite number).
    Some(T, T),
}

impl<T> Sample<T> {
    /// Whether any lane has it.
    #[inline(always)]
    fn is_there(&self) -> bool {
        !matches!(self, Self::None)
    }

    /// The number and, unless all lanes have it, the mask of those that do; `None` if none has it.
    #[inline(always)]
    fn given(self) -> Option<(T, Option<T>)> {
        match self {
            Self::None => None,
            Self::All(z) => Some((z, None)),
            Self::Some(z, present) => Some((z, Some(present))),
        }
    }
}

/// Samples of a uniform record by index.
pub trait Record<T> {
    /// Whether samples up to `j` can be read; checked once, so that the loops need no bounds checks.
    fn reaches(&self, j: usize) -> bool;
    /// Samples of the whole record.
    fn samples(&self) -> usize;
    /// The output at sample `j`; never missing.
    fn output(&self, j: usize) -> T;
    /// The output at sample `j` as a reading.
    fn reading(&self, j: usize) -> Sample<T>;
    /// The position at sample `j`.
    fn position(&self, j: usize) -> Sample<T>;
}

/// The state of a filter within its record.
#[derive(Debug, Clone, Copy)]
pub struct Runner<B, T> {
    /// Mean and covariance.
    pub block: B,
    /// Sum over the readings so far.
    pub score: LogLikelihood<T>,
    /// The lowest variance at any reading so far, where a step can lose positive definiteness beyond rounding: below zero, a
    /// reading has used what is no covariance.
    ///
    /// Between readings nothing uses the covariance. Constant parameters need no watch, since a reading only lowers their
    /// variances and the last one tells; nor does CWPA without integration error, whose step is a sum of squares.
    pub lowest: T,
}

/// The output between samples `j` and `j + 1`, at `f` of the way.
#[inline(always)]
fn between<T: Number>(record: &impl Record<T>, how: Interpolation, j: usize, f: f64) -> T {
    let (u0, u1) = (record.output(j), record.output(j + 1));
    match how {
        Interpolation::Hold => u0,
        _ if f == 0.0 => u0,
        _ if f == 1.0 => u1,
        Interpolation::Cubic if record.samples() >= 4 => {
            let first = j.saturating_sub(1).min(record.samples() - 4);
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

/// The output at start, middle and end of the step from sample `j`.
#[inline(always)]
fn during<T: Number>(record: &impl Record<T>, how: Interpolation, j: usize) -> [T; 3] {
    let (start, end) = (record.output(j), record.output(j + 1));
    match how {
        Interpolation::Hold => [start; 3],
        Interpolation::Linear => [start, start.like(0.5).times_plus(end - start, start), end],
        Interpolation::Cubic => [start, between(record, how, j, 0.5), end],
    }
}

impl<V: Row<Number: Logarithm>, const M: usize> Runner<AciBlock<V, M>, V::Number> {
    /// Processes samples from `from` to `to`, reading positions after `from` up to `to`.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    #[inline(always)]
    pub fn process<E: AccelerationModel<V, M, Input = V::Number>>(
        &mut self,
        effect: &E,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
        (from, to): (usize, usize),
    ) -> Result<(), DomainError> {
        let &Settings { dt, interpolation, integrator, order, q, .. } = settings;
        if !record.reaches(to) {
            return Ok(());
        }
        if integrator == Integrator::Exact || !settings.drift.is_constant() {
            for j in from..to {
                let step_input =
                    StepInput { model: *effect, order, input: |s: f64| between(record, interpolation, j, s / dt), dt };
                self.block.step(integrator, q, &settings.drift, &step_input)?;
                self.read_position(settings, record.position(j + 1));
                self.watch();
                for i in 0..M {
                    self.lowest = self.block.P_theta[i].at(i).least(self.lowest);
                }
            }
            return Ok(());
        }
        // A local copy stays in registers.
        let mut here = *self;
        // Between two readings the parameters are constant, and so is the table.
        let mut reached = from;
        while reached < to {
            let from = reached;
            let table = effect.table(&here.block.theta, &here.block.P_theta, order);
            let mut sample = Sample::None;
            if integrator == Integrator::Rk2 {
                for j in from..to {
                    let [start, middle, _] = during(record, interpolation, j);
                    here.block.rk2(dt, q, &effect.at(&table, start)?, &effect.at(&table, middle)?);
                    reached = j + 1;
                    sample = record.position(reached);
                    if sample.is_there() {
                        break;
                    }
                }
            } else {
                let mut first = effect.at(&table, record.output(from))?;
                for j in from..to {
                    let [_, middle, end] = during(record, interpolation, j);
                    let end = effect.at(&table, end)?;
                    here.block.rk4(dt, q, &first, &effect.at(&table, middle)?, &end);
                    reached = j + 1;
                    sample = record.position(reached);
                    if sample.is_there() {
                        break;
                    }
                    // Neighbouring steps share an instant, unless the output jumps.
                    first = if interpolation == Interpolation::Hold {
                        effect.at(&table, record.output(reached))?
                    } else {
                        end
                    };
                }
            }
            here.read_position(settings, sample);
        }
        *self = here;
        Ok(())
    }

    /// Keeps the lowest variance of position and velocity.
    #[inline(always)]
    fn watch(&mut self) {
        self.lowest = self.block.ppp.least(self.block.pvv.least(self.lowest));
    }

    /// Updates by a position, if there is one.
    #[inline(always)]
    pub fn read_position(&mut self, settings: &Settings<V, M>, sample: Sample<V::Number>) {
        let Some((z, present)) = sample.given() else { return };
        let (R, tau) = (settings.R_position, settings.tau);
        let innovation = MaskedInnovation { present, ..self.block.innovate(tau, z, R) };
        self.block.correct(tau, R, &innovation);
        self.score.add(&innovation);
        self.watch();
    }
}

impl<V: Row<Number: Logarithm>, const M: usize> Runner<CwpaBlock<V, M>, V::Number> {
    /// Processes samples from `from` to `to`, reading both channels after `from` up to `to`.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    #[inline(always)]
    pub fn process<O: OutputModel<V>>(
        &mut self,
        sensor: &O,
        settings: &Settings<V, M>,
        record: &impl Record<V::Number>,
        (from, to): (usize, usize),
    ) -> Result<(), DomainError> {
        if !record.reaches(to) {
            return Ok(());
        }
        let &Settings { dt, integrator, order, q, R_output, .. } = settings;
        if integrator != Integrator::Exact || !settings.drift.is_constant() {
            for j in from..to {
                self.block.step(integrator, dt, q, &settings.drift);
                self.read_output(sensor, order, R_output, record.reading(j + 1))?;
                self.read_position(settings, record.position(j + 1));
                self.watch();
                for i in 0..M {
                    self.lowest = self.block.P_theta[i].at(i).least(self.lowest);
                }
            }
            return Ok(());
        }
        let mut here = *self;
        let mut reached = from;
        while reached < to {
            let from = reached;
            let mut sample = Sample::None;
            for j in from..to {
                here.block.exact(dt, q);
                reached = j + 1;
                here.read_output(sensor, order, R_output, record.reading(reached))?;
                sample = record.position(reached);
                if sample.is_there() {
                    break;
                }
            }
            here.read_position(settings, sample);
        }
        *self = here;
        Ok(())
    }

    /// Keeps the lowest variance of position, velocity and acceleration.
    #[inline(always)]
    fn watch(&mut self) {
        let CwpaBlock { ppp, pvv, paa, .. } = self.block;
        self.lowest = ppp.least(pvv.least(paa.least(self.lowest)));
    }

    /// Updates by an output, if there is one.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    #[inline(always)]
    pub fn read_output<O: OutputModel<V>>(
        &mut self,
        sensor: &O,
        order: Order,
        R: V::Number,
        sample: Sample<V::Number>,
    ) -> Result<(), DomainError> {
        let Some((z, present)) = sample.given() else { return Ok(()) };
        let mut output = self.block.innovate_output(sensor, order, z, R)?;
        output.innovation.present = present;
        self.block.correct_output(&output);
        self.score.add(&output.innovation);
        Ok(())
    }

    /// Updates by a position, if there is one.
    #[inline(always)]
    pub fn read_position(&mut self, settings: &Settings<V, M>, sample: Sample<V::Number>) {
        let Some((z, present)) = sample.given() else { return };
        let innovation = MaskedInnovation { present, ..self.block.innovate_position(z, settings.R_position) };
        self.block.correct_position(settings.R_position, &innovation);
        self.score.add(&innovation);
    }
}
