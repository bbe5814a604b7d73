//! Uniform records as kernels see them: one run's own rows, or rows of several runs turned into lanes.

use ekf_core::number::Number;
use pulp::Simd;

use crate::lanes::Lanes;
use crate::run::{Record, Sample};

/// Samples turned at a time: two channels of eight lanes stay in the first cache.
pub const STRETCH: usize = 64;
/// Samples on either side of a stretch that an interpolation may ask for.
const HALO: usize = 3;

/// The record of one run.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a, T> {
    /// Output, m/s^2; not a number where missing.
    pub output: &'a [f64],
    /// Position, m; not a number where missing.
    pub position: &'a [f64],
    /// Lends its kind.
    pub kind: T,
}

impl<T: Number> Rows<'_, T> {
    #[inline(always)]
    fn sample(&self, x: f64) -> Sample<T> {
        if x.is_nan() { Sample::None } else { Sample::All(self.kind.like(x)) }
    }
}

impl<T: Number> Record<T> for Rows<'_, T> {
    #[inline(always)]
    fn reaches(&self, j: usize) -> bool {
        j < self.output.len() && j < self.position.len()
    }

    #[inline(always)]
    fn output(&self, j: usize) -> T {
        self.kind.like(self.output[j])
    }

    #[inline(always)]
    fn reading(&self, j: usize) -> Sample<T> {
        self.sample(self.output[j])
    }

    #[inline(always)]
    fn position(&self, j: usize) -> Sample<T> {
        self.sample(self.position[j])
    }
}

/// A stretch of the records of several runs.
pub struct Stretch<S: Simd> {
    first: usize,
    output: [Lanes<S>; STRETCH + 1 + 2 * HALO],
    reading: [Sample<Lanes<S>>; STRETCH + 1 + 2 * HALO],
    position: [Sample<Lanes<S>>; STRETCH + 1 + 2 * HALO],
}

/// The samples of one instant in all lanes.
#[inline(always)]
fn across<S: Simd>(simd: S, rows: &[&[f64]], j: usize) -> Sample<Lanes<S>> {
    let there = rows.iter().filter(|row| !row[j].is_nan()).count();
    if there == 0 {
        return Sample::None;
    }
    let value = Lanes::from_fn(simd, |lane| if rows[lane][j].is_nan() { 0.0 } else { rows[lane][j] });
    if there == rows.len() {
        return Sample::All(value);
    }
    Sample::Some(value, Lanes::from_fn(simd, |lane| if rows[lane][j].is_nan() { 0.0 } else { 1.0 }))
}

impl<S: Simd> Stretch<S> {
    /// Room for a stretch.
    pub fn new(simd: S) -> Self {
        let zero = Lanes::from_fn(simd, |_| 0.0);
        Self {
            first: 0,
            output: [zero; STRETCH + 1 + 2 * HALO],
            reading: [Sample::None; STRETCH + 1 + 2 * HALO],
            position: [Sample::None; STRETCH + 1 + 2 * HALO],
        }
    }

    /// Turns samples `from..=to` and their neighbours; one row per lane and channel.
    #[inline(always)]
    pub fn turn(&mut self, simd: S, output: &[&[f64]], position: &[&[f64]], driven: bool, (from, to): (usize, usize)) {
        self.first = from.saturating_sub(HALO);
        let last = (to + HALO).min(output[0].len() - 1);
        for j in self.first..=last {
            let slot = j - self.first;
            if driven {
                self.output[slot] = Lanes::from_fn(simd, |lane| output[lane][j]);
            } else {
                self.reading[slot] = across(simd, output, j);
            }
            if from <= j && j <= to {
                self.position[slot] = across(simd, position, j);
            }
        }
    }
}

impl<S: Simd> Record<Lanes<S>> for Stretch<S> {
    #[inline(always)]
    fn reaches(&self, j: usize) -> bool {
        self.first <= j && j - self.first < self.output.len()
    }

    #[inline(always)]
    fn output(&self, j: usize) -> Lanes<S> {
        self.output[j - self.first]
    }

    #[inline(always)]
    fn reading(&self, j: usize) -> Sample<Lanes<S>> {
        self.reading[j - self.first]
    }

    #[inline(always)]
    fn position(&self, j: usize) -> Sample<Lanes<S>> {
        self.position[j - self.first]
    }
}
