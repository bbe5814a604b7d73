//! The accelerometer output between its samples: held, linear or cubic.

/// How the output is continued between two samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// The last sample is held: a delay of half a sample (derivations 3.3).
    Hold,
    /// A straight line: costs a gain of `-(w dt)^2 / 12`.
    Linear,
    /// Four-point Lagrange; near an end or a hole of the record the nearest four, or a line.
    Cubic,
}

/// `u(s) = c0 + c1 s + c2 s^2 + c3 s^3` with `s` the time since the left sample of the segment, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// `c0..c3`, in the unit of the output over powers of seconds.
    pub c: [f64; 4],
}

/// A neighbour farther away than this many segment lengths is not used for the curve inside.
const FAR: f64 = 5.0;
/// A segment this many times as long as the distance of its neighbours is not bridged by them: noise would be magnified.
const LONG: f64 = 4.0;

impl Segment {
    /// The polynomial between samples `i` and `i + 1` of `(t, u)`; a record of one sample is held.
    ///
    /// `t` must rise strictly; `i` beyond the last segment is taken as the last segment.
    #[must_use]
    pub fn between(t: &[f64], u: &[f64], i: usize, how: Interpolation) -> Self {
        let n = t.len().min(u.len());
        if n == 0 {
            return Self { c: [0.0; 4] };
        }
        if n == 1 {
            return Self { c: [u[0], 0.0, 0.0, 0.0] };
        }
        let i = i.min(n - 2);
        match how {
            Interpolation::Hold => Self { c: [u[i], 0.0, 0.0, 0.0] },
            Interpolation::Linear => Self::linear(t, u, i),
            Interpolation::Cubic => Self::cubic(t, u, i, n),
        }
    }

    fn linear(t: &[f64], u: &[f64], i: usize) -> Self {
        Self { c: [u[i], (u[i + 1] - u[i]) / (t[i + 1] - t[i]), 0.0, 0.0] }
    }

    /// The four samples that a cubic goes through: the first of them, and stamps since sample `i`; `None` for a line.
    fn four(t: &[f64], i: usize) -> Option<(usize, [f64; 4])> {
        let first = i.saturating_sub(1).min(t.len().checked_sub(4)?);
        let x: [f64; 4] = core::array::from_fn(|k| t[first + k] - t[i]);
        let length = t[i + 1] - t[i];
        let far = x.iter().any(|distance| distance.abs() > FAR * length);
        let long = x.windows(2).any(|pair| length > LONG * (pair[1] - pair[0]));
        (!far && !long).then_some((first, x))
    }

    /// Of the samples `i - 1` to `i + 2`: stamps since sample `i` where the polynomial depends on one, else not a number;
    /// beside an end of the record as if it went on.
    pub(crate) fn nodes(t: &[f64], i: usize, how: Interpolation) -> [f64; 4] {
        let length = t[i + 1] - t[i];
        match (how, Self::four(t, i)) {
            (Interpolation::Hold, _) => [f64::NAN, 0.0, f64::NAN, f64::NAN],
            (Interpolation::Cubic, Some((first, x))) if first + 1 == i => x,
            (Interpolation::Cubic, Some(_)) => [-length, 0.0, length, 2.0 * length],
            _ => [f64::NAN, 0.0, length, f64::NAN],
        }
    }

    fn cubic(t: &[f64], u: &[f64], i: usize, n: usize) -> Self {
        let Some((first, x)) = Self::four(&t[..n], i) else {
            return Self::linear(t, u, i);
        };
        // Newton's divided differences, then the nested form multiplied out in powers of s.
        let mut d: [f64; 4] = core::array::from_fn(|k| u[first + k]);
        for level in 1..4 {
            for k in (level..4).rev() {
                d[k] = (d[k] - d[k - 1]) / (x[k] - x[k - level]);
            }
        }
        let mut c = [d[3], 0.0, 0.0, 0.0];
        for k in (0..3).rev() {
            c = [d[k] - x[k] * c[0], c[0] - x[k] * c[1], c[1] - x[k] * c[2], c[2] - x[k] * c[3]];
        }
        Self { c }
    }

    /// `u(s)`.
    #[must_use]
    pub fn value(&self, s: f64) -> f64 {
        let [c0, c1, c2, c3] = self.c;
        c0 + s * (c1 + s * (c2 + s * c3))
    }

    /// `int_a^b u ds` and `int_a^b (b - s) u ds`: what `u` adds to velocity and to position over `[a, b]`.
    #[must_use]
    pub fn integrals(&self, a: f64, b: f64) -> (f64, f64) {
        let h = b - a;
        // The same polynomial about `a`, so that nothing cancels when `a` is far from zero.
        let [_, c1, c2, c3] = self.c;
        let e0 = self.value(a);
        let e1 = c1 + a * (2.0 * c2 + a * 3.0 * c3);
        let e2 = c2 + 3.0 * a * c3;
        (
            h * (e0 + h * (e1 / 2.0 + h * (e2 / 3.0 + h * c3 / 4.0))),
            h * h * (e0 / 2.0 + h * (e1 / 6.0 + h * (e2 / 12.0 + h * c3 / 20.0))),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const T: [f64; 6] = [0.0, 0.9, 2.1, 3.0, 3.8, 5.2];

    fn cubic(x: f64) -> f64 {
        1.0 - 2.0 * x + 0.5 * x * x + 0.25 * x * x * x
    }

    #[test]
    fn cubic_interpolation_reproduces_a_cubic_on_an_uneven_clock() {
        let u = T.map(cubic);
        for i in 0..5 {
            let segment = Segment::between(&T, &u, i, Interpolation::Cubic);
            let s = 0.37 * (T[i + 1] - T[i]);
            assert!((segment.value(s) - cubic(T[i] + s)).abs() < 1e-12); // a dozen operations on numbers near 10
        }
    }

    #[test]
    fn integrals_equal_the_antiderivatives() {
        let segment = Segment { c: [1.0, -2.0, 0.5, 0.25] };
        let (first, second) = segment.integrals(0.3, 1.1);
        let once = |x: f64| x - x * x + x.powi(3) / 6.0 + x.powi(4) / 16.0;
        let twice = |x: f64| x * x / 2.0 - x.powi(3) / 3.0 + x.powi(4) / 24.0 + x.powi(5) / 80.0;
        assert!((first - (once(1.1) - once(0.3))).abs() < 1e-14);
        assert!((second - (twice(1.1) - twice(0.3) - 0.8 * once(0.3))).abs() < 1e-14);
    }

    #[test]
    fn a_long_segment_between_close_neighbours_is_a_line() {
        let t = [0.0, 1.0, 9.0, 10.0];
        let u = [0.0, 1.0, 3.0, 9.0];
        let segment = Segment::between(&t, &u, 1, Interpolation::Cubic);
        assert!((segment.value(4.0) - 2.0).abs() < 1e-15);
    }

    #[test]
    fn a_hole_in_the_record_is_bridged_by_a_line() {
        let t = [0.0, 1.0, 2.0, 100.0, 101.0];
        let u = [0.0, 9.0, -5.0, 4.0, 0.0];
        let segment = Segment::between(&t, &u, 1, Interpolation::Cubic);
        assert!((segment.value(0.5) - 2.0).abs() < 1e-15);
    }
}
