//! One number of each of several independent runs, as many as the vector unit `S` holds.

use std::ops::{Add, Div, Mul, Neg, Sub};

use ekf_core::structured::number::Number;
use pulp::{Simd, bytemuck};

/// A number per run.
#[derive(Clone, Copy)]
pub struct Lanes<S: Simd> {
    values: S::f64s,
    simd: S,
}

impl<S: Simd> Lanes<S> {
    /// Runs side by side.
    pub const COUNT: usize = S::F64_LANES;

    /// `f(lane)` in each lane.
    #[inline(always)]
    pub fn from_fn(simd: S, mut f: impl FnMut(usize) -> f64) -> Self {
        let mut values = simd.splat_f64s(0.0);
        let lanes: &mut [f64] = bytemuck::cast_slice_mut(std::slice::from_mut(&mut values));
        for (lane, value) in lanes.iter_mut().enumerate() {
            *value = f(lane);
        }
        Self { values, simd }
    }

    /// The token that proves that the processor has the vector unit.
    #[inline(always)]
    pub fn simd(&self) -> S {
        self.simd
    }

    /// As it is where it is a number and zero elsewhere; and one where it is a number, zero elsewhere. `None` if no lane
    /// holds a number.
    #[inline(always)]
    pub fn numbers(self) -> Option<(Self, Self)> {
        let Self { values, simd } = self;
        let is_number = simd.equal_f64s(values, values);
        if simd.first_true_m64s(is_number) == Self::COUNT {
            return None;
        }
        let only = |x| Self { values: simd.select_f64s(is_number, x, simd.splat_f64s(0.0)), simd };
        Some((only(values), only(simd.splat_f64s(1.0))))
    }

    /// What one lane holds.
    #[inline(always)]
    pub fn lane(&self, lane: usize) -> f64 {
        bytemuck::cast_slice::<S::f64s, f64>(std::slice::from_ref(&self.values))[lane]
    }

    /// Puts `x` into one lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, x: f64) {
        bytemuck::cast_slice_mut::<S::f64s, f64>(std::slice::from_mut(&mut self.values))[lane] = x;
    }
}

macro_rules! operator {
    ($trait:ident, $name:ident, $instruction:ident) => {
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self { values: self.simd.$instruction(self.values, other.values), simd: self.simd }
            }
        }
    };
}

operator!(Add, add, add_f64s);
operator!(Sub, sub, sub_f64s);
operator!(Mul, mul, mul_f64s);
operator!(Div, div, div_f64s);

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { values: self.simd.neg_f64s(self.values), simd: self.simd }
    }
}

impl<S: Simd> Number for Lanes<S> {
    #[inline(always)]
    fn like(self, x: f64) -> Self {
        Self { values: self.simd.splat_f64s(x), simd: self.simd }
    }

    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        Self { values: self.simd.mul_add_f64s(self.values, a.values, b.values), simd: self.simd }
    }

    #[inline(always)]
    fn least(self, other: Self) -> Self {
        Self { values: self.simd.min_f64s(self.values, other.values), simd: self.simd }
    }
}
