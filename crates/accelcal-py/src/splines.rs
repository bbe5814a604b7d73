//! Python's view of the test functions of the weak form; no mathematics.

use ekf_core::splines::{CELLS, cell, pieces};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Values, columns and beginnings of the rows of a sparse matrix.
type Rows<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i32>>, Bound<'py, PyArray1<i32>>);

/// What samples at times `t` weigh in sums against `count` splines, as a matrix in compressed rows.
///
/// `powers` are the polynomials of the ten cells, (powers, 10), highest power first; `weight` is that of each sample.
#[pyfunction]
#[pyo3(signature = (t, weight, powers, *, start, step, count))]
pub fn spline_weights<'py>(
    py: Python<'py>,
    t: PyReadonlyArray1<'py, f64>,
    weight: PyReadonlyArray1<'py, f64>,
    powers: PyReadonlyArray2<'py, f64>,
    start: f64,
    step: f64,
    count: usize,
) -> PyResult<Rows<'py>> {
    let (t, weight) = (t.as_slice()?, weight.as_slice()?);
    let (powers, rest) = powers.as_slice()?.as_chunks::<CELLS>();
    if !rest.is_empty() || weight.len() != t.len() {
        return Err(PyValueError::new_err("a weight for each sample and ten polynomials are needed"));
    }
    let sparse = py.detach(|| compressed(t, weight, powers, (start, step), count));
    let (values, columns, begins) = sparse.ok_or_else(|| PyValueError::new_err("too many samples for one matrix"))?;
    Ok((PyArray1::from_vec(py, values), PyArray1::from_vec(py, columns), PyArray1::from_vec(py, begins)))
}

/// The matrix; none where its elements are more than 32 bits count.
fn compressed(
    t: &[f64],
    weight: &[f64],
    powers: &[[f64; CELLS]],
    (start, step): (f64, f64),
    count: usize,
) -> Option<(Vec<f64>, Vec<i32>, Vec<i32>)> {
    let rows_of = |t: f64| {
        let (number, within) = cell((t - start) / step)?;
        let number = usize::try_from(number).ok()?; // nothing begins before the first
        let first = number.saturating_sub(CELLS - 1);
        (first < count).then_some((number, within, first..count.min(number + 1)))
    };
    let mut begins = vec![0_usize; count + 1];
    for (_, _, rows) in t.iter().filter_map(|&t| rows_of(t)) {
        for row in rows {
            begins[row + 1] += 1;
        }
    }
    for row in 0..count {
        begins[row + 1] += begins[row];
    }
    let total = begins[count];
    let begins_32 = begins.iter().map(|&begin| i32::try_from(begin).ok()).collect::<Option<Vec<_>>>()?;
    let (mut values, mut columns, mut next) = (vec![0.0; total], vec![0; total], begins);
    for (column, (&t, &weight)) in t.iter().zip(weight).enumerate() {
        let Some((number, within, rows)) = rows_of(t) else {
            continue;
        };
        let column = i32::try_from(column).ok()?;
        let value = pieces(within, powers);
        for row in rows {
            let place = next[row];
            values[place] = value[number - row] * weight;
            columns[place] = column;
            next[row] = place + 1;
        }
    }
    Some((values, columns, begins_32))
}
