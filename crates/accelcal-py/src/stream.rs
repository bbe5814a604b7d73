//! A filter fed event by event.

use ekf_core::dense::update::{GatedReading, Innovation};
use ekf_core::structured::whitening::Score;
use ekf_core::{Channel, Engine, Event, Live, RunError, Track};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::failure::Circumstances;
use crate::setup::{FilterSetup, Matrix, belief, blocks, matrix, prior, sized};

/// Numbers of a reading, in the order of [`COLUMNS`].
type Row = [f64; COLUMNS];

/// Stamp, value, `e`, `S`, what whitening leaves of `e`, its variance, the readings' share of that, slopes of the
/// log-likelihood, their variances and covariance.
const COLUMNS: usize = 12;

/// A [`Live`] filter of any size, dense or in blocks.
trait Stream: Send + Sync {
    /// Takes one event in; `keep` receives each reading that it led to.
    fn push(&mut self, event: Event, keep: &mut dyn FnMut(Row)) -> Result<(), RunError>;
    fn finish(&mut self, keep: &mut dyn FnMut(Row)) -> Result<(), RunError>;
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

fn hand_over<E: Engine<N>, const N: usize>(outcome: &E::Outcome, keep: &mut dyn FnMut(Row)) {
    if let Some(GatedReading { innovation: Innovation { e, s }, .. }) = E::reading(outcome) {
        let Event { t, value, .. } = E::event(outcome);
        let score = E::score(outcome).unwrap_or(Score {
            left: e,
            variance: s,
            of_readings: 1.0,
            slopes: [0.0; 2],
            informations: [0.0; 3],
        });
        let ([first, second], [of_first, of_second, of_both]) = (score.slopes, score.informations);
        let white = [score.left, score.variance, score.of_readings];
        keep([t, value, e, s, white[0], white[1], white[2], first, second, of_first, of_second, of_both]);
    }
}

impl<E: Engine<N> + Send + Sync, const N: usize> Stream for Live<E, N>
where
    E::State: Send + Sync,
{
    fn push(&mut self, event: Event, keep: &mut dyn FnMut(Row)) -> Result<(), RunError> {
        Live::push(self, event, |outcome| hand_over::<E, N>(outcome, keep))
    }

    fn finish(&mut self, keep: &mut dyn FnMut(Row)) -> Result<(), RunError> {
        Live::finish(self, |outcome| hand_over::<E, N>(outcome, keep))
    }

    fn state(&self) -> StreamState {
        let &Track { t, rejected, log_likelihood, .. } = self.track();
        let belief = self.belief();
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

    /// Takes one event in; the newest innovation that it led to.
    fn push(&mut self, py: Python<'_>, event: Event) -> PyResult<Option<f64>> {
        let mut newest = None;
        let pushed = self.stream.push(event, &mut |row| newest = Some(row[2]));
        pushed.map_err(|error| self.failed(py, event.t, error))?;
        Ok(newest)
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
        let pushed = self.push(py, Event { t, channel: Channel::Output, value });
        self.first = self.first.or(Some(t));
        self.outputs += 1;
        pushed
    }

    /// One encoder sample; the newest innovation that it led to.
    fn position(&mut self, py: Python<'_>, t: f64, value: f64) -> PyResult<Option<f64>> {
        self.push(py, Event { t, channel: Channel::Position, value })
    }

    /// Takes events in, in their order: stamps, which are outputs, values, (n,) each.
    ///
    /// The readings that they led to, (n, 12); then how many events were refused, and the last sentence.
    fn feed(
        &mut self,
        py: Python<'_>,
        t: PyReadonlyArray1<'_, f64>,
        output: PyReadonlyArray1<'_, bool>,
        value: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(Matrix, usize, String)> {
        let (t, output, value) = (t.as_slice()?, output.as_slice()?, value.as_slice()?);
        if t.len() != output.len() || t.len() != value.len() {
            return Err(PyValueError::new_err("stamps, kinds and values of events differ in number"));
        }
        let mut readings = Vec::new();
        let (mut refused, mut last) = (0, None);
        py.detach(|| {
            for ((&t, &output), &value) in t.iter().zip(output).zip(value) {
                let channel = if output { Channel::Output } else { Channel::Position };
                if let Err(error) = self.stream.push(Event { t, channel, value }, &mut |row| readings.extend(row)) {
                    (refused, last) = (refused + 1, Some((t, error)));
                }
                if output {
                    self.first = self.first.or(Some(t));
                    self.outputs += 1;
                }
            }
        });
        let sentence = last.map_or(String::new(), |(t, error)| self.failed(py, t, error).value(py).to_string());
        Ok((matrix(py, readings, COLUMNS)?, refused, sentence))
    }

    /// Processes what still waits; its readings, (n, 12).
    fn finish(&mut self, py: Python<'_>) -> PyResult<Matrix> {
        let mut readings = Vec::new();
        let finished = self.stream.finish(&mut |row| readings.extend(row));
        finished.map_err(|error| self.failed(py, self.t().unwrap_or(f64::NAN), error))?;
        matrix(py, readings, COLUMNS)
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
