//! One `f64` whose multiply-add is the processor's own instruction.

use std::ops::{Add, Div, Mul, Neg, Sub};

use ekf_core::structured::number::Number;
use pulp::Simd;

use crate::record::likelihood::Logarithm;

/// One number, whatever it is computed with.
pub trait Scalar: Logarithm + Send + Sync {
    /// The number.
    fn value(self) -> f64;
}

impl Scalar for f64 {
    #[inline(always)]
    fn value(self) -> f64 {
        self
    }
}

impl<S: Simd> Scalar for Fused<S> {
    #[inline(always)]
    fn value(self) -> f64 {
        self.x
    }
}

/// An `f64` inside a run that was compiled for `S`; anywhere else its multiply-add is a library call.
#[derive(Debug, Clone, Copy)]
pub struct Fused<S> {
    /// The number.
    pub x: f64,
    /// Token that proves that the processor has the instructions.
    pub simd: S,
}

macro_rules! operator {
    ($trait:ident, $name:ident) => {
        impl<S: Simd> $trait for Fused<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self { x: self.x.$name(other.x), simd: self.simd }
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl<S: Simd> Neg for Fused<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { x: -self.x, simd: self.simd }
    }
}

impl<S: Simd> Number for Fused<S> {
    #[inline(always)]
    fn like(self, x: f64) -> Self {
        Self { x, simd: self.simd }
    }

    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        Self { x: self.x.mul_add(a.x, b.x), simd: self.simd }
    }

    #[inline(always)]
    fn least(self, other: Self) -> Self {
        Self { x: if self.x < other.x { self.x } else { other.x }, simd: self.simd }
    }
}

impl<S: Simd> Logarithm for Fused<S> {
    #[inline(always)]
    fn ln(self) -> Self {
        Self { x: self.x.ln(), simd: self.simd }
    }
}
