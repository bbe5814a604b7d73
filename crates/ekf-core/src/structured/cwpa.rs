//! CWPA (10) in blocks: motion `p, v, a` in six numbers, its covariances with the parameters, the parameters' own.
//!
//! White jerk of density `q` moves `a`; `Phi` acts on the motion alone, so a step never multiplies whole matrices. Equal to
//! [`crate::Cwpa`] without a low-pass, up to rounding.

use core::convert::Infallible;

use crate::dense::belief::{check_covariance, check_mean};
use crate::dense::system::Order;
use crate::error::{DomainError, StepError};
use crate::integration::{Derivative, Integrator, Stage, runge_kutta};
use crate::structured::aci::MaskedInnovation;
use crate::structured::gauss_markov::GaussMarkovSet;
use crate::structured::measurement::{OutputModel, PredictedOutput};
use crate::structured::number::Number;
use crate::structured::row::{Row, add_outer, moved_rows, product};

/// Mean and covariance of CWPA with `M` parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CwpaBlock<V: Row, const M: usize> {
    /// Position, m.
    pub p: V::Number,
    /// Velocity, m/s.
    pub v: V::Number,
    /// Acceleration, m/s^2.
    pub a: V::Number,
    /// Parameters, SI.
    pub theta: V,
    /// Variance of `p`.
    pub ppp: V::Number,
    /// Covariance of `p` and `v`.
    pub ppv: V::Number,
    /// Covariance of `p` and `a`.
    pub ppa: V::Number,
    /// Variance of `v`.
    pub pvv: V::Number,
    /// Covariance of `v` and `a`.
    pub pva: V::Number,
    /// Variance of `a`.
    pub paa: V::Number,
    /// Covariance of `p` and the parameters.
    pub cp: V,
    /// Covariance of `v` and the parameters.
    pub cv: V,
    /// Covariance of `a` and the parameters.
    pub ca: V,
    /// Covariance of the parameters, by rows.
    pub P_theta: [V; M],
}

/// The innovation of an output reading, and its `P H'`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputInnovation<V: Row> {
    /// `e` and `S`.
    pub innovation: MaskedInnovation<V::Number>,
    motion: [V::Number; 3],
    theta: V,
}

impl<V: Row, const M: usize> CwpaBlock<V, M> {
    /// The blocks of mean `x(i)` and covariance `P(i, j)`, `j <= i`, states `p, v, a, theta`.
    #[must_use]
    pub fn new(x: impl Fn(usize) -> V::Number, P: impl Fn(usize, usize) -> V::Number) -> Self {
        let row = |of: &dyn Fn(usize) -> V::Number| V::from_fn(x(0), of);
        Self {
            p: x(0),
            v: x(1),
            a: x(2),
            theta: row(&|i| x(i + 3)),
            ppp: P(0, 0),
            ppv: P(1, 0),
            ppa: P(2, 0),
            pvv: P(1, 1),
            pva: P(2, 1),
            paa: P(2, 2),
            cp: row(&|i| P(i + 3, 0)),
            cv: row(&|i| P(i + 3, 1)),
            ca: row(&|i| P(i + 3, 2)),
            P_theta: core::array::from_fn(|i| row(&|j| P(i.max(j) + 3, i.min(j) + 3))),
        }
    }

    /// State `i`.
    ///
    /// # Panics
    /// If there is no state `i`.
    #[must_use]
    pub fn x(&self, i: usize) -> V::Number {
        match i {
            0 => self.p,
            1 => self.v,
            2 => self.a,
            _ => self.theta.at(i - 3),
        }
    }

    /// Covariance of states `i` and `j`.
    ///
    /// # Panics
    /// If there is no state `i` or `j`.
    #[must_use]
    pub fn P(&self, i: usize, j: usize) -> V::Number {
        match (i.min(j), i.max(j)) {
            (0, 0) => self.ppp,
            (0, 1) => self.ppv,
            (0, 2) => self.ppa,
            (1, 1) => self.pvv,
            (1, 2) => self.pva,
            (2, 2) => self.paa,
            (0, j) => self.cp.at(j - 3),
            (1, j) => self.cv.at(j - 3),
            (2, j) => self.ca.at(j - 3),
            (i, j) => self.P_theta[j - 3].at(i - 3),
        }
    }

    /// One step of `dt` seconds; the parameters may drift.
    #[inline(always)]
    pub fn step(&mut self, integrator: Integrator, dt: f64, q: V::Number, drift: &GaussMarkovSet<V, M>) {
        if integrator == Integrator::Exact {
            self.exact(dt, q);
            if !drift.is_constant() {
                *self = self.gauss_markov(dt, drift);
            }
        } else {
            let start = *self;
            let Ok(moved) = runge_kutta(integrator, &BlockRate { q, drift }, &start, 0.0, dt);
            *self = moved;
        }
    }

    /// `P = Phi P Phi' + Q` of the motion in closed form (derivations 4.1), parameters constant.
    #[inline(always)]
    pub fn exact(&mut self, dt: f64, q: V::Number) {
        let c = |x: f64| q.like(x);
        let (h, lever) = (c(dt), c(0.5 * dt * dt));
        let dt2 = dt * dt;
        let (va, aa) = (self.pva, self.paa);
        let pp = lever.times_plus(self.ppa, h.times_plus(self.ppv, self.ppp));
        let pv = lever.times_plus(va, h.times_plus(self.pvv, self.ppv));
        let vv = h.times_plus(va, self.pvv);
        self.ppa = lever.times_plus(aa, h.times_plus(va, self.ppa));
        self.pva = h.times_plus(aa, va);
        self.ppp = lever.times_plus(self.ppa, h.times_plus(pv, q.times_plus(c(dt2 * dt2 * dt / 20.0), pp)));
        self.ppv = h.times_plus(self.ppa, q.times_plus(c(dt2 * dt2 / 8.0), pv));
        self.pvv = h.times_plus(self.pva, q.times_plus(c(dt2 * dt / 3.0), vv));
        self.ppa = q.times_plus(c(dt2 * dt / 6.0), self.ppa);
        self.pva = q.times_plus(c(dt2 / 2.0), self.pva);
        self.paa = q.times_plus(h, aa);
        self.cp = self.cp.plus(h, self.cv).plus(lever, self.ca);
        self.cv = self.cv.plus(h, self.ca);
        self.p = lever.times_plus(self.a, h.times_plus(self.v, self.p));
        self.v = h.times_plus(self.a, self.v);
    }

    /// Propagates drifting parameters over `dt` seconds; by value, so that the block of a run stays in registers.
    fn gauss_markov(mut self, dt: f64, drift: &GaussMarkovSet<V, M>) -> Self {
        let decay = drift.decay(self.p, dt);
        self.cp = self.cp * decay;
        self.cv = self.cv * decay;
        self.ca = self.ca * decay;
        (self.theta, self.P_theta) = drift.propagated(&self.theta, &self.P_theta, dt);
        self
    }

    /// `e` and `S` of a reading `z` of position with variance `R`.
    #[inline(always)]
    #[must_use]
    pub fn innovate_position(&self, z: V::Number, R: V::Number) -> MaskedInnovation<V::Number> {
        MaskedInnovation { e: z - self.p, s: self.ppp + R, present: None }
    }

    /// Updates by a reading of position; the row of `p` is multiplied by `R / S`.
    #[inline(always)]
    pub fn correct_position(&mut self, R: V::Number, innovation: &MaskedInnovation<V::Number>) {
        let minus = innovation.minus_inverse();
        let f = innovation.left(R, minus);
        let column = [self.ppp, self.ppv, self.ppa];
        let c = self.cp;
        self.correct(minus, innovation.e, column, c);
        self.ppp = column[0] * f;
        self.ppv = column[1] * f;
        self.ppa = column[2] * f;
        self.cp = c.scaled(f);
    }

    /// `e` and `S` of a reading `z` of the output with variance `R`.
    ///
    /// The Hessian of `output(a, theta)` is `d g' + g d'`: its traces with `P` are inner products with `P g` and `P d`.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    #[inline(always)]
    pub fn innovate_output<O: OutputModel<V>>(
        &self,
        sensor: &O,
        order: Order,
        z: V::Number,
        R: V::Number,
    ) -> Result<OutputInnovation<V>, DomainError> {
        let PredictedOutput { expected, slope, h, curvature: (da, d), along } =
            sensor.predicted(&self.theta, self.a)?;
        let motion = [
            slope.times_plus(self.ppa, h.dot(self.cp)),
            slope.times_plus(self.pva, h.dot(self.cv)),
            slope.times_plus(self.paa, h.dot(self.ca)),
        ];
        let theta = product(&self.P_theta, &h).plus(slope, self.ca);
        let mut e = z - expected;
        // The part of the parameters depends on the longest chain, so it is added last.
        let mut s = slope.times_plus(motion[2], R) + h.dot(theta);
        if order == Order::Second {
            let dPd = da
                .times_plus(da.times_plus(self.paa, da.like(2.0) * d.dot(self.ca)), d.dot(product(&self.P_theta, &d)));
            let (dPg, gPg) = match along {
                None => (da.times_plus(self.paa, d.dot(self.ca)), self.paa),
                Some((ga, g)) => {
                    let ya = ga.times_plus(self.paa, g.dot(self.ca));
                    let y = product(&self.P_theta, &g).plus(ga, self.ca);
                    (da.times_plus(ya, d.dot(y)), ga.times_plus(ya, g.dot(y)))
                }
            };
            e = e - dPg;
            s = dPg.times_plus(dPg, dPd.times_plus(gPg, s));
        }
        Ok(OutputInnovation { innovation: MaskedInnovation { e, s, present: None }, motion, theta })
    }

    /// Updates by a reading of the output.
    #[inline(always)]
    pub fn correct_output(&mut self, output: &OutputInnovation<V>) {
        let minus = output.innovation.minus_inverse();
        let [kp, kv, ka] = output.motion;
        let minus_p = kp * minus;
        self.ppp = minus_p.times_plus(kp, self.ppp);
        self.ppv = minus_p.times_plus(kv, self.ppv);
        self.ppa = minus_p.times_plus(ka, self.ppa);
        self.cp = self.cp.plus(minus_p, output.theta);
        self.correct(minus, output.innovation.e, output.motion, output.theta);
    }

    /// `x -= column e minus`, `P += column column' minus`, but for the row of `p` in `P`.
    #[inline(always)]
    fn correct(&mut self, minus: V::Number, e: V::Number, [kp, kv, ka]: [V::Number; 3], theta: V) {
        let ei = -e * minus;
        self.p = kp.times_plus(ei, self.p);
        self.v = kv.times_plus(ei, self.v);
        self.a = ka.times_plus(ei, self.a);
        self.theta = self.theta.plus(ei, theta);
        let (minus_v, minus_a) = (kv * minus, ka * minus);
        self.pvv = minus_v.times_plus(kv, self.pvv);
        self.pva = minus_v.times_plus(ka, self.pva);
        self.paa = minus_a.times_plus(ka, self.paa);
        self.cv = self.cv.plus(minus_v, theta);
        self.ca = self.ca.plus(minus_a, theta);
        add_outer(&mut self.P_theta, &theta, minus);
    }
}

/// The right-hand side of CWPA: autonomous, and never without a value.
struct BlockRate<'a, V: Row, const M: usize> {
    q: V::Number,
    drift: &'a GaussMarkovSet<V, M>,
}

impl<V: Row, const M: usize> Derivative<CwpaBlock<V, M>> for BlockRate<'_, V, M> {
    type Error = Infallible;

    #[inline(always)]
    fn rate(&self, y: &CwpaBlock<V, M>, _: f64) -> Result<CwpaBlock<V, M>, Infallible> {
        let &Self { q, drift } = self;
        let two = q.like(2.0);
        let (theta, P_theta) = drift.rate(&y.theta, &y.P_theta);
        Ok(CwpaBlock {
            p: y.v,
            v: y.a,
            a: q.like(0.0),
            theta,
            ppp: two * y.ppv,
            ppv: y.pvv + y.ppa,
            ppa: y.pva,
            pvv: two * y.pva,
            pva: y.paa,
            paa: q,
            cp: y.cv + drift.decay_rate(y.cp),
            cv: y.ca + drift.decay_rate(y.cv),
            ca: drift.decay_rate(y.ca),
            P_theta,
        })
    }
}

impl<V: Row, const M: usize> Stage for CwpaBlock<V, M> {
    #[inline(always)]
    fn moved(&self, h: f64, rate: &Self) -> Self {
        let h = rate.p.like(h);
        Self {
            p: h.times_plus(rate.p, self.p),
            v: h.times_plus(rate.v, self.v),
            a: h.times_plus(rate.a, self.a),
            theta: self.theta.plus(h, rate.theta),
            ppp: h.times_plus(rate.ppp, self.ppp),
            ppv: h.times_plus(rate.ppv, self.ppv),
            ppa: h.times_plus(rate.ppa, self.ppa),
            pvv: h.times_plus(rate.pvv, self.pvv),
            pva: h.times_plus(rate.pva, self.pva),
            paa: h.times_plus(rate.paa, self.paa),
            cp: self.cp.plus(h, rate.cp),
            cv: self.cv.plus(h, rate.cv),
            ca: self.ca.plus(h, rate.ca),
            P_theta: moved_rows(&self.P_theta, h, &rate.P_theta),
        }
    }
}

impl<V: Row<Number = f64>, const M: usize> CwpaBlock<V, M> {
    /// Whether the mean is finite and `P` can still be a covariance.
    ///
    /// # Errors
    /// [`StepError::Mean`], [`StepError::Variance`], [`StepError::Correlation`].
    #[inline]
    pub fn checked(&self) -> Result<(), StepError> {
        check_mean(M + 3, |i| self.x(i))?;
        check_covariance(M + 3, |i, j| self.P(i, j))
    }
}
