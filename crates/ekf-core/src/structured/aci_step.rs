//! One step of ACI by any integrator, parameters constant or drifting (random walks, Gauss-Markov processes).
//!
//! `theta' = -rate theta + noise`: every block of the parameters decays, `c' = ... - rate c`, `M_ij' = -(r_i + r_j) M_ij`
//! and `M_ii' += q_i`.

use crate::dense::system::Order;
use crate::error::DomainError;
use crate::integration::{Derivative, Integrator, Stage, runge_kutta};
use crate::structured::acceleration::AccelerationModel;
use crate::structured::aci::AciBlock;
use crate::structured::gauss_markov::GaussMarkovSet;
use crate::structured::number::Number;
use crate::structured::row::{Row, moved_rows};

/// A drive over one step: how acceleration follows, and what is given at every instant.
#[derive(Debug, Clone, Copy)]
pub struct StepInput<E, I> {
    /// The sensor, and further effects.
    pub model: E,
    /// First or second order.
    pub order: Order,
    /// What is given `s` seconds into the step.
    pub input: I,
    /// Length of the step, s.
    pub dt: f64,
}

impl<V: Row, const M: usize> AciBlock<V, M> {
    /// One step of any integrator, any order, parameters constant or drifting.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse; the block is then incomplete and must be dropped.
    #[inline(always)]
    pub fn step<E, I>(
        &mut self,
        integrator: Integrator,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        step: &StepInput<E, I>,
    ) -> Result<(), DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let StepInput { model, order, input, dt } = step;
        let dt = *dt;
        if integrator == Integrator::Exact {
            return self.exact(q, drift, step);
        }
        if integrator == Integrator::Rk4 {
            return self.fourth_order(q, drift, step);
        }
        if !drift.is_constant() {
            *self = self.staged(integrator, q, drift, step)?;
            return Ok(());
        }
        let table = model.table(&self.theta, &self.P_theta, *order);
        let start = model.at(&table, input(0.0))?;
        self.rk2(dt, q, &start, &model.at(&table, input(0.5 * dt))?);
        Ok(())
    }

    /// One step of RK4, any order, parameters constant or drifting.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse; the block is then as it was.
    #[inline(always)]
    fn fourth_order<E, I>(
        &mut self,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        step: &StepInput<E, I>,
    ) -> Result<(), DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        if !drift.is_constant() {
            *self = self.staged(Integrator::Rk4, q, drift, step)?;
            return Ok(());
        }
        let &StepInput { model, order, ref input, dt } = step;
        let table = model.table(&self.theta, &self.P_theta, order);
        let start = model.at(&table, input(0.0))?;
        let middle = model.at(&table, input(0.5 * dt))?;
        self.rk4(dt, q, &start, &middle, &model.at(&table, input(dt))?);
        Ok(())
    }

    /// Runge-Kutta stage by stage, for parameters that drift; by value, so that the block of a run stays in registers.
    fn staged<E, I>(
        self,
        integrator: Integrator,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        step: &StepInput<E, I>,
    ) -> Result<Self, DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        runge_kutta(integrator, &BlockRate { q, drift, step }, &self, 0.0, step.dt)
    }
}

/// The right-hand side of ACI over one step.
struct BlockRate<'a, V: Row, E, I, const M: usize> {
    q: V::Number,
    drift: &'a GaussMarkovSet<V, M>,
    step: &'a StepInput<E, I>,
}

impl<V, E, I, const M: usize> Derivative<AciBlock<V, M>> for BlockRate<'_, V, E, I, M>
where
    V: Row,
    E: AccelerationModel<V, M>,
    I: Fn(f64) -> E::Input,
{
    type Error = DomainError;

    fn rate(&self, y: &AciBlock<V, M>, s: f64) -> Result<AciBlock<V, M>, DomainError> {
        let &Self { q, drift, step } = self;
        let table = step.model.table(&y.theta, &y.P_theta, step.order);
        let now = step.model.at(&table, (step.input)(s))?;
        let (theta, P_theta) = drift.rate(&y.theta, &y.P_theta);
        let two = q.like(2.0);
        Ok(AciBlock {
            p: y.v,
            v: now.a,
            theta,
            ppp: two * y.ppv,
            ppv: y.pvv + now.g.dot(y.c1),
            pvv: two.times_plus(now.g.dot(y.c2), q * (now.slope * now.slope)),
            c1: y.c2 + drift.decay_rate(y.c1),
            c2: now.h + drift.decay_rate(y.c2),
            P_theta,
        })
    }
}

impl<V: Row, const M: usize> Stage for AciBlock<V, M> {
    #[inline(always)]
    fn moved(&self, h: f64, rate: &Self) -> Self {
        let h = rate.p.like(h);
        Self {
            p: h.times_plus(rate.p, self.p),
            v: h.times_plus(rate.v, self.v),
            theta: self.theta.plus(h, rate.theta),
            ppp: h.times_plus(rate.ppp, self.ppp),
            ppv: h.times_plus(rate.ppv, self.ppv),
            pvv: h.times_plus(rate.pvv, self.pvv),
            c1: self.c1.plus(h, rate.c1),
            c2: self.c2.plus(h, rate.c2),
            P_theta: moved_rows(&self.P_theta, h, &rate.P_theta),
        }
    }
}
