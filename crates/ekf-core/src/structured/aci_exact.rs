//! The step of ACI whose parameters stand still, as integrals over the drive: exact, or with Runge-Kutta's `Phi`.

use crate::dense::integrate::{Integrator, nodes};
use crate::error::DomainError;
use crate::structured::acceleration::{AccelerationModel, AccelerationPartials};
use crate::structured::aci::StepIntegrals;
use crate::structured::number::Number;
use crate::structured::row::Row;

impl<V: Row> StepIntegrals<V> {
    /// The push over `dt` seconds, `input(s)` being what is given `s` seconds into the step.
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
        effect: &E,
        table: &E::Table,
        input: impl Fn(f64) -> E::Input,
    ) -> Result<Self, DomainError> {
        let zero = q.like(0.0);
        let mut exact = Self { dp: zero, dv: zero, to_p: V::every(zero), to_v: V::every(zero), Q: [zero; 3] };
        for (s, weight) in nodes(0.0, dt) {
            exact.add(dt - s, weight, q, &effect.at(table, input(s))?);
        }
        if integrator == Integrator::Exact {
            return Ok(exact);
        }
        let start = effect.at(table, input(0.0))?;
        let middle = effect.at(table, input(0.5 * dt))?;
        if integrator == Integrator::Rk2 {
            return Ok(exact.with(&start, 0.5 * dt * dt, &[(&middle, dt)]));
        }
        let end = effect.at(table, input(dt))?;
        let (lever, sixth) = (dt * dt / 6.0, dt / 6.0);
        let first = exact.with(&start, lever, &[(&start, sixth), (&middle, 4.0 * sixth), (&end, sixth)]);
        let rest = exact.with(&middle, 2.0 * lever, &[]);
        Ok(Self { dp: first.dp + rest.dp, to_p: first.to_p + rest.to_p, ..first })
    }

    /// The push over `dt` seconds of a drive that stands still, from its one instant: a microcontroller's step.
    ///
    /// Evaluated in the middle of a straight output it leaves out the slope's lever, `slope dt^3 / 12` of position a step.
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
        let mut push =
            Self { dp: lever * position.a, dv: zero, to_p: position.g.scaled(lever), to_v: V::every(zero), Q: self.Q };
        for (at, weight) in velocity {
            let weight = witness.like(*weight);
            push.dv = weight.times_plus(at.a, push.dv);
            push.to_v = push.to_v.plus(weight, at.g);
        }
        push
    }
}
