//! The step of ACI as integrals over the drive: exact, or with the `Phi` of Runge-Kutta.

use crate::dense::system::Order;
use crate::error::DomainError;
use crate::integration::{Integrator, POINTS, nodes};
use crate::structured::acceleration::{AccelerationModel, AccelerationPartials};
use crate::structured::aci::{AciBlock, StepIntegrals};
use crate::structured::aci_step::StepInput;
use crate::structured::gauss_markov::GaussMarkovSet;
use crate::structured::number::Number;
use crate::structured::row::Row;

impl<V: Row> StepIntegrals<V> {
    /// The integrals over `dt` seconds, `input(s)` being what is given `s` seconds into the step.
    ///
    /// Exact to degree nine in `s` (five Gauss-Legendre points); `Q` is exact for every integrator, since Runge-Kutta's own
    /// can be indefinite. `q` is the output's density.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    #[inline(always)]
    pub fn over<E: AccelerationModel<V, M>, const M: usize>(
        integrator: Integrator,
        dt: f64,
        q: V::Number,
        model: &E,
        table: &E::Table,
        input: impl Fn(f64) -> E::Input,
    ) -> Result<Self, DomainError> {
        let zero = q.like(0.0);
        let mut exact = Self { dp: zero, dv: zero, to_p: V::every(zero), to_v: V::every(zero), Q: [zero; 3] };
        for (s, weight) in nodes(0.0, dt) {
            exact.add(dt - s, weight, q, &model.at(table, input(s))?);
        }
        if integrator == Integrator::Exact {
            return Ok(exact);
        }
        let start = model.at(table, input(0.0))?;
        let middle = model.at(table, input(0.5 * dt))?;
        if integrator == Integrator::Rk2 {
            return Ok(exact.with(&start, 0.5 * dt * dt, &[(&middle, dt)]));
        }
        let end = model.at(table, input(dt))?;
        let (lever, sixth) = (dt * dt / 6.0, dt / 6.0);
        let first = exact.with(&start, lever, &[(&start, sixth), (&middle, 4.0 * sixth), (&end, sixth)]);
        let rest = exact.with(&middle, 2.0 * lever, &[]);
        Ok(Self { dp: first.dp + rest.dp, to_p: first.to_p + rest.to_p, ..first })
    }

    /// The integrals over a step of a drive, exact, with parameters that drift from `theta` with covariance `P_theta`.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    #[inline(always)]
    pub fn over_drifting<E, I, const M: usize>(
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        (theta, P_theta): (&V, &[V; M]),
        step: &StepInput<E, I>,
    ) -> Result<Self, DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let h = step.dt;
        let zero = q.like(0.0);
        let none = V::every(zero);
        let mut integrals = Self { dp: zero, dv: zero, to_p: none, to_v: none, Q: [zero; 3] };
        for (s, weight) in nodes(0.0, h) {
            let (theta, P_theta) = drift.propagated(theta, P_theta, s);
            let table = step.model.table(&theta, &P_theta, step.order);
            let mut now = step.model.at(&table, (step.input)(s))?;
            now.g = now.g * drift.decay(q, s);
            integrals.add(h - s, weight, q, &now);
        }
        Ok(integrals)
    }

    /// The integrals over `dt` seconds of a constant drive, from one instant: the step of a microcontroller.
    ///
    /// Evaluated in the middle of a straight output it leaves out the slope's lever, `slope dt^3 / 12` of position a step.
    /// What follows from `dt` alone is worked out in double precision: nothing where `dt` is a constant, else half a dozen
    /// operations, in software on a processor without them.
    #[inline(always)]
    #[must_use]
    pub fn held(dt: f64, q: V::Number, at: &AccelerationPartials<V>) -> Self {
        let c = |x: f64| q.like(x);
        let (h, lever) = (c(dt), c(0.5 * dt * dt));
        let noise = q * (at.slope * at.slope);
        Self {
            dp: lever * at.a,
            dv: h * at.a,
            to_p: at.g.scaled(lever),
            to_v: at.g.scaled(h),
            Q: [c(dt * dt * dt / 3.0) * noise, lever * noise, h * noise],
        }
    }

    /// One point of the quadrature, `left` seconds before the end.
    #[inline(always)]
    pub(crate) fn add(&mut self, left: f64, weight: f64, q: V::Number, at: &AccelerationPartials<V>) {
        let (once, lever) = (q.like(weight), q.like(weight * left));
        self.dp = lever.times_plus(at.a, self.dp);
        self.dv = once.times_plus(at.a, self.dv);
        self.to_p = self.to_p.plus(lever, at.g);
        self.to_v = self.to_v.plus(once, at.g);
        let noise = q * (at.slope * at.slope);
        for (Q, moment) in self.Q.iter_mut().zip([left * left, left, 1.0]) {
            *Q = q.like(weight * moment).times_plus(noise, *Q);
        }
    }

    /// The same noise with mean and `Phi` of a few instants: one for the position, weighted ones for the velocity.
    #[inline(always)]
    fn with(
        &self,
        position: &AccelerationPartials<V>,
        lever: f64,
        velocity: &[(&AccelerationPartials<V>, f64)],
    ) -> Self {
        let witness = self.dp;
        let zero = witness.like(0.0);
        let lever = witness.like(lever);
        let mut integrals =
            Self { dp: lever * position.a, dv: zero, to_p: position.g.scaled(lever), to_v: V::every(zero), Q: self.Q };
        for (at, weight) in velocity {
            let weight = witness.like(*weight);
            integrals.dv = weight.times_plus(at.a, integrals.dv);
            integrals.to_v = integrals.to_v.plus(weight, at.g);
        }
        integrals
    }
}

/// What the noise of drifting parameters adds to the state at the end of a step, from one point of the quadrature.
///
/// The noise on parameter `i` has the variance `variance[i]`; a unit of it moves position by `to_p[i]`, velocity by `to_v[i]`
/// and leaves `left[i]` in the parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriftImpulse<V> {
    /// Variance of each impulse.
    pub variance: V,
    /// Its effect on position.
    pub to_p: V,
    /// Its effect on velocity.
    pub to_v: V,
    /// What is left of it in the parameter.
    pub left: V,
}

impl<V: Row> DriftImpulse<V> {
    /// The impulses over a step from parameters `theta` with covariance `P_theta`.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    pub fn over<E, I, const M: usize>(
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        (theta, P_theta): (&V, &[V; M]),
        step: &StepInput<E, I>,
    ) -> Result<[Self; POINTS], DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let h = step.dt;
        let none = V::every(q.like(0.0));
        let mut impulses = [Self { variance: none, to_p: none, to_v: none, left: none }; POINTS];
        for (impulse, (s, weight)) in impulses.iter_mut().zip(nodes(0.0, h)) {
            for (r, inner) in nodes(s, h) {
                let (theta, P_theta) = drift.propagated(theta, P_theta, r);
                let table = step.model.table(&theta, &P_theta, Order::First);
                let g = step.model.at(&table, (step.input)(r))?.g * drift.decay(q, r - s);
                impulse.to_p = impulse.to_p.plus(q.like(inner * (h - r)), g);
                impulse.to_v = impulse.to_v.plus(q.like(inner), g);
            }
            impulse.variance = drift.q().scaled(q.like(weight));
            impulse.left = drift.decay(q, h - s);
        }
        Ok(impulses)
    }
}

impl<V: Row, const M: usize> AciBlock<V, M> {
    /// Without integration error: [`StepIntegrals::over`], and for drifting parameters the quadrature of [`crate::Aci`].
    #[inline(always)]
    pub(crate) fn exact<E, I>(
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
            *self = self.exact_drifting(q, drift, step)?;
            return Ok(());
        }
        let table = step.model.table(&self.theta, &self.P_theta, step.order);
        let integrals = StepIntegrals::over(Integrator::Exact, step.dt, q, &step.model, &table, &step.input)?;
        self.carried(q.like(step.dt), &integrals);
        Ok(())
    }

    /// By value, so that the block of a run stays in registers.
    fn exact_drifting<E, I>(
        mut self,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        step: &StepInput<E, I>,
    ) -> Result<Self, DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
        let h = step.dt;
        let integrals = StepIntegrals::over_drifting(q, drift, (&self.theta, &self.P_theta), step)?;
        let process_noise = self.drift_noise(q, drift, step)?;
        self.carried(q.like(h), &integrals);
        let decay = drift.decay(q, h);
        (self.theta, self.P_theta) = drift.propagated(&self.theta, &self.P_theta, h);
        self.c1 = self.c1 * decay + process_noise.c1;
        self.c2 = self.c2 * decay + process_noise.c2;
        self.ppp = self.ppp + process_noise.ppp;
        self.ppv = self.ppv + process_noise.ppv;
        self.pvv = self.pvv + process_noise.pvv;
        Ok(self)
    }

    /// Blocks of `Q_d` that the noise of the parameters adds to the motion.
    fn drift_noise<E, I>(
        &self,
        q: V::Number,
        drift: &GaussMarkovSet<V, M>,
        step: &StepInput<E, I>,
    ) -> Result<Self, DomainError>
    where
        E: AccelerationModel<V, M>,
        I: Fn(f64) -> E::Input,
    {
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
        for impulse in DriftImpulse::over(q, drift, (&self.theta, &self.P_theta), step)? {
            let DriftImpulse { variance, to_p, to_v, left } = impulse;
            drift_noise.ppp = drift_noise.ppp + (to_p * variance).dot(to_p);
            drift_noise.ppv = drift_noise.ppv + (to_p * variance).dot(to_v);
            drift_noise.pvv = drift_noise.pvv + (to_v * variance).dot(to_v);
            drift_noise.c1 = drift_noise.c1 + to_p * variance * left;
            drift_noise.c2 = drift_noise.c2 + to_v * variance * left;
        }
        Ok(drift_noise)
    }
}
