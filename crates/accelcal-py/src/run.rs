//! A filter run over a record: contiguous views in, one row per event out.

use ekf_core::dense::system::System;
use ekf_core::dense::update::GatedReading;
use ekf_core::{Belief, Channel, Engine, Event, Filter, RunError, Samples, Track, smooth};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::failure::Circumstances;
use crate::setup::{FilterSetup, Matrix, belief, blocks, matrix, prior, sized};

/// One row per event; `e` and `s` are NaN where nothing was read.
#[derive(Default)]
struct Rows {
    states: usize,
    t: Vec<f64>,
    position: Vec<bool>,
    x: Vec<f64>,
    variance: Vec<f64>,
    e: Vec<f64>,
    s: Vec<f64>,
    accepted: Vec<bool>,
    smoothed: Option<(Vec<f64>, Vec<f64>)>,
    P: Vec<f64>,
    log_likelihood: f64,
}

impl Rows {
    fn keep<const N: usize>(&mut self, event: &Event, belief: &Belief<N>, reading: Option<GatedReading>) {
        self.t.push(event.t);
        self.position.push(event.channel == Channel::Position);
        self.x.extend_from_slice(belief.x.as_slice());
        self.variance.extend_from_slice(belief.P.diagonal().as_slice());
        self.e.push(reading.map_or(f64::NAN, |read| read.innovation.e));
        self.s.push(reading.map_or(f64::NAN, |read| read.innovation.s));
        self.accepted.push(reading.is_some_and(|read| read.accepted));
    }

    fn end<E: Engine<N>, const N: usize>(&mut self, engine: &E, track: &Track<E::State>) {
        self.P = engine.belief(&track.state).P.as_slice().to_vec();
        self.log_likelihood = track.log_likelihood;
    }
}

fn run_structured<E: Engine<N>, const N: usize>(
    filter: &E,
    prior: &Belief<N>,
    output: Samples<'_>,
    position: Samples<'_>,
) -> Result<Rows, RunError> {
    let mut rows = Rows { states: N, ..Rows::default() };
    let track = filter.run(prior, output, position, |track, outcome| {
        rows.keep(&E::event(outcome), &filter.belief(&track.state), E::reading(outcome));
    })?;
    rows.end(filter, &track);
    Ok(rows)
}

fn run_dense<S: System<N>, const N: usize>(
    filter: &Filter<S>,
    prior: &Belief<N>,
    output: Samples<'_>,
    position: Samples<'_>,
    smoothing: bool,
) -> Result<Rows, RunError> {
    let mut rows = Rows { states: N, ..Rows::default() };
    let mut outcomes = Vec::new();
    let track = filter.run(prior, output, position, |_, outcome| {
        rows.keep(&outcome.event, &outcome.belief, Filter::<S>::reading(outcome));
        if smoothing {
            outcomes.push(*outcome);
        }
    })?;
    if smoothing {
        smooth(filter, prior, &mut outcomes)?;
        let (mut x, mut variance) = (Vec::new(), Vec::new());
        for outcome in &outcomes {
            x.extend_from_slice(outcome.belief.x.as_slice());
            variance.extend_from_slice(outcome.belief.P.diagonal().as_slice());
        }
        rows.smoothed = Some((x, variance));
    }
    rows.end(filter, &track);
    Ok(rows)
}

/// What a run over a record gave, as arrays.
#[pyclass(frozen, get_all, module = "accelcal._core")]
pub struct FilterRows {
    t: Py<PyArray1<f64>>,
    position: Py<PyArray1<bool>>,
    x: Matrix,
    variance: Matrix,
    e: Py<PyArray1<f64>>,
    s: Py<PyArray1<f64>>,
    accepted: Py<PyArray1<bool>>,
    smoothed: Option<(Matrix, Matrix)>,
    covariance: Matrix,
    log_likelihood: f64,
}

impl FilterRows {
    fn new(py: Python<'_>, rows: Rows) -> PyResult<Self> {
        let N = rows.states;
        let smoothed = match rows.smoothed {
            Some((x, variance)) => Some((matrix(py, x, N)?, matrix(py, variance, N)?)),
            None => None,
        };
        Ok(Self {
            t: rows.t.into_pyarray(py).unbind(),
            position: rows.position.into_pyarray(py).unbind(),
            x: matrix(py, rows.x, N)?,
            variance: matrix(py, rows.variance, N)?,
            e: rows.e.into_pyarray(py).unbind(),
            s: rows.s.into_pyarray(py).unbind(),
            accepted: rows.accepted.into_pyarray(py).unbind(),
            smoothed,
            covariance: matrix(py, rows.P, N)?,
            log_likelihood: rows.log_likelihood,
        })
    }
}

/// Runs a filter over a record; contiguous views in, the GIL released.
///
/// # Errors
/// `FilterError`; `ValueError` for shapes that do not fit.
#[pyfunction]
#[pyo3(signature = (setup, x0, P0, output, position, smoothing))]
#[allow(clippy::needless_pass_by_value)] // views are handed over by PyO3
pub fn run_filter(
    py: Python<'_>,
    setup: &FilterSetup,
    x0: PyReadonlyArray1<'_, f64>,
    P0: PyReadonlyArray2<'_, f64>,
    output: (PyReadonlyArray1<'_, f64>, PyReadonlyArray1<'_, f64>),
    position: (PyReadonlyArray1<'_, f64>, PyReadonlyArray1<'_, f64>),
    smoothing: bool,
) -> PyResult<FilterRows> {
    let (states, x, P) = prior(&x0, &P0)?;
    let output = Samples { t: output.0.as_slice()?, y: output.1.as_slice()? };
    let position = Samples { t: position.0.as_slice()?, y: position.1.as_slice()? };
    let rows = py.detach(|| {
        if !smoothing {
            let rows =
                blocks!(setup, states, |filter, N| run_structured(&filter, &belief::<N>(x, P), output, position));
            if let Some(rows) = rows {
                return rows;
            }
        }
        sized!(setup, states, |filter, N| run_dense(&filter, &belief::<N>(x, P), output, position, smoothing))
    });
    let rate = output.t.first().zip(output.t.last()).map(|(begin, end)| (output.t.len() - 1) as f64 / (end - begin));
    FilterRows::new(py, rows.map_err(|error| Circumstances::new(setup, states, P, rate, false).raise(py, error))?)
}
