//! Errors in variables: the output's noise is in the gradient by the parameters and in the innovation at once.
//!
//! A sample's noise `n` adds `da/du n` to the acceleration and `d2a/(du dtheta) n` to its gradient. What either left in
//! position differs by a factor that moves with the motion alone, so one covariance serves all parameters: `Pi`, of
//! what a unit slope would have put into `p, v` and no reading has taken out (derivations 3.5). A reading then holds, in
//! the mean, `b = d2a/(du dtheta) da/du H Pi H' / S` of information on the parameters that is not there, which `P b`
//! takes out, and as much too small a variance. Gains and `S` are those of the filter of `p, v` with known parameters, in
//! which the information on these is gathered. First order in the noise's share of the regressor's power.

use core::array::from_fn;

use crate::error::DomainError;
use crate::structured::acceleration::MixedPartials;
use crate::structured::aci::MaskedInnovation;
use crate::structured::aci_step::StepInput;
use crate::structured::aci_ud::{AciFactored, FactoredReading};
use crate::structured::gauss_markov::GaussMarkovSet;
use crate::structured::number::{Number, Real};
use crate::structured::row::{Plain, Row};
use crate::structured::taps::{TAPS, Taps};
use crate::structured::watch::{Gains, Passage};
use crate::structured::whitening::{Score, Whitened, Whitening};

/// Readings between two corrections of the estimate: information adds, so it need not be at each of them.
const EVERY: u32 = 16;

/// Covariance of what the output's noise put into `p, v` and no reading has taken out, for `da/du = 1`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputNoise<T> {
    /// `Pi`: of `p`, of both, of `v`.
    pub Pi: [T; 3],
    /// Covariance of `p` and of `v` with the noise of each sample that still drives.
    cross: [[T; 2]; TAPS],
}

impl<T: Number> OutputNoise<T> {
    /// Before the first sample; of `witness` only the type is used.
    #[must_use]
    pub fn none(witness: T) -> Self {
        let zero = witness.like(0.0);
        Self { Pi: [zero; 3], cross: [[zero; 2]; TAPS] }
    }

    /// `dt` seconds of a segment that is `length` seconds long; `variance` is that of one sample.
    #[inline(always)]
    pub fn predict(&mut self, dt: T, length: f64, taps: &Taps, variance: T) {
        let [pp, pv, vv] = self.Pi;
        let two = dt.like(2.0);
        let mut Pi = [dt.times_plus(two.times_plus(pv, dt * vv), pp), dt.times_plus(vv, pv), vv];
        for (cross, weight) in self.cross.iter_mut().zip(&taps.weights) {
            let (gp, gv) = (dt.like(weight[0] * length * length), dt.like(weight[1] * length));
            let (np, nv) = (variance * gp, variance * gv);
            let (cp, cv) = (dt.times_plus(cross[1], cross[0]), cross[1]);
            // (F C + n/2) g' and its transpose: the noise of the step itself is in it once.
            Pi[0] = gp.times_plus(two.times_plus(cp, np), Pi[0]);
            Pi[1] = gv.times_plus(cp + np, gp.times_plus(cv, Pi[1]));
            Pi[2] = gv.times_plus(two.times_plus(cv, nv), Pi[2]);
            *cross = [cp + np, cv + nv];
        }
        self.Pi = Pi;
    }

    /// A sample has passed: the oldest of a curve drives no more.
    #[inline(always)]
    pub fn shift(&mut self) {
        let zero = self.Pi[0].like(0.0);
        self.cross = from_fn(|i| self.cross.get(i + 1).copied().unwrap_or([zero; 2]));
    }

    /// Its variance in a reading of `p + tau v`.
    #[inline(always)]
    #[must_use]
    pub fn variance(&self, tau: T) -> T {
        let [pp, pv, vv] = self.Pi;
        tau.times_plus(pv + tau.times_plus(vv, pv), pp)
    }

    /// After a reading of `p + tau v` with the gains of `p` and `v`: `Pi = A Pi A'`, `A = I - K H`.
    #[inline(always)]
    pub fn correct(&mut self, tau: T, gain: [T; 2]) {
        let moved = |p: T, v: T| {
            let read = tau.times_plus(v, p);
            [p - gain[0] * read, v - gain[1] * read]
        };
        let [pp, pv, vv] = self.Pi;
        let (left, right) = (moved(pp, pv), moved(pv, vv));
        let (top, bottom) = (moved(left[0], right[0]), moved(left[1], right[1]));
        self.Pi = [top[0], top[1], bottom[1]];
        for cross in &mut self.cross {
            *cross = moved(cross[0], cross[1]);
        }
    }
}

/// The usual spacing after a segment of `length`: a mean of those that are not much longer, to which it creeps up.
fn usual(spacing: f64, length: f64) -> f64 {
    if spacing == 0.0 {
        length
    } else if length < 1.5 * spacing {
        spacing + (length - spacing) / 32.0
    } else {
        spacing * 1.0005
    }
}

/// What is done about the output's noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Correction {
    /// Nothing: the published filter.
    None,
    /// It is taken out of estimate and covariance.
    Estimate,
    /// So it is, and innovations are whitened for a monitor.
    EstimateAndScores,
}

/// ACI on factors, and what the output's noise did to its estimate; `N = M + 2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AciCorrected<T, const N: usize, const M: usize> {
    /// The filter.
    pub filter: AciFactored<T, N, M>,
    /// What the output's noise left in `p, v`.
    pub noise: OutputNoise<T>,
    /// Of the innovations; none without [`Correction::EstimateAndScores`], and before the first [`EVERY`] of them.
    whitening: Option<Whitening<T>>,
    /// Of the newest reading.
    pub score: Option<Score<T>>,
    /// Usual spacing of the samples, s: behind a lost one a segment is longer, and the noise of a sample is not.
    spacing: f64,
    /// Variance of the noise of a sample.
    sample: T,
    /// Of the last step: `d2a/(du dtheta) da/du`, and `(da/du)^2`.
    slopes: (Plain<T, M>, T),
    /// `b` and its share of `da/du` itself, of the readings since the last correction.
    gathered: (Plain<T, M>, T),
    readings: u32,
    /// What the newest step did to errors of the mean; `None` unless a watch is beside the filter.
    pub passage: Option<Passage<T, M>>,
}

impl<T: Real, const N: usize, const M: usize> AciCorrected<T, N, M> {
    /// At the start.
    #[must_use]
    pub fn new(filter: AciFactored<T, N, M>) -> Self {
        const { assert!(M >= 2, "scores are of the first two parameters") };
        let zero = filter.p.like(0.0);
        let none = (Plain::every(zero), zero);
        let noise = OutputNoise::none(zero);
        Self {
            filter,
            noise,
            whitening: None,
            score: None,
            spacing: 0.0,
            sample: zero,
            slopes: none,
            gathered: none,
            readings: 0,
            passage: None,
        }
    }

    /// One step without integration error over a part of a segment of `length` seconds; without `taps` no correction.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse; the filter is then as it was.
    #[inline(always)]
    pub fn exact<E, I>(
        &mut self,
        q: T,
        drift: &GaussMarkovSet<Plain<T, M>, M>,
        step: &StepInput<E, I>,
        taps: Option<(&Taps, f64)>,
    ) -> Result<(), DomainError>
    where
        E: MixedPartials<Plain<T, M>, M>,
        I: Fn(f64) -> E::Input,
    {
        let Some((taps, length)) = taps else {
            return self.filter.exact(q, drift, step).map(|_| ());
        };
        let theta = self.filter.theta;
        let begin = step.model.mixed(&theta, (step.input)(0.0))?;
        let end = step.model.mixed(&theta, (step.input)(step.dt))?;
        let integrals = self.filter.exact(q, drift, step)?;
        let half = q.like(0.5);
        self.slopes = (
            begin.0.scaled(half * begin.1).plus(half * end.1, end.0),
            half * begin.1.times_plus(begin.1, end.1 * end.1),
        );
        if length > 0.0 {
            self.spacing = usual(self.spacing, length);
            let dt = q.like(step.dt);
            self.sample = q / q.like(self.spacing);
            self.noise.predict(dt, length, taps, self.sample);
            if let Some(whitening) = &mut self.whitening {
                whitening.predict(dt, length, taps, half * (begin.1 + end.1));
            }
        }
        if let Some(passage) = &mut self.passage {
            let slope = half * (begin.1 + end.1);
            *passage = Passage {
                dt: q.like(step.dt),
                slope,
                to_p: integrals.to_p,
                to_v: integrals.to_v,
                left: drift.decay(q, step.dt),
                noise: self.slopes.0.scaled(q.like(1.0) / self.slopes.1),
                taps: taps.gains(slope, length),
                passed: false,
                reading: None,
            };
        }
        Ok(())
    }

    /// A sample has passed.
    #[inline(always)]
    pub fn passed(&mut self) {
        self.noise.shift();
        if let Some(whitening) = &mut self.whitening {
            whitening.shift(self.sample);
        }
        if let Some(passage) = &mut self.passage {
            passage.passed = true;
        }
    }

    /// Takes in a reading of `p + tau v + b'theta` with variance `R`; without a correction also give [`Self::exact`] no taps.
    #[inline(always)]
    pub fn correct_with(
        &mut self,
        tau: T,
        R: T,
        reading: &FactoredReading<T, M>,
        innovation: &MaskedInnovation<T>,
        correction: Correction,
    ) {
        let between = self.filter.U[0].0[1];
        let (settled, gains) = self.filter.correct_with(R, reading, innovation);
        if correction == Correction::None {
            return;
        }
        let share = self.noise.variance(tau) / settled.s;
        let white = self.whitening.as_mut().map(|whitening| {
            // `U' H` of the first two parameters, without what the second has of the first.
            let [first, second] = [reading.theta.0[0], reading.theta.0[1]];
            let innovation_slopes = [innovation.e, first, second - between * first];
            let slopes = [self.slopes.0.0[0] / self.slopes.1, self.slopes.0.0[1] / self.slopes.1];
            let others = innovation.s - settled.s;
            whitening.correct(tau, R, &Whitened { innovation: innovation_slopes, gain: settled.gain, others, slopes })
        });
        self.score = white.map(|(score, _)| score);
        if let Some(passage) = &mut self.passage {
            let over = R.like(1.0) / gains.s;
            let (motion, theta) = gains.unscaled;
            passage.reading = Some(Gains {
                tau,
                b: reading.b,
                motion: motion.map(|gain| gain * over),
                theta: theta.scaled(over),
                settled: settled.gain,
                white: white.map(|(_, white)| white),
            });
        }
        self.noise.correct(tau, settled.gain);
        self.gathered.0 = self.gathered.0.plus(share, self.slopes.0);
        self.gathered.1 = share.times_plus(self.slopes.1, self.gathered.1);
        self.readings += 1;
        if self.readings == EVERY {
            self.apply();
            if correction == Correction::EstimateAndScores && self.whitening.is_none() {
                self.whitening = Some(Whitening::new(self.filter.with_known_parameters(), self.sample));
            }
        }
    }

    /// Takes what was gathered out of estimate and covariance.
    #[inline(always)]
    fn apply(&mut self) {
        let (b, share) = self.gathered;
        let zero = share.like(0.0);
        (self.gathered, self.readings) = ((Plain::every(zero), zero), 0);
        if share.is_positive() {
            let (p, v, theta) = self.filter.columns(&b);
            self.filter.p = self.filter.p + p;
            self.filter.v = self.filter.v + v;
            self.filter.theta = self.filter.theta + theta;
            self.filter.add_outer(share.like(1.0) / share, (p, v), theta.0, M);
        }
    }
}
