//! A watch on a live filter: for effects that its model lacks, how much its innovations say for each of them.
//!
//! A suspect is an effect with the coefficient `c` that the filter does not subtract. What a unit of `c` leaves in the
//! filter's mean follows from the filter's own steps and gains, parameters included: `d <- Phi d + forcing`,
//! `psi = b + H d`, `d <- d - K psi`, so that an innovation has the mean `c psi`. White scores of it (derivations 6.20)
//! give the score `b = sum psi nu / s` and the information `G = sum psi^2 / s`, and with `c ~ N(0, S^2)` the e-value
//! `(1 + S^2 G)^(-1/2) exp(b^2 S^2 / (2 (1 + S^2 G)))`, whose mean is one at all times while `c = 0`.
//!
//! An effect that begins late meets a filter whose parameters are known, and is another column than the one that was
//! there always. So each suspect has two sensitivities: from the begin on, and from a start that is renewed while nothing
//! speaks for it, at geometric ages. Starts have weights whose sum is one, so the weighted mean is an e-process as well.

use crate::structured::number::Number;
use crate::structured::row::{Plain, Row};
use crate::structured::taps::TAPS;
use crate::structured::whitening::{STATES, Vector, White};

/// What one step of a filter does to a small error of its mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passage<T, const M: usize> {
    /// Time, s.
    pub dt: T,
    /// `da/du`.
    pub slope: T,
    /// What a unit of each parameter adds to `p` and `v`.
    pub to_p: Plain<T, M>,
    /// Likewise.
    pub to_v: Plain<T, M>,
    /// What is left of each parameter at the end.
    pub left: Plain<T, M>,
    /// `d2a/(du dtheta)` over `da/du`.
    pub noise: Plain<T, M>,
    /// What the noise of each sample adds to `p` and `v`.
    pub taps: [[T; 2]; TAPS],
    /// Whether the oldest sample drives no more.
    pub passed: bool,
    /// The reading at its end.
    pub reading: Option<Gains<T, M>>,
}

/// A reading of `p + tau v + b'theta` and what the filter made of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains<T, const M: usize> {
    /// Time constant of the low-pass, s.
    pub tau: T,
    /// Of the parameters in the reading.
    pub b: Plain<T, M>,
    /// Gains of `p` and `v`.
    pub motion: [T; 2],
    /// Gains of the parameters.
    pub theta: Plain<T, M>,
    /// Gains of `p` and `v` in the filter whose parameters are known.
    pub settled: [T; 2],
    /// How it is whitened; `None` before that begins.
    pub white: Option<White<T>>,
}

impl<T: Number, const M: usize> Passage<T, M> {
    /// No time and no reading; of `witness` only the type is used.
    #[must_use]
    pub fn none(witness: T) -> Self {
        let (zero, one) = (witness.like(0.0), witness.like(1.0));
        let nothing = Plain::every(zero);
        Self {
            dt: zero,
            slope: one,
            to_p: nothing,
            to_v: nothing,
            left: Plain::every(one),
            noise: nothing,
            taps: [[zero; 2]; TAPS],
            passed: false,
            reading: None,
        }
    }
}

/// What a unit of a suspect's coefficient adds over a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuspectColumn<T> {
    /// To the output, m/s^2: at the begin of the step, half-way, and at its end.
    pub over: [T; 3],
    /// To the reading at its end, m.
    pub position: T,
    /// To the output by a unit of the output: how its noise is in `over`.
    pub slope: T,
}

/// What a unit of a coefficient leaves in a filter, and what the innovations say of it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sensitivity<T, const M: usize> {
    /// In the mean of `p, v`,
    motion: [T; 2],
    /// of the parameters,
    theta: Plain<T, M>,
    /// and of the whitening.
    mean: Vector<T>,
    /// Score `b` and information `G`.
    sums: [T; 2],
}

impl<T: Number, const M: usize> Sensitivity<T, M> {
    /// An effect that begins now; of `witness` only the type is used.
    fn none(witness: T) -> Self {
        let zero = witness.like(0.0);
        Self { motion: [zero; 2], theta: Plain::every(zero), mean: [zero; STATES], sums: [zero; 2] }
    }

    /// The motion begins anew, with the parameters as they are.
    fn interrupt(&mut self) {
        let zero = self.motion[0].like(0.0);
        (self.motion, self.mean) = ([zero; 2], [zero; STATES]);
    }

    /// One step of the filter, by a force that adds `forcing` to `p` and `v`.
    #[inline(always)]
    fn advance(&mut self, passage: &Passage<T, M>, forcing: [T; 2], column: &SuspectColumn<T>) {
        let &Passage { dt, ref to_p, ref to_v, ref left, ref noise, ref taps, passed, ref reading, .. } = passage;
        let mut p = dt.times_plus(self.motion[1], self.motion[0]) + forcing[0];
        let mut v = self.motion[1] + forcing[1];
        let (mut m, mut w) = (dt.times_plus(self.mean[1], self.mean[0]), self.mean[1]);
        for i in 0..M {
            p = to_p.0[i].times_plus(self.theta.0[i], p);
            v = to_v.0[i].times_plus(self.theta.0[i], v);
        }
        self.theta = self.theta * *left;
        for (gains, noise) in taps.iter().zip(&self.mean[2..]) {
            (m, w) = (gains[0].times_plus(*noise, m), gains[1].times_plus(*noise, w));
        }
        (self.motion, self.mean[0], self.mean[1]) = ([p, v], m, w);
        if passed {
            self.mean.copy_within(3.., 2);
            self.mean[STATES - 1] = dt.like(0.0);
        }
        let Some(Gains { tau, b, motion, theta, settled, white }) = reading else {
            return;
        };
        let mut psi = tau.times_plus(v, p) + column.position;
        let mut of_noise = -column.slope;
        for i in 0..M {
            psi = b.0[i].times_plus(self.theta.0[i], psi);
            of_noise = noise.0[i].times_plus(self.theta.0[i], of_noise);
        }
        self.motion = [p - motion[0] * psi, v - motion[1] * psi];
        self.theta = self.theta - theta.scaled(psi);
        let Some(White { L, scaled, over, share }) = white else {
            return;
        };
        let white = psi - tau.times_plus(w, m);
        for (mean, L) in self.mean.iter_mut().zip(L) {
            *mean = L.times_plus(white, *mean);
        }
        (self.mean[0], self.mean[1]) = (self.mean[0] - settled[0] * psi, self.mean[1] - settled[1] * psi);
        // The output's noise is in the sensitivity and in what is left: its mean is taken out, its variance counted.
        let shared = *share * of_noise;
        let [score, information] = &mut self.sums;
        *score = white.times_plus(*scaled, *score) + shared;
        *information = (white * white).times_plus(*over, *information) + shared * of_noise;
    }
}

/// An effect that the model lacks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suspect<T, const M: usize> {
    /// Typical size of its coefficient, SI.
    scale: f64,
    /// As if it had been there always.
    always: Sensitivity<T, M>,
    /// As if it had begun at the newest start.
    lately: Sensitivity<T, M>,
}

impl<T: Number, const M: usize> Suspect<T, M> {
    /// Before the first sample; `scale` is the typical size of the coefficient, SI; of `witness` only the type is used.
    #[must_use]
    pub fn new(witness: T, scale: f64) -> Self {
        let none = Sensitivity::none(witness);
        Self { scale, always: none, lately: none }
    }

    /// The motion begins anew, with the parameters as they are.
    pub fn interrupt(&mut self) {
        self.always.interrupt();
        self.lately.interrupt();
    }

    /// Score and information of the effect as if it had been there always.
    #[must_use]
    pub const fn sums(&self) -> [T; 2] {
        self.always.sums
    }

    /// One step of the filter.
    #[inline(always)]
    pub fn advance(&mut self, passage: &Passage<T, M>, column: &SuspectColumn<T>) {
        let [begin, middle, end] = column.over;
        // A parabola through the three, integrated twice.
        let sixth = -(passage.slope * passage.dt) * passage.dt.like(1.0 / 6.0);
        let sum = begin + (middle + middle);
        let forcing = [sixth * passage.dt * sum, sixth * (sum + (middle + middle) + end)];
        self.always.advance(passage, forcing, column);
        self.lately.advance(passage, forcing, column);
    }

    /// Since the watch began, and since the newest start: logarithm of the e-value, mean and standard deviation.
    fn posteriors(&self, value: impl Fn(T) -> f64) -> [(f64, f64, f64); 2] {
        [self.always.sums, self.lately.sums].map(|sums| posterior(value(sums[0]), value(sums[1]), self.scale))
    }
}

/// Weight of an effect that has been there from the begin of the watch on.
const FROM_BEGIN: f64 = 0.5;
/// Later starts at most, of even weights; at least an eighth of the watch apart, so they last for years.
pub const STARTS: u32 = 128;
/// The watch over its newest part at which that can begin anew.
const EIGHTH: u64 = 8;
/// Standard deviations of the prior in typical sizes of the effect: sensors are worse than their data sheets.
pub const TAILS: [f64; 3] = [1.0, 10.0, 100.0];

/// What a suspect's sums say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    /// Natural logarithm of the e-value, the weighted mean over the starts.
    pub log_e: f64,
    /// The coefficient given the readings since the likelier start, and its standard deviation, SI.
    pub size: f64,
    /// Likewise.
    pub std: f64,
    /// Steps of the watch before that start.
    pub since: u64,
}

/// Suspects beside one filter; `S` is an array, or whatever else holds them.
#[derive(Debug, Clone, PartialEq)]
pub struct Watch<S> {
    /// Each with its sums.
    pub suspects: S,
    /// Steps between two starts at least.
    least: u64,
    /// Steps so far.
    steps: u64,
    /// Steps before the newest start, and which start that is.
    begun: (u64, u32),
}

impl<S> Watch<S> {
    /// From suspects that hold nothing yet; starts are `least` steps apart or more.
    #[must_use]
    pub fn new(suspects: S, least: u64) -> Self {
        Self { suspects, least: least.max(1), steps: 0, begun: (0, 0) }
    }

    /// Steps so far.
    #[must_use]
    pub const fn steps(&self) -> u64 {
        self.steps
    }

    /// One step of the filter; `column` gives what each suspect adds over it.
    #[inline(always)]
    pub fn advance<T: Number, const M: usize>(
        &mut self,
        passage: &Passage<T, M>,
        column: impl Fn(usize) -> SuspectColumn<T>,
        value: impl Fn(T) -> f64,
    ) where
        S: AsMut<[Suspect<T, M>]>,
    {
        for (j, suspect) in self.suspects.as_mut().iter_mut().enumerate() {
            suspect.advance(passage, &column(j));
        }
        self.steps += 1;
        let (begun, start) = self.begun;
        if self.steps.is_multiple_of(self.least) && self.steps - begun >= self.steps / EIGHTH && start < STARTS {
            self.restart(value);
        }
    }

    /// Begins anew, unless something has probably begun: a decision on the past alone, as the guarantee asks for. All do so
    /// at once, so that they are compared on the same readings.
    fn restart<T: Number, const M: usize>(&mut self, value: impl Fn(T) -> f64)
    where
        S: AsMut<[Suspect<T, M>]>,
    {
        let suspects = self.suspects.as_mut();
        let limit = libm::log(suspects.len() as f64);
        if suspects.iter().all(|suspect| suspect.posteriors(&value)[1].0 < limit) {
            for suspect in suspects {
                suspect.lately = Sensitivity::none(suspect.always.motion[0]);
            }
            self.begun = (self.steps, self.begun.1 + 1);
        }
    }

    /// What the sums of suspect `j` say; `None` without such a suspect.
    #[must_use]
    pub fn evidence<T: Number, const M: usize>(&self, j: usize, value: impl Fn(T) -> f64) -> Option<Evidence>
    where
        S: AsRef<[Suspect<T, M>]>,
    {
        let [always, lately] = self.suspects.as_ref().get(j)?.posteriors(value);
        let of = |(log_e, size, std): (f64, f64, f64), weight: f64, since: u64| Evidence {
            log_e: log_e + libm::log(weight),
            size,
            std,
            since,
        };
        let always = of(always, FROM_BEGIN, 0);
        let lately = of(lately, (1.0 - FROM_BEGIN) / f64::from(STARTS), self.begun.0);
        if self.begun.1 == 0 {
            return Some(always); // both are one
        }
        let log_e = log_sum(always.log_e, lately.log_e);
        Some(Evidence { log_e, ..if lately.log_e > always.log_e { lately } else { always } })
    }
}

/// `ln(exp(a) + exp(b))`.
fn log_sum(a: f64, b: f64) -> f64 {
    let (least, most) = if a < b { (a, b) } else { (b, a) };
    if least == f64::NEG_INFINITY { most } else { most + libm::log1p(libm::exp(least - most)) }
}

/// Logarithm of the e-value, mean and standard deviation of a coefficient with the score `b` and the information `G`
/// whose prior is the even mixture of `N(0, (m scale)^2)` over [`TAILS`].
///
/// ```
/// use ekf_core::structured::watch::posterior;
/// let (log_e, size, std) = posterior(600.0, 1e4, 1.0); // 6 standard deviations from zero
/// assert!((log_e - 12.399).abs() < 1e-3 && (size - 0.06).abs() < 1e-5 && (std - 0.01).abs() < 1e-5);
/// ```
#[must_use]
pub fn posterior(b: f64, G: f64, scale: f64) -> (f64, f64, f64) {
    let tails = TAILS.map(|m| {
        let variance = (m * scale) * (m * scale);
        let spread = 1.0 + variance * G;
        let size = b * variance / spread;
        (0.5 * (b * size - libm::log(spread)), size, variance / spread)
    });
    let total = tails.iter().fold(f64::NEG_INFINITY, |sum, (log_e, ..)| log_sum(sum, *log_e));
    let (mut mean, mut square) = (0.0, 0.0);
    for (log_e, size, variance) in tails {
        let weight = libm::exp(log_e - total);
        mean += weight * size;
        square += weight * (variance + size * size);
    }
    (total - libm::log(TAILS.len() as f64), mean, libm::sqrt((square - mean * mean).max(0.0)))
}
