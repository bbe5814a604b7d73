//! Python's view of the loops that effects with memory need; no mathematics.

use ekf_core::hysteresis;
use numpy::{PyArray1, PyReadonlyArray1};
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
