//! Python's view of parts of a record side by side; see `ekf_core::abreast`.

use ekf_core::abreast::{self, Abreast};
use ekf_core::replay::{Noise, Prior, Readings, ReplayError};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::replay::{prior_of, refuse};

type Floats<'py> = PyReadonlyArray1<'py, f64>;
type Flags<'py> = PyReadonlyArray1<'py, bool>;
type Part<'py> = (Floats<'py>, Floats<'py>, Floats<'py>, Floats<'py>, Flags<'py>, Flags<'py>);

/// Parts of equal length, ready for filters of any noise.
#[pyclass(frozen, module = "accelcal._core")]
pub struct Parts {
    eights: Vec<Vec<Abreast<8>>>,
    fours: Vec<Vec<Abreast<4>>>,
    singles: Vec<Vec<Abreast<1>>>,
}

#[pymethods]
impl Parts {
    /// Of each part t, z, first, second, restart, and which readings count.
    #[new]
    fn new(parts: Vec<Part<'_>>) -> PyResult<Self> {
        let parts = parts
            .iter()
            .map(|(t, z, first, second, restart, counts)| {
                let readings = Readings {
                    t: t.as_slice()?,
                    z: z.as_slice()?,
                    first: first.as_slice()?,
                    second: second.as_slice()?,
                    restart: restart.as_slice()?,
                };
                Ok((readings, counts.as_slice()?))
            })
            .collect::<PyResult<Vec<_>>>()?;
        let (eights, left) = parts.as_chunks::<8>();
        let (fours, left) = left.as_chunks::<4>();
        let (singles, _) = left.as_chunks::<1>();
        Ok(Self {
            eights: eights.iter().map(side_by_side).collect::<PyResult<_>>()?,
            fours: fours.iter().map(side_by_side).collect::<PyResult<_>>()?,
            singles: singles.iter().map(side_by_side).collect::<PyResult<_>>()?,
        })
    }

    /// Log-likelihood of the readings that count, all parts together.
    #[pyo3(signature = (*, q, r, prior))]
    fn log_likelihood(&self, py: Python<'_>, q: f64, r: f64, prior: (f64, f64, f64, f64)) -> PyResult<f64> {
        let (noise, prior) = (Noise { q, R: r }, prior_of(prior));
        py.detach(|| {
            let mut sum = 0.0;
            for rows in &self.eights {
                sum += abreast::log_likelihood(rows, noise, prior)?;
            }
            for rows in &self.fours {
                sum += abreast::log_likelihood(rows, noise, prior)?;
            }
            for rows in &self.singles {
                sum += abreast::log_likelihood(rows, noise, prior)?;
            }
            Ok(sum)
        })
        .map_err(|error: ReplayError| refuse(error))
    }

    /// Innovations (parts, readings), m.
    #[pyo3(signature = (*, q, r, prior))]
    fn innovations<'py>(
        &self,
        py: Python<'py>,
        q: f64,
        r: f64,
        prior: (f64, f64, f64, f64),
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (noise, prior) = (Noise { q, R: r }, prior_of(prior));
        let found = py
            .detach(|| {
                let mut found = Vec::new();
                for rows in &self.eights {
                    innovations(rows, noise, prior, &mut found)?;
                }
                for rows in &self.fours {
                    innovations(rows, noise, prior, &mut found)?;
                }
                for rows in &self.singles {
                    innovations(rows, noise, prior, &mut found)?;
                }
                Ok(found)
            })
            .map_err(|error: ReplayError| refuse(error))?;
        let parts = 8 * self.eights.len() + 4 * self.fours.len() + self.singles.len();
        let readings = found.len() / parts.max(1);
        PyArray1::from_vec(py, found).reshape([parts, readings])
    }
}

fn side_by_side<const N: usize>(parts: &[(Readings<'_>, &[bool]); N]) -> PyResult<Vec<Abreast<N>>> {
    let mut rows = Vec::with_capacity(parts[0].0.t.len());
    abreast::side_by_side(*parts, |row| rows.push(row)).map_err(refuse)?;
    Ok(rows)
}

/// Appends the innovations of each part.
fn innovations<const N: usize>(
    rows: &[Abreast<N>],
    noise: Noise,
    prior: Prior,
    found: &mut Vec<f64>,
) -> Result<(), ReplayError> {
    let (begin, n) = (found.len(), rows.len());
    found.resize(begin + N * n, 0.0);
    let (found, mut k) = (&mut found[begin..], 0);
    abreast::innovations(rows, noise, prior, |e| {
        for (j, value) in e.into_iter().enumerate() {
            found[j * n + k] = value;
        }
        k += 1;
    })
}
