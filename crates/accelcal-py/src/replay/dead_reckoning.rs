//! Python's view of dead reckoning, several paths at once.

use ekf_core::replay::MotionCovariance;
use ekf_core::replay::dead_reckoning::{Displacement, Slopes, StepNoise, Trial};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Displacement by effects at the nodes of each path, (paths, nodes) each: velocity, m/s, and position, m.
///
/// `last` (paths, 3) is the displacement at the node before: acceleration, velocity, position; `steps` and `added`
/// (paths, nodes) are the time since the node before, s, and the added acceleration, m/s^2.
#[pyfunction]
pub fn displaced<'py>(
    py: Python<'py>,
    last: PyReadonlyArray2<'py, f64>,
    steps: PyReadonlyArray2<'py, f64>,
    added: PyReadonlyArray2<'py, f64>,
) -> PyResult<[Bound<'py, PyArray2<f64>>; 2]> {
    let (n, w) = (steps.shape()[0], steps.shape()[1]);
    if last.shape() != [n, 3] || added.shape() != [n, w] || w == 0 {
        return Err(PyValueError::new_err("the last displacements, steps and accelerations are of different shapes"));
    }
    let (last, steps, added) = (last.as_slice()?, steps.as_slice()?, added.as_slice()?);
    let (mut v, mut p) = (vec![0.0; n * w], vec![0.0; n * w]);
    py.detach(|| {
        for (path, last) in last.chunks_exact(3).enumerate() {
            let mut at = Displacement { a: last[0], v: last[1], p: last[2] };
            for i in path * w..(path + 1) * w {
                at = at.after(steps[i], added[i]);
                (v[i], p[i]) = (at.v, at.p);
            }
        }
    });
    let shaped = |y: Vec<f64>| PyArray1::from_vec(py, y).reshape([n, w]);
    Ok([shaped(v)?, shaped(p)?])
}

/// Accelerations at the nodes of each path by one step of Newton's method, (paths, nodes) m/s^2.
///
/// `last` and `steps` as in `displaced`; `trial` are displacements in velocity and position that some accelerations led
/// to, `found` what the effects give there, `slopes` how it falls with position and velocity, (paths, nodes) each.
#[pyfunction]
pub fn corrected<'py>(
    py: Python<'py>,
    last: PyReadonlyArray2<'py, f64>,
    steps: PyReadonlyArray2<'py, f64>,
    trial: (PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>),
    acceleration: PyReadonlyArray2<'py, f64>,
    slopes: (PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>),
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (n, w) = (steps.shape()[0], steps.shape()[1]);
    let arrays = [&trial.0, &trial.1, &acceleration, &slopes.0, &slopes.1];
    if last.shape() != [n, 3] || w == 0 || arrays.iter().any(|y| y.shape() != [n, w]) {
        return Err(PyValueError::new_err("the last displacements, steps, trial and slopes are of different shapes"));
    }
    let (last, steps, acceleration) = (last.as_slice()?, steps.as_slice()?, acceleration.as_slice()?);
    let (v, p) = (trial.0.as_slice()?, trial.1.as_slice()?);
    let (slope_p, slope_v) = (slopes.0.as_slice()?, slopes.1.as_slice()?);
    let mut a = vec![0.0; n * w];
    py.detach(|| {
        for (path, last) in last.chunks_exact(3).enumerate() {
            let mut at = Displacement { a: last[0], v: last[1], p: last[2] };
            for i in path * w..(path + 1) * w {
                let slopes = Slopes { p: slope_p[i], v: slope_v[i] };
                let here = Displacement { a: 0.0, v: v[i], p: p[i] };
                at = at.corrected(steps[i], Trial { at: here, acceleration: acceleration[i], slopes });
                a[i] = at.a;
            }
        }
    });
    PyArray1::from_vec(py, a).reshape([n, w])
}

/// Variance of the position at the end of each step, (paths, steps) m^2; `covariances` (paths, 3) are carried on in place.
///
/// `steps` and `lost` are (paths, steps): duration, s, and variance of the velocity lost within it; `slopes_p` and
/// `slopes_v` are (paths, steps + 1): -da/dp and -da/dv at the nodes between.
#[pyfunction]
pub fn dead_reckoning_variance<'py>(
    py: Python<'py>,
    mut covariances: PyReadwriteArray2<'py, f64>,
    steps: PyReadonlyArray2<'py, f64>,
    slopes_p: PyReadonlyArray2<'py, f64>,
    slopes_v: PyReadonlyArray2<'py, f64>,
    lost: PyReadonlyArray2<'py, f64>,
    q: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (n, w) = (steps.shape()[0], steps.shape()[1]);
    let nodes = [n, w + 1];
    if covariances.shape() != [n, 3] || slopes_p.shape() != nodes || slopes_v.shape() != nodes || lost.shape() != [n, w]
    {
        return Err(PyValueError::new_err("covariances, steps, slopes and lost variances are of different shapes"));
    }
    let (covariances, steps) = (covariances.as_slice_mut()?, steps.as_slice()?);
    let (slopes_p, slopes_v, lost) = (slopes_p.as_slice()?, slopes_v.as_slice()?, lost.as_slice()?);
    let mut variances = vec![0.0; n * w];
    py.detach(|| {
        for (path, entries) in covariances.chunks_exact_mut(3).enumerate() {
            let mut P = MotionCovariance { pp: entries[0], pv: entries[1], vv: entries[2] };
            let at = |node: usize| Slopes { p: slopes_p[path * (w + 1) + node], v: slopes_v[path * (w + 1) + node] };
            for step in 0..w {
                let i = path * w + step;
                P = P.dead_reckoned(steps[i], at(step), at(step + 1), StepNoise { q, lost: lost[i] });
                variances[i] = P.pp;
            }
            entries.copy_from_slice(&[P.pp, P.pv, P.vv]);
        }
    });
    PyArray1::from_vec(py, variances).reshape([n, w])
}
