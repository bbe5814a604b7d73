//! ACI with constant parameters and `P = U D U'`: the portable filter, with equal bits on every IEEE 754 processor.
//!
//! Parameters are last, so Thornton's step touches two rows of `U`; the reading is Bierman's (Bierman 1977, ch. V, VI).
//! Nothing is fused and every sum has one order.

use core::array::from_fn;

use crate::structured::aci::{MaskedInnovation, StepIntegrals};
use crate::structured::number::Real;
use crate::structured::row::{Plain, Row};

/// Mean `p, v, theta` and the factors of the covariance; `N = M + 2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AciFactored<T, const N: usize, const M: usize> {
    /// Position, m.
    pub p: T,
    /// Velocity, m/s.
    pub v: T,
    /// Parameters, SI.
    pub theta: Plain<T, M>,
    /// `U` between `p` and `v`.
    pub upv: T,
    /// `U` between `p` and the parameters.
    pub up: Plain<T, M>,
    /// `U` between `v` and the parameters.
    pub uv: Plain<T, M>,
    /// `U` among the parameters, by rows: unit upper triangular.
    pub U: [Plain<T, M>; M],
    /// `D` of `p` and `v`.
    pub d: [T; 2],
    /// `D` of the parameters.
    pub D: Plain<T, M>,
}

impl<T: Real, const N: usize, const M: usize> AciFactored<T, N, M> {
    /// From mean `x(i)` and factors `U(i, j)`, `i < j`, and `D(i)`, states `p, v, theta`.
    #[must_use]
    pub fn new(x: impl Fn(usize) -> T, U: impl Fn(usize, usize) -> T, D: impl Fn(usize) -> T) -> Self {
        const { assert!(N == M + 2) };
        let (zero, one) = (x(0).like(0.0), x(0).like(1.0));
        let among = |i: usize, j: usize| match i.cmp(&j) {
            core::cmp::Ordering::Less => U(i + 2, j + 2),
            core::cmp::Ordering::Equal => one,
            core::cmp::Ordering::Greater => zero,
        };
        Self {
            p: x(0),
            v: x(1),
            theta: Plain(from_fn(|i| x(i + 2))),
            upv: U(0, 1),
            up: Plain(from_fn(|j| U(0, j + 2))),
            uv: Plain(from_fn(|j| U(1, j + 2))),
            U: from_fn(|i| Plain(from_fn(|j| among(i, j)))),
            d: [D(0), D(1)],
            D: Plain(from_fn(|i| D(i + 2))),
        }
    }

    /// `P(i, j)`, multiplied out.
    #[must_use]
    pub fn P(&self, i: usize, j: usize) -> T {
        let entry = |i: usize, k: usize| match (i, k) {
            (0, 0) | (1, 1) => self.p.like(1.0),
            (0, 1) => self.upv,
            (0, k) => self.up.at(k - 2),
            (1, k) if k > 1 => self.uv.at(k - 2),
            (i, k) if i > 1 && k > 1 => self.U[i - 2].at(k - 2),
            _ => self.p.like(0.0),
        };
        let pivot = |k: usize| if k < 2 { self.d[k] } else { self.D.at(k - 2) };
        (0..N).fold(self.p.like(0.0), |sum, k| (entry(i, k) * pivot(k)).times_plus(entry(j, k), sum))
    }

    /// Thornton's step with `Phi = [[1, dt, to_p'], [0, 1, to_v'], [0, 0, 1]]`.
    ///
    /// The rows of the parameters are already in place, so `up += dt uv + to_p' U`, `uv += to_v' U`; what is left is the
    /// two by two step of `p, v` with the noise `Q`.
    #[inline(always)]
    pub fn predict(&mut self, dt: T, push: &StepIntegrals<Plain<T, M>>) {
        for j in 0..M {
            let (mut p, mut v) = (push.to_p.0[j], push.to_v.0[j]);
            for i in 0..j {
                p = push.to_p.0[i].times_plus(self.U[i].0[j], p);
                v = push.to_v.0[i].times_plus(self.U[i].0[j], v);
            }
            self.up.0[j] = dt.times_plus(self.uv.0[j], self.up.0[j]) + p;
            self.uv.0[j] = self.uv.0[j] + v;
        }
        let [qpp, qpv, qvv] = push.Q;
        let zero = dt.like(0.0);
        let w = self.upv + dt;
        let [dp, dv] = self.d;
        let pivot = dv + qvv;
        self.p = dt.times_plus(self.v, self.p) + push.dp;
        self.v = self.v + push.dv;
        if pivot.is_positive() {
            // The noise alone has pivots qvv and qpp - qpv^2 / qvv; what both share is a square, never a difference.
            let ratio = if qvv.is_positive() { qpv / qvv } else { zero };
            let remainder = w - ratio;
            self.upv = (w * dv + qpv) / pivot;
            self.d = [dp + (qpp - qpv * ratio) + dv * (qvv / pivot) * remainder * remainder, pivot];
        } else {
            self.upv = zero;
            self.d = [dp + qpp, pivot];
        }
    }

    /// `e` and `S` of a reading `z` of position with variance `R`.
    #[inline(always)]
    #[must_use]
    pub fn innovate(&self, z: T, R: T) -> MaskedInnovation<T> {
        let mut s = R + self.d[0];
        s = (self.upv * self.d[1]).times_plus(self.upv, s);
        for j in 0..M {
            s = (self.up.0[j] * self.D.0[j]).times_plus(self.up.0[j], s);
        }
        MaskedInnovation { e: z - self.p, s, present: None }
    }

    /// Bierman's update by a reading of position.
    ///
    /// Every new pivot is the old one times a ratio of sums of positive terms.
    #[inline(always)]
    pub fn correct(&mut self, R: T, innovation: &MaskedInnovation<T>) {
        let zero = R.like(0.0);
        let mut s = R + self.d[0];
        let mut gp = self.d[0];
        self.d[0] = if s.is_positive() { self.d[0] * (R / s) } else { self.d[0] };

        let f = self.upv;
        let g = self.d[1] * f;
        let before = s;
        s = f.times_plus(g, s);
        let lambda = if before.is_positive() { f / before } else { zero };
        if s.is_positive() {
            self.d[1] = self.d[1] * (before / s);
        }
        self.upv = f - lambda * gp;
        gp = f.times_plus(g, gp);
        let mut gv = g;

        let mut gains = [zero; M];
        for j in 0..M {
            let f = self.up.0[j];
            let g = self.D.0[j] * f;
            let before = s;
            s = f.times_plus(g, s);
            let lambda = if before.is_positive() { f / before } else { zero };
            if s.is_positive() {
                self.D.0[j] = self.D.0[j] * (before / s);
            }
            self.up.0[j] = f - lambda * gp;
            gp = f.times_plus(g, gp);
            let u = self.uv.0[j];
            self.uv.0[j] = u - lambda * gv;
            gv = u.times_plus(g, gv);
            for (row, gain) in self.U.iter_mut().zip(&mut gains).take(j) {
                let u = row.0[j];
                row.0[j] = u - lambda * *gain;
                *gain = u.times_plus(g, *gain);
            }
            gains[j] = g;
        }
        let scaled = innovation.e / s;
        self.p = gp.times_plus(scaled, self.p);
        self.v = gv.times_plus(scaled, self.v);
        self.theta = self.theta.plus(scaled, Plain(gains));
    }
}
