//! The loops of [`ekf_core::replay`] compiled for the widest registers of this processor.
//!
//! The operations are those of the plain loops, in their order and none of them fused, so the bits are equal.

use ekf_core::replay::columns::{self, FilteredReading, Gains, ReadingSpan, Response};
use ekf_core::replay::filter::{self, Driven, InterleavedReading, interleave};
use ekf_core::replay::grid::{Cell, Grid};
use ekf_core::replay::{Noise, Prior, Readings, ReplayError};
use ekf_core::signal::integrals::ConditionError;
use pulp::{Arch, NullaryFnOnce};

/// Sum over the parts of their log-likelihoods: [`filter::log_likelihood`].
///
/// # Errors
/// Those of the plain loop.
pub fn log_likelihood<const N: usize>(
    readings: &[InterleavedReading<N>],
    noise: Noise,
    prior: Prior,
) -> Result<f64, ReplayError> {
    Arch::new().dispatch(Score { readings, noise, prior })
}

struct Score<'a, const N: usize> {
    readings: &'a [InterleavedReading<N>],
    noise: Noise,
    prior: Prior,
}

impl<const N: usize> NullaryFnOnce for Score<'_, N> {
    type Output = Result<f64, ReplayError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        filter::log_likelihood(self.readings, self.noise, self.prior)
    }
}

/// Innovations of every part, m, one row of `rows` behind the other: [`filter::innovations`].
///
/// # Errors
/// Those of the plain loop, and when readings are unusable or lengths differ.
pub fn innovations<const N: usize>(
    parts: [Readings<'_>; N],
    noise: Noise,
    prior: Prior,
    rows: &mut [f64],
) -> Result<(), ReplayError> {
    Arch::new().dispatch(Innovations { parts, noise, prior, rows })
}

struct Innovations<'a, const N: usize> {
    parts: [Readings<'a>; N],
    noise: Noise,
    prior: Prior,
    rows: &'a mut [f64],
}

impl<const N: usize> NullaryFnOnce for Innovations<'_, N> {
    type Output = Result<(), ReplayError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { parts, noise, prior, rows } = self;
        let n = parts.first().map_or(0, |readings| readings.t.len());
        let interleaved = interleave(parts, None)?;
        if rows.len() != N * n {
            return Err(ConditionError::Length { expected: N * n, actual: rows.len() }.into());
        }
        let mut k = 0;
        filter::innovations(
            interleaved,
            noise,
            prior,
            #[inline(always)]
            |e| {
                for (j, value) in e.into_iter().enumerate() {
                    rows[j * n + k] = value;
                }
                k += 1;
            },
        )
    }
}

/// Products of the innovations of `N` filters over blocks of time: [`filter::block_products`].
///
/// # Errors
/// Those of the plain loop.
pub fn block_products<const N: usize>(
    shared: Readings<'_>,
    driven: [Driven<'_>; N],
    filter: (Noise, Prior),
    settled: &[bool],
    edges: &[f64],
    take: impl FnMut(&[[f64; N]; N], usize),
) -> Result<(), ReplayError> {
    Arch::new().dispatch(BlockProducts { shared, driven, filter, settled, edges, take })
}

struct BlockProducts<'a, F, const N: usize> {
    shared: Readings<'a>,
    driven: [Driven<'a>; N],
    filter: (Noise, Prior),
    settled: &'a [bool],
    edges: &'a [f64],
    take: F,
}

impl<F: FnMut(&[[f64; N]; N], usize), const N: usize> NullaryFnOnce for BlockProducts<'_, F, N> {
    type Output = Result<(), ReplayError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        filter::block_products(self.shared, self.driven, self.filter, self.settled, self.edges, self.take)
    }
}

/// Readings prepared for columns: [`columns::prepare`].
///
/// # Errors
/// Those of the plain loop.
pub fn prepare(
    gains: Gains<'_>,
    counts: &[bool],
    grid: (Grid, usize),
    before: Option<f64>,
    cells: &mut Vec<Cell>,
    readings: &mut Vec<FilteredReading>,
) -> Result<(), ReplayError> {
    Arch::new().dispatch(Prepare { gains, counts, grid, before, cells, readings })
}

struct Prepare<'a> {
    gains: Gains<'a>,
    counts: &'a [bool],
    grid: (Grid, usize),
    before: Option<f64>,
    cells: &'a mut Vec<Cell>,
    readings: &'a mut Vec<FilteredReading>,
}

impl NullaryFnOnce for Prepare<'_> {
    type Output = Result<(), ReplayError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { gains, counts, grid, before, cells, readings } = self;
        cells.reserve(counts.len() + grid.1);
        readings.reserve(counts.len());
        columns::prepare(
            gains,
            counts,
            grid,
            before,
            #[inline(always)]
            |cell| cells.push(cell),
            #[inline(always)]
            |reading| readings.push(reading),
        )
    }
}

/// Columns that add to the acceleration: [`columns::filter_input_columns`].
///
/// # Errors
/// Those of the plain loop.
pub fn filter_input_columns<const N: usize>(
    span: ReadingSpan<'_>,
    columns: [&[f64]; N],
    factor: f64,
    response: &mut Response<N>,
    sums: [&mut [f64]; N],
) -> Result<(), ReplayError> {
    Arch::new().dispatch(InputColumns { span, columns, factor, response, sums })
}

/// Columns that add to the reading: [`columns::filter_reading_columns`].
///
/// # Errors
/// Those of the plain loop.
pub fn filter_reading_columns<const N: usize>(
    span: ReadingSpan<'_>,
    columns: [&[f64]; N],
    response: &mut Response<N>,
    sums: [&mut [f64]; N],
) -> Result<(), ReplayError> {
    Arch::new().dispatch(ReadingColumns { span, columns, response, sums })
}

struct InputColumns<'a, const N: usize> {
    span: ReadingSpan<'a>,
    columns: [&'a [f64]; N],
    factor: f64,
    response: &'a mut Response<N>,
    sums: [&'a mut [f64]; N],
}

impl<const N: usize> NullaryFnOnce for InputColumns<'_, N> {
    type Output = Result<(), ReplayError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        columns::filter_input_columns(self.span, self.columns, self.factor, self.response, self.sums)
    }
}

struct ReadingColumns<'a, const N: usize> {
    span: ReadingSpan<'a>,
    columns: [&'a [f64]; N],
    response: &'a mut Response<N>,
    sums: [&'a mut [f64]; N],
}

impl<const N: usize> NullaryFnOnce for ReadingColumns<'_, N> {
    type Output = Result<(), ReplayError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        columns::filter_reading_columns(self.span, self.columns, self.response, self.sums)
    }
}
