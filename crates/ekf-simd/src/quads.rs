//! The parameters of one run in vector registers: four per register.

use std::ops::{Add, Mul, Sub};

use ekf_core::row::Row;
use pulp::{Simd, bytemuck, f64x4, x86::V3};

use crate::fused::Fused;

/// A row of `4 Q` parameters of one run; places beyond the parameters hold zeros.
#[derive(Clone, Copy)]
pub struct Quads<const Q: usize> {
    each: [f64x4; Q],
    simd: V3,
}

impl<const Q: usize> Quads<Q> {
    #[inline(always)]
    fn with(mut self, other: Self, f: impl Fn(f64x4, f64x4) -> f64x4) -> Self {
        for (x, y) in self.each.iter_mut().zip(other.each) {
            *x = f(*x, y);
        }
        self
    }
}

impl<const Q: usize> Add for Quads<Q> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |x, y| self.simd.add_f64x4(x, y))
    }
}

impl<const Q: usize> Sub for Quads<Q> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |x, y| self.simd.sub_f64x4(x, y))
    }
}

impl<const Q: usize> Mul for Quads<Q> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |x, y| self.simd.mul_f64x4(x, y))
    }
}

impl<const Q: usize> Row for Quads<Q> {
    type Number = Fused<V3>;

    const LENGTH: usize = 4 * Q;

    #[inline(always)]
    fn from_fn(kind: Fused<V3>, mut f: impl FnMut(usize) -> Fused<V3>) -> Self {
        let each = std::array::from_fn(|q| f64x4(f(4 * q).x, f(4 * q + 1).x, f(4 * q + 2).x, f(4 * q + 3).x));
        Self { each, simd: kind.simd }
    }

    #[inline(always)]
    fn every(x: Fused<V3>) -> Self {
        Self { each: [x.simd.splat_f64x4(x.x); Q], simd: x.simd }
    }

    #[inline(always)]
    fn at(&self, i: usize) -> Fused<V3> {
        let values: [f64; 4] = bytemuck::cast(self.each[i / 4]);
        Fused { x: values[i % 4], simd: self.simd }
    }

    #[inline(always)]
    fn times_plus(mut self, a: Self, b: Self) -> Self {
        for ((x, a), b) in self.each.iter_mut().zip(a.each).zip(b.each) {
            *x = self.simd.mul_add_f64x4(*x, a, b);
        }
        self
    }

    #[inline(always)]
    fn sum(self) -> Fused<V3> {
        let mut total = self.each[0];
        for x in &self.each[1..] {
            total = self.simd.add_f64x4(total, *x);
        }
        Fused { x: self.simd.reduce_sum_f64s(total), simd: self.simd }
    }
}
