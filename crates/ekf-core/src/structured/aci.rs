//! ACI (9) in blocks: `P = [[ppp, ppv, c1'], [ppv, pvv, c2'], [c1, c2, P_theta]]`, states `p, v, theta`; `M` below is `P_theta`.
//!
//! `F` has two rows that are not zero, so while parameters are constant `M` does not change and a step costs inner products:
//! `ppp' = 2 ppv, ppv' = pvv + g'c1, pvv' = 2 g'c2 + q, c1' = c2, c2' = M g`. Equal to [`crate::Aci`] up to rounding.

use crate::dense::belief::{check_covariance, check_mean};
use crate::error::StepError;
use crate::structured::acceleration::AccelerationPartials;
use crate::structured::number::Number;
use crate::structured::row::{Row, add_outer, product};

/// Mean and covariance of ACI with `M` parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AciBlock<V: Row, const M: usize> {
    /// Position, m.
    pub p: V::Number,
    /// Velocity, m/s.
    pub v: V::Number,
    /// Parameters, SI.
    pub theta: V,
    /// Variance of `p`.
    pub ppp: V::Number,
    /// Covariance of `p` and `v`.
    pub ppv: V::Number,
    /// Variance of `v`.
    pub pvv: V::Number,
    /// Covariance of `p` and the parameters.
    pub c1: V,
    /// Covariance of `v` and the parameters.
    pub c2: V,
    /// Covariance of the parameters, by rows.
    pub P_theta: [V; M],
}

/// `e` and `S` of a reading before the update, masked where lanes lack it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaskedInnovation<T> {
    /// `e = z - H x`.
    pub e: T,
    /// `S = H P H' + R`.
    pub s: T,
    /// One where the reading is present, zero where it is missing; `None` if every lane has it.
    pub present: Option<T>,
}

impl<T: Number> MaskedInnovation<T> {
    /// `-1 / S`, or zero where the reading is missing: what waits for `S` then waits for no change of sign.
    #[inline(always)]
    pub(crate) fn minus_inverse(&self) -> T {
        -self.present.unwrap_or(self.s.like(1.0)) / self.s
    }

    /// The factor of the row of `p`: `R / S`, or one where the reading is missing; `minus` is [`Self::minus_inverse`].
    #[inline(always)]
    pub(crate) fn left(&self, R: T, minus: T) -> T {
        match self.present {
            None => -R * minus,
            Some(present) => (-R).times_plus(minus, R.like(1.0) - present),
        }
    }
}

impl<V: Row, const M: usize> AciBlock<V, M> {
    /// The blocks of mean `x(i)` and covariance `P(i, j)`, `j <= i`, states `p, v, theta`.
    #[must_use]
    pub fn new(x: impl Fn(usize) -> V::Number, P: impl Fn(usize, usize) -> V::Number) -> Self {
        let row = |of: &dyn Fn(usize) -> V::Number| V::from_fn(x(0), of);
        Self {
            p: x(0),
            v: x(1),
            theta: row(&|i| x(i + 2)),
            ppp: P(0, 0),
            ppv: P(1, 0),
            pvv: P(1, 1),
            c1: row(&|i| P(i + 2, 0)),
            c2: row(&|i| P(i + 2, 1)),
            P_theta: core::array::from_fn(|i| row(&|j| P(i.max(j) + 2, i.min(j) + 2))),
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
            _ => self.theta.at(i - 2),
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
            (1, 1) => self.pvv,
            (0, j) => self.c1.at(j - 2),
            (1, j) => self.c2.at(j - 2),
            (i, j) => self.P_theta[j - 2].at(i - 2),
        }
    }

    /// RK2, midpoint, of (11)-(12) over `dt` seconds, from the instants at start and middle; `q` is the output's density.
    #[inline(always)]
    pub fn rk2(&mut self, dt: f64, q: V::Number, start: &AccelerationPartials<V>, middle: &AccelerationPartials<V>) {
        let c = |x: f64| q.like(x);
        let (h, half) = (c(dt), c(0.5 * dt));
        let (q0, qm) = (q * (start.slope * start.slope), q * (middle.slope * middle.slope));
        let c1 = self.c1.plus(half, self.c2);
        let c2 = self.c2.plus(half, start.h);
        // What a reading before this step reaches last, `c2` and `pvv`, enters last: the next reading waits for it.
        let pushed = half.times_plus(q0, self.pvv) + middle.g.dot(c1);
        let ppp = c(2.0 * dt).times_plus(self.ppv, self.ppp);
        self.ppp = c(dt * dt).times_plus(self.pvv + start.g.dot(self.c1), ppp);
        self.ppv = h.times_plus(h.times_plus(start.g.dot(self.c2), pushed), self.ppv);
        self.pvv = c(2.0 * dt).times_plus(middle.g.dot(c2), h.times_plus(qm, self.pvv));
        self.c1 = self.c1.plus(h, c2);
        self.c2 = self.c2.plus(h, middle.h);
        self.p = h.times_plus(half.times_plus(start.a, self.v), self.p);
        self.v = h.times_plus(middle.a, self.v);
    }

    /// RK4 of (13)-(14): with constant parameters all four stages fall into one closed form.
    ///
    /// With `gf = g0 + 2 gm`, `gs = gf + 2 gm + g1` and likewise `q`:
    /// `ppp += 2 dt ppv + dt^2/3 (3 pvv + gf'(c1 + dt c2) + dt^2 3/4 gm'h0 + dt (q0 + qm)/2)`,
    /// `ppv += dt pvv + dt/6 (gs'c1 + dt ((gs + gf)'c2 + dt (gm'(h0 + hm) + (gm'h0 + g1'hm)/2) + q0 + 2 qm))`,
    /// `pvv += dt/6 (2 gs'c2 + 2 dt (gm'(h0 + hm) + g1'hm) + q0 + 4 qm + q1)`.
    #[inline(always)]
    pub fn rk4(
        &mut self,
        dt: f64,
        q: V::Number,
        start: &AccelerationPartials<V>,
        middle: &AccelerationPartials<V>,
        end: &AccelerationPartials<V>,
    ) {
        let c = |x: f64| q.like(x);
        let constant = |x: f64| V::every(c(x));
        let (h, sixth) = (c(dt), c(dt / 6.0));
        let (q0, qm) = (q * (start.slope * start.slope), q * (middle.slope * middle.slope));
        let q1 = q * (end.slope * end.slope);
        let two = constant(2.0);
        let gf = two.times_plus(middle.g, start.g);
        let gs = two.times_plus(middle.g, gf + end.g);
        let c1 = self.c1.plus(h, self.c2);
        let c2 = self.c2.plus(h, middle.h);
        let shared = (middle.g * middle.h).scaled(c(-3.0 * dt));
        let dv = gs.times_plus(c2, shared);
        let dp = gs.times_plus(c1.plus(c(0.5 * dt * dt), middle.h), gf.times_plus(c2, shared).scaled(h));
        let dd = gf.times_plus(c1, (start.g * middle.h).scaled(c(0.75 * dt * dt)));
        let (dv, dp, dd) = (dv.sum(), dp.sum(), dd.sum());

        let pushed = c(0.5 * dt).times_plus(q0 + qm, dd);
        self.ppp = c(2.0 * dt)
            .times_plus(self.ppv, c(dt * dt / 3.0).times_plus(c(3.0).times_plus(self.pvv, pushed), self.ppp));
        self.ppv = h.times_plus(self.pvv, sixth.times_plus(h.times_plus(c(2.0).times_plus(qm, q0), dp), self.ppv));
        self.pvv = sixth.times_plus(c(2.0).times_plus(dv, c(4.0).times_plus(qm, q0 + q1)), self.pvv);

        let hf = two.times_plus(middle.h, start.h);
        self.c1 = c1.plus(c(dt * dt / 6.0), hf);
        self.c2 = self.c2.plus(sixth, two.times_plus(middle.h, hf + end.h));
        let af = c(2.0).times_plus(middle.a, start.a);
        self.p = c(dt * dt / 6.0).times_plus(af, h.times_plus(self.v, self.p));
        self.v = sixth.times_plus(c(2.0).times_plus(middle.a, af + end.a), self.v);
    }

    /// `e` and `S` of a reading `z` of `p + tau v` with variance `R`; `tau` is the low-pass in front of the output.
    #[inline(always)]
    #[must_use]
    pub fn innovate(&self, tau: f64, z: V::Number, R: V::Number) -> MaskedInnovation<V::Number> {
        if tau == 0.0 {
            return MaskedInnovation { e: z - self.p, s: self.ppp + R, present: None };
        }
        let tau = R.like(tau);
        let (dp, dv) = self.motion_covariance(tau);
        MaskedInnovation { e: z - tau.times_plus(self.v, self.p), s: tau.times_plus(dv, dp) + R, present: None }
    }

    /// Updates by the reading: `x += P H' e / S`, `P -= P H' H P / S`, with one division.
    ///
    /// Without a low-pass the row of `p` is multiplied by `f = R / S`, which keeps `ppp` positive whatever the rounding.
    #[inline(always)]
    pub fn correct(&mut self, tau: f64, R: V::Number, innovation: &MaskedInnovation<V::Number>) {
        if tau != 0.0 {
            let tau = R.like(tau);
            let (dp, dv) = self.motion_covariance(tau);
            self.correct_with(&CrossCovariance { dp, dv, column: self.c1.plus(tau, self.c2) }, innovation);
            return;
        }
        let minus = innovation.minus_inverse();
        let (ei, f) = (-innovation.e * minus, innovation.left(R, minus));
        self.p = self.ppp.times_plus(ei, self.p);
        self.v = self.ppv.times_plus(ei, self.v);
        self.theta = self.theta.plus(ei, self.c1);
        add_outer(&mut self.P_theta, &self.c1, minus);
        let minus_v = self.ppv * minus;
        self.c2 = self.c2.plus(minus_v, self.c1);
        self.pvv = minus_v.times_plus(self.ppv, self.pvv);
        self.c1 = self.c1.scaled(f);
        self.ppv = self.ppv * f;
        self.ppp = self.ppp * f;
    }

    /// `e` and `S` of a reading of `p + tau v + b'theta`: an encoder with effects `b` of its own; and `P H'`.
    #[inline(always)]
    #[must_use]
    pub fn innovate_with_effects(
        &self,
        tau: V::Number,
        b: &V,
        z: V::Number,
        R: V::Number,
    ) -> (MaskedInnovation<V::Number>, CrossCovariance<V>) {
        let (dp, dv) = self.motion_covariance(tau);
        let cross = CrossCovariance {
            dp: dp + b.dot(self.c1),
            dv: dv + b.dot(self.c2),
            column: self.c1.plus(tau, self.c2) + product(&self.P_theta, b),
        };
        let expected = tau.times_plus(self.v, self.p) + b.dot(self.theta);
        (
            MaskedInnovation {
                e: z - expected,
                s: tau.times_plus(cross.dv, cross.dp) + b.dot(cross.column) + R,
                present: None,
            },
            cross,
        )
    }

    /// Updates by such a reading; `cross` is its `P H'`.
    #[inline(always)]
    pub fn correct_with(&mut self, cross: &CrossCovariance<V>, innovation: &MaskedInnovation<V::Number>) {
        let &CrossCovariance { dp, dv, column } = cross;
        let minus = innovation.minus_inverse();
        let ei = -innovation.e * minus;
        self.p = dp.times_plus(ei, self.p);
        self.v = dv.times_plus(ei, self.v);
        self.theta = self.theta.plus(ei, column);
        let (minus_p, minus_v) = (dp * minus, dv * minus);
        self.ppp = minus_p.times_plus(dp, self.ppp);
        self.ppv = minus_p.times_plus(dv, self.ppv);
        self.pvv = minus_v.times_plus(dv, self.pvv);
        self.c1 = self.c1.plus(minus_p, column);
        self.c2 = self.c2.plus(minus_v, column);
        add_outer(&mut self.P_theta, &column, minus);
    }

    /// `P H'` of `p + tau v` in the rows of `p` and `v`.
    #[inline(always)]
    fn motion_covariance(&self, tau: V::Number) -> (V::Number, V::Number) {
        (tau.times_plus(self.ppv, self.ppp), tau.times_plus(self.pvv, self.ppv))
    }

    /// `P = Phi P Phi' + Q` with `Phi = [[1, dt, to_p'], [0, 1, to_v'], [0, 0, 1]]`; the mean is moved by `dp`, `dv`.
    #[inline(always)]
    pub fn carried(&mut self, dt: V::Number, push: &StepIntegrals<V>) {
        let (mp, mv) = (product(&self.P_theta, &push.to_p), product(&self.P_theta, &push.to_v));
        let two = dt.like(2.0);
        let c1 = self.c1.plus(dt, self.c2);
        let ppv = dt.times_plus(self.pvv, self.ppv);
        let [qpp, qpv, qvv] = push.Q;
        self.ppp = dt.times_plus(self.ppv + ppv, self.ppp) + two.times_plus(push.to_p.dot(c1), push.to_p.dot(mp)) + qpp;
        self.ppv = ppv + push.to_p.dot(self.c2 + mv) + push.to_v.dot(c1) + qpv;
        self.pvv = self.pvv + two.times_plus(push.to_v.dot(self.c2), push.to_v.dot(mv)) + qvv;
        self.c1 = c1 + mp;
        self.c2 = self.c2 + mv;
        self.p = dt.times_plus(self.v, self.p) + push.dp;
        self.v = self.v + push.dv;
    }
}

/// `P H'` of a reading, by blocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossCovariance<V: Row> {
    /// In the row of `p`.
    pub dp: V::Number,
    /// In the row of `v`.
    pub dv: V::Number,
    /// In the rows of the parameters.
    pub column: V,
}

/// Integrals of the acceleration, its gradient and its noise over one step with constant parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepIntegrals<V: Row> {
    /// `int (dt - s) a ds`, m.
    pub dp: V::Number,
    /// `int a ds`, m/s.
    pub dv: V::Number,
    /// `int (dt - s) g ds`.
    pub to_p: V,
    /// `int g ds`.
    pub to_v: V,
    /// Noise gathered: `pp`, `pv`, `vv`.
    pub Q: [V::Number; 3],
}

impl<V: Row<Number = f64>, const M: usize> AciBlock<V, M> {
    /// Whether the mean is finite and `P` can still be a covariance.
    ///
    /// # Errors
    /// [`StepError::Mean`], [`StepError::Variance`], [`StepError::Correlation`].
    #[inline]
    pub fn checked(&self) -> Result<(), StepError> {
        check_mean(M + 2, |i| self.x(i))?;
        check_covariance(M + 2, |i, j| self.P(i, j))
    }
}
