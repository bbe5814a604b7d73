//! The replay: one two-state filter over the encoder, and every column carried through its gains.
//!
//! State (p, v) with `p'' = input + w`, `E w w' = q`, reading `z = p + e`, `var e = R`. The gains depend on the
//! noise and on the times alone, so any column that adds to the acceleration or to the reading can be replayed
//! afterwards; whitened innovations `y` and columns `X` obey `y = X beta + N(0, I)`.

pub mod columns;
pub mod parallel;

use crate::signal::integrals::{ConditionError, check_samples};

/// Intensity of the two noises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Two-sided density of the process noise on acceleration, (m/s^2)^2/Hz; half the square of a data sheet's density.
    pub q: f64,
    /// Variance of one encoder reading, m^2.
    pub R: f64,
}

/// Covariance of (p, v), stored as its three different entries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionCovariance {
    /// var p, m^2.
    pub pp: f64,
    /// cov(p, v), m^2/s.
    pub pv: f64,
    /// var v, (m/s)^2.
    pub vv: f64,
}

/// What is known of (p, v) before the first reading, and again after each break of the record.
///
/// The expected position is the reading at hand, which therefore teaches nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Expected velocity, m/s.
    pub v: f64,
    /// Covariance of the expectation.
    pub P: MotionCovariance,
}

/// Encoder readings and what drives the motion between them.
#[derive(Debug, Clone, Copy)]
pub struct Readings<'a> {
    /// Reading times, s, strictly rising.
    pub t: &'a [f64],
    /// Readings, m.
    pub z: &'a [f64],
    /// Integral of the input over the interval that ends at each reading, m/s.
    pub first: &'a [f64],
    /// Double integral of the input over the same interval, m.
    pub second: &'a [f64],
    /// Where the chain of inputs is broken before the reading: the filter starts again there.
    pub restart: &'a [bool],
}

/// The filter's own record, one entry per reading; callers own the memory.
#[derive(Debug)]
pub struct Track<'a> {
    /// Innovation `e = z - p`, m.
    pub e: &'a mut [f64],
    /// Innovation variance, m^2.
    pub S: &'a mut [f64],
    /// Gain on position, 1.
    pub gain_p: &'a mut [f64],
    /// Gain on velocity, 1/s.
    pub gain_v: &'a mut [f64],
    /// Predicted position, m.
    pub p: &'a mut [f64],
    /// Predicted velocity, m/s.
    pub v: &'a mut [f64],
    /// Predicted variance of position, m^2.
    pub pp: &'a mut [f64],
    /// Predicted covariance of position and velocity, m^2/s.
    pub pv: &'a mut [f64],
    /// Predicted variance of velocity, (m/s)^2.
    pub vv: &'a mut [f64],
}

/// A finished [`Track`], for reading.
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs)] // the fields of `Track`
pub struct TrackView<'a> {
    pub e: &'a [f64],
    pub S: &'a [f64],
    pub gain_p: &'a [f64],
    pub gain_v: &'a [f64],
    pub p: &'a [f64],
    pub v: &'a [f64],
    pub pp: &'a [f64],
    pub pv: &'a [f64],
    pub vv: &'a [f64],
}

/// Why a replay stopped.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum ReplayError {
    /// The signals themselves are unusable.
    Condition(ConditionError),
    /// A noise intensity that is not positive and finite.
    Noise {
        /// Process density as given, (m/s^2)^2/Hz.
        q: f64,
        /// Reading variance as given, m^2.
        R: f64,
    },
    /// The innovation variance stopped being positive.
    InnovationVariance {
        /// Index of the reading.
        index: usize,
        /// The variance, m^2.
        S: f64,
    },
    /// A reading lies outside the grid that carries the columns.
    Grid {
        /// Index of the reading.
        index: usize,
        /// Its time, s.
        t: f64,
    },
}

impl core::fmt::Display for ReplayError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Condition(error) => error.fmt(f),
            Self::Noise { q, R } => write!(f, "noise must be positive and finite: q = {q}, R = {R}"),
            Self::InnovationVariance { index, S } => {
                write!(f, "innovation variance {S} at reading {index} is not positive")
            }
            Self::Grid { index, t } => write!(f, "reading {index} at {t} s lies outside the grid of the columns"),
        }
    }
}

impl core::error::Error for ReplayError {}

impl From<ConditionError> for ReplayError {
    fn from(error: ConditionError) -> Self {
        Self::Condition(error)
    }
}

impl Noise {
    /// Refuses what is not positive and finite.
    pub(crate) fn check(self) -> Result<(), ReplayError> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        if positive(self.q) && positive(self.R) { Ok(()) } else { Err(ReplayError::Noise { q: self.q, R: self.R }) }
    }
}

impl Readings<'_> {
    fn check(&self, noise: Noise) -> Result<(), ReplayError> {
        self.check_samples()?;
        noise.check()
    }

    /// Refuses unusable readings and slices of different lengths.
    pub(crate) fn check_samples(&self) -> Result<(), ReplayError> {
        check_samples(self.t, self.z)?;
        for found in [self.first.len(), self.second.len(), self.restart.len()] {
            same_length(self.t.len(), found)?;
        }
        Ok(())
    }

    /// True where the filter starts at `k` with the prior.
    pub(crate) fn starts(&self, k: usize) -> bool {
        k == 0 || self.restart[k]
    }
}

fn same_length(expected: usize, found: usize) -> Result<(), ConditionError> {
    if expected == found { Ok(()) } else { Err(ConditionError::Length { expected, found }) }
}

impl MotionCovariance {
    /// `Phi P Phi' + Q_d` over `h` seconds, exact for white acceleration noise.
    #[must_use]
    pub fn predict(self, h: f64, q: f64) -> Self {
        Self {
            pp: self.pp + h * (2.0 * self.pv + h * (self.vv + h * q / 3.0)),
            pv: self.pv + h * (self.vv + h * q / 2.0),
            vv: self.vv + h * q,
        }
    }

    /// After one reading of position; `1/S` comes from the caller. The factor `R/S` keeps `pp` positive.
    fn update(self, R: f64, inverse: f64) -> Self {
        let keep = R * inverse;
        Self { pp: self.pp * keep, pv: self.pv * keep, vv: self.vv - self.pv * self.pv * inverse }
    }
}

/// One filter in motion: prediction to each reading, then its update.
struct Walk<'a> {
    readings: Readings<'a>,
    noise: Noise,
    prior: Prior,
    p: f64,
    v: f64,
    P: MotionCovariance,
}

impl<'a> Walk<'a> {
    fn new(readings: Readings<'a>, noise: Noise, prior: Prior) -> Self {
        Self { readings, noise, prior, p: 0.0, v: 0.0, P: prior.P }
    }

    /// Moves the state to reading `k`; returns `(e, S)`.
    fn predict(&mut self, k: usize) -> Result<(f64, f64), ReplayError> {
        let Readings { t, z, first, second, .. } = self.readings;
        if self.readings.starts(k) {
            self.p = z[k];
            self.v = self.prior.v;
            self.P = self.prior.P;
        } else {
            let h = t[k] - t[k - 1];
            self.p += h * self.v + second[k];
            self.v += first[k];
            self.P = self.P.predict(h, self.noise.q);
        }
        let S = self.P.pp + self.noise.R;
        if S > 0.0 { Ok((z[k] - self.p, S)) } else { Err(ReplayError::InnovationVariance { index: k, S }) }
    }

    /// Takes reading `k` in; returns the gains.
    fn update(&mut self, e: f64, S: f64) -> (f64, f64) {
        let inverse = 1.0 / S;
        let (gain_p, gain_v) = (self.P.pp * inverse, self.P.pv * inverse);
        self.p += gain_p * e;
        self.v += gain_v * e;
        self.P = self.P.update(self.noise.R, inverse);
        (gain_p, gain_v)
    }
}

/// Runs the two-state filter and keeps what the columns and the smoother need.
///
/// # Errors
/// [`ReplayError`] for unusable readings or noise; the track is then incomplete.
pub fn filter(readings: Readings<'_>, noise: Noise, prior: Prior, track: &mut Track<'_>) -> Result<(), ReplayError> {
    readings.check(noise)?;
    let n = readings.t.len();
    for found in [track.e.len(), track.S.len(), track.gain_p.len(), track.gain_v.len(), track.p.len()] {
        same_length(n, found)?;
    }
    for found in [track.v.len(), track.pp.len(), track.pv.len(), track.vv.len()] {
        same_length(n, found)?;
    }
    let mut walk = Walk::new(readings, noise, prior);
    for k in 0..n {
        let (e, S) = walk.predict(k)?;
        (track.e[k], track.S[k]) = (e, S);
        (track.p[k], track.v[k]) = (walk.p, walk.v);
        (track.pp[k], track.pv[k], track.vv[k]) = (walk.P.pp, walk.P.pv, walk.P.vv);
        (track.gain_p[k], track.gain_v[k]) = walk.update(e, S);
    }
    Ok(())
}

/// `-1/2 sum (e^2/S + ln 2 pi S)` over the readings that count: an innovation log-likelihood (physics 6.3).
///
/// # Errors
/// [`ReplayError`] for unusable readings or noise.
pub fn log_likelihood(readings: Readings<'_>, noise: Noise, prior: Prior, counts: &[bool]) -> Result<f64, ReplayError> {
    readings.check(noise)?;
    same_length(readings.t.len(), counts.len())?;
    let mut walk = Walk::new(readings, noise, prior);
    let mut sum = 0.0;
    for (k, &counted) in counts.iter().enumerate() {
        let (e, S) = walk.predict(k)?;
        if counted {
            sum += e * e / S + libm::log(core::f64::consts::TAU * S);
        }
        walk.update(e, S);
    }
    Ok(-0.5 * sum)
}

/// Smooths a finished track: position, velocity and the process noise that the readings ask for.
///
/// Modified Bryson-Frazier form of the RTS smoother: no inverse, exact for any gap. `noise_wanted[k]` is the
/// smoothed process noise at reading `k`, m/s^2; between two readings it is a straight line, and adding it to the
/// input gives the smoothed acceleration.
///
/// # Errors
/// [`ReplayError`] when a buffer has the wrong length or the readings are unusable.
pub fn smooth(
    readings: Readings<'_>,
    noise: Noise,
    track: TrackView<'_>,
    position: &mut [f64],
    velocity: &mut [f64],
    smoothed_noise: &mut [f64],
) -> Result<(), ReplayError> {
    readings.check(noise)?;
    let n = readings.t.len();
    for found in [track.e.len(), track.vv.len(), position.len(), velocity.len(), smoothed_noise.len()] {
        same_length(n, found)?;
    }
    let (mut r_p, mut r_v) = (0.0, 0.0); // the adjoint of (p, v) just after reading k
    for k in (0..n).rev() {
        r_p = track.e[k] / track.S[k] + (1.0 - track.gain_p[k]) * r_p - track.gain_v[k] * r_v;
        position[k] = track.p[k] + track.pp[k] * r_p + track.pv[k] * r_v;
        velocity[k] = track.v[k] + track.pv[k] * r_p + track.vv[k] * r_v;
        smoothed_noise[k] = noise.q * r_v;
        if readings.starts(k) {
            (r_p, r_v) = (0.0, 0.0);
        } else {
            r_v += (readings.t[k] - readings.t[k - 1]) * r_p;
        }
    }
    Ok(())
}

/// A uniform grid of times, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// First time.
    pub start: f64,
    /// Spacing.
    pub step: f64,
}

/// Columns of a stretch of the record, and where they enter.
#[derive(Debug, Clone, Copy)]
pub struct Columns<'a> {
    /// Number of columns that add to the acceleration.
    pub inputs: usize,
    /// Number of columns that add to the reading.
    pub readings: usize,
    /// Grid on which the input columns are sampled.
    pub grid: Grid,
    /// Input columns, row by row: one row of `inputs` values per grid time, m/s^2 per unit.
    pub on_grid: &'a [f64],
    /// Reading columns, row by row: one row of `readings` values per encoder reading, m per unit.
    pub at_readings: &'a [f64],
}

/// Gains of the filter that the columns are carried through.
#[derive(Debug, Clone, Copy)]
pub struct Gains<'a> {
    /// Reading times of the stretch, s.
    pub t: &'a [f64],
    /// Where the filter started again.
    pub restart: &'a [bool],
    /// Gain on position.
    pub gain_p: &'a [f64],
    /// Gain on velocity, 1/s.
    pub gain_v: &'a [f64],
    /// Innovation variance, m^2.
    pub S: &'a [f64],
}

/// Carries columns through the gains, stretch by stretch.
///
/// `state` holds the response of (p, v) to every column, `2 (inputs + readings)` numbers, zero at the start of a
/// record and handed on unchanged from stretch to stretch; `before` is the time of the reading before the stretch.
/// Row `k` of `whitened`, `inputs + readings` numbers, is the response of the prediction at reading `k` over
/// `sqrt(S)`.
///
/// # Errors
/// [`ReplayError`] when buffers do not fit or the grid does not reach over the stretch; `state` is then undefined.
pub fn carry(
    gains: Gains<'_>,
    columns: Columns<'_>,
    before: Option<f64>,
    state: &mut [f64],
    whitened: &mut [f64],
) -> Result<(), ReplayError> {
    let n = gains.t.len();
    let width = columns.inputs + columns.readings;
    for found in [gains.restart.len(), gains.gain_p.len(), gains.gain_v.len(), gains.S.len()] {
        same_length(n, found)?;
    }
    same_length(2 * width, state.len())?;
    same_length(n * width, whitened.len())?;
    same_length(n * columns.readings, columns.at_readings.len())?;
    let (sp, sv) = state.split_at_mut(width);
    let mut previous = before;
    for k in 0..n {
        let now = gains.t[k];
        match previous {
            Some(earlier) if !gains.restart[k] => {
                advance(&columns, earlier, now, sp, sv).ok_or(ReplayError::Grid { index: k, t: now })?;
            }
            _ => {
                sp.fill(0.0);
                sv.fill(0.0);
            }
        }
        previous = Some(now);
        let row = &mut whitened[k * width..(k + 1) * width];
        let (gain_p, gain_v, scale) = (gains.gain_p[k], gains.gain_v[k], 1.0 / libm::sqrt(gains.S[k]));
        let direct = &columns.at_readings[k * columns.readings..(k + 1) * columns.readings];
        let starts = gains.restart[k] || (k == 0 && before.is_none());
        for j in 0..width {
            // At a start the reading itself fixes the position, so a column teaches nothing there.
            let offset = if j < columns.inputs { 0.0 } else { direct[j - columns.inputs] };
            let g = if starts { 0.0 } else { sp[j] + offset };
            sp[j] -= gain_p * g;
            sv[j] -= gain_v * g;
            if starts && j >= columns.inputs {
                sp[j] = -offset;
            }
            row[j] = g * scale;
        }
    }
    Ok(())
}

/// Moves the responses from `from` to `to`, one grid cell at a time; `None` when the grid does not cover it.
fn advance(columns: &Columns<'_>, from: f64, to: f64, sp: &mut [f64], sv: &mut [f64]) -> Option<()> {
    let Columns { inputs, grid, on_grid, .. } = *columns;
    let h = to - from;
    for j in inputs..sp.len() {
        sp[j] += h * sv[j];
    }
    if inputs == 0 {
        return Some(());
    }
    cells(grid, on_grid.len() / inputs, from, to, |cell| {
        let first = cell.row as usize;
        add_cell(&on_grid[first * inputs..(first + NODES) * inputs], inputs, &cell, sp, sv);
    })
}

/// Grid rows that shape the curve inside one cell.
pub(crate) const NODES: usize = 4;

/// What a part of one grid cell adds to (p, v): `p += h v + second . rows`, `v += first . rows`, the rows being the
/// four from `row` on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// First of the four grid rows.
    pub row: u32,
    /// Length of the part, s.
    pub h: f64,
    /// Weights of the rows in the first integral, s.
    pub first: [f64; NODES],
    /// Weights of the rows in the double integral, s^2.
    pub second: [f64; NODES],
}

/// Hands out the cells between `from` and `to` in turn; `None` when a grid of `rows` rows does not cover them.
pub fn cells(grid: Grid, rows: usize, from: f64, to: f64, mut take: impl FnMut(Cell)) -> Option<()> {
    let place = (from - grid.start) / grid.step;
    let end = (to - grid.start) / grid.step;
    let slack = 1e-6; // rounding of times, in grid steps
    if rows < NODES || place < -slack || end > (rows - 1) as f64 + slack {
        return None;
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 <= place <= rows - 1, checked above
    let mut cell = (place.max(0.0) as usize).min(rows - 2);
    let mut a = place;
    loop {
        let next = (cell + 1) as f64;
        let b = if cell + 2 == rows { end } else { end.min(next) };
        if b > a {
            let row = cell.saturating_sub(1).min(rows - NODES);
            take(Cell::between(row, a - row as f64, b - row as f64, grid.step));
            a = b;
        }
        if b >= end {
            return Some(());
        }
        cell += 1;
    }
}

impl Cell {
    /// The part between `a` and `b`, in grid steps behind `row`, from the integrals of the Lagrange polynomials.
    fn between(row: usize, a: f64, b: f64, step: f64) -> Self {
        let (at_a, at_b) = (moments(a), moments(b));
        let first: [f64; NODES] = core::array::from_fn(|i| at_b[i].0 - at_a[i].0);
        let second = core::array::from_fn(|i| step * step * (b * first[i] - (at_b[i].1 - at_a[i].1)));
        #[allow(clippy::cast_possible_truncation)] // grids are far below 2^32 rows
        let row = row as u32;
        Self { row, h: (b - a) * step, first: first.map(|weight| weight * step), second }
    }
}

/// Integrals from 0 to `u` of the Lagrange polynomials on 0, 1, 2, 3, and of `u` times each.
fn moments(u: f64) -> [(f64, f64); NODES] {
    const POLYNOMIALS: [[f64; NODES]; NODES] = [
        [1.0, -11.0 / 6.0, 1.0, -1.0 / 6.0],
        [0.0, 3.0, -2.5, 0.5],
        [0.0, -1.5, 2.0, -0.5],
        [0.0, 1.0 / 3.0, -0.5, 1.0 / 6.0],
    ];
    POLYNOMIALS.map(|[c0, c1, c2, c3]| {
        (
            u * (c0 + u * (c1 / 2.0 + u * (c2 / 3.0 + u * (c3 / 4.0)))),
            u * u * (c0 / 2.0 + u * (c1 / 3.0 + u * (c2 / 4.0 + u * (c3 / 5.0)))),
        )
    })
}

fn add_cell(rows: &[f64], inputs: usize, cell: &Cell, sp: &mut [f64], sv: &mut [f64]) {
    let [w0, w1, w2, w3] = cell.first;
    let [x0, x1, x2, x3] = cell.second;
    let (r0, rest) = rows.split_at(inputs);
    let (r1, rest) = rest.split_at(inputs);
    let (r2, r3) = rest.split_at(inputs);
    for j in 0..inputs {
        sp[j] += cell.h * sv[j] + (x0 * r0[j] + x1 * r1[j]) + (x2 * r2[j] + x3 * r3[j]);
        sv[j] += (w0 * r0[j] + w1 * r1[j]) + (w2 * r2[j] + w3 * r3[j]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SMatrix, SVector};

    const N: usize = 8;
    const T: [f64; N] = [0.0, 0.011, 0.019, 0.034, 0.2, 0.213, 0.221, 0.24]; // a gap of many steps in the middle
    const Z: [f64; N] = [0.10, 0.14, 0.11, 0.18, 0.31, 0.29, 0.30, 0.36];
    const FIRST: [f64; N] = [0.0, 0.02, -0.01, 0.03, 0.2, -0.02, 0.01, 0.05];
    const SECOND: [f64; N] = [0.0, 1e-4, -4e-5, 2e-4, 1.5e-2, -1e-4, 3e-5, 4e-4];
    const WHOLE: [bool; N] = [true, false, false, false, false, false, false, false];
    const BROKEN: [bool; N] = [true, false, false, false, true, false, false, false];
    const NOISE: Noise = Noise { q: 0.7, R: 4e-4 };
    const PRIOR: Prior = Prior { v: 0.4, P: MotionCovariance { pp: 2e-3, pv: 1e-2, vv: 0.9 } };

    fn readings(restart: &[bool]) -> Readings<'_> {
        Readings { t: &T, z: &Z, first: &FIRST, second: &SECOND, restart }
    }

    /// A track that owns its memory: e, S, `gain_p`, `gain_v`, p, v, pp, pv, vv.
    #[derive(Default)]
    struct Kept([[f64; N]; 9]);

    impl Kept {
        fn of(readings: Readings<'_>, noise: Noise, prior: Prior) -> Result<Self, ReplayError> {
            let mut kept = Self::default();
            let [e, S, gain_p, gain_v, p, v, pp, pv, vv] = &mut kept.0;
            filter(readings, noise, prior, &mut Track { e, S, gain_p, gain_v, p, v, pp, pv, vv })?;
            Ok(kept)
        }

        fn view(&self) -> TrackView<'_> {
            let [e, S, gain_p, gain_v, p, v, pp, pv, vv] = &self.0;
            TrackView { e, S, gain_p, gain_v, p, v, pp, pv, vv }
        }

        fn gains<'a>(&'a self, restart: &'a [bool], rows: core::ops::Range<usize>) -> Gains<'a> {
            Gains {
                t: &T[rows.clone()],
                restart: &restart[rows.clone()],
                gain_p: &self.0[2][rows.clone()],
                gain_v: &self.0[3][rows.clone()],
                S: &self.0[1][rows],
            }
        }
    }

    type States = SVector<f64, { 2 * N }>;
    type Spread = SMatrix<f64, { 2 * N }, { 2 * N }>;

    /// Mean and covariance of (p, v) at every reading before any reading is used, one row pair each.
    fn dense_prior(restart: &[bool]) -> (States, Spread) {
        let (mut mean, mut P) = (States::zeros(), Spread::zeros());
        for k in 0..N {
            let at = 2 * k;
            if k == 0 || restart[k] {
                (mean[at], mean[at + 1]) = (Z[k], PRIOR.v);
                P[(at, at)] = PRIOR.P.pp;
                (P[(at, at + 1)], P[(at + 1, at)]) = (PRIOR.P.pv, PRIOR.P.pv);
                P[(at + 1, at + 1)] = PRIOR.P.vv;
                continue;
            }
            let h = T[k] - T[k - 1];
            let mut F = Spread::identity();
            F.fixed_view_mut::<2, 2>(at, at).fill(0.0);
            (F[(at, at - 2)], F[(at, at - 1)], F[(at + 1, at - 1)]) = (1.0, h, 1.0);
            mean = F * mean;
            mean[at] += SECOND[k];
            mean[at + 1] += FIRST[k];
            P = F * P * F.transpose();
            let q = NOISE.q;
            P[(at, at)] += q * h * h * h / 3.0;
            P[(at, at + 1)] += q * h * h / 2.0;
            P[(at + 1, at)] += q * h * h / 2.0;
            P[(at + 1, at + 1)] += q * h;
        }
        (mean, P)
    }

    /// Innovation of all readings at once, its covariance, and the covariance of states with readings.
    fn dense_readings(mean: &States, P: &Spread) -> (SVector<f64, N>, SMatrix<f64, N, N>, SMatrix<f64, { 2 * N }, N>) {
        let mut H = SMatrix::<f64, N, { 2 * N }>::zeros();
        for k in 0..N {
            H[(k, 2 * k)] = 1.0;
        }
        let C = H * P * H.transpose() + SMatrix::<f64, N, N>::identity() * NOISE.R;
        (SVector::from(Z) - H * mean, C, P * H.transpose())
    }

    #[test]
    fn smoother_equals_the_dense_gaussian_posterior() {
        for restart in [WHOLE, BROKEN] {
            let (mean, P) = dense_prior(&restart);
            let (e, C, PH) = dense_readings(&mean, &P);
            let expected = mean + PH * C.cholesky().unwrap().solve(&e);
            let kept = Kept::of(readings(&restart), NOISE, PRIOR).unwrap();
            let (mut p, mut v, mut wanted) = ([0.0; N], [0.0; N], [0.0; N]);
            smooth(readings(&restart), NOISE, kept.view(), &mut p, &mut v, &mut wanted).unwrap();
            for k in 0..N {
                // a 8 x 8 solve of condition 1e3, numbers below 3
                assert!((p[k] - expected[2 * k]).abs() < 1e-12, "p {k}");
                assert!((v[k] - expected[2 * k + 1]).abs() < 1e-11, "v {k}");
            }
        }
    }

    #[test]
    fn filter_equals_the_dense_gaussian_posterior_at_the_last_reading() {
        let (mean, P) = dense_prior(&WHOLE);
        let (e, C, PH) = dense_readings(&mean, &P);
        let solved = C.cholesky().unwrap();
        let (expected, spread) = (mean + PH * solved.solve(&e), P - PH * solved.solve(&PH.transpose()));
        let kept = Kept::of(readings(&WHOLE), NOISE, PRIOR).unwrap();
        let [e, S, gain_p, gain_v, p, v, pp, pv, vv] = kept.0.map(|series| series[N - 1]);
        let after = MotionCovariance { pp, pv, vv }.update(NOISE.R, 1.0 / S);
        let last = 2 * (N - 1);
        assert!((p + gain_p * e - expected[last]).abs() < 1e-12);
        assert!((v + gain_v * e - expected[last + 1]).abs() < 1e-11);
        assert!((after.pp / spread[(last, last)] - 1.0).abs() < 1e-10);
        assert!((after.pv / spread[(last, last + 1)] - 1.0).abs() < 1e-10);
        assert!((after.vv / spread[(last + 1, last + 1)] - 1.0).abs() < 1e-10);
    }

    #[test]
    fn smoothed_noise_drives_the_smoothed_motion() {
        let kept = Kept::of(readings(&BROKEN), NOISE, PRIOR).unwrap();
        let (mut p, mut v, mut w) = ([0.0; N], [0.0; N], [0.0; N]);
        smooth(readings(&BROKEN), NOISE, kept.view(), &mut p, &mut v, &mut w).unwrap();
        for k in (1..N).filter(|&k| !BROKEN[k]) {
            let h = T[k] - T[k - 1];
            let gained = FIRST[k] + h * (w[k - 1] + w[k]) / 2.0; // a straight line between readings
            let moved = h * v[k - 1] + SECOND[k] + h * h * (2.0 * w[k - 1] + w[k]) / 6.0;
            assert!((v[k] - v[k - 1] - gained).abs() < 1e-13, "v {k}");
            assert!((p[k] - p[k - 1] - moved).abs() < 1e-14, "p {k}");
        }
        assert!(w.iter().any(|w| w.abs() > 0.1)); // the readings do ask for noise
    }

    #[test]
    fn log_likelihood_equals_the_dense_gaussian_density() {
        for restart in [WHOLE, BROKEN] {
            let (mean, P) = dense_prior(&restart);
            let (e, C, _) = dense_readings(&mean, &P);
            let solved = C.cholesky().unwrap();
            let tau = core::f64::consts::TAU;
            let expected =
                -0.5 * (e.dot(&solved.solve(&e)) + libm::log(solved.determinant()) + N as f64 * libm::log(tau));
            let found = log_likelihood(readings(&restart), NOISE, PRIOR, &[true; N]).unwrap();
            assert!((found - expected).abs() < 1e-10, "{found} {expected}"); // a sum of 8 terms near 3
        }
    }

    #[test]
    fn likelihood_counts_only_what_is_asked() {
        let kept = Kept::of(readings(&WHOLE), NOISE, PRIOR).unwrap();
        let [e, S, ..] = kept.0;
        let counts: [bool; N] = core::array::from_fn(|k| k % 3 == 1);
        let term = |k: usize| -0.5 * (e[k] * e[k] / S[k] + libm::log(core::f64::consts::TAU * S[k]));
        let expected: f64 = (0..N).filter(|&k| counts[k]).map(term).sum();
        let found = log_likelihood(readings(&WHOLE), NOISE, PRIOR, &counts).unwrap();
        assert!((found - expected).abs() < 1e-13);
    }

    #[test]
    fn a_start_depends_on_nothing_before_it() {
        let whole = Kept::of(readings(&BROKEN), NOISE, PRIOR).unwrap();
        let mut changed = Z;
        changed[2] += 1.0;
        let other = Kept::of(Readings { z: &changed, ..readings(&BROKEN) }, NOISE, PRIOR).unwrap();
        for (one, two) in whole.0.iter().zip(&other.0) {
            assert!(one[4..].iter().zip(&two[4..]).all(|(a, b)| a.to_bits() == b.to_bits()));
        }
        assert!((whole.0[0][3] - other.0[0][3]).abs() > 1e-3); // while before it the change is felt
    }

    #[test]
    fn covariance_over_two_steps_equals_one_long_step() {
        let (one, two) = (PRIOR.P.predict(0.3, 0.7), PRIOR.P.predict(0.1, 0.7).predict(0.2, 0.7));
        assert!((one.pp - two.pp).abs() < 1e-15 && (one.pv - two.pv).abs() < 1e-15 && (one.vv - two.vv).abs() < 1e-15);
    }

    const GRID: Grid = Grid { start: -0.05, step: 0.03 };
    const ROWS: usize = 11; // to 0.25 s

    /// A cubic, which four-point interpolation carries exactly, and its two running integrals.
    fn column(t: f64) -> f64 {
        3.0 - 40.0 * t + 300.0 * t * t - 500.0 * t.powi(3)
    }

    fn once(t: f64) -> f64 {
        3.0 * t - 20.0 * t * t + 100.0 * t.powi(3) - 125.0 * t.powi(4)
    }

    fn twice(t: f64) -> f64 {
        1.5 * t * t - 20.0 / 3.0 * t.powi(3) + 25.0 * t.powi(4) - 25.0 * t.powi(5)
    }

    fn on_grid() -> [f64; 2 * ROWS] {
        core::array::from_fn(|i| if i % 2 == 0 { column(GRID.start + (i / 2) as f64 * GRID.step) } else { 1.0 })
    }

    const DIRECT: [f64; N] = [0.3, -0.2, 0.5, 0.1, 0.7, -0.4, 0.2, 0.6];

    fn columns<'a>(on_grid: &'a [f64], at_readings: &'a [f64]) -> Columns<'a> {
        Columns { inputs: 2, readings: 1, grid: GRID, on_grid, at_readings }
    }

    #[test]
    fn carried_columns_equal_differences_of_the_filter() {
        for restart in [WHOLE, BROKEN] {
            let base = Kept::of(readings(&restart), NOISE, PRIOR).unwrap();
            let [e, S, ..] = base.0;
            let (mut state, mut whitened) = ([0.0; 6], [0.0; 3 * N]);
            let grid = on_grid();
            carry(base.gains(&restart, 0..N), columns(&grid, &DIRECT), None, &mut state, &mut whitened).unwrap();

            let step = |k: usize| if k == 0 || restart[k] { 0.0 } else { T[k] - T[k - 1] };
            let from = |k: usize| T[k] - step(k);
            let curved: [f64; N] = core::array::from_fn(|k| FIRST[k] + once(T[k]) - once(from(k)));
            let bent: [f64; N] =
                core::array::from_fn(|k| SECOND[k] + twice(T[k]) - twice(from(k)) - step(k) * once(from(k)));
            let faster: [f64; N] = core::array::from_fn(|k| FIRST[k] + step(k));
            let farther: [f64; N] = core::array::from_fn(|k| SECOND[k] + step(k) * step(k) / 2.0);
            let lowered: [f64; N] = core::array::from_fn(|k| Z[k] - DIRECT[k]);
            let changed = [
                Readings { first: &curved, second: &bent, ..readings(&restart) },
                Readings { first: &faster, second: &farther, ..readings(&restart) },
                Readings { z: &lowered, ..readings(&restart) },
            ];
            for (j, with_one_unit) in changed.into_iter().enumerate() {
                let after = Kept::of(with_one_unit, NOISE, PRIOR).unwrap().0[0];
                for k in 0..N {
                    // The filter is linear: a whole unit is as good as a small one. Differences of numbers near 1.
                    let expected = (e[k] - after[k]) / libm::sqrt(S[k]);
                    assert!((whitened[3 * k + j] - expected).abs() < 1e-12, "column {j}, reading {k}");
                }
            }
            assert!((1..3 * N).any(|i| whitened[i].abs() > 0.1)); // and present is something to carry
        }
    }

    #[test]
    fn columns_carried_in_stretches_equal_the_whole() {
        let base = Kept::of(readings(&BROKEN), NOISE, PRIOR).unwrap();
        let grid = on_grid();
        let (mut state, mut whole) = ([0.0; 6], [0.0; 3 * N]);
        carry(base.gains(&BROKEN, 0..N), columns(&grid, &DIRECT), None, &mut state, &mut whole).unwrap();
        for cut in 1..N {
            let (mut state, mut parts) = ([0.0; 6], [0.0; 3 * N]);
            let (left, right) = parts.split_at_mut(3 * cut);
            let (early, late) = DIRECT.split_at(cut);
            carry(base.gains(&BROKEN, 0..cut), columns(&grid, early), None, &mut state, left).unwrap();
            carry(base.gains(&BROKEN, cut..N), columns(&grid, late), Some(T[cut - 1]), &mut state, right).unwrap();
            assert_eq!(whole.map(f64::to_bits), parts.map(f64::to_bits));
        }
    }

    #[test]
    fn bad_noise_is_refused() {
        for (q, R) in [(0.0, 1.0), (1.0, -1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
            let noise = Noise { q, R };
            let refused = Kept::of(readings(&WHOLE), noise, PRIOR).err();
            assert!(matches!(refused, Some(ReplayError::Noise { .. })));
            assert!(log_likelihood(readings(&WHOLE), noise, PRIOR, &[true; N]).is_err());
        }
    }

    #[test]
    fn a_prior_that_is_no_covariance_stops_the_filter() {
        let prior = Prior { v: 0.0, P: MotionCovariance { pp: -1.0, pv: 0.0, vv: 1.0 } };
        let expected = ReplayError::InnovationVariance { index: 0, S: -1.0 + NOISE.R };
        assert_eq!(Kept::of(readings(&WHOLE), NOISE, prior).err(), Some(expected));
        assert_eq!(log_likelihood(readings(&WHOLE), NOISE, prior, &[true; N]), Err(expected));
    }

    #[test]
    fn unusable_readings_are_refused_with_the_place() {
        let mut backward = T;
        backward[5] = backward[4];
        let expected = ConditionError::Time { index: 5, t: T[4] };
        let found = Kept::of(Readings { t: &backward, ..readings(&WHOLE) }, NOISE, PRIOR).err();
        assert_eq!(found, Some(ReplayError::Condition(expected)));
        let mut lost = Z;
        lost[3] = f64::NAN;
        let found = Kept::of(Readings { z: &lost, ..readings(&WHOLE) }, NOISE, PRIOR).err();
        assert_eq!(found, Some(ReplayError::Condition(ConditionError::Sample { index: 3 })));
        let short = ReplayError::Condition(ConditionError::Length { expected: N, found: N - 1 });
        let found = Kept::of(Readings { first: &FIRST[1..], ..readings(&WHOLE) }, NOISE, PRIOR).err();
        assert_eq!(found, Some(short));
        assert_eq!(log_likelihood(readings(&WHOLE), NOISE, PRIOR, &[true; N - 1]), Err(short));
        let kept = Kept::of(readings(&WHOLE), NOISE, PRIOR).unwrap();
        let (mut p, mut v, mut wanted) = ([0.0; N], [0.0; N - 1], [0.0; N]);
        let found = smooth(readings(&WHOLE), NOISE, kept.view(), &mut p, &mut v, &mut wanted);
        assert_eq!(found, Err(short));
    }

    #[test]
    fn a_grid_that_does_not_reach_over_the_readings_is_refused() {
        let kept = Kept::of(readings(&WHOLE), NOISE, PRIOR).unwrap();
        let grid = on_grid();
        let (mut state, mut whitened) = ([0.0; 6], [0.0; 3 * N]);
        let short = columns(&grid[..2 * (ROWS - 1)], &DIRECT); // ends at 0.22 s
        let found = carry(kept.gains(&WHOLE, 0..N), short, None, &mut state, &mut whitened);
        assert_eq!(found, Err(ReplayError::Grid { index: 6, t: T[6] }));
        let late = Columns { grid: Grid { start: 0.005, ..GRID }, ..columns(&grid, &DIRECT) };
        let found = carry(kept.gains(&WHOLE, 0..N), late, None, &mut state, &mut whitened);
        assert_eq!(found, Err(ReplayError::Grid { index: 1, t: T[1] }));
        let found = carry(kept.gains(&WHOLE, 0..N), columns(&grid, &DIRECT), None, &mut state[..5], &mut whitened);
        assert_eq!(found, Err(ReplayError::Condition(ConditionError::Length { expected: 6, found: 5 })));
    }
}
