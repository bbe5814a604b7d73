//! ACI in blocks with parameters that wander: random walks and Gauss-Markov processes, stage by stage.
//!
//! `theta' = -rate theta + noise`: every block of the parameters decays, `c' = ... - rate c`, `M_ij' = -(r_i + r_j) M_ij`
//! and `M_ii' += q_i`.

use crate::dense::integrate::{Integrator, nodes};
use crate::dense::system::Order;
use crate::error::DomainError;
use crate::structured::acceleration::Effect;
use crate::structured::aci::{AciBlock, Push};
use crate::structured::gauss_markov::Wandering;
use crate::structured::number::Number;
use crate::structured::row::Row;

/// A drive over one step: how acceleration follows, and what is given at every instant.
#[derive(Debug, Clone, Copy)]
pub struct Course<E, I> {
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
        wandering: &Wandering<V, M>,
        course: &Course<E, I>,
    ) -> Result<(), DomainError>
    where
        E: Effect<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let Course { effect, order, input, dt } = course;
        let dt = *dt;
        if integrator == Integrator::Exact {
            return self.exact(q, wandering, course);
        }
        if integrator == Integrator::Rk4 {
            return self.fourth_order(q, wandering, course);
        }
        if !wandering.still() {
            return self.staged(integrator, q, wandering, course);
        }
        let table = effect.table(&self.theta, &self.spread, *order);
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
        wandering: &Wandering<V, M>,
        course: &Course<E, I>,
    ) -> Result<(), DomainError>
    where
        E: Effect<V, M>,
        I: Fn(f64) -> E::Input,
    {
        if !wandering.still() {
            return self.staged(Integrator::Rk4, q, wandering, course);
        }
        let &Course { effect, order, ref input, dt } = course;
        let table = effect.table(&self.theta, &self.spread, order);
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
        wandering: &Wandering<V, M>,
        course: &Course<E, I>,
    ) -> Result<(), DomainError>
    where
        E: Effect<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let h = course.dt;
        let start = *self;
        let k1 = start.rate(q, wandering, course, 0.0)?;
        let k2 = start.moved(0.5 * h, &k1).rate(q, wandering, course, 0.5 * h)?;
        if integrator == Integrator::Rk2 {
            *self = start.moved(h, &k2);
            return Ok(());
        }
        let k3 = start.moved(0.5 * h, &k2).rate(q, wandering, course, 0.5 * h)?;
        let k4 = start.moved(h, &k3).rate(q, wandering, course, h)?;
        *self = start.moved(h / 6.0, &k1).moved(h / 3.0, &k2).moved(h / 3.0, &k3).moved(h / 6.0, &k4);
        Ok(())
    }

    /// Time derivatives of all blocks, `s` seconds into the step.
    fn rate<E, I>(
        &self,
        q: V::Number,
        wandering: &Wandering<V, M>,
        course: &Course<E, I>,
        s: f64,
    ) -> Result<Self, DomainError>
    where
        E: Effect<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let c = |x: f64| q.like(x);
        let table = course.effect.table(&self.theta, &self.spread, course.order);
        let now = course.effect.at(&table, (course.input)(s))?;
        let (theta, spread) = wandering.rate(&self.theta, &self.spread);
        Ok(Self {
            p: self.v,
            v: now.a,
            theta,
            ppp: c(2.0) * self.ppv,
            ppv: self.pvv + now.g.dot(self.c1),
            pvv: c(2.0).times_plus(now.g.dot(self.c2), q * (now.slope * now.slope)),
            c1: self.c2 + wandering.fading(self.c1),
            c2: now.h + wandering.fading(self.c2),
            spread,
        })
    }

    /// `self + h rate`.
    #[inline(always)]
    fn moved(&self, h: f64, rate: &Self) -> Self {
        let h = rate.p.like(h);
        let mut spread = self.spread;
        for (row, by) in spread.iter_mut().zip(&rate.spread) {
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
            spread,
        }
    }

    /// Without integration error: [`Push::over`], and for wandering parameters what [`crate::Aci`] says.
    #[inline(always)]
    fn exact<E, I>(
        &mut self,
        q: V::Number,
        wandering: &Wandering<V, M>,
        course: &Course<E, I>,
    ) -> Result<(), DomainError>
    where
        E: Effect<V, M>,
        I: Fn(f64) -> E::Input,
    {
        if !wandering.still() {
            return self.exact_wandering(q, wandering, course);
        }
        let table = course.effect.table(&self.theta, &self.spread, course.order);
        let push = Push::over(Integrator::Exact, course.dt, q, &course.effect, &table, &course.input)?;
        self.carried(q.like(course.dt), &push);
        Ok(())
    }

    fn exact_wandering<E, I>(
        &mut self,
        q: V::Number,
        wandering: &Wandering<V, M>,
        course: &Course<E, I>,
    ) -> Result<(), DomainError>
    where
        E: Effect<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let h = course.dt;
        let zero = q.like(0.0);
        let none = V::every(zero);
        let mut push = Push { dp: zero, dv: zero, to_p: none, to_v: none, Q: [zero; 3] };
        for (s, weight) in nodes(0.0, h) {
            let decay = wandering.decay(q, s);
            let (theta, spread) = wandering.later(&self.theta, &self.spread, s);
            let table = course.effect.table(&theta, &spread, course.order);
            let mut now = course.effect.at(&table, (course.input)(s))?;
            now.g = now.g * decay;
            push.add(h - s, weight, q, &now);
        }
        let walks = self.walked(q, wandering, course)?;
        self.carried(q.like(h), &push);
        let decay = wandering.decay(q, h);
        (self.theta, self.spread) = wandering.later(&self.theta, &self.spread, h);
        self.c1 = self.c1 * decay + walks.c1;
        self.c2 = self.c2 * decay + walks.c2;
        self.ppp = self.ppp + walks.ppp;
        self.ppv = self.ppv + walks.ppv;
        self.pvv = self.pvv + walks.pvv;
        Ok(())
    }

    /// What the noise of the parameters has done to the motion at the end of the step: the motion's blocks of `Q_d`.
    fn walked<E, I>(
        &self,
        q: V::Number,
        wandering: &Wandering<V, M>,
        course: &Course<E, I>,
    ) -> Result<Self, DomainError>
    where
        E: Effect<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let h = course.dt;
        let zero = q.like(0.0);
        let none = V::every(zero);
        let mut walked = Self {
            p: zero,
            v: zero,
            theta: none,
            ppp: zero,
            ppv: zero,
            pvv: zero,
            c1: none,
            c2: none,
            spread: [none; M],
        };
        for (s, weight) in nodes(0.0, h) {
            let (mut bp, mut bv) = (none, none);
            for (r, inner) in nodes(s, h) {
                let (theta, spread) = wandering.later(&self.theta, &self.spread, r);
                let table = course.effect.table(&theta, &spread, Order::First);
                let g = course.effect.at(&table, (course.input)(r))?.g * wandering.decay(q, r - s);
                bp = bp.plus(q.like(inner * (h - r)), g);
                bv = bv.plus(q.like(inner), g);
            }
            let noise = wandering.q().scaled(q.like(weight));
            let left = wandering.decay(q, h - s);
            walked.ppp = walked.ppp + (bp * noise).dot(bp);
            walked.ppv = walked.ppv + (bp * noise).dot(bv);
            walked.pvv = walked.pvv + (bv * noise).dot(bv);
            walked.c1 = walked.c1 + bp * noise * left;
            walked.c2 = walked.c2 + bv * noise * left;
        }
        Ok(walked)
    }
}
