//! The numbers that structured kernels run on: `f64`, with the feature `f32` single precision, or several runs side by side.

use core::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, or one per lane.
///
/// The implementations here round after every operation, so a kernel gives equal bits on every processor that follows
/// IEEE 754. Fused multiply-add belongs to the lane types of `ekf-simd`: without the processor's own instruction it is a
/// library call, twenty times as slow.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self> + 'static
{
    /// `x` in this arithmetic, in every lane; of `self` only the type is used.
    #[must_use]
    fn like(self, x: f64) -> Self;

    /// `self a + b`.
    #[must_use]
    fn times_plus(self, a: Self, b: Self) -> Self;

    /// The smaller of both; `other` where `self` is not a number.
    #[must_use]
    fn least(self, other: Self) -> Self;
}

/// One real number, whose sign can decide a branch.
pub trait Real: Number {
    /// Whether it is above zero; false for not a number.
    fn is_positive(self) -> bool;
}

impl Real for f64 {
    #[inline(always)]
    fn is_positive(self) -> bool {
        self > 0.0
    }
}

#[cfg(feature = "f32")]
impl Real for f32 {
    #[inline(always)]
    fn is_positive(self) -> bool {
        self > 0.0
    }
}

impl Number for f64 {
    #[inline(always)]
    fn like(self, x: f64) -> Self {
        x
    }

    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        self * a + b
    }

    #[inline(always)]
    fn least(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
}

#[cfg(feature = "f32")]
impl Number for f32 {
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation)] // single precision is intended
    fn like(self, x: f64) -> Self {
        x as Self
    }

    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        self * a + b
    }

    #[inline(always)]
    fn least(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
}
