//! ACI in blocks with parameters that wander: random walks and Gauss-Markov processes, stage by stage.
//!
//! `theta' = -rate theta + noise`: every block of the parameters decays, `c' = ... - rate c`, `M_ij' = -(r_i + r_j) M_ij`
//! and `M_ii' += q_i`.

use crate::dense::integrate::{Integrator, nodes};
use crate::dense::system::Order;
use crate::error::DomainError;
use crate::structured::acceleration::AccelerationModel;
use crate::structured::aci::{AciBlock, StepIntegrals};
use crate::structured::gauss_markov::GaussMarkovSet;
use crate::structured::number::Number;
use crate::structured::row::Row;

/// A drive over one step: how acceleration follows, and what is given at every instant.
#[derive(Debug, Clone, Copy)]
pub struct StepInput<E, I> {
    /// The sensor, and further effects.
    pub effect: E,
    /// First or second order.
    pub order: Order,
    /// What is given `s` seconds into the step.
    pub input: I,
    /// Length of the step, s.
    pub dt: f64,
}

impl<V: Row, const M: usize> AciBlock<V, M> {
    /// One step of any integrator, any order, wandering parameters or none.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse; the block is then half-way and must be dropped.
    #[inline(always)]
    pub fn step<E, I>(
        &mut self,
        integrator: Integrator,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        course: &StepInput<E, I>,
    ) -> Result<(), DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let StepInput { effect, order, input, dt } = course;
        let dt = *dt;
        if integrator == Integrator::Exact {
            return self.exact(q, drift, course);
        }
        if integrator == Integrator::Rk4 {
            return self.fourth_order(q, drift, course);
        }
        if !drift.is_constant() {
            return self.staged(integrator, q, drift, course);
        }
        let table = effect.table(&self.theta, &self.P_theta, *order);
        let start = effect.at(&table, input(0.0))?;
        self.rk2(dt, q, &start, &effect.at(&table, input(0.5 * dt))?);
        Ok(())
    }

    /// One step of RK4, any order, wandering parameters or none.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse; the block is then as it was.
    #[inline(always)]
    pub fn fourth_order<E, I>(
        &mut self,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        course: &StepInput<E, I>,
    ) -> Result<(), DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        if !drift.is_constant() {
            return self.staged(Integrator::Rk4, q, drift, course);
        }
        let &StepInput { effect, order, ref input, dt } = course;
        let table = effect.table(&self.theta, &self.P_theta, order);
        let start = effect.at(&table, input(0.0))?;
        let middle = effect.at(&table, input(0.5 * dt))?;
        self.rk4(dt, q, &start, &middle, &effect.at(&table, input(dt))?);
        Ok(())
    }

    /// Runge-Kutta on the blocks.
    fn staged<E, I>(
        &mut self,
        integrator: Integrator,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        course: &StepInput<E, I>,
    ) -> Result<(), DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let h = course.dt;
        let start = *self;
        let k1 = start.rate(q, drift, course, 0.0)?;
        let k2 = start.moved(0.5 * h, &k1).rate(q, drift, course, 0.5 * h)?;
        if integrator == Integrator::Rk2 {
            *self = start.moved(h, &k2);
            return Ok(());
        }
        let k3 = start.moved(0.5 * h, &k2).rate(q, drift, course, 0.5 * h)?;
        let k4 = start.moved(h, &k3).rate(q, drift, course, h)?;
        *self = start.moved(h / 6.0, &k1).moved(h / 3.0, &k2).moved(h / 3.0, &k3).moved(h / 6.0, &k4);
        Ok(())
    }

    /// Time derivatives of all blocks, `s` seconds into the step.
    fn rate<E, I>(
        &self,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        course: &StepInput<E, I>,
        s: f64,
    ) -> Result<Self, DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let c = |x: f64| q.like(x);
        let table = course.effect.table(&self.theta, &self.P_theta, course.order);
        let now = course.effect.at(&table, (course.input)(s))?;
        let (theta, P_theta) = drift.rate(&self.theta, &self.P_theta);
        Ok(Self {
            p: self.v,
            v: now.a,
            theta,
            ppp: c(2.0) * self.ppv,
            ppv: self.pvv + now.g.dot(self.c1),
            pvv: c(2.0).times_plus(now.g.dot(self.c2), q * (now.slope * now.slope)),
            c1: self.c2 + drift.fading(self.c1),
            c2: now.h + drift.fading(self.c2),
            P_theta,
        })
    }

    /// `self + h rate`.
    #[inline(always)]
    fn moved(&self, h: f64, rate: &Self) -> Self {
        let h = rate.p.like(h);
        let mut P_theta = self.P_theta;
        for (row, by) in P_theta.iter_mut().zip(&rate.P_theta) {
            *row = row.plus(h, *by);
        }
        Self {
            p: h.times_plus(rate.p, self.p),
            v: h.times_plus(rate.v, self.v),
            theta: self.theta.plus(h, rate.theta),
            ppp: h.times_plus(rate.ppp, self.ppp),
            ppv: h.times_plus(rate.ppv, self.ppv),
            pvv: h.times_plus(rate.pvv, self.pvv),
            c1: self.c1.plus(h, rate.c1),
            c2: self.c2.plus(h, rate.c2),
            P_theta,
        }
    }

    /// Without integration error: [`StepIntegrals::over`], and for wandering parameters what [`crate::Aci`] says.
    #[inline(always)]
    fn exact<E, I>(
        &mut self,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        course: &StepInput<E, I>,
    ) -> Result<(), DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        if !drift.is_constant() {
            return self.exact_drifting(q, drift, course);
        }
        let table = course.effect.table(&self.theta, &self.P_theta, course.order);
        let push = StepIntegrals::over(Integrator::Exact, course.dt, q, &course.effect, &table, &course.input)?;
        self.carried(q.like(course.dt), &push);
        Ok(())
    }

    fn exact_drifting<E, I>(
        &mut self,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        course: &StepInput<E, I>,
    ) -> Result<(), DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let h = course.dt;
        let zero = q.like(0.0);
        let none = V::every(zero);
        let mut push = StepIntegrals { dp: zero, dv: zero, to_p: none, to_v: none, Q: [zero; 3] };
        for (s, weight) in nodes(0.0, h) {
            let decay = drift.decay(q, s);
            let (theta, P_theta) = drift.later(&self.theta, &self.P_theta, s);
            let table = course.effect.table(&theta, &P_theta, course.order);
            let mut now = course.effect.at(&table, (course.input)(s))?;
            now.g = now.g * decay;
            push.add(h - s, weight, q, &now);
        }
        let walks = self.drift_noise(q, drift, course)?;
        self.carried(q.like(h), &push);
        let decay = drift.decay(q, h);
        (self.theta, self.P_theta) = drift.later(&self.theta, &self.P_theta, h);
        self.c1 = self.c1 * decay + walks.c1;
        self.c2 = self.c2 * decay + walks.c2;
        self.ppp = self.ppp + walks.ppp;
        self.ppv = self.ppv + walks.ppv;
        self.pvv = self.pvv + walks.pvv;
        Ok(())
    }

    /// What the noise of the parameters has done to the motion at the end of the step: the motion's blocks of `Q_d`.
    fn drift_noise<E, I>(
        &self,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        course: &StepInput<E, I>,
    ) -> Result<Self, DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let h = course.dt;
        let zero = q.like(0.0);
        let none = V::every(zero);
        let mut drift_noise = Self {
            p: zero,
            v: zero,
            theta: none,
            ppp: zero,
            ppv: zero,
            pvv: zero,
            c1: none,
            c2: none,
            P_theta: [none; M],
        };
        for (s, weight) in nodes(0.0, h) {
            let (mut bp, mut bv) = (none, none);
            for (r, inner) in nodes(s, h) {
                let (theta, P_theta) = drift.later(&self.theta, &self.P_theta, r);
                let table = course.effect.table(&theta, &P_theta, Order::First);
                let g = course.effect.at(&table, (course.input)(r))?.g * drift.decay(q, r - s);
                bp = bp.plus(q.like(inner * (h - r)), g);
                bv = bv.plus(q.like(inner), g);
            }
            let noise = drift.q().scaled(q.like(weight));
            let left = drift.decay(q, h - s);
            drift_noise.ppp = drift_noise.ppp + (bp * noise).dot(bp);
            drift_noise.ppv = drift_noise.ppv + (bp * noise).dot(bv);
            drift_noise.pvv = drift_noise.pvv + (bv * noise).dot(bv);
            drift_noise.c1 = drift_noise.c1 + bp * noise * left;
            drift_noise.c2 = drift_noise.c2 + bv * noise * left;
        }
        Ok(drift_noise)
    }
}
