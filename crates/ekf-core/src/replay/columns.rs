//! Columns of effects filtered with the gains of the replay, a few at once, whitened samples summed in groups.
//!
//! White stays white when equal numbers of samples are summed, and below a fraction of the rate nothing is lost. The
//! geometry of the grid is computed once for a span of readings and used by every column.

use crate::replay::grid::{Cell, Cells, Grid, NODES};
use crate::replay::{ReplayError, same_length};
use crate::signal::integrals::ConditionError;

/// Gains of the filter that the columns pass.
#[derive(Debug, Clone, Copy)]
pub struct Gains<'a> {
    /// Reading times, s.
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

/// One reading, with the gains and the weight applied to a column there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilteredReading {
    /// Time since the reading before, s.
    pub h: f64,
    /// Gain on position.
    pub gain_p: f64,
    /// Gain on velocity, 1/s.
    pub gain_v: f64,
    /// `1/sqrt(S)`, 1/m; 0 where the reading does not count.
    pub weight: f64,
    /// Cells of the grid since the reading before.
    pub cells: u32,
    /// The filter starts anew here.
    pub starts: bool,
    /// The reading enters a sum.
    pub counts: bool,
}

/// A span of readings, prepared for columns.
#[derive(Debug, Clone, Copy)]
pub struct ReadingSpan<'a> {
    /// One entry for each reading.
    pub readings: &'a [FilteredReading],
    /// The cells of all readings, one behind the other; empty when only position columns are carried.
    pub cells: &'a [Cell],
    /// Readings in a sum, at least 1; a remainder at the end is left out.
    pub group: usize,
}

/// Prepares a span of readings; `take_cell` and `take` receive each cell and each reading in order of time.
///
/// `before` is the time of the reading before the span. The grid, `rows` rows of it, must reach over the span; no rows serve
/// columns of the reading alone.
///
/// # Errors
/// [`ReplayError`] when lengths differ, times do not rise or the grid does not reach.
#[inline(always)]
pub fn prepare(
    gains: Gains<'_>,
    counts: &[bool],
    (grid, rows): (Grid, usize),
    before: Option<f64>,
    mut take_cell: impl FnMut(Cell),
    mut take: impl FnMut(FilteredReading),
) -> Result<(), ReplayError> {
    let n = gains.t.len();
    for length in [gains.restart.len(), gains.gain_p.len(), gains.gain_v.len(), gains.S.len(), counts.len()] {
        same_length(n, length)?;
    }
    let (mut previous, mut grid) = (before, Cells::of(grid, rows));
    for (k, &counted) in counts.iter().enumerate() {
        let now = gains.t[k];
        if previous.is_some_and(|earlier| !(earlier < now)) {
            return Err(ConditionError::Time { index: k, t: now }.into());
        }
        let from = previous.filter(|_| !gains.restart[k]);
        let mut passed = 0;
        if let Some(earlier) = from.filter(|_| rows > 0) {
            grid.between(earlier, now, |cell| {
                passed += 1;
                take_cell(cell);
            })
            .ok_or(ReplayError::Grid { index: k, t: now })?;
        }
        take(FilteredReading {
            h: from.map_or(0.0, |earlier| now - earlier),
            gain_p: gains.gain_p[k],
            gain_v: gains.gain_v[k],
            weight: if counted { inverse_root(gains.S[k]) } else { 0.0 },
            cells: passed,
            starts: from.is_none(),
            counts: counted,
        });
        previous = Some(now);
    }
    Ok(())
}

/// `1/sqrt(x)`, out of line: the core's square root is an instruction of its own choice, and stalls among wider ones.
#[inline(never)]
fn inverse_root(x: f64) -> f64 {
    1.0 / libm::sqrt(x)
}

/// Response of (p, v) to `N` columns; zero at the start of a record, kept from span to span.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response<const N: usize> {
    /// Of position, m per unit.
    pub p: [f64; N],
    /// Of velocity, m/s per unit.
    pub v: [f64; N],
}

impl<const N: usize> Default for Response<N> {
    fn default() -> Self {
        Self { p: [0.0; N], v: [0.0; N] }
    }
}

/// Filters `N` columns that add to the acceleration, sampled on the grid, each times `factor`.
///
/// `sums` holds one row per column: sums over the groups of whitened responses, over the square root of the group.
///
/// # Errors
/// [`ReplayError::Condition`] when the span has fewer cells than its readings passed, a column is shorter than the grid that
/// they need, or `sums` do not fit.
///
/// # Panics
/// If the cells do not stand in the order in which [`prepare`] gives them.
#[inline(always)]
pub fn filter_input_columns<const N: usize>(
    span: ReadingSpan<'_>,
    columns: [&[f64]; N],
    factor: f64,
    response: &mut Response<N>,
    sums: [&mut [f64]; N],
) -> Result<(), ReplayError> {
    let passed = span.readings.iter().map(|reading| reading.cells as usize).sum();
    if span.cells.len() < passed {
        return Err(ConditionError::Length { expected: passed, actual: span.cells.len() }.into());
    }
    let rows = span.cells.last().map_or(0, |cell| cell.row as usize + NODES);
    let shortest = columns.iter().map(|column| column.len()).min().unwrap_or(rows);
    if shortest < rows {
        return Err(ConditionError::Length { expected: rows, actual: shortest }.into());
    }
    let mut packed = Packed { columns, factor, low: 0, rows: [[0.0; N]; PACKED], high: 0 };
    let mut ahead = span.cells;
    run_columns(
        span,
        response,
        sums,
        #[inline(always)]
        |reading, p, v| {
            let (now, later) = ahead.split_at(reading.cells as usize);
            ahead = later;
            for cell in now {
                let [r0, r1, r2, r3] = packed.at(cell.row as usize);
                let [w0, w1, w2, w3] = cell.first;
                let [x0, x1, x2, x3] = cell.second;
                for j in 0..N {
                    p[j] += cell.h * v[j] + (x0 * r0[j] + x1 * r1[j]) + (x2 * r2[j] + x3 * r3[j]);
                    v[j] += (w0 * r0[j] + w1 * r1[j]) + (w2 * r2[j] + w3 * r3[j]);
                }
            }
            *p
        },
    )
}

/// Filters `N` columns that add to the reading, one value for each reading of the span.
///
/// `sums` are those of [`filter_input_columns`].
///
/// # Errors
/// [`ReplayError::Condition`] when a column or `sums` do not fit the span.
#[inline(always)]
pub fn filter_reading_columns<const N: usize>(
    span: ReadingSpan<'_>,
    columns: [&[f64]; N],
    response: &mut Response<N>,
    sums: [&mut [f64]; N],
) -> Result<(), ReplayError> {
    for column in columns {
        same_length(span.readings.len(), column.len())?;
    }
    let mut k = 0;
    run_columns(
        span,
        response,
        sums,
        #[inline(always)]
        |reading, p, v| {
            for j in 0..N {
                p[j] += reading.h * v[j];
            }
            k += 1;
            core::array::from_fn(|j| p[j] + columns[j][k - 1])
        },
    )
}

/// Runs the filter over the readings; `advance` moves the responses up to it and returns those of its prediction.
#[inline(always)] // with the closure, or the columns do not stay side by side in registers
fn run_columns<const N: usize>(
    span: ReadingSpan<'_>,
    response: &mut Response<N>,
    mut sums: [&mut [f64]; N],
    mut advance: impl FnMut(&FilteredReading, &mut [f64; N], &mut [f64; N]) -> [f64; N],
) -> Result<(), ReplayError> {
    let counted = span.readings.iter().filter(|reading| reading.counts).count();
    let groups = counted / span.group.max(1);
    for length in sums.iter().map(|sum| sum.len()) {
        same_length(groups, length)?;
    }
    let mean = 1.0 / libm::sqrt(span.group as f64);
    let Response { mut p, mut v } = *response;
    let (mut sum, mut held, mut row) = ([0.0; N], 0, 0);
    for reading in span.readings {
        if reading.starts {
            // The reading itself fixes the position, so the response of the prediction is zero here.
            (p, v) = ([0.0; N], [0.0; N]);
            p = advance(reading, &mut p, &mut v).map(|g| -g);
            v = [0.0; N];
        } else {
            let g = advance(reading, &mut p, &mut v);
            for j in 0..N {
                p[j] -= reading.gain_p * g[j];
                v[j] -= reading.gain_v * g[j];
                sum[j] += reading.weight * g[j];
            }
        }
        if reading.counts {
            held += 1;
            if held == span.group && row < groups {
                for (filled, whole) in sums.iter_mut().zip(sum) {
                    filled[row] = whole * mean;
                }
                (sum, held, row) = ([0.0; N], 0, row + 1);
            }
        }
    }
    *response = Response { p, v };
    Ok(())
}

/// Grid rows that are interleaved at a time.
const PACKED: usize = 256;

/// A window of the columns, row by row.
struct Packed<'a, const N: usize> {
    columns: [&'a [f64]; N],
    factor: f64,
    low: usize,
    high: usize,
    rows: [[f64; N]; PACKED],
}

impl<const N: usize> Packed<'_, N> {
    /// The four rows from `row` on; `row` never falls from call to call.
    #[inline(always)]
    fn at(&mut self, row: usize) -> &[[f64; N]; NODES] {
        if row + NODES > self.high {
            self.fill(row);
        }
        let from = row - self.low;
        // The window holds the rows from `low` to `high`, so the slice has this length.
        self.rows[from..from + NODES].first_chunk().unwrap_or(&[[0.0; N]; NODES])
    }

    #[inline(never)]
    fn fill(&mut self, row: usize) {
        self.low = row;
        self.high = row + PACKED;
        for (j, column) in self.columns.iter().enumerate() {
            for (packed, value) in self.rows.iter_mut().zip(&column[row..]) {
                packed[j] = value * self.factor;
            }
        }
    }
}
