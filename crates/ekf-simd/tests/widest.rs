//! The replay's loops in wide registers give the bits of the plain ones.
#![allow(non_snake_case)] // as in the crate

use ekf_core::replay::columns::{FilteredReading, Gains, ReadingSpan, Response, prepare};
use ekf_core::replay::filter::{InterleavedReading, Track, filter, interleave};
use ekf_core::replay::grid::{Cell, Grid};
use ekf_core::replay::{MotionCovariance, Noise, Prior, Readings, ReplayError};
use ekf_core::signal::integrals::ConditionError;
use proptest::prelude::*;

const READINGS: usize = 200;
const GROUP: usize = 3;
const GRID: Grid = Grid { start: -2e-3, step: 1.3e-3 };
const ROWS: usize = 800; // to 1.04 s, beyond any reading
const NOISE: Noise = Noise { q: 3e-5, R: 4e-12 };
const PRIOR: Prior = Prior { v: 0.1, P: MotionCovariance { pp: 1e-8, pv: 2e-9, vv: 0.5 } };

/// Readings on an uneven clock, with a start in the middle and some that do not count.
struct Record {
    t: Vec<f64>,
    z: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
    restart: Vec<bool>,
    extra_q: Vec<f64>,
    extra_R: Vec<f64>,
    counts: Vec<bool>,
}

impl Record {
    fn new(seed: f64) -> Self {
        let readings = |f: &dyn Fn(f64) -> f64| (0..READINGS).map(|k| f(k as f64 + seed)).collect::<Vec<_>>();
        Self {
            t: (0..READINGS).map(|k| 1e-3 * (k as f64 + 0.3 * (k as f64 * 1.7 + seed).sin())).collect(),
            z: readings(&|x| 1e-5 * (0.3 * x).cos()),
            first: readings(&|x| 1e-4 * (0.1 * x).sin()),
            second: readings(&|x| 1e-8 * (0.2 * x).cos()),
            restart: (0..READINGS).map(|k| k == 0 || k == 90).collect(),
            extra_q: (0..READINGS).map(|k| if k % 31 == 7 { 1e-6 } else { 0.0 }).collect(),
            extra_R: (0..READINGS).map(|k| if k % 23 == 3 { 1e-12 } else { 0.0 }).collect(),
            counts: (0..READINGS).map(|k| k > 5 && k % 7 != 0).collect(),
        }
    }

    fn readings(&self) -> Readings<'_> {
        Readings {
            t: &self.t,
            z: &self.z,
            first: &self.first,
            second: &self.second,
            restart: &self.restart,
            extra_q: &self.extra_q,
            extra_R: &self.extra_R,
        }
    }
}

/// A prepared stretch that owns its memory.
fn prepared(record: &Record) -> (Vec<FilteredReading>, Vec<Cell>) {
    let mut series: [Vec<f64>; 9] = core::array::from_fn(|_| vec![0.0; READINGS]);
    let [e, S, gain_p, gain_v, p, v, pp, pv, vv] = &mut series;
    filter(record.readings(), NOISE, PRIOR, &mut Track { e, S, gain_p, gain_v, p, v, pp, pv, vv }).unwrap();
    let [_, S, gain_p, gain_v, ..] = &series;
    let gains = Gains { t: &record.t, restart: &record.restart, gain_p, gain_v, S };
    let (mut readings, mut cells) = (Vec::new(), Vec::new());
    prepare(gains, &record.counts, (GRID, ROWS), None, |cell| cells.push(cell), |one| readings.push(one)).unwrap();
    (readings, cells)
}

fn bits(rows: &[Vec<f64>]) -> Vec<u64> {
    rows.iter().flatten().map(|x| x.to_bits()).collect()
}

/// Columns through both loops; whether sums and states are the same to the last bit.
fn same_columns<const N: usize>(seed: f64) -> bool {
    let record = Record::new(seed);
    let (readings, cells) = prepared(&record);
    let span = ReadingSpan { readings: &readings, cells: &cells, group: GROUP };
    let groups = record.counts.iter().filter(|&&counted| counted).count() / GROUP;
    let columns: [Vec<f64>; N] =
        core::array::from_fn(|j| (0..ROWS).map(|k| (0.01 * (j + 1) as f64 * k as f64 + seed).sin()).collect());
    let columns: [&[f64]; N] = core::array::from_fn(|j| columns[j].as_slice());
    let read: [&[f64]; N] = core::array::from_fn(|j| &columns[j][..READINGS]);
    let is_constant = Response { p: [0.0; N], v: [0.0; N] };
    let mut sums = [(); 4].map(|()| vec![vec![0.0; groups]; N]);
    let mut states = [is_constant; 4];
    let [wide, plain, wide_read, plain_read] = sums.each_mut().map(|rows| {
        let mut rows = rows.iter_mut();
        core::array::from_fn::<&mut [f64], N, _>(|_| rows.next().unwrap())
    });
    ekf_simd::replay::filter_input_columns(span, columns, -1.2, &mut states[0], wide).unwrap();
    ekf_core::replay::columns::filter_input_columns(span, columns, -1.2, &mut states[1], plain).unwrap();
    ekf_simd::replay::filter_reading_columns(span, read, &mut states[2], wide_read).unwrap();
    ekf_core::replay::columns::filter_reading_columns(span, read, &mut states[3], plain_read).unwrap();
    assert!(sums.iter().all(|rows| rows.iter().flatten().any(|x| x.abs() > 1e-3)));
    bits(&sums[0]) == bits(&sums[1])
        && bits(&sums[2]) == bits(&sums[3])
        && states[0] == states[1]
        && states[2] == states[3]
}

fn same_parts<const N: usize>(seed: f64) -> bool {
    let records: [Record; N] = core::array::from_fn(|j| Record::new(seed + j as f64));
    let parts = records.each_ref().map(Record::readings);
    let counts = records.each_ref().map(|record| record.counts.as_slice());
    let packed: Vec<InterleavedReading<N>> = interleave(parts, Some(counts)).unwrap().collect();
    let wide = ekf_simd::replay::log_likelihood(&packed, NOISE, PRIOR).unwrap();
    let plain = ekf_core::replay::filter::log_likelihood(&packed, NOISE, PRIOR).unwrap();

    let (mut rows, mut expected) = (vec![0.0; N * READINGS], vec![0.0; N * READINGS]);
    ekf_simd::replay::innovations(parts, NOISE, PRIOR, &mut rows).unwrap();
    let mut k = 0;
    ekf_core::replay::filter::innovations(interleave(parts, None).unwrap(), NOISE, PRIOR, |e| {
        for (j, value) in e.into_iter().enumerate() {
            expected[j * READINGS + k] = value;
        }
        k += 1;
    })
    .unwrap();
    wide.to_bits() == plain.to_bits() && k == READINGS && bits(&[rows]) == bits(&[expected])
}

#[test]
fn rows_that_do_not_hold_the_innovations_are_refused() {
    let record = Record::new(0.0);
    let actual = ekf_simd::replay::innovations([record.readings(); 4], NOISE, PRIOR, &mut [0.0; READINGS]);
    let expected = ConditionError::Length { expected: 4 * READINGS, actual: READINGS };
    assert_eq!(actual, Err(ReplayError::Condition(expected)));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn columns_have_the_bits_of_the_plain_loop(seed in 0.0..10.0) {
        prop_assert!(same_columns::<1>(seed));
        prop_assert!(same_columns::<2>(seed));
        prop_assert!(same_columns::<4>(seed));
        prop_assert!(same_columns::<8>(seed));
    }

    #[test]
    fn likelihood_and_innovations_have_the_bits_of_the_plain_loop(seed in 0.0..10.0) {
        prop_assert!(same_parts::<1>(seed));
        prop_assert!(same_parts::<4>(seed));
        prop_assert!(same_parts::<8>(seed));
    }
}
