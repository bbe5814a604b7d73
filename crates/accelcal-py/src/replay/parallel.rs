//! Several records behind one filter at a time; `Parts` and `innovations` in Python.

use ekf_core::replay::filter::{Driven, InterleavedReading, interleave};
use ekf_core::replay::{Noise, Readings, ReplayError};
use ekf_simd::replay as wide;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

use crate::replay::track::{Flags, Floats, Record, prior_of, readings_of, refuse};

type Part<'py> = (Record<'py>, Flags<'py>);

/// Columns of a relation between two channels.
const COLUMNS: usize = 5;

/// Parts of equal length, ready for filters of any noise.
#[pyclass(frozen, module = "accelcal._core")]
pub struct Parts {
    eights: Vec<Vec<InterleavedReading<8>>>,
    singles: Vec<Vec<InterleavedReading<1>>>,
}

#[pymethods]
impl Parts {
    /// Of each part its record, and which readings count.
    #[new]
    fn new(parts: Vec<Part<'_>>) -> PyResult<Self> {
        let parts = parts
            .iter()
            .map(|(record, counts)| Ok((readings_of(record)?, counts.as_slice()?)))
            .collect::<PyResult<Vec<_>>>()?;
        let (eights, left) = parts.as_chunks::<8>();
        let (singles, _) = left.as_chunks::<1>();
        Ok(Self {
            eights: eights.iter().map(packed).collect::<PyResult<_>>()?,
            singles: singles.iter().map(packed).collect::<PyResult<_>>()?,
        })
    }

    /// Log-likelihood of the readings that count, all parts together.
    #[pyo3(signature = (*, q, r, prior))]
    fn log_likelihood(&self, py: Python<'_>, q: f64, r: f64, prior: (f64, f64, f64, f64)) -> PyResult<f64> {
        let (noise, prior) = (Noise { q, R: r }, prior_of(prior));
        py.detach(|| {
            let mut sum = 0.0;
            for rows in &self.eights {
                sum += wide::log_likelihood(rows, noise, prior)?;
            }
            for rows in &self.singles {
                sum += wide::log_likelihood(rows, noise, prior)?;
            }
            Ok(sum)
        })
        .map_err(|error: ReplayError| refuse(error))
    }
}

/// Innovations (drives, readings) of drives t, z, first, second, restart, `extra_q`, `extra_r` behind one filter, m.
#[pyfunction]
#[pyo3(signature = (drives, *, q, r, prior))]
pub fn innovations<'py>(
    py: Python<'py>,
    drives: Vec<Record<'_>>,
    q: f64,
    r: f64,
    prior: (f64, f64, f64, f64),
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (noise, prior) = (Noise { q, R: r }, prior_of(prior));
    let drives = drives.iter().map(readings_of).collect::<PyResult<Vec<_>>>()?;
    let n = drives.first().map_or(0, |readings| readings.t.len());
    let mut innovations = vec![0.0; drives.len() * n];
    py.detach(|| {
        let (fours, singles) = drives.as_chunks::<4>();
        let (several, alone) = innovations.split_at_mut(4 * n * fours.len());
        for (drives, rows) in fours.iter().zip(several.chunks_exact_mut((4 * n).max(1))) {
            wide::innovations(*drives, noise, prior, rows)?;
        }
        for (drive, rows) in singles.iter().zip(alone.chunks_exact_mut(n.max(1))) {
            wide::innovations([*drive], noise, prior, rows)?;
        }
        Ok(())
    })
    .map_err(|error: ReplayError| refuse(error))?;
    PyArray1::from_vec(py, innovations).reshape([drives.len(), n])
}

/// Products of the innovations of five drives, and the count of readings, summed over blocks of time, (blocks, 6, 6).
///
/// The drives are given by z, first, second; `shared` is one whose other arrays all of them have. `settled` readings enter,
/// (readings,); `edges` are the times at which the blocks begin, s.
#[pyfunction]
#[pyo3(signature = (shared, drives, settled, edges, *, q, r, prior))]
#[allow(clippy::too_many_arguments)] // keyword arguments on the Python side
pub fn block_products<'py>(
    py: Python<'py>,
    shared: Record<'_>,
    drives: [(Floats<'_>, Floats<'_>, Floats<'_>); COLUMNS],
    settled: Flags<'_>,
    edges: Floats<'_>,
    q: f64,
    r: f64,
    prior: (f64, f64, f64, f64),
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    const WIDTH: usize = COLUMNS + 1;
    let filter = (Noise { q, R: r }, prior_of(prior));
    let shared = readings_of(&shared)?;
    let mut driven = [Driven { z: &[], first: &[], second: &[] }; COLUMNS];
    for (driven, (z, first, second)) in driven.iter_mut().zip(&drives) {
        *driven = Driven { z: z.as_slice()?, first: first.as_slice()?, second: second.as_slice()? };
    }
    let (settled, edges) = (settled.as_slice()?, edges.as_slice()?);
    let mut sums = Vec::with_capacity(edges.len() * WIDTH * WIDTH);
    py.detach(|| {
        wide::block_products(shared, driven, filter, settled, edges, |products, count| {
            for row in products {
                sums.extend_from_slice(row);
                sums.push(0.0);
            }
            sums.extend_from_slice(&[0.0; COLUMNS]);
            sums.push(count as f64);
        })
    })
    .map_err(|error: ReplayError| refuse(error))?;
    PyArray1::from_vec(py, sums).reshape([edges.len(), WIDTH, WIDTH])
}

fn packed<const N: usize>(parts: &[(Readings<'_>, &[bool]); N]) -> PyResult<Vec<InterleavedReading<N>>> {
    let counts = parts.each_ref().map(|part| part.1);
    Ok(interleave(parts.each_ref().map(|part| part.0), Some(counts)).map_err(refuse)?.collect())
}
