//! One filter over many uniform records, in lanes and threads.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::failure::Circumstances;
use crate::setup::{AnySystem, FilterSetup, Matrix, matrix, raise};

/// Final means `(runs, N)`, covariances `(runs, N N)`, log-likelihoods and faults, one per run.
type BatchFinals = (Matrix, Matrix, Py<PyArray1<f64>>, Vec<Option<String>>);

/// Runs one filter over many uniform records, in lanes and threads; rows are runs, one row serves all of them.
///
/// # Errors
/// `FilterError`; `ValueError` for shapes that do not fit.
#[pyfunction]
#[pyo3(signature = (setup, x0, P0, output, position, dt, runs, threads))]
#[allow(clippy::needless_pass_by_value, clippy::too_many_arguments)] // views are handed over by PyO3
pub fn run_filter_batch(
    py: Python<'_>,
    setup: &FilterSetup,
    x0: PyReadonlyArray2<'_, f64>,
    P0: PyReadonlyArray2<'_, f64>,
    output: PyReadonlyArray2<'_, f64>,
    position: PyReadonlyArray2<'_, f64>,
    dt: f64,
    runs: usize,
    threads: usize,
) -> PyResult<BatchFinals> {
    let (states, samples) = (x0.shape()[1], output.shape()[1]);
    let prior = ekf_simd::Prior { states, x: x0.as_slice()?, P: P0.as_slice()? };
    let (output, position) = (output.as_slice()?, position.as_slice()?);
    let batch = ekf_simd::Batch { dt, samples, runs, output, position };
    let path = ekf_simd::InstructionSet::best();
    let finals = py.detach(|| match setup.system {
        AnySystem::Aci(system) => {
            ekf_simd::run_aci(&setup.choices.with_system(system), prior, batch, true, path, threads)
        }
        AnySystem::Cwpa(system) => {
            ekf_simd::run_cwpa(&setup.choices.with_system(system), prior, batch, true, path, threads)
        }
    });
    let finals = finals.map_err(|error| raise(py, error.into(), error.to_string()))?;
    let of_run = |run: usize| {
        let width = states * states;
        let P = if prior.P.len() == width { prior.P } else { &prior.P[run * width..(run + 1) * width] };
        Circumstances::new(setup, states, P, Some(1.0 / dt), false)
    };
    let sentence =
        |(run, ended): (usize, &ekf_simd::Final)| ended.fault.map(|fault| of_run(run).sentence(&fault, &fault));
    let flat = |of: fn(&ekf_simd::Final) -> &[f64]| finals.iter().flat_map(of).copied().collect::<Vec<f64>>();
    let log_likelihoods: Vec<f64> = finals.iter().map(|ended| ended.log_likelihood).collect();
    Ok((
        matrix(py, flat(|ended| &ended.x), states)?,
        matrix(py, flat(|ended| &ended.P), states * states)?,
        log_likelihoods.into_pyarray(py).unbind(),
        finals.iter().enumerate().map(sentence).collect(),
    ))
}
