//! A filter at a fixed rate for Python: a sample per call, or a record per call into the caller's arrays.

use ekf_core::{GaussMarkov, RunError};
use ekf_simd::fixed_rate::filter::{self, FixedRate, Histories};
use ekf_simd::fixed_rate::step::{EffectColumns, SampleInput};
use numpy::{
    Element, IntoPyArray, PyArray, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::failure::Circumstances;
use crate::setup::{AnySystem, FilterSetup, Matrix, matrix, prior};

/// A filter fed sample by sample, `dt` apart.
#[pyclass(module = "accelcal._core")]
pub struct FixedRateFilter {
    filter: Box<dyn FixedRate>,
    dt: f64,
    effects: usize,
    suspects: usize,
    circumstances: Circumstances,
}

impl FixedRateFilter {
    fn failed(&self, py: Python<'_>, event: usize, error: ekf_core::StepError) -> PyErr {
        self.circumstances.raise(py, RunError::Step { event, t: event as f64 * self.dt, error })
    }
}

#[pymethods]
impl FixedRateFilter {
    /// `effects` is the specific force at rest and `(rate, q)` of every parameter where effects follow `k, K0`; `watch` typical
    /// sizes of suspects, SI, and the samples between two starts at least.
    #[new]
    #[pyo3(signature = (setup, x0, P0, dt, effects=None, watch=None))]
    fn new(
        py: Python<'_>,
        setup: &FilterSetup,
        x0: PyReadonlyArray1<'_, f64>,
        P0: PyReadonlyArray2<'_, f64>,
        dt: f64,
        effects: Option<(f64, Vec<(f64, f64)>)>,
        watch: Option<(Vec<f64>, u64)>,
    ) -> PyResult<Self> {
        let (states, x, P) = prior(&x0, &P0)?;
        let prior = ekf_simd::Prior { states, x, P };
        let count = effects.as_ref().map_or(0, |_| states.saturating_sub(4));
        let columns = effects.is_some();
        let filter = match (setup.system, effects) {
            (AnySystem::Aci(system), Some((rest, gauss_markov))) => {
                let gauss_markov: Vec<GaussMarkov> =
                    gauss_markov.into_iter().map(|(rate, q)| GaussMarkov { rate, q }).collect();
                filter::aci_with_effects(
                    &setup.choices.with_system(system),
                    setup.correction,
                    dt,
                    rest,
                    &gauss_markov,
                    prior,
                )
            }
            (AnySystem::Aci(system), None) => {
                filter::aci(&setup.choices.with_system(system), setup.correction, dt, prior)
            }
            (AnySystem::Cwpa(system), _) => filter::cwpa(&setup.choices.with_system(system), dt, prior),
        };
        let circumstances = Circumstances::new(setup, states, P, Some(1.0 / dt), columns);
        match filter {
            Ok(mut filter) => {
                let (scales, least) = watch.unwrap_or_default();
                if !scales.is_empty() && !filter.watch(&scales, least) {
                    return Err(PyValueError::new_err(
                        "a watch needs an ACI filter on UD factors that whitens innovations",
                    ));
                }
                Ok(Self { filter, dt, effects: count, suspects: scales.len(), circumstances })
            }
            Err(error) => Err(circumstances.raise(py, error.into())),
        }
    }

    /// Takes in the output `u` (m/s^2) and, where it was read, the position `z` (m) of the next sample.
    ///
    /// Returns the innovation of the newest reading, or None where nothing was read.
    #[pyo3(signature = (u, z=None))]
    fn step(&mut self, py: Python<'_>, u: f64, z: Option<f64>) -> PyResult<Option<f64>> {
        if self.effects > 0 {
            return Err(PyValueError::new_err(format!(
                "this filter tracks {} effects; give their columns with step_with_effects",
                self.effects
            )));
        }
        let sample = SampleInput { u, z: z.unwrap_or(f64::NAN), effects: None, suspects: None };
        match self.filter.step(&sample) {
            Ok(innovation) => Ok(innovation.map(|innovation| innovation.e)),
            Err(error) => Err(self.failed(py, self.filter.samples(), error)),
        }
    }

    /// As `step`, with effects: `columns` (3, m) holds them per unit of their coefficients at the sample before, half-way and
    /// at this one, m/s^2; `position_columns` (m,) what a unit of each adds to the position read, m; `slopes` (m,) what a
    /// unit of the output adds to each.
    #[pyo3(signature = (u, z, columns, position_columns, slopes=None))]
    fn step_with_effects(
        &mut self,
        py: Python<'_>,
        u: f64,
        z: Option<f64>,
        columns: PyReadonlyArray2<'_, f64>,
        position_columns: PyReadonlyArray1<'_, f64>,
        slopes: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Option<f64>> {
        let width = self.effects + self.suspects;
        if columns.shape() != [3, width] || position_columns.len() != width {
            return Err(PyValueError::new_err(format!(
                "this filter tracks {} effects and watches {}; found columns of shape {:?} and {} position columns",
                self.effects,
                self.suspects,
                columns.shape(),
                position_columns.len()
            )));
        }
        let (before, rest) = columns.as_slice()?.split_at(width);
        let (middle, here) = rest.split_at(width);
        let slopes = slopes.as_ref().map_or(Ok(&[][..]), PyReadonlyArray1::as_slice)?;
        let all = [before, middle, here, position_columns.as_slice()?, slopes];
        let parts = all.map(|row| row.split_at(self.effects.min(row.len())));
        let columns = |[before, middle, here, position, slopes]: [_; 5]| EffectColumns {
            over: [before, middle, here],
            position,
            slopes,
        };
        let (effects, suspects) = (columns(parts.map(|part| part.0)), columns(parts.map(|part| part.1)));
        let sample = SampleInput { u, z: z.unwrap_or(f64::NAN), effects: Some(&effects), suspects: Some(&suspects) };
        match self.filter.step(&sample) {
            Ok(innovation) => Ok(innovation.map(|innovation| innovation.e)),
            Err(error) => Err(self.failed(py, self.filter.samples(), error)),
        }
    }

    /// Begins anew with another prior; suspects keep what they have gathered.
    fn begin(&mut self, py: Python<'_>, x0: PyReadonlyArray1<'_, f64>, P0: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let (states, x, P) = prior(&x0, &P0)?;
        let begun = self.filter.begin(ekf_simd::Prior { states, x, P });
        begun.map_err(|error| self.circumstances.raise(py, error.into()))
    }

    /// Of each suspect, (J, 6): logarithm of its e-value, size, standard deviation, s since when, score and information.
    #[getter]
    fn evidence(&self, py: Python<'_>) -> PyResult<Matrix> {
        let suspects = (0..self.suspects).filter_map(|j| {
            let (evidence, [b, G], steps) = self.filter.evidence(j)?;
            let since = steps.saturating_sub(evidence.since) as f64 * self.dt;
            Some([evidence.log_e, evidence.size, evidence.std, since, b, G])
        });
        matrix(py, suspects.flatten().collect(), 6)
    }

    /// Takes in a record, `u` and `z` (n,), NaN where not read; histories go into arrays of the caller's.
    #[pyo3(signature = (u, z, *, states=None, variances=None, innovations=None, innovation_variances=None))]
    #[allow(clippy::too_many_arguments)] // keyword arguments on the Python side
    fn run(
        &mut self,
        py: Python<'_>,
        u: PyReadonlyArray1<'_, f64>,
        z: PyReadonlyArray1<'_, f64>,
        states: Option<Bound<'_, PyAny>>,
        variances: Option<Bound<'_, PyAny>>,
        innovations: Option<Bound<'_, PyAny>>,
        innovation_variances: Option<Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        if self.effects > 0 {
            return Err(PyValueError::new_err("effects follow from the state at every step; use step_with_effects"));
        }
        let (u, z) = (u.as_slice()?, z.as_slice()?);
        if u.len() != z.len() {
            let text = format!("u has {} samples, z {}; give NaN where position was not read", u.len(), z.len());
            return Err(PyValueError::new_err(text));
        }
        let (n, N) = (u.len(), self.filter.states());
        let mut states = given(states.as_ref(), "states", [n, N])?;
        let mut variances = given(variances.as_ref(), "variances", [n, N])?;
        let mut innovations = given(innovations.as_ref(), "innovations", [n])?;
        let mut innovation_variances = given(innovation_variances.as_ref(), "innovation_variances", [n])?;
        let mut histories = Histories {
            states: slice(&mut states)?,
            variances: slice(&mut variances)?,
            innovations: slice(&mut innovations)?,
            innovation_variances: slice(&mut innovation_variances)?,
        };
        let before = self.filter.samples();
        let filter = &mut self.filter;
        let ran = py.detach(|| filter.over(u, z, &mut histories));
        ran.map_err(|(index, error)| self.failed(py, before + index, error))
    }

    /// States (N,), a copy.
    #[getter]
    fn x(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        let x: Vec<f64> = (0..self.filter.states()).map(|i| self.filter.x(i)).collect();
        x.into_pyarray(py).unbind()
    }

    /// Covariance (N, N), a copy.
    #[getter]
    fn covariance(&self, py: Python<'_>) -> PyResult<Matrix> {
        let N = self.filter.states();
        matrix(py, (0..N * N).map(|at| self.filter.P(at / N, at % N)).collect(), N)
    }

    /// Writes the states into `into` (N,) and their variances into `variances` (N,).
    #[pyo3(signature = (into, variances))]
    fn read(&self, into: Bound<'_, PyAny>, variances: Option<Bound<'_, PyAny>>) -> PyResult<()> {
        let N = self.filter.states();
        let mut into = given(Some(&into), "into", [N])?;
        for (i, x) in slice(&mut into)?.unwrap_or_default().iter_mut().enumerate() {
            *x = self.filter.x(i);
        }
        let mut variances = given(variances.as_ref(), "variances", [N])?;
        for (i, P) in slice(&mut variances)?.unwrap_or_default().iter_mut().enumerate() {
            *P = self.filter.P(i, i);
        }
        Ok(())
    }

    /// Innovation of the newest reading, in its unit.
    #[getter]
    fn innovation(&self) -> Option<f64> {
        self.filter.innovation().map(|innovation| innovation.e)
    }

    /// Its variance `S`.
    #[getter]
    fn innovation_variance(&self) -> Option<f64> {
        self.filter.innovation().map(|innovation| innovation.s)
    }

    /// Its normalised square `e^2 / S`.
    #[getter]
    fn nis(&self) -> Option<f64> {
        self.filter.innovation().map(|innovation| innovation.nis())
    }

    /// What whitening leaves of the innovation, its variance, the reading's share of that; slopes of the log-likelihood by
    /// k, K0, their variances and covariance.
    #[getter]
    fn score(&self) -> Option<[f64; 8]> {
        self.filter.score().map(|score| {
            let ([first, second], [of_first, of_second, of_both]) = (score.slopes, score.informations);
            [score.left, score.variance, score.of_readings, first, second, of_first, of_second, of_both]
        })
    }

    /// Samples processed.
    #[getter]
    fn samples(&self) -> usize {
        self.filter.samples()
    }

    /// Readings that the gate rejected.
    #[getter]
    fn rejected(&self) -> usize {
        self.filter.rejected()
    }

    /// Log-likelihood of the accepted readings; a `ValueError` where it is not finite.
    #[getter]
    fn log_likelihood(&self) -> PyResult<f64> {
        let value = self.filter.log_likelihood();
        let refused = || {
            PyValueError::new_err(format!(
                "the log-likelihood is {value}: the variance of an innovation is \
             outside 1e-38 to 1e38 m²; check the units of r_position and of the prior"
            ))
        };
        value.is_finite().then_some(value).ok_or_else(refused)
    }
}

/// A call with two floats that does nothing: the least that any call costs.
#[pyfunction]
pub fn empty_call(first: f64, second: f64) {
    let _ = (first, second);
}

/// An array of the caller's that can be written into, of one shape.
fn given<'py, const D: usize>(
    array: Option<&Bound<'py, PyAny>>,
    name: &str,
    shape: [usize; D],
) -> PyResult<Option<PyReadwriteArray<'py, f64, numpy::ndarray::Dim<[usize; D]>>>>
where
    numpy::ndarray::Dim<[usize; D]>: numpy::ndarray::Dimension,
{
    let Some(array) = array else {
        return Ok(None);
    };
    let refused = |actual: String| {
        PyValueError::new_err(format!(
            "{name}: give a writable, C-contiguous float64 array of shape {shape:?}; found {actual}"
        ))
    };
    let untyped = array.cast::<numpy::PyUntypedArray>().map_err(|_| refused(array.get_type().to_string()))?;
    let actual = format!("dtype {}, shape {:?}", untyped.dtype(), untyped.shape());
    if untyped.shape() != shape {
        return Err(refused(actual));
    }
    let typed = array.cast::<PyArray<f64, numpy::ndarray::Dim<[usize; D]>>>().map_err(|_| refused(actual.clone()))?;
    let writable = typed.try_readwrite().map_err(|_| refused(format!("{actual}, read-only or in use")))?;
    if writable.is_c_contiguous() { Ok(Some(writable)) } else { Err(refused(format!("{actual}, not contiguous"))) }
}

fn slice<'a, T: Element, D: numpy::ndarray::Dimension>(
    array: &'a mut Option<PyReadwriteArray<'_, T, D>>,
) -> PyResult<Option<&'a mut [T]>> {
    Ok(match array {
        Some(array) => Some(array.as_slice_mut()?),
        None => None,
    })
}
