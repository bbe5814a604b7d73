//! One step at a fixed rate: predict from the sample before to this one, then read what was measured there.

use ekf_core::dense::update::Innovation;
use ekf_core::error::StepError;
use ekf_core::structured::acceleration::{Driven, Effect, WithEffects};
use ekf_core::structured::aci::{AciBlock, Surprise};
use ekf_core::structured::aci_step::Course;
use ekf_core::structured::cwpa::CwpaBlock;
use ekf_core::structured::measurement::Output;
use ekf_core::structured::number::Number;
use ekf_core::structured::row::Row;
use ekf_core::{Integrator, Interpolation};

use crate::arch::fma::One;
use crate::record::block::Block;
use crate::record::kernel::{AciWith, CwpaWith};
use crate::record::likelihood::{Likelihood, Score};
use crate::record::runner::Settings;

/// What stands at one sample.
#[derive(Debug, Clone, Copy, Default)]
pub struct Arrival<'a> {
    /// The output, m/s^2; not a number where missing (CWPA).
    pub u: f64,
    /// The position, m; not a number where missing.
    pub z: f64,
    /// Effects per unit of their coefficients, m/s^2: at the sample before, half-way, and here. Empty without effects.
    pub effects: [&'a [f64]; 3],
    /// What a unit of each coefficient adds to the position read here, m. Empty where none does.
    pub leaning: &'a [f64],
}

/// What readings led to: the gate, and sums over what it let in.
#[derive(Debug, Clone, Copy)]
pub struct Taking<T> {
    /// Readings with `e^2 / S` above this are rejected.
    pub gate: f64,
    /// Of the readings taken in.
    pub likelihood: Likelihood<T>,
    /// Readings rejected.
    pub rejected: usize,
}

impl<T: One> Taking<T> {
    /// `e` and `S` checked, and whether the gate lets them in.
    #[inline(always)]
    fn judged(&mut self, surprise: &Surprise<T>) -> Result<(Innovation, bool), StepError> {
        let innovation = Innovation::checked(surprise.e.value(), surprise.s.value())?;
        let accepted = innovation.nis() <= self.gate;
        if accepted {
            self.likelihood.add(surprise);
        } else {
            self.rejected += 1;
        }
        Ok((innovation, accepted))
    }
}

/// The outputs before a sample, the newest first, and how many samples there were in all.
#[derive(Debug, Clone, Copy, Default)]
pub struct Past {
    u: [f64; 3],
    /// Samples taken in.
    pub samples: usize,
}

impl Past {
    /// A sample later.
    #[inline(always)]
    pub fn push(&mut self, u: f64) {
        self.u = [u, self.u[0], self.u[1]];
        self.samples += 1;
    }

    /// The output over the step to `u`: held, a line, or the cubic through the last four samples once there are four.
    #[inline(always)]
    fn until(&self, u: f64, how: Interpolation) -> Piece {
        let [u0, u1, u2] = self.u;
        match how {
            Interpolation::Hold => Piece { end: u0, d: [0.0; 3] },
            Interpolation::Cubic if self.samples > 2 => {
                Piece { end: u, d: [u - u0, u - 2.0 * u0 + u1, u - 3.0 * (u0 - u1) - u2] }
            }
            _ => Piece { end: u, d: [u - u0, 0.0, 0.0] },
        }
    }
}

/// A polynomial over one step, by Newton's backward differences at its end.
#[derive(Debug, Clone, Copy)]
struct Piece {
    end: f64,
    d: [f64; 3],
}

impl Piece {
    /// The output at `x` of the way.
    #[inline(always)]
    fn at(&self, x: f64) -> f64 {
        let [d1, d2, d3] = self.d;
        self.end + (x - 1.0) * (d1 + 0.5 * x * (d2 + (x + 1.0) / 3.0 * d3))
    }
}

/// A system that steps from sample to sample.
pub trait Paced<V: Row, const M: usize>: Copy + Send + Sync
where
    V::Number: One,
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
        taking: &mut Taking<V::Number>,
        past: &Past,
        arrival: &Arrival<'_>,
    ) -> Result<Option<Innovation>, StepError>;
}

impl<V, E, const M: usize> Paced<V, M> for AciWith<E>
where
    V: Row + Send + Sync,
    V::Number: One,
    E: Effect<V, M, Input = V::Number> + Send + Sync,
{
    type Block = AciBlock<V, M>;

    const DRIVEN: bool = true;

    #[inline(always)]
    fn step(
        &self,
        block: &mut Self::Block,
        settings: &Settings<V, M>,
        taking: &mut Taking<V::Number>,
        past: &Past,
        arrival: &Arrival<'_>,
    ) -> Result<Option<Innovation>, StepError> {
        let &Settings { dt, integrator, interpolation, order, q, R_position: R, tau, .. } = settings;
        if past.samples > 0 {
            let piece = past.until(arrival.u, interpolation);
            if integrator == Integrator::Rk4 && settings.wandering.still() {
                let table = self.effect.table(&block.theta, &block.spread, order);
                let start = self.effect.at(&table, q.like(past.u[0]))?;
                let middle = self.effect.at(&table, q.like(piece.at(0.5)))?;
                let end = self.effect.at(&table, q.like(piece.end))?;
                block.rk4(dt, q, &start, &middle, &end);
            } else {
                let input = |s: f64| q.like(piece.at(s / dt));
                block.step(integrator, q, &settings.wandering, &Course { effect: self.effect, order, input, dt })?;
            }
        }
        if arrival.z.is_nan() {
            return Ok(None);
        }
        let (tau, z) = (q.like(tau), q.like(arrival.z));
        let ahead = settings.tau != 0.0;
        let surprise = if ahead { block.innovate_ahead(tau, z, R) } else { block.innovate(z, R) };
        let (innovation, accepted) = taking.judged(&surprise)?;
        match (accepted, ahead) {
            (true, true) => block.correct_ahead(tau, &surprise),
            (true, false) => block.correct(R, &surprise),
            _ => {}
        }
        Ok(Some(innovation))
    }
}

/// ACI whose sensor has further effects, by RK4.
#[derive(Debug, Clone, Copy)]
pub struct AciWithEffects {
    /// Specific force while the stage stands still, m/s^2.
    pub rest: f64,
}

/// One number per effect as a row of all parameters: behind the sensor's own two, zero where there is none.
#[inline(always)]
fn placed<V: Row>(kind: V::Number, each: &[f64]) -> V {
    V::from_fn(kind, |i| kind.like(if i < 2 { 0.0 } else { each.get(i - 2).copied().unwrap_or(0.0) }))
}

impl<V, const M: usize> Paced<V, M> for AciWithEffects
where
    V: Row + Send + Sync,
    V::Number: One,
{
    type Block = AciBlock<V, M>;

    const DRIVEN: bool = true;

    #[inline(always)]
    fn step(
        &self,
        block: &mut Self::Block,
        settings: &Settings<V, M>,
        taking: &mut Taking<V::Number>,
        past: &Past,
        arrival: &Arrival<'_>,
    ) -> Result<Option<Innovation>, StepError> {
        let &Settings { dt, interpolation, order, q, R_position: R, tau, .. } = settings;
        if past.samples > 0 {
            let piece = past.until(arrival.u, interpolation);
            let [start, middle, end] = arrival.effects.map(|each| placed::<V>(q, each));
            let input = |s: f64| {
                // The parabola through the three instants.
                let x = s / dt;
                let weights =
                    [(2.0 * x - 1.0) * (x - 1.0), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)].map(|w| q.like(w));
                let columns = start.scaled(weights[0]).plus(weights[1], middle).plus(weights[2], end);
                Driven { u: q.like(piece.at(x)), columns }
            };
            block.fourth_order(
                q,
                &settings.wandering,
                &Course { effect: WithEffects { rest: self.rest }, order, input, dt },
            )?;
        }
        if arrival.z.is_nan() {
            return Ok(None);
        }
        let b = placed(q, arrival.leaning);
        let (surprise, along) = block.innovate_along(q.like(tau), &b, q.like(arrival.z), R);
        let (innovation, accepted) = taking.judged(&surprise)?;
        if accepted {
            block.correct_along(&along, &surprise);
        }
        Ok(Some(innovation))
    }
}

impl<V, O, const M: usize> Paced<V, M> for CwpaWith<O>
where
    V: Row + Send + Sync,
    V::Number: One,
    O: Output<V> + Copy + Send + Sync,
{
    type Block = CwpaBlock<V, M>;

    const DRIVEN: bool = false;

    #[inline(always)]
    fn step(
        &self,
        block: &mut Self::Block,
        settings: &Settings<V, M>,
        taking: &mut Taking<V::Number>,
        past: &Past,
        arrival: &Arrival<'_>,
    ) -> Result<Option<Innovation>, StepError> {
        let &Settings { dt, integrator, order, q, R_position, R_output, .. } = settings;
        if past.samples > 0 {
            block.step(integrator, dt, q, &settings.wandering);
        }
        let mut newest = None;
        if !arrival.u.is_nan() {
            let seen = block.innovate_output(&self.sensor, order, q.like(arrival.u), R_output)?;
            let (innovation, accepted) = taking.judged(&seen.surprise)?;
            if accepted {
                block.correct_output(&seen);
            }
            newest = Some(innovation);
        }
        if !arrival.z.is_nan() {
            let surprise = block.innovate_position(q.like(arrival.z), R_position);
            let (innovation, accepted) = taking.judged(&surprise)?;
            if accepted {
                block.correct_position(R_position, &surprise);
            }
            newest = Some(innovation);
        }
        Ok(newest)
    }
}
