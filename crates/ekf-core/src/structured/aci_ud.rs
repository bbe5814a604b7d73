//! ACI with `P = U D U'`: the filter that cannot lose positive definiteness, with equal bits on every IEEE 754 processor.
//!
//! Parameters are last, so Thornton's step touches two rows of `U`; the reading is Bierman's (Bierman 1977, ch. V, VI), the
//! noise of drifting parameters enters by the rank-one update of Agee and Turner. Every new pivot is a sum or a ratio of
//! sums of terms that are not negative. Nothing is fused and every sum has one order.

use core::array::from_fn;

use nalgebra::SMatrix;

use crate::dense::system::Order;
use crate::dense::ud::factorise;
use crate::error::{DomainError, SetupError, StepError};
use crate::integration::Integrator;
use crate::structured::acceleration::AccelerationModel;
use crate::structured::aci::{MaskedInnovation, StepIntegrals};
use crate::structured::aci_exact::DriftImpulse;
use crate::structured::aci_step::StepInput;
use crate::structured::gauss_markov::GaussMarkovSet;
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

    /// State `i`.
    ///
    /// # Panics
    /// If there is no state `i`.
    #[must_use]
    pub fn x(&self, i: usize) -> T {
        match i {
            0 => self.p,
            1 => self.v,
            _ => self.theta.at(i - 2),
        }
    }

    /// `P(i, j)`, multiplied out.
    ///
    /// # Panics
    /// If there is no state `i` or `j`.
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

    /// One step without integration error; the parameters may drift. Returns what they add to the motion.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse; the factors are then as they were.
    pub fn exact<E, I>(
        &mut self,
        q: T,
        drift: &GaussMarkovSet<Plain<T, M>, M>,
        step: &StepInput<E, I>,
    ) -> Result<StepIntegrals<Plain<T, M>>, DomainError>
    where
        E: AccelerationModel<Plain<T, M>, M>,
        I: Fn(f64) -> E::Input,
    {
        let P_theta = match step.order {
            Order::First => [Plain::every(q.like(0.0)); M], // only the second order looks at it
            Order::Second => from_fn(|i| Plain(from_fn(|j| self.P(i + 2, j + 2)))),
        };
        let dt = q.like(step.dt);
        if drift.is_constant() {
            let table = step.model.table(&self.theta, &P_theta, step.order);
            let integrals =
                StepIntegrals::over::<E, M>(Integrator::Exact, step.dt, q, &step.model, &table, &step.input)?;
            self.predict(dt, &integrals);
            return Ok(integrals);
        }
        let start = (&self.theta, &P_theta);
        let integrals = StepIntegrals::over_drifting(q, drift, start, step)?;
        let impulses = DriftImpulse::over(q, drift, start, step)?;
        self.predict(dt, &integrals);
        self.decay(&drift.decay(q, step.dt));
        for impulse in &impulses {
            self.add_impulses(impulse);
        }
        Ok(integrals)
    }

    /// Multiplies the parameters by `left`: their rows of `U`, brought back to a unit diagonal.
    fn decay(&mut self, left: &Plain<T, M>) {
        self.theta = self.theta * *left;
        for j in 0..M {
            let factor = left.at(j);
            self.D.0[j] = self.D.0[j] * (factor * factor);
            if !factor.is_positive() {
                continue; // nothing is left, and the column counts no more
            }
            self.up.0[j] = self.up.0[j] / factor;
            self.uv.0[j] = self.uv.0[j] / factor;
            for i in 0..j {
                self.U[i].0[j] = self.U[i].0[j] * left.at(i) / factor;
            }
        }
    }

    /// Adds the noise of every drifting parameter, one after the other.
    fn add_impulses(&mut self, impulse: &DriftImpulse<Plain<T, M>>) {
        let zero = self.p.like(0.0);
        for i in 0..M {
            let c = impulse.variance.at(i);
            if c.is_positive() {
                let mut a = [zero; M];
                a[i] = impulse.left.at(i);
                self.add_outer(c, (impulse.to_p.at(i), impulse.to_v.at(i)), a, i + 1);
            }
        }
    }

    /// Covariance of `p, v` if the parameters were known: of `p`, of both, of `v`.
    #[must_use]
    pub fn with_known_parameters(&self) -> [T; 3] {
        let pv = self.upv * self.d[1];
        [self.upv.times_plus(pv, self.d[0]), pv, self.d[1]]
    }

    /// `P[:, theta] w`: in the rows of `p`, of `v` and of the parameters.
    #[must_use]
    pub fn columns(&self, w: &Plain<T, M>) -> (T, T, Plain<T, M>) {
        let mut f = *w;
        for j in 0..M {
            for i in 0..j {
                f.0[j] = w.0[i].times_plus(self.U[i].0[j], f.0[j]);
            }
        }
        let f = f * self.D;
        (self.up.dot(f), self.uv.dot(f), Plain(from_fn(|i| self.U[i].dot(f))))
    }

    /// `P += c a a'` with `a = (ap, av, a)`, whose numbers behind the first `count` parameters are zero (Bierman 1977, ch. III).
    pub fn add_outer(&mut self, mut c: T, (mut ap, mut av): (T, T), mut a: [T; M], count: usize) {
        for j in (0..count).rev() {
            let s = a[j];
            let pivot = (c * s).times_plus(s, self.D.0[j]);
            if !pivot.is_positive() {
                continue;
            }
            let beta = s * (c / pivot);
            c = c * (self.D.0[j] / pivot);
            self.D.0[j] = pivot;
            ap = ap - s * self.up.0[j];
            self.up.0[j] = beta.times_plus(ap, self.up.0[j]);
            av = av - s * self.uv.0[j];
            self.uv.0[j] = beta.times_plus(av, self.uv.0[j]);
            for (a, row) in a.iter_mut().zip(&mut self.U).take(j) {
                *a = *a - s * row.0[j];
                row.0[j] = beta.times_plus(*a, row.0[j]);
            }
        }
        let pivot = (c * av).times_plus(av, self.d[1]);
        if pivot.is_positive() {
            let beta = av * (c / pivot);
            c = c * (self.d[1] / pivot);
            self.d[1] = pivot;
            ap = ap - av * self.upv;
            self.upv = beta.times_plus(ap, self.upv);
        }
        self.d[0] = (c * ap).times_plus(ap, self.d[0]);
    }

    /// `e` and `S` of a reading of `p + tau v + b'theta`: an encoder with effects `b` of its own; and `f = U' H`.
    #[must_use]
    pub fn innovate_with_effects(
        &self,
        tau: T,
        b: &Plain<T, M>,
        z: T,
        R: T,
    ) -> (MaskedInnovation<T>, FactoredReading<T, M>) {
        let v = self.upv + tau;
        let mut theta = *b + self.up.plus(tau, self.uv);
        for j in 0..M {
            for i in 0..j {
                theta.0[j] = b.0[i].times_plus(self.U[i].0[j], theta.0[j]);
            }
        }
        let mut s = (v * self.d[1]).times_plus(v, R + self.d[0]);
        for (f, D) in theta.0.iter().zip(&self.D.0) {
            s = (*f * *D).times_plus(*f, s);
        }
        let e = z - (tau.times_plus(self.v, self.p) + b.dot(self.theta));
        (MaskedInnovation { e, s, present: None }, FactoredReading { v, theta, b: *b })
    }

    /// Bierman's update by such a reading; what it would be if the parameters were known, and its gains.
    pub fn correct_with(
        &mut self,
        R: T,
        reading: &FactoredReading<T, M>,
        innovation: &MaskedInnovation<T>,
    ) -> (KnownParameters<T>, UpdateGains<T, M>) {
        let zero = R.like(0.0);
        let mut s = R + self.d[0];
        let mut gp = self.d[0];
        if s.is_positive() {
            self.d[0] = self.d[0] * (R / s);
        }
        let f = reading.v;
        let g = self.d[1] * f;
        let before = s;
        s = f.times_plus(g, s);
        let lambda = if before.is_positive() { f / before } else { zero };
        if s.is_positive() {
            self.d[1] = self.d[1] * (before / s);
        }
        let u = self.upv;
        self.upv = u - lambda * gp;
        gp = u.times_plus(g, gp);
        let mut gv = g;
        let settled = KnownParameters { gain: [gp / s, gv / s], s };

        let mut gains = [zero; M];
        for j in 0..M {
            let f = reading.theta.0[j];
            let g = self.D.0[j] * f;
            let before = s;
            s = f.times_plus(g, s);
            let lambda = if before.is_positive() { f / before } else { zero };
            if s.is_positive() {
                self.D.0[j] = self.D.0[j] * (before / s);
            }
            let u = self.up.0[j];
            self.up.0[j] = u - lambda * gp;
            gp = u.times_plus(g, gp);
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
        (settled, UpdateGains { unscaled: ([gp, gv], Plain(gains)), s })
    }
}

/// A reading in the filter of `p, v` whose parameters are known, which is a part of the factors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownParameters<T> {
    /// Gains of `p` and `v`.
    pub gain: [T; 2],
    /// Variance of the innovation.
    pub s: T,
}

/// Gains of an update, which cost a division only where they are asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UpdateGains<T, const M: usize> {
    /// Of `p`, `v` and the parameters, times `s`.
    pub unscaled: ([T; 2], Plain<T, M>),
    /// Variance of the innovation.
    pub s: T,
}

/// `f = U' H` of a reading, but for position, where it is one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FactoredReading<T, const M: usize> {
    /// In the place of `v`.
    pub v: T,
    /// In the places of the parameters.
    pub theta: Plain<T, M>,
    /// Of the parameters in the reading.
    pub b: Plain<T, M>,
}

impl<const N: usize, const M: usize> AciFactored<f64, N, M> {
    /// From mean `x(i)` and covariance `P(i, j)`, `j <= i`, states `p, v, theta`.
    ///
    /// # Errors
    /// [`SetupError::Prior`] with the pivot that is negative: `P` is no covariance.
    pub fn factored(x: impl Fn(usize) -> f64, P: impl Fn(usize, usize) -> f64) -> Result<Self, SetupError> {
        let (U, D) = factorise(&SMatrix::<f64, N, N>::from_fn(|i, j| P(i.max(j), i.min(j))))?;
        Ok(Self::new(x, |i, j| U[(i, j)], |i| D[i]))
    }
}

impl<T: Real + Into<f64>, const N: usize, const M: usize> AciFactored<T, N, M> {
    /// Whether the mean is finite and every pivot can be one.
    ///
    /// # Errors
    /// [`StepError::Mean`], [`StepError::Variance`].
    pub fn checked(&self) -> Result<(), StepError> {
        if let Some(state) = [self.p, self.v].iter().chain(&self.theta.0).position(|&x| !x.into().is_finite()) {
            return Err(StepError::Mean { state });
        }
        let pivots = self.d.iter().chain(&self.D.0).map(|&pivot| pivot.into());
        match pivots.enumerate().find(|(_, pivot)| !(*pivot >= 0.0 && pivot.is_finite())) {
            Some((state, variance)) => Err(StepError::Variance { state, variance }),
            None => Ok(()),
        }
    }
}
