//! Python's view of the replay: whole records in, whole arrays out, no mathematics.

use ekf_core::Samples;
use ekf_core::replay::columns::Gains;
use ekf_core::replay::filter::{Track, TrackView, filter};
use ekf_core::replay::smoother::smooth;
use ekf_core::replay::{MotionCovariance, Noise, Prior, Readings};
use ekf_core::signal::integrals::{self, Conditioning};
use ekf_core::signal::interpolation::Interpolation;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pub(crate) type Floats<'py> = PyReadonlyArray1<'py, f64>;
pub(crate) type Flags<'py> = PyReadonlyArray1<'py, bool>;
/// Of one record t, z, first, second, restart, `extra_q`, `extra_r`.
pub(crate) type Record<'py> =
    (Floats<'py>, Floats<'py>, Floats<'py>, Floats<'py>, Flags<'py>, Floats<'py>, Floats<'py>);
type Out<'py> = Bound<'py, PyArray1<f64>>;

/// Every error of the core reaches Python as a `ValueError` with its sentence.
#[allow(clippy::needless_pass_by_value)] // the shape `map_err` asks for
pub(crate) fn refuse(error: impl core::error::Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}

fn interpolation(name: &str) -> PyResult<Interpolation> {
    match name {
        "hold" => Ok(Interpolation::Hold),
        "linear" => Ok(Interpolation::Linear),
        "cubic" => Ok(Interpolation::Cubic),
        other => Err(PyValueError::new_err(format!("interpolation must be hold, linear or cubic, not {other:?}"))),
    }
}

/// Integrals of a sampled signal between instants; see `ekf_core::signal::integrals::drive`.
#[pyfunction]
#[pyo3(signature = (t, u, at, *, how, tau, delay, hole))]
#[allow(clippy::too_many_arguments, clippy::type_complexity)] // keyword arguments on the Python side
pub fn drive<'py>(
    py: Python<'py>,
    t: Floats<'py>,
    u: Floats<'py>,
    at: Floats<'py>,
    how: &str,
    tau: f64,
    delay: f64,
    hole: f64,
) -> PyResult<(Out<'py>, Out<'py>, Bound<'py, PyArray1<bool>>)> {
    let conditioning = Conditioning { interpolation: interpolation(how)?, tau, delay, hole };
    let (t, u, at) = (t.as_slice()?, u.as_slice()?, at.as_slice()?);
    let n = at.len();
    let (mut first, mut second, mut covered) = (vec![0.0; n], vec![0.0; n], vec![false; n]);
    py.detach(|| integrals::drive(Samples { t, y: u }, conditioning, at, &mut first, &mut second, &mut covered))
        .map_err(refuse)?;
    Ok((PyArray1::from_vec(py, first), PyArray1::from_vec(py, second), PyArray1::from_vec(py, covered)))
}

/// Encoder readings with the integrals between them, as views of arrays.
pub(crate) fn readings_of<'a>(
    (t, z, first, second, restart, extra_q, extra_r): &'a Record<'_>,
) -> PyResult<Readings<'a>> {
    Ok(Readings {
        t: t.as_slice()?,
        z: z.as_slice()?,
        first: first.as_slice()?,
        second: second.as_slice()?,
        restart: restart.as_slice()?,
        extra_q: extra_q.as_slice()?,
        extra_R: extra_r.as_slice()?,
    })
}

pub(crate) fn prior_of((v, pp, pv, vv): (f64, f64, f64, f64)) -> Prior {
    Prior { v, P: MotionCovariance { pp, pv, vv } }
}

/// The record of the two-state filter, kept on the Rust side between filtering, smoothing and reading out.
#[pyclass(frozen, module = "accelcal._core")]
pub struct ReplayTrack {
    noise: Noise,
    /// `SERIES`, one behind the other in one piece of memory: an allocator keeps many smaller ones when they are freed.
    data: Vec<f64>,
}

/// What a track holds of each reading.
const SERIES: [&str; 9] = ["e", "S", "gain_p", "gain_v", "p", "v", "pp", "pv", "vv"];

#[pymethods]
impl ReplayTrack {
    /// Runs the filter; see `ekf_core::replay::filter`.
    #[new]
    #[pyo3(signature = (t, z, first, second, restart, extra_q, extra_r, *, q, r, prior))]
    #[allow(clippy::too_many_arguments)] // keyword arguments on the Python side
    fn new(
        py: Python<'_>,
        t: Floats<'_>,
        z: Floats<'_>,
        first: Floats<'_>,
        second: Floats<'_>,
        restart: Flags<'_>,
        extra_q: Floats<'_>,
        extra_r: Floats<'_>,
        q: f64,
        r: f64,
        prior: (f64, f64, f64, f64),
    ) -> PyResult<Self> {
        let record = (t, z, first, second, restart, extra_q, extra_r);
        let readings = readings_of(&record)?;
        let noise = Noise { q, R: r };
        let mut data = vec![0.0; SERIES.len() * readings.t.len()];
        let mut left = data.as_mut_slice();
        let [e, s, gain_p, gain_v, p, v, pp, pv, vv] = core::array::from_fn(|_| {
            let (series, rest) = core::mem::take(&mut left).split_at_mut(readings.t.len());
            left = rest;
            series
        });
        let mut track = Track { e, S: s, gain_p, gain_v, p, v, pp, pv, vv };
        py.detach(|| filter(readings, noise, prior_of(prior), &mut track)).map_err(refuse)?;
        Ok(Self { noise, data })
    }

    /// Smoothed position, velocity and process noise at the readings; see `ekf_core::replay::smooth`.
    #[pyo3(signature = (t, z, first, second, restart, extra_q, extra_r))]
    #[allow(clippy::too_many_arguments)] // those of the constructor
    fn smooth<'py>(
        &self,
        py: Python<'py>,
        t: Floats<'py>,
        z: Floats<'py>,
        first: Floats<'py>,
        second: Floats<'py>,
        restart: Flags<'py>,
        extra_q: Floats<'py>,
        extra_r: Floats<'py>,
    ) -> PyResult<(Out<'py>, Out<'py>, Out<'py>)> {
        let record = (t, z, first, second, restart, extra_q, extra_r);
        let readings = readings_of(&record)?;
        let n = readings.t.len();
        let mut out: [Vec<f64>; 3] = core::array::from_fn(|_| vec![0.0; n]);
        let [position, velocity, wanted] = &mut out;
        py.detach(|| smooth(readings, self.noise, self.view(), position, velocity, wanted)).map_err(refuse)?;
        let [position, velocity, wanted] = out.map(|values| PyArray1::from_vec(py, values));
        Ok((position, velocity, wanted))
    }

    /// One series of the track by name: e, S, `gain_p`, `gain_v`, p, v, pp, pv or vv.
    fn series<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Out<'py>> {
        let index = SERIES
            .iter()
            .position(|&series| series == name)
            .ok_or_else(|| PyValueError::new_err(format!("no series {name:?}; present are {SERIES:?}")))?;
        Ok(PyArray1::from_slice(py, self.all()[index]))
    }
}

impl ReplayTrack {
    /// Every series.
    fn all(&self) -> [&[f64]; SERIES.len()] {
        let n = self.data.len() / SERIES.len();
        core::array::from_fn(|k| &self.data[k * n..(k + 1) * n])
    }

    /// Gains of readings `from..to`.
    pub(crate) fn gains<'a>(
        &'a self,
        t: &'a [f64],
        restart: &'a [bool],
        from: usize,
        to: usize,
    ) -> PyResult<Gains<'a>> {
        let [_, s, gain_p, gain_v, ..] = self.all();
        let n = s.len();
        if t.len() != n || restart.len() != n || from > to || to > n {
            return Err(PyValueError::new_err(format!("readings {from}..{to} of {}, track of {n}", t.len())));
        }
        Ok(Gains {
            t: &t[from..to],
            restart: &restart[from..to],
            gain_p: &gain_p[from..to],
            gain_v: &gain_v[from..to],
            S: &s[from..to],
        })
    }

    fn view(&self) -> TrackView<'_> {
        let [e, s, gain_p, gain_v, p, v, pp, pv, vv] = self.all();
        TrackView { e, S: s, gain_p, gain_v, p, v, pp, pv, vv }
    }
}
