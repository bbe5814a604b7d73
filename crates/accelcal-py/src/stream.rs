//! A filter fed event by event.

use ekf_core::{Channel, Engine, Event, Live, RunError, Track};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::failure::Circumstances;
use crate::setup::{FilterSetup, Matrix, belief, blocks, matrix, prior, sized};

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
    circumstances: Circumstances,
    /// Time of the first output, s, and outputs so far.
    first: Option<f64>,
    outputs: usize,
}

impl FilterStream {
    /// The error of Python, with the mean rate of the outputs up to `t`.
    fn failed(&self, py: Python<'_>, t: f64, error: RunError) -> PyErr {
        let rate = self.first.filter(|first| *first < t).map(|first| self.outputs as f64 / (t - first));
        self.circumstances.at(rate).raise(py, error)
    }
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
        let circumstances = Circumstances::new(setup, states, P, None, false);
        match stream {
            Ok(stream) => Ok(Self { stream, circumstances, first: None, outputs: 0 }),
            Err(error) => Err(circumstances.raise(py, error)),
        }
    }

    /// One accelerometer sample; the newest innovation that it led to.
    fn output(&mut self, py: Python<'_>, t: f64, value: f64) -> PyResult<Option<f64>> {
        let channel = Channel::Output;
        let pushed = self.stream.push(Event { t, channel, value }).map_err(|error| self.failed(py, t, error));
        self.first = self.first.or(Some(t));
        self.outputs += 1;
        pushed
    }

    /// One encoder sample; the newest innovation that it led to.
    fn position(&mut self, py: Python<'_>, t: f64, value: f64) -> PyResult<Option<f64>> {
        let channel = Channel::Position;
        let pushed = self.stream.push(Event { t, channel, value });
        pushed.map_err(|error| self.failed(py, t, error))
    }

    /// Processes what still waits.
    fn finish(&mut self, py: Python<'_>) -> PyResult<Option<f64>> {
        let finished = self.stream.finish();
        finished.map_err(|error| self.failed(py, self.t().unwrap_or(f64::NAN), error))
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
