//! The curve of the output between its samples, as what each of them adds to position and velocity.

use crate::integration::nodes as quadrature;
use crate::signal::interpolation::Interpolation;
use crate::structured::number::Number;

/// Samples of the output that a curve between two of them depends on, at most.
pub const TAPS: usize = 4;

/// What each sample of the output adds to position and velocity over a step, in the order of their stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Taps {
    /// Per unit of the output and for a segment of one second.
    pub(crate) weights: [[f64; 2]; TAPS],
}

impl Taps {
    /// Over the part `[a, b]` of a segment between samples at `nodes`, all in shares of its length; not a number for a
    /// sample on which the polynomial does not depend.
    #[must_use]
    pub fn over(nodes: [f64; TAPS], (a, b): (f64, f64)) -> Self {
        let mut weights = [[0.0; 2]; TAPS];
        for (i, (weight, node)) in weights.iter_mut().zip(nodes).enumerate() {
            for (x, share) in quadrature(a, b) {
                // Lagrange's polynomial: one at its sample, zero at the others; not a number without a sample.
                let others = nodes.iter().enumerate().filter(|(k, other)| *k != i && !other.is_nan());
                let value = others.fold(share, |product, (_, other)| product * (x - other) / (node - other));
                if !node.is_nan() {
                    weight[0] += (b - x) * value;
                    weight[1] += value;
                }
            }
        }
        Self { weights }
    }

    /// What the noise of each sample adds to position and velocity over a segment of `length` seconds; `slope` is `da/du`.
    #[inline(always)]
    pub(crate) fn gains<T: Number>(&self, slope: T, length: f64) -> [[T; 2]; TAPS] {
        self.weights.map(|[p, v]| [slope * slope.like(p * length * length), slope * slope.like(v * length)])
    }

    /// Over a whole segment between even stamps; `causal` puts a cubic through the two samples before, otherwise through
    /// one on either side.
    #[must_use]
    pub fn even(how: Interpolation, causal: bool) -> Self {
        Self::over(even(how, causal), (0.0, 1.0))
    }
}

/// Nodes of even stamps, in shares of a segment.
#[must_use]
pub(crate) fn even(how: Interpolation, causal: bool) -> [f64; TAPS] {
    match how {
        Interpolation::Hold => [f64::NAN, 0.0, f64::NAN, f64::NAN],
        Interpolation::Linear => [f64::NAN, 0.0, 1.0, f64::NAN],
        Interpolation::Cubic if causal => [-2.0, -1.0, 0.0, 1.0],
        Interpolation::Cubic => [-1.0, 0.0, 1.0, 2.0],
    }
}
