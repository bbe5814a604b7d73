//! The set-up of a filter: names to choices, the number of states to a constant, errors to Python.

use ekf_core::{
    Aci, Belief, Carrier, Consider, Correction, Cwpa, Filter, Form, GaussMarkov, Integrator, Interpolation, LowPass,
    Order, Parameters, RunError, Sensor,
};
use nalgebra::{SMatrix, SVector};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pyo3::create_exception!(
    accelcal,
    FilterError,
    PyValueError,
    "A filter or record is unusable, or a step failed; see `kind`, `event` and `t`."
);

/// The error of Python with `sentence` as its text.
pub(crate) fn raise(py: Python<'_>, error: RunError, sentence: String) -> PyErr {
    let raised = FilterError::new_err(sentence);
    let (event, t) = match error {
        RunError::Step { event, t, .. } => (Some(event), Some(t)),
        _ => (None, None),
    };
    let value = raised.value(py);
    let set = value
        .setattr("kind", error.name())
        .and_then(|()| value.setattr("event", event))
        .and_then(|()| value.setattr("t", t));
    set.err().unwrap_or(raised)
}

#[derive(Clone, Copy)]
pub(crate) enum AnySystem {
    Aci(Aci),
    Cwpa(Cwpa),
}

/// A filter before its number of states is known.
#[pyclass(frozen, module = "accelcal._core")]
pub struct FilterSetup {
    pub(crate) system: AnySystem,
    pub(crate) choices: Filter<()>,
    pub(crate) structured: bool,
    pub(crate) correction: Correction,
}

fn chosen<T: Copy>(what: &str, name: &str, choices: &[(&str, T)]) -> PyResult<T> {
    choices.iter().find(|(words, _)| *words == name).map(|(_, choice)| *choice).ok_or_else(|| {
        let words: Vec<&str> = choices.iter().map(|(words, _)| *words).collect();
        PyValueError::new_err(format!("{what} = {name:?}: choose one of {words:?}"))
    })
}

fn form_named(name: &str) -> PyResult<Form> {
    chosen("form", name, &[("inverse", Form::Inverse), ("forward", Form::Forward)])
}

#[pymethods]
impl FilterSetup {
    /// `gauss_markov` holds `(rate, q)` of k, K0, K2, K3; `tau = 0` means no low-pass, `gate = inf` no gate;
    /// `consider` holds indices of states.
    #[new]
    #[pyo3(signature = (*, system, form, interpolation, integrator, order, carrier, consider, q, q_output, tau, gauss_markov, r_position, r_output, gate, kernel, correction))]
    #[allow(clippy::too_many_arguments)] // keyword-only, called from one place
    fn new(
        system: &str,
        form: &str,
        interpolation: &str,
        integrator: &str,
        order: &str,
        carrier: &str,
        consider: Vec<usize>,
        q: f64,
        q_output: f64,
        tau: f64,
        gauss_markov: [(f64, f64); 4],
        r_position: f64,
        r_output: f64,
        gate: f64,
        kernel: &str,
        correction: &str,
    ) -> PyResult<Self> {
        let sensor =
            Sensor { form: form_named(form)?, gauss_markov: gauss_markov.map(|(rate, q)| GaussMarkov { rate, q }) };
        let low_pass = (tau != 0.0).then_some(LowPass { tau, q: q_output });
        let aci = AnySystem::Aci(Aci { sensor, q, tau });
        let cwpa = AnySystem::Cwpa(Cwpa { sensor, q, low_pass });
        let choices = Filter {
            system: (),
            interpolation: chosen(
                "interpolation",
                interpolation,
                &[("hold", Interpolation::Hold), ("linear", Interpolation::Linear), ("cubic", Interpolation::Cubic)],
            )?,
            integrator: chosen(
                "integrator",
                integrator,
                &[("rk2", Integrator::Rk2), ("rk4", Integrator::Rk4), ("exact", Integrator::Exact)],
            )?,
            order: chosen("order", order, &[("1", Order::First), ("2", Order::Second)])?,
            carrier: chosen("carrier", carrier, &[("dense", Carrier::Dense), ("factored", Carrier::Factored)])?,
            consider: Consider::states(&consider).map_err(|error| PyValueError::new_err(error.to_string()))?,
            R_position: r_position,
            R_output: r_output,
            gate,
        };
        let structured = chosen("kernel", kernel, &[("structured", true), ("dense", false)])?;
        let correction = chosen(
            "correction",
            correction,
            &[
                ("none", Correction::None),
                ("estimate", Correction::Estimate),
                ("scores", Correction::EstimateAndScores),
            ],
        )?;
        Ok(Self { system: chosen("system", system, &[("aci", aci), ("cwpa", cwpa)])?, choices, structured, correction })
    }
}

/// The one place where the run-time number of states becomes a constant.
macro_rules! sized {
    ($setup:expr, $states:expr, |$filter:ident, $N:ident| $body:expr) => {
        sized!(@ $setup, $states, $filter, $N, $body, (Aci, 4), (Aci, 6), (Cwpa, 5), (Cwpa, 6), (Cwpa, 7), (Cwpa, 8))
    };
    (@ $setup:expr, $states:expr, $filter:ident, $N:ident, $body:expr, $(($system:ident, $size:literal)),*) => {
        match (&$setup.system, $states) {
            $(($crate::setup::AnySystem::$system(system), $size) => {
                const $N: usize = $size;
                let $filter = $setup.choices.with_system(*system);
                $body
            })*
            (_, given) => Err(ekf_core::RunError::Setup(ekf_core::SetupError::Size { given })),
        }
    };
}

/// As `sized`, for filters in blocks; `None` without a structured kernel, or if the dense one is chosen.
macro_rules! blocks {
    ($setup:expr, $states:expr, |$filter:ident, $N:ident| $body:expr) => {
        blocks!(@ $setup, $states, $filter, $N, $body, (Aci, 4), (Aci, 6), (Cwpa, 5), (Cwpa, 7))
    };
    (@ $setup:expr, $states:expr, $filter:ident, $N:ident, $body:expr, $(($system:ident, $size:literal)),*) => {
        match (&$setup.system, $states) {
            ($crate::setup::AnySystem::Aci(system), 4) if $setup.correction != ekf_core::Correction::None => {
                const $N: usize = 4;
                let $filter = ekf_core::Corrected::new($setup.choices.with_system(*system), $setup.correction);
                Some($body)
            }
            ($crate::setup::AnySystem::Aci(system), 6) if $setup.correction != ekf_core::Correction::None => {
                const $N: usize = 6;
                let $filter = ekf_core::Corrected::new($setup.choices.with_system(*system), $setup.correction);
                Some($body)
            }
            $(($crate::setup::AnySystem::$system(system), $size) if $setup.structured => {
                const $N: usize = $size;
                let filter = $setup.choices.with_system(*system);
                ekf_core::Structured::<$size>::has_kernel(&filter).then(|| {
                    let $filter = ekf_core::InBlocks(filter);
                    $body
                })
            })*
            _ => None,
        }
    };
}

pub(crate) use {blocks, sized};

/// A prior of `N` states, from slices of that size.
pub(crate) fn belief<const N: usize>(x: &[f64], P: &[f64]) -> Belief<N> {
    Belief { x: SVector::from_column_slice(x), P: SMatrix::from_row_slice(P) }
}

/// Contiguous views of a prior, and the number of states it has.
pub(crate) fn prior<'a>(
    x0: &'a PyReadonlyArray1<'_, f64>,
    P0: &'a PyReadonlyArray2<'_, f64>,
) -> PyResult<(usize, &'a [f64], &'a [f64])> {
    let states = x0.len();
    if P0.shape() != [states, states] {
        return Err(PyValueError::new_err(format!("P0 has shape {:?}, x0 has {states} states", P0.shape())));
    }
    Ok((states, x0.as_slice()?, P0.as_slice()?))
}

pub(crate) type Matrix = Py<PyArray2<f64>>;

/// A vector of rows as a matrix.
pub(crate) fn matrix(py: Python<'_>, rows: Vec<f64>, width: usize) -> PyResult<Matrix> {
    let height = rows.len() / width;
    Ok(rows.into_pyarray(py).reshape([height, width])?.unbind())
}

/// The parameters `(k, K0, K2, K3)` in the other form, and the Jacobian that carries their covariance.
///
/// # Errors
/// `FilterError` if the slope of the sensor at zero is not positive.
#[pyfunction]
pub fn swap_form(form: &str, parameters: [f64; 4]) -> PyResult<([f64; 4], [[f64; 4]; 4])> {
    let [k, K0, K2, K3] = parameters;
    let (other, J) = form_named(form)?
        .swap(&Parameters { k, K0, K2, K3 })
        .map_err(|error| PyValueError::new_err(error.to_string()))?;
    let Parameters { k, K0, K2, K3 } = other;
    Ok(([k, K0, K2, K3], J.transpose().into()))
}
