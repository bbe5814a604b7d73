//! Python's view of the loops that effects with memory need; no mathematics.

use ekf_core::{hysteresis, lag};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// What a slack lets through of a signal; see `ekf_core::hysteresis::play`.
#[pyfunction(name = "play")]
#[pyo3(signature = (x, width, start))]
pub fn play_operator<'py>(
    py: Python<'py>,
    x: PyReadonlyArray1<'py, f64>,
    width: f64,
    start: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let x = x.as_slice()?;
    let mut y = vec![0.0; x.len()];
    py.detach(|| hysteresis::play(x, width, start, &mut y));
    Ok(PyArray1::from_vec(py, y))
}

/// A low-pass at times of any spacing; see `ekf_core::lag::lagged`.
#[pyfunction(name = "lagged_at")]
#[pyo3(signature = (t, y, tau, start))]
pub fn lagged_at<'py>(
    py: Python<'py>,
    t: PyReadonlyArray1<'py, f64>,
    y: PyReadonlyArray1<'py, f64>,
    tau: f64,
    start: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (t, y) = (t.as_slice()?, y.as_slice()?);
    if t.len() != y.len() {
        return Err(PyValueError::new_err("a time for each sample is needed"));
    }
    let mut x = vec![0.0; t.len()];
    py.detach(|| lag::lagged(t, y, tau, start, &mut x));
    Ok(PyArray1::from_vec(py, x))
}

/// Filters of second order, each with (b, a, state), one behind the other; see `ekf_core::lag::cascade`.
#[pyfunction]
#[pyo3(signature = (sections, x))]
pub fn cascade<'py>(
    py: Python<'py>,
    sections: Vec<([f64; 3], [f64; 2], [f64; 2])>,
    x: PyReadonlyArray1<'py, f64>,
) -> Bound<'py, PyArray1<f64>> {
    let mut sections: Vec<_> = sections.into_iter().map(|(b, a, state)| lag::Section { b, a, state }).collect();
    let mut y: Vec<f64> = x.as_array().iter().copied().collect();
    py.detach(|| lag::cascade(&mut sections, &mut y));
    PyArray1::from_vec(py, y)
}
