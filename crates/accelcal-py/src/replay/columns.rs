//! Columns of effects filtered with the gains of the replay; `Bank` in Python.

use std::sync::Mutex;

use ekf_core::replay::ReplayError;
use ekf_core::replay::columns::{FilteredReading, ReadingSpan, Response};
use ekf_core::replay::grid::{Cell, Grid};
use ekf_simd::replay::{filter_input_columns, filter_reading_columns, prepare};
use numpy::{PyReadonlyArray1, PyReadwriteArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::replay::track::{ReplayTrack, refuse};

type Column<'py> = PyReadonlyArray1<'py, f64>;

/// Readings prepared for columns; see `ekf_core::replay::columns`.
#[pyclass(frozen, module = "accelcal._core")]
pub struct Bank {
    readings: Vec<FilteredReading>,
    cells: Vec<Cell>,
    group: usize,
    /// Sums that each column gives.
    #[pyo3(get)]
    rows: usize,
}

#[pymethods]
impl Bank {
    /// Prepares readings `from..to`; `grid` is the first time, spacing and number of rows of the input columns.
    #[new]
    #[pyo3(signature = (track, t, restart, counts, *, grid, from_, to, group))]
    #[allow(clippy::too_many_arguments)] // keyword arguments on the Python side
    fn new(
        py: Python<'_>,
        track: &ReplayTrack,
        t: Column<'_>,
        restart: PyReadonlyArray1<'_, bool>,
        counts: PyReadonlyArray1<'_, bool>,
        grid: (f64, f64, usize),
        from_: usize,
        to: usize,
        group: usize,
    ) -> PyResult<Self> {
        let (t, restart, counts) = (t.as_slice()?, restart.as_slice()?, counts.as_slice()?);
        let gains = track.gains(t, restart, from_, to)?;
        if counts.len() != t.len() || group == 0 {
            let text = format!("{} flags for {} readings, groups of {group}", counts.len(), t.len());
            return Err(PyValueError::new_err(text));
        }
        let counts = &counts[from_..to];
        let before = from_.checked_sub(1).map(|k| t[k]);
        let (start, step, rows) = grid;
        let (mut readings, mut cells) = SPARE.lock().ok().and_then(|mut spare| spare.take()).unwrap_or_default();
        py.detach(|| prepare(gains, counts, (Grid { start, step }, rows), before, &mut cells, &mut readings))
            .map_err(refuse)?;
        let rows = counts.iter().filter(|&&counted| counted).count() / group;
        Ok(Self { readings, cells, group, rows })
    }

    /// Columns on the grid, times `factor`; `state` (columns, 2) is handed on, `sums` (columns, rows) is filled.
    fn carry_inputs(
        &self,
        py: Python<'_>,
        columns: Vec<Column<'_>>,
        factor: f64,
        state: PyReadwriteArray2<'_, f64>,
        sums: PyReadwriteArray2<'_, f64>,
    ) -> PyResult<()> {
        self.carry(py, &columns, Port::Input { factor }, state, sums)
    }

    /// Columns at the prepared readings; otherwise like `carry_inputs`.
    fn carry_readings(
        &self,
        py: Python<'_>,
        columns: Vec<Column<'_>>,
        state: PyReadwriteArray2<'_, f64>,
        sums: PyReadwriteArray2<'_, f64>,
    ) -> PyResult<()> {
        self.carry(py, &columns, Port::Reading, state, sums)
    }
}

impl Drop for Bank {
    fn drop(&mut self) {
        let (mut readings, mut cells) = (core::mem::take(&mut self.readings), core::mem::take(&mut self.cells));
        readings.clear();
        cells.clear();
        if let Ok(mut spare) = SPARE.lock() {
            *spare = Some((readings, cells));
        }
    }
}

/// Memory of the bank that was dropped last, for the next one: fresh pages cost as much as what is written to them.
static SPARE: Mutex<Option<(Vec<FilteredReading>, Vec<Cell>)>> = Mutex::new(None);

/// Where columns enter.
#[derive(Clone, Copy)]
enum Port {
    Input { factor: f64 },
    Reading,
}

impl Bank {
    fn carry(
        &self,
        py: Python<'_>,
        columns: &[Column<'_>],
        port: Port,
        mut state: PyReadwriteArray2<'_, f64>,
        mut sums: PyReadwriteArray2<'_, f64>,
    ) -> PyResult<()> {
        let columns: Vec<&[f64]> = columns.iter().map(|column| column.as_slice()).collect::<Result<_, _>>()?;
        let n = columns.len();
        let (held, filled) = (state.as_array().dim(), sums.as_array().dim());
        if held != (n, 2) || filled != (n, self.rows) {
            let text = format!("{n} columns of {} sums, state {held:?}, sums {filled:?}", self.rows);
            return Err(PyValueError::new_err(text));
        }
        let state = state.as_slice_mut()?;
        let sums = sums.as_slice_mut()?;
        py.detach(|| {
            let mut sums = Rows { left: sums, length: self.rows };
            let mut at = 0;
            while at < n {
                let width = match n - at {
                    8.. => 8,
                    4..8 => 4,
                    2..4 => 2,
                    _ => 1,
                };
                let (columns, state) = (&columns[at..at + width], &mut state[2 * at..2 * (at + width)]);
                match width {
                    8 => self.some::<8>(columns, port, state, &mut sums),
                    4 => self.some::<4>(columns, port, state, &mut sums),
                    2 => self.some::<2>(columns, port, state, &mut sums),
                    _ => self.some::<1>(columns, port, state, &mut sums),
                }?;
                at += width;
            }
            Ok(())
        })
        .map_err(|error: ReplayError| refuse(error))
    }

    /// `N` columns side by side.
    fn some<const N: usize>(
        &self,
        columns: &[&[f64]],
        port: Port,
        state: &mut [f64],
        sums: &mut Rows<'_>,
    ) -> Result<(), ReplayError> {
        let span = ReadingSpan { readings: &self.readings, cells: &self.cells, group: self.group };
        let columns: [&[f64]; N] = core::array::from_fn(|j| columns[j]);
        let mut response =
            Response { p: core::array::from_fn(|j| state[2 * j]), v: core::array::from_fn(|j| state[2 * j + 1]) };
        let sums: [&mut [f64]; N] = core::array::from_fn(|_| sums.take());
        match port {
            Port::Input { factor } => filter_input_columns(span, columns, factor, &mut response, sums),
            Port::Reading => filter_reading_columns(span, columns, &mut response, sums),
        }?;
        for (held, (p, v)) in state.chunks_exact_mut(2).zip(response.p.into_iter().zip(response.v)) {
            held.copy_from_slice(&[p, v]);
        }
        Ok(())
    }
}

/// Rows of a matrix, handed out one by one.
struct Rows<'a> {
    left: &'a mut [f64],
    length: usize,
}

impl<'a> Rows<'a> {
    fn take(&mut self) -> &'a mut [f64] {
        let (row, rest) = core::mem::take(&mut self.left).split_at_mut(self.length);
        self.left = rest;
        row
    }
}
