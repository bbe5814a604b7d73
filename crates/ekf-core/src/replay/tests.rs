//! The replay against dense Gaussian algebra, and several records at once against each alone.

use super::columns::{
    FilteredReading, Gains, ReadingSpan, Response, filter_input_columns, filter_reading_columns, prepare,
};
use super::filter::{
    Driven, InterleavedReading, Track, TrackView, block_products, filter, innovations, interleave, log_likelihood,
};
use super::grid::{Cell, Grid};
use super::smoother::smooth;
use super::*;
use nalgebra::{SMatrix, SVector};

const N: usize = 8;
const T: [f64; N] = [0.0, 0.011, 0.019, 0.034, 0.2, 0.213, 0.221, 0.24]; // a gap of many steps in the middle
const Z: [f64; N] = [0.10, 0.14, 0.11, 0.18, 0.31, 0.29, 0.30, 0.36];
const FIRST: [f64; N] = [0.0, 0.02, -0.01, 0.03, 0.2, -0.02, 0.01, 0.05];
const SECOND: [f64; N] = [0.0, 1e-4, -4e-5, 2e-4, 1.5e-2, -1e-4, 3e-5, 4e-4];
const WHOLE: [bool; N] = [true, false, false, false, false, false, false, false];
const BROKEN: [bool; N] = [true, false, false, false, true, false, false, false];
const EXTRA: [f64; N] = [0.0, 0.0, 1.9, 0.0, 0.0, 0.3, 0.0, 0.0]; // two intervals know less of the motion
const NOISY: [f64; N] = [0.0, 0.0, 0.0, 2e-3, 0.0, 0.0, 1e-4, 0.0]; // two readings that are worse than the rest
const NOISE: Noise = Noise { q: 0.7, R: 4e-4 };
const PRIOR: Prior = Prior { v: 0.4, P: MotionCovariance { pp: 2e-3, pv: 1e-2, vv: 0.9 } };

fn readings(restart: &[bool]) -> Readings<'_> {
    Readings { t: &T, z: &Z, first: &FIRST, second: &SECOND, restart, extra_q: &EXTRA, extra_R: &NOISY }
}

/// A track that owns its memory: e, S, `gain_p`, `gain_v`, p, v, pp, pv, vv.
#[derive(Default)]
struct Kept([[f64; N]; 9]);

impl Kept {
    fn of(readings: Readings<'_>, noise: Noise, prior: Prior) -> Result<Self, ReplayError> {
        let mut series = Self::default();
        let [e, S, gain_p, gain_v, p, v, pp, pv, vv] = &mut series.0;
        filter(readings, noise, prior, &mut Track { e, S, gain_p, gain_v, p, v, pp, pv, vv })?;
        Ok(series)
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

/// Log-likelihood of one record.
fn likelihood(readings: Readings<'_>, noise: Noise, prior: Prior, counts: &[bool]) -> Result<f64, ReplayError> {
    let mut rows = interleave([readings], Some([counts]))?;
    let interleaved: [InterleavedReading<1>; N] = core::array::from_fn(|_| rows.next().unwrap());
    log_likelihood(&interleaved, noise, prior)
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
        let q = NOISE.q + EXTRA[k];
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
    let C = H * P * H.transpose() + SMatrix::<f64, N, N>::from_diagonal(&SVector::from(NOISY).add_scalar(NOISE.R));
    (SVector::from(Z) - H * mean, C, P * H.transpose())
}

#[test]
fn smoother_equals_the_dense_gaussian_posterior() {
    for restart in [WHOLE, BROKEN] {
        let (mean, P) = dense_prior(&restart);
        let (e, C, PH) = dense_readings(&mean, &P);
        let expected = mean + PH * C.cholesky().unwrap().solve(&e);
        let series = Kept::of(readings(&restart), NOISE, PRIOR).unwrap();
        let (mut p, mut v, mut wanted) = ([0.0; N], [0.0; N], [0.0; N]);
        smooth(readings(&restart), NOISE, series.view(), &mut p, &mut v, &mut wanted).unwrap();
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
    let series = Kept::of(readings(&WHOLE), NOISE, PRIOR).unwrap();
    let [e, S, gain_p, gain_v, p, v, pp, pv, vv] = series.0.map(|series| series[N - 1]);
    let after = MotionCovariance { pp: pp * NOISE.R / S, pv: pv * NOISE.R / S, vv: vv - pv * pv / S };
    let last = 2 * (N - 1);
    assert!((p + gain_p * e - expected[last]).abs() < 1e-12);
    assert!((v + gain_v * e - expected[last + 1]).abs() < 1e-11);
    assert!((after.pp / spread[(last, last)] - 1.0).abs() < 1e-10);
    assert!((after.pv / spread[(last, last + 1)] - 1.0).abs() < 1e-10);
    assert!((after.vv / spread[(last + 1, last + 1)] - 1.0).abs() < 1e-10);
}

#[test]
fn smoothed_noise_drives_the_smoothed_motion() {
    let series = Kept::of(readings(&BROKEN), NOISE, PRIOR).unwrap();
    let (mut p, mut v, mut w) = ([0.0; N], [0.0; N], [0.0; N]);
    smooth(readings(&BROKEN), NOISE, series.view(), &mut p, &mut v, &mut w).unwrap();
    for k in (1..N).filter(|&k| !BROKEN[k]) {
        let h = T[k] - T[k - 1];
        let share = 1.0 + EXTRA[k] / NOISE.q;
        let gained = FIRST[k] + share * h * (w[k - 1] + w[k]) / 2.0; // a straight line between readings
        let moved = h * v[k - 1] + SECOND[k] + share * h * h * (2.0 * w[k - 1] + w[k]) / 6.0;
        assert!((v[k] - v[k - 1] - gained).abs() < 1e-13, "v {k}");
        assert!((p[k] - p[k - 1] - moved).abs() < 1e-14, "p {k}");
    }
    assert!(w.iter().any(|w| w.abs() > 0.1)); // the smoothed noise is not zero
}

#[test]
fn log_likelihood_equals_the_dense_gaussian_density() {
    for restart in [WHOLE, BROKEN] {
        let (mean, P) = dense_prior(&restart);
        let (e, C, _) = dense_readings(&mean, &P);
        let solved = C.cholesky().unwrap();
        let tau = core::f64::consts::TAU;
        let expected = -0.5 * (e.dot(&solved.solve(&e)) + libm::log(solved.determinant()) + N as f64 * libm::log(tau));
        let actual = likelihood(readings(&restart), NOISE, PRIOR, &[true; N]).unwrap();
        assert!((actual - expected).abs() < 1e-10, "{actual} {expected}"); // a sum of 8 terms near 3
    }
}

#[test]
fn likelihood_counts_only_what_is_asked() {
    let series = Kept::of(readings(&WHOLE), NOISE, PRIOR).unwrap();
    let [e, S, ..] = series.0;
    let counts: [bool; N] = core::array::from_fn(|k| k % 3 == 1);
    let term = |k: usize| -0.5 * (e[k] * e[k] / S[k] + libm::log(core::f64::consts::TAU * S[k]));
    let expected: f64 = (0..N).filter(|&k| counts[k]).map(term).sum();
    let actual = likelihood(readings(&WHOLE), NOISE, PRIOR, &counts).unwrap();
    assert!((actual - expected).abs() < 1e-13);
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

const DIRECT: [f64; N] = [0.3, -0.2, 0.5, 0.1, 0.7, -0.4, 0.2, 0.6];

/// Readings prepared for columns, in memory of their own.
struct Prepared {
    readings: Vec<FilteredReading>,
    cells: Vec<Cell>,
}

impl Prepared {
    fn new(gains: Gains<'_>, grid: Grid, rows: usize, before: Option<f64>) -> Result<Self, ReplayError> {
        let (mut readings, mut cells) = (Vec::new(), Vec::new());
        let counts = vec![true; gains.t.len()];
        prepare(gains, &counts, (grid, rows), before, |cell| cells.push(cell), |reading| readings.push(reading))?;
        Ok(Self { readings, cells })
    }

    fn span(&self) -> ReadingSpan<'_> {
        ReadingSpan { readings: &self.readings, cells: &self.cells, group: 1 }
    }
}

/// A cubic and a constant on the grid, and a column of the readings; each whitened sample by itself.
#[derive(Default)]
struct Filtered {
    inputs: Response<2>,
    direct: Response<1>,
    whitened: [Vec<f64>; 3],
}

impl Filtered {
    /// Appends readings `rows` of the record.
    fn extend(&mut self, series: &Kept, restart: &[bool], rows: core::ops::Range<usize>) {
        let before = rows.start.checked_sub(1).map(|k| T[k]);
        let prepared = Prepared::new(series.gains(restart, rows.clone()), GRID, ROWS, before).unwrap();
        let curve: [f64; ROWS] = core::array::from_fn(|i| column(GRID.start + i as f64 * GRID.step));
        let [mut a, mut b, mut c] = [(); 3].map(|()| vec![0.0; rows.len()]);
        let columns: [&[f64]; 2] = [&curve, &[1.0; ROWS]];
        filter_input_columns(prepared.span(), columns, 1.0, &mut self.inputs, [&mut a, &mut b]).unwrap();
        filter_reading_columns(prepared.span(), [&DIRECT[rows]], &mut self.direct, [&mut c]).unwrap();
        for (whole, part) in self.whitened.iter_mut().zip([a, b, c]) {
            whole.extend(part);
        }
    }
}

#[test]
fn filtered_columns_equal_differences_of_the_filter() {
    for restart in [WHOLE, BROKEN] {
        let base = Kept::of(readings(&restart), NOISE, PRIOR).unwrap();
        let [e, S, ..] = base.0;
        let mut filtered = Filtered::default();
        filtered.extend(&base, &restart, 0..N);

        let step = |k: usize| if k == 0 || restart[k] { 0.0 } else { T[k] - T[k - 1] };
        let from = |k: usize| T[k] - step(k);
        let curved: [f64; N] = core::array::from_fn(|k| FIRST[k] + once(T[k]) - once(from(k)));
        let twice_curved: [f64; N] =
            core::array::from_fn(|k| SECOND[k] + twice(T[k]) - twice(from(k)) - step(k) * once(from(k)));
        let faster: [f64; N] = core::array::from_fn(|k| FIRST[k] + step(k));
        let farther: [f64; N] = core::array::from_fn(|k| SECOND[k] + step(k) * step(k) / 2.0);
        let lowered: [f64; N] = core::array::from_fn(|k| Z[k] - DIRECT[k]);
        let changed = [
            Readings { first: &curved, second: &twice_curved, ..readings(&restart) },
            Readings { first: &faster, second: &farther, ..readings(&restart) },
            Readings { z: &lowered, ..readings(&restart) },
        ];
        for (j, with_one_unit) in changed.into_iter().enumerate() {
            let after = Kept::of(with_one_unit, NOISE, PRIOR).unwrap().0[0];
            for k in 0..N {
                // The filter is linear: a whole unit is as good as a small one. Differences of numbers near 1.
                let expected = (e[k] - after[k]) / libm::sqrt(S[k]);
                assert!((filtered.whitened[j][k] - expected).abs() < 1e-12, "column {j}, reading {k}");
            }
        }
        assert!(filtered.whitened.iter().flatten().any(|x| x.abs() > 0.1)); // and there is something to filter
    }
}

#[test]
fn columns_filtered_in_two_spans_equal_the_whole() {
    let base = Kept::of(readings(&BROKEN), NOISE, PRIOR).unwrap();
    let mut whole = Filtered::default();
    whole.extend(&base, &BROKEN, 0..N);
    for cut in 1..N {
        let mut parts = Filtered::default();
        parts.extend(&base, &BROKEN, 0..cut);
        parts.extend(&base, &BROKEN, cut..N);
        assert_eq!(whole.whitened, parts.whitened);
    }
}

#[test]
fn bad_noise_is_refused() {
    for (q, R) in [(0.0, 1.0), (1.0, -1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
        let noise = Noise { q, R };
        let refused = Kept::of(readings(&WHOLE), noise, PRIOR).err();
        assert!(matches!(refused, Some(ReplayError::Noise { .. })));
        assert!(likelihood(readings(&WHOLE), noise, PRIOR, &[true; N]).is_err());
    }
}

#[test]
fn a_prior_that_is_no_covariance_stops_the_filter() {
    let prior = Prior { v: 0.0, P: MotionCovariance { pp: -1.0, pv: 0.0, vv: 1.0 } };
    let expected = ReplayError::InnovationVariance { index: 0, S: -1.0 + NOISE.R };
    assert_eq!(Kept::of(readings(&WHOLE), NOISE, prior).err(), Some(expected));
    assert_eq!(likelihood(readings(&WHOLE), NOISE, prior, &[true; N]), Err(expected));
}

#[test]
fn unusable_readings_are_refused_with_the_place() {
    let mut backward = T;
    backward[5] = backward[4];
    let expected = ConditionError::Time { index: 5, t: T[4] };
    let actual = Kept::of(Readings { t: &backward, ..readings(&WHOLE) }, NOISE, PRIOR).err();
    assert_eq!(actual, Some(ReplayError::Condition(expected)));
    let mut lost = Z;
    lost[3] = f64::NAN;
    let actual = Kept::of(Readings { z: &lost, ..readings(&WHOLE) }, NOISE, PRIOR).err();
    assert_eq!(actual, Some(ReplayError::Condition(ConditionError::Sample { index: 3 })));
    let mut negative = EXTRA;
    negative[2] = -1.9;
    let actual = Kept::of(Readings { extra_q: &negative, ..readings(&WHOLE) }, NOISE, PRIOR).err();
    assert_eq!(actual, Some(ReplayError::ExtraNoise { index: 2, q: -1.9 }));
    let mut unknown = NOISY;
    unknown[6] = f64::INFINITY;
    let actual = Kept::of(Readings { extra_R: &unknown, ..readings(&WHOLE) }, NOISE, PRIOR).err();
    assert_eq!(actual, Some(ReplayError::ExtraVariance { index: 6, R: f64::INFINITY }));
    let short = ReplayError::Condition(ConditionError::Length { expected: N, actual: N - 1 });
    let actual = Kept::of(Readings { first: &FIRST[1..], ..readings(&WHOLE) }, NOISE, PRIOR).err();
    assert_eq!(actual, Some(short));
    assert_eq!(likelihood(readings(&WHOLE), NOISE, PRIOR, &[true; N - 1]), Err(short));
    let series = Kept::of(readings(&WHOLE), NOISE, PRIOR).unwrap();
    let (mut p, mut v, mut wanted) = ([0.0; N], [0.0; N - 1], [0.0; N]);
    let actual = smooth(readings(&WHOLE), NOISE, series.view(), &mut p, &mut v, &mut wanted);
    assert_eq!(actual, Err(short));
    let mut v = [0.0; N];
    for cut in 0..9 {
        let mut parts = series.0.each_ref().map(<[f64; N]>::as_slice);
        parts[cut] = &parts[cut][1..];
        let [e, S, gain_p, gain_v, p_before, v_before, pp, pv, vv] = parts;
        let view = TrackView { e, S, gain_p, gain_v, p: p_before, v: v_before, pp, pv, vv };
        assert_eq!(smooth(readings(&WHOLE), NOISE, view, &mut p, &mut v, &mut wanted), Err(short), "part {cut}");
    }
}

#[test]
fn columns_without_the_cells_of_their_span_are_refused() {
    let series = Kept::of(readings(&WHOLE), NOISE, PRIOR).unwrap();
    let prepared = Prepared::new(series.gains(&WHOLE, 0..N), GRID, ROWS, None).unwrap();
    let expected = prepared.cells.len();
    for actual in [0, expected - 1] {
        let span = ReadingSpan { cells: &prepared.cells[..actual], ..prepared.span() };
        let refused = filter_input_columns(span, [&[1.0; ROWS]], 1.0, &mut Response::default(), [&mut [0.0; N]]);
        assert_eq!(refused, Err(ReplayError::Condition(ConditionError::Length { expected, actual })));
    }
}

#[test]
fn a_grid_that_does_not_reach_over_the_readings_is_refused() {
    let series = Kept::of(readings(&WHOLE), NOISE, PRIOR).unwrap();
    let short = Prepared::new(series.gains(&WHOLE, 0..N), GRID, ROWS - 1, None).err(); // ends at 0.22 s
    assert_eq!(short, Some(ReplayError::Grid { index: 6, t: T[6] }));
    let late = Prepared::new(series.gains(&WHOLE, 0..N), Grid { start: 0.005, ..GRID }, ROWS, None).err();
    assert_eq!(late, Some(ReplayError::Grid { index: 1, t: T[1] }));
    let backward = Prepared::new(Gains { t: &[0.2, 0.0], ..series.gains(&WHOLE, 0..2) }, GRID, ROWS, None).err();
    assert_eq!(backward, Some(ReplayError::Condition(ConditionError::Time { index: 1, t: 0.0 })));
    let prepared = Prepared::new(series.gains(&WHOLE, 0..N), GRID, ROWS, None).unwrap();
    let mut sums = [0.0; N - 1];
    let actual = filter_reading_columns(prepared.span(), [&DIRECT], &mut Response::default(), [&mut sums]);
    assert_eq!(actual, Err(ReplayError::Condition(ConditionError::Length { expected: N, actual: N - 1 })));
}

const LENGTH: usize = 40;
const SHARP: Prior = Prior { v: 0.1, P: MotionCovariance { pp: 1e-8, pv: 2e-9, vv: 0.5 } };
const LOW_NOISE: Noise = Noise { q: 3e-5, R: 4e-12 };

/// Four parts of a record with its own gaps, restarts and readings that do not count.
struct Records {
    t: [[f64; LENGTH]; 4],
    z: [[f64; LENGTH]; 4],
    first: [[f64; LENGTH]; 4],
    second: [[f64; LENGTH]; 4],
    restart: [[bool; LENGTH]; 4],
    extra_q: [[f64; LENGTH]; 4],
    extra_R: [[f64; LENGTH]; 4],
    counts: [[bool; LENGTH]; 4],
}

impl Records {
    fn new() -> Self {
        let at = |part: usize, k: usize| (k * 7 + part * 13) as f64;
        let filled =
            |f: &dyn Fn(usize, usize) -> f64| core::array::from_fn(|part| core::array::from_fn(|k| f(part, k)));
        let mut t: [[f64; LENGTH]; 4] = filled(&|part, k| 1e-3 * (k as f64 + 0.3 * libm::sin(at(part, k))));
        t[2][20..].iter_mut().for_each(|time| *time += 0.5);
        Self {
            t,
            z: filled(&|part, k| 1e-5 * libm::cos(0.3 * at(part, k))),
            first: filled(&|part, k| 1e-4 * libm::sin(0.1 * at(part, k))),
            second: filled(&|part, k| 1e-8 * libm::cos(0.2 * at(part, k))),
            restart: core::array::from_fn(|part| core::array::from_fn(|k| k == 0 || (part == 2 && k == 20))),
            extra_q: filled(&|part, k| if (k + 3 * part) % 9 == 4 { 3e-5 } else { 0.0 }),
            extra_R: filled(&|part, k| if (k + part) % 6 == 1 { 7e-12 } else { 0.0 }),
            counts: core::array::from_fn(|part| core::array::from_fn(|k| k > 3 && (k + part) % 5 != 0)),
        }
    }

    fn part(&self, part: usize) -> (Readings<'_>, &[bool]) {
        let readings = Readings {
            t: &self.t[part],
            z: &self.z[part],
            first: &self.first[part],
            second: &self.second[part],
            restart: &self.restart[part],
            extra_q: &self.extra_q[part],
            extra_R: if part == 3 { &[] } else { &self.extra_R[part] },
        };
        (readings, &self.counts[part])
    }
}

/// The filter's own record, as in `Kept`.
fn history(readings: Readings<'_>) -> [[f64; LENGTH]; 9] {
    let mut history = [[0.0; LENGTH]; 9];
    let [e, S, gain_p, gain_v, p, v, pp, pv, vv] = &mut history;
    filter(readings, LOW_NOISE, SHARP, &mut Track { e, S, gain_p, gain_v, p, v, pp, pv, vv }).unwrap();
    history
}

fn interleaved<const M: usize>(parts: [(Readings<'_>, &[bool]); M]) -> [InterleavedReading<M>; LENGTH] {
    let mut rows = interleave(parts.map(|part| part.0), Some(parts.map(|part| part.1))).unwrap();
    core::array::from_fn(|_| rows.next().unwrap())
}

#[test]
fn interleaved_records_have_the_likelihood_of_each() {
    let parts = Records::new();
    let expected: f64 = (0..4)
        .map(|part| {
            let (readings, counts) = parts.part(part);
            let [e, S, ..] = history(readings);
            let term = |k: usize| -0.5 * (e[k] * e[k] / S[k] + libm::log(core::f64::consts::TAU * S[k]));
            (0..LENGTH).filter(|&k| counts[k]).map(term).sum::<f64>()
        })
        .sum();
    let actual = log_likelihood(&interleaved([0, 1, 2, 3].map(|part| parts.part(part))), LOW_NOISE, SHARP).unwrap();
    assert!((actual - expected).abs() < 1e-12 * expected.abs(), "{actual} {expected}"); // a hundred terms, double
    let single: f64 = (0..4).map(|k| log_likelihood(&interleaved([parts.part(k)]), LOW_NOISE, SHARP).unwrap()).sum();
    assert!((single - expected).abs() < 1e-12 * expected.abs(), "{single} {expected}");
    let other = Noise { q: 4e-5, ..LOW_NOISE };
    let moved = log_likelihood(&interleaved([parts.part(0)]), other, SHARP).unwrap();
    let unchanged = log_likelihood(&interleaved([parts.part(0)]), LOW_NOISE, SHARP).unwrap();
    assert!((moved - unchanged).abs() > 1e-6 * unchanged.abs());
}

#[test]
fn innovations_are_those_of_the_filter() {
    let parts = Records::new();
    let mut actual = [[0.0; 4]; LENGTH];
    let mut rows = actual.iter_mut();
    let all = interleave([0, 1, 2, 3].map(|part| parts.part(part).0), None).unwrap();
    innovations(all, LOW_NOISE, SHARP, |e| *rows.next().unwrap() = e).unwrap();
    for part in 0..4 {
        let [e, ..] = history(parts.part(part).0);
        for (k, row) in actual.iter().enumerate() {
            assert_eq!(row[part].to_bits(), e[k].to_bits(), "{part} {k}"); // equal operations in equal order
        }
    }
}

#[test]
fn products_of_innovations_are_summed_over_blocks() {
    let parts = Records::new();
    let (one, two) = (parts.part(0).0, parts.part(1).0);
    let of_two = [one, Readings { z: two.z, first: two.first, second: two.second, ..one }];
    let t = of_two[0].t;
    let settled: [bool; LENGTH] = core::array::from_fn(|k| k % 5 != 0);
    let behind = t[LENGTH - 1] + 1.0; // a block without readings
    let edges = [t[1], t[LENGTH / 3], t[LENGTH / 2], behind];
    let e = of_two.map(|readings| history(readings)[0]);
    let mut block = 0;
    let driven = of_two.map(|Readings { z, first, second, .. }| Driven { z, first, second });
    block_products(of_two[0], driven, (LOW_NOISE, SHARP), &settled, &edges, |products, count| {
        let next = edges.get(block + 1).copied().unwrap_or(f64::INFINITY);
        let from = if block == 0 { f64::NEG_INFINITY } else { edges[block] };
        let rows = (0..LENGTH).filter(|&k| settled[k] && t[k] >= from && t[k] < next);
        for (i, j) in [(0, 0), (1, 0), (1, 1)] {
            let expected: f64 = rows.clone().map(|k| e[i][k] * e[j][k]).sum();
            assert!((products[i][j] - expected).abs() <= 1e-12 * expected.abs(), "{block} {i} {j}");
        }
        assert_eq!(count, rows.count());
        block += 1;
    })
    .unwrap();
    assert_eq!(block, edges.len());
}

#[test]
fn what_is_unusable_is_refused() {
    let parts = Records::new();
    let (readings, counts) = parts.part(0);
    let short = ReplayError::Condition(ConditionError::Length { expected: LENGTH, actual: LENGTH - 1 });
    assert_eq!(interleave([readings], Some([&counts[1..]])).err(), Some(short));
    let rows = interleaved([(readings, counts)]);
    assert!(matches!(log_likelihood(&rows, Noise { q: 0.0, R: 1.0 }, SHARP), Err(ReplayError::Noise { .. })));
    let prior = Prior { v: 0.0, P: MotionCovariance { pp: -1.0, pv: 0.0, vv: 1.0 } };
    let lost = ReplayError::InnovationVariance { index: 0, S: LOW_NOISE.R - 1.0 };
    assert_eq!(log_likelihood(&rows, LOW_NOISE, prior), Err(lost));
}

#[test]
fn a_log_likelihood_that_is_not_finite_is_refused() {
    let mut far = Z;
    far[3] = 1e160; // its square has no double
    let actual = likelihood(Readings { z: &far, ..readings(&WHOLE) }, NOISE, PRIOR, &[true; N]);
    assert_eq!(actual, Err(ReplayError::LogLikelihood { value: f64::NEG_INFINITY }));
    let wide = Noise { q: NOISE.q, R: 1e60 }; // nor has the product of eight variances
    let actual = likelihood(readings(&WHOLE), wide, PRIOR, &[true; N]);
    assert_eq!(actual, Err(ReplayError::LogLikelihood { value: f64::NEG_INFINITY }));
}
