//! Uniform records as kernels read them: the rows of one run, or those of several runs transposed to lanes.

use ekf_core::structured::number::Number;
use pulp::Simd;

use crate::arch::lanes::Lanes;
use crate::record::runner::{Record, Sample};

/// Samples transposed at a time: two channels of eight lanes stay in the first cache.
pub const WINDOW: usize = 64;
/// Samples on either side of a window that an interpolation may need.
const HALO: usize = 3;

/// The record of one run.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a, T> {
    /// Output, m/s^2; not a number where missing.
    pub output: &'a [f64],
    /// Position, m; not a number where missing.
    pub position: &'a [f64],
    /// Only its type is used.
    pub witness: T,
}

impl<T: Number> Rows<'_, T> {
    #[inline(always)]
    fn sample(&self, x: f64) -> Sample<T> {
        if x.is_nan() { Sample::None } else { Sample::All(self.witness.like(x)) }
    }
}

impl<T: Number> Record<T> for Rows<'_, T> {
    #[inline(always)]
    fn reaches(&self, j: usize) -> bool {
        j < self.output.len() && j < self.position.len()
    }

    #[inline(always)]
    fn samples(&self) -> usize {
        self.output.len()
    }

    #[inline(always)]
    fn output(&self, j: usize) -> T {
        self.witness.like(self.output[j])
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

/// A window of the records of several runs, transposed to lanes; not a number where missing.
///
/// Its alignment becomes that of the stack frame: spilled vectors then never cross a line of the cache, which would cost
/// eight lanes a third of their speed.
#[repr(C, align(64))]
pub struct LaneWindow<S: Simd> {
    output: [Lanes<S>; WINDOW + 1 + 2 * HALO],
    position: [Lanes<S>; WINDOW + 1 + 2 * HALO],
    first: usize,
    samples: usize,
}

/// Where the runs have a number.
#[inline(always)]
fn sample<S: Simd>(values: Lanes<S>) -> Sample<Lanes<S>> {
    values.numbers().map_or(Sample::None, |(values, present)| Sample::Some(values, present))
}

impl<S: Simd> LaneWindow<S> {
    /// An empty window.
    pub fn new(simd: S) -> Self {
        let zero = Lanes::from_fn(simd, |_| 0.0);
        Self { first: 0, samples: 0, output: [zero; WINDOW + 1 + 2 * HALO], position: [zero; WINDOW + 1 + 2 * HALO] }
    }

    /// Transposes samples `from..=to` and their neighbours; one row per lane and channel.
    ///
    /// A function of its own: with the run's instructions the compiler scatters, which is slower than moving one by one.
    #[inline(never)]
    pub fn transpose(&mut self, output: &[&[f64]], position: &[&[f64]], (from, to): (usize, usize)) {
        self.samples = output[0].len();
        self.first = from.saturating_sub(HALO);
        let last = (to + HALO).min(output[0].len() - 1);
        for (slots, rows) in [(&mut self.output, output), (&mut self.position, position)] {
            for (lane, row) in rows.iter().enumerate() {
                for (slot, x) in slots.iter_mut().zip(&row[self.first..=last]) {
                    slot.set(lane, *x);
                }
            }
        }
    }
}

impl<S: Simd> Record<Lanes<S>> for LaneWindow<S> {
    #[inline(always)]
    fn reaches(&self, j: usize) -> bool {
        self.first <= j && j - self.first < self.output.len()
    }

    #[inline(always)]
    fn samples(&self) -> usize {
        self.samples
    }

    #[inline(always)]
    fn output(&self, j: usize) -> Lanes<S> {
        self.output[j - self.first]
    }

    #[inline(always)]
    fn reading(&self, j: usize) -> Sample<Lanes<S>> {
        sample(self.output[j - self.first])
    }

    #[inline(always)]
    fn position(&self, j: usize) -> Sample<Lanes<S>> {
        sample(self.position[j - self.first])
    }
}
