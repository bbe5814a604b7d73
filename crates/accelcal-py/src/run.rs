//! The live filters for Python: a set-up, a run over a record, and a stream.

use ekf_core::dense::update::GatedReading;
use ekf_core::sensor::polynomial::Form;
use ekf_core::{
    Aci, Belief, Carrier, Channel, Cwpa, Engine, Event, Filter, GaussMarkov, InBlocks, Integrator, Interpolation, Live,
    LowPass, Order, Parameters, RunError, Samples, Sensor, SetupError, Structured, Track, dense::system::System,
    smooth,
};
use nalgebra::{SMatrix, SVector};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pyo3::create_exception!(
    accelcal,
    FilterError,
    PyValueError,
    "A filter or record is unusable, or a step failed; see `kind`, `event` and `t`."
);

pub(crate) fn raise(py: Python<'_>, error: RunError) -> PyErr {
    let raised = FilterError::new_err(error.to_string());
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
    structured: bool,
}

fn chosen<T: Copy>(what: &str, name: &str, choices: &[(&str, T)]) -> PyResult<T> {
    choices.iter().find(|(known, _)| *known == name).map(|(_, choice)| *choice).ok_or_else(|| {
        let known: Vec<&str> = choices.iter().map(|(known, _)| *known).collect();
        PyValueError::new_err(format!("{what} = {name:?}: choose one of {known:?}"))
    })
}

fn form_named(name: &str) -> PyResult<Form> {
    chosen("form", name, &[("inverse", Form::Inverse), ("forward", Form::Forward)])
}

#[pymethods]
impl FilterSetup {
    /// `wander` holds `(rate, q)` of k, K0, K2, K3; `tau = 0` means no low-pass, `gate = inf` no gate.
    #[new]
    #[pyo3(signature = (*, system, form, interpolation, integrator, order, carrier, q, q_output, tau, wander, r_position, r_output, gate, kernel))]
    #[allow(clippy::too_many_arguments)] // keyword-only, called from one place
    fn new(
        system: &str,
        form: &str,
        interpolation: &str,
        integrator: &str,
        order: &str,
        carrier: &str,
        q: f64,
        q_output: f64,
        tau: f64,
        wander: [(f64, f64); 4],
        r_position: f64,
        r_output: f64,
        gate: f64,
        kernel: &str,
    ) -> PyResult<Self> {
        let sensor = Sensor { form: form_named(form)?, gauss_markov: wander.map(|(rate, q)| GaussMarkov { rate, q }) };
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
            R_position: r_position,
            R_output: r_output,
            gate,
        };
        let structured = chosen("kernel", kernel, &[("structured", true), ("dense", false)])?;
        Ok(Self { system: chosen("system", system, &[("aci", aci), ("cwpa", cwpa)])?, choices, structured })
    }
}

/// The one place where the run-time number of states becomes a constant.
macro_rules! sized {
    ($setup:expr, $states:expr, |$filter:ident, $N:ident| $body:expr) => {
        sized!(@ $setup, $states, $filter, $N, $body, (Aci, 4), (Aci, 6), (Cwpa, 5), (Cwpa, 6), (Cwpa, 7), (Cwpa, 8))
    };
    (@ $setup:expr, $states:expr, $filter:ident, $N:ident, $body:expr, $(($system:ident, $size:literal)),*) => {
        match (&$setup.system, $states) {
            $((AnySystem::$system(system), $size) => {
                const $N: usize = $size;
                let $filter = $setup.choices.with_system(*system);
                $body
            })*
            (_, given) => Err(RunError::Setup(SetupError::Size { given })),
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
            $((AnySystem::$system(system), $size) if $setup.structured => {
                const $N: usize = $size;
                let filter = $setup.choices.with_system(*system);
                Structured::<$size>::has_kernel(&filter).then(|| {
                    let $filter = InBlocks(filter);
                    $body
                })
            })*
            _ => None,
        }
    };
}

fn belief<const N: usize>(x: &[f64], P: &[f64]) -> Belief<N> {
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

fn run_structured<S: System<N>, const N: usize>(
    filter: &InBlocks<S>,
    prior: &Belief<N>,
    output: Samples<'_>,
    position: Samples<'_>,
) -> Result<Rows, RunError>
where
    Filter<S>: Structured<N>,
{
    let mut rows = Rows { states: N, ..Rows::default() };
    let track = filter.run(prior, output, position, |track, (event, reading)| {
        rows.keep(event, &filter.belief(&track.state), *reading);
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
        smooth(&mut outcomes);
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

pub(crate) type Matrix = Py<PyArray2<f64>>;

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

/// A vector of rows as a matrix.
pub(crate) fn matrix(py: Python<'_>, rows: Vec<f64>, width: usize) -> PyResult<Matrix> {
    let height = rows.len() / width;
    Ok(rows.into_pyarray(py).reshape([height, width])?.unbind())
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
    FilterRows::new(py, rows.map_err(|error| raise(py, error))?)
}

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
    let finals = finals.map_err(|error| raise(py, error.into()))?;
    let flat = |of: fn(&ekf_simd::Final) -> &[f64]| finals.iter().flat_map(of).copied().collect::<Vec<f64>>();
    let log_likelihoods: Vec<f64> = finals.iter().map(|ended| ended.log_likelihood).collect();
    Ok((
        matrix(py, flat(|ended| &ended.x), states)?,
        matrix(py, flat(|ended| &ended.P), states * states)?,
        log_likelihoods.into_pyarray(py).unbind(),
        finals.iter().map(|ended| ended.fault.map(|fault| fault.to_string())).collect(),
    ))
}

/// A [`Live`] filter of any size, dense or in blocks.
trait Stream: Send + Sync {
    fn push(&mut self, event: Event) -> Result<Option<f64>, RunError>;
    fn finish(&mut self) -> Result<Option<f64>, RunError>;
    fn state(&self) -> StreamState;
}

struct StreamState {
    t: Option<f64>,
    x: Vec<f64>,
    P: Vec<f64>,
    log_likelihood: f64,
    rejected: usize,
    waiting: usize,
}

impl<E: Engine<N> + Send + Sync, const N: usize> Stream for Live<E, N>
where
    E::State: Send + Sync,
{
    fn push(&mut self, event: Event) -> Result<Option<f64>, RunError> {
        let mut newest = None;
        Live::push(self, event, |outcome| newest = E::reading(outcome).or(newest))?;
        Ok(newest.map(|reading| reading.innovation.e))
    }

    fn finish(&mut self) -> Result<Option<f64>, RunError> {
        let mut newest = None;
        Live::finish(self, |outcome| newest = E::reading(outcome).or(newest))?;
        Ok(newest.map(|reading| reading.innovation.e))
    }

    fn state(&self) -> StreamState {
        let &Track { state, t, rejected, log_likelihood, .. } = self.track();
        let belief = self.filter().belief(&state);
        let (x, P) = (belief.x.as_slice().to_vec(), belief.P.as_slice().to_vec());
        StreamState { t, x, P, log_likelihood, rejected, waiting: self.waiting() }
    }
}

/// A filter fed event by event.
#[pyclass(module = "accelcal._core")]
pub struct FilterStream {
    stream: Box<dyn Stream>,
}

#[pymethods]
impl FilterStream {
    #[new]
    #[allow(clippy::needless_pass_by_value)] // views are handed over by PyO3
    fn new(
        py: Python<'_>,
        setup: &FilterSetup,
        x0: PyReadonlyArray1<'_, f64>,
        P0: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let (states, x, P) = prior(&x0, &P0)?;
        let blocks = blocks!(setup, states, |filter, N| {
            Live::new(filter, &belief::<N>(x, P)).map(|live| Box::new(live) as Box<dyn Stream>).map_err(RunError::from)
        });
        let stream = match blocks {
            Some(stream) => stream,
            None => sized!(setup, states, |filter, N| {
                Live::new(filter, &belief::<N>(x, P))
                    .map(|live| Box::new(live) as Box<dyn Stream>)
                    .map_err(RunError::from)
            }),
        };
        stream.map(|stream| Self { stream }).map_err(|error| raise(py, error))
    }

    /// One accelerometer sample; the newest innovation that it led to.
    fn output(&mut self, py: Python<'_>, t: f64, value: f64) -> PyResult<Option<f64>> {
        let channel = Channel::Output;
        let pushed = self.stream.push(Event { t, channel, value });
        pushed.map_err(|error| raise(py, error))
    }

    /// One encoder sample; the newest innovation that it led to.
    fn position(&mut self, py: Python<'_>, t: f64, value: f64) -> PyResult<Option<f64>> {
        let channel = Channel::Position;
        let pushed = self.stream.push(Event { t, channel, value });
        pushed.map_err(|error| raise(py, error))
    }

    /// Processes what still waits.
    fn finish(&mut self, py: Python<'_>) -> PyResult<Option<f64>> {
        self.stream.finish().map_err(|error| raise(py, error))
    }

    #[getter]
    fn t(&self) -> Option<f64> {
        self.stream.state().t
    }

    #[getter]
    fn x(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        self.stream.state().x.into_pyarray(py).unbind()
    }

    #[getter]
    fn covariance(&self, py: Python<'_>) -> PyResult<Matrix> {
        let StreamState { x, P, .. } = self.stream.state();
        matrix(py, P, x.len())
    }

    #[getter]
    fn log_likelihood(&self) -> f64 {
        self.stream.state().log_likelihood
    }

    #[getter]
    fn rejected(&self) -> usize {
        self.stream.state().rejected
    }

    #[getter]
    fn waiting(&self) -> usize {
        self.stream.state().waiting
    }
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
