//! The two parameters of one run in one vector register.

use std::arch::x86_64::__m128d;
use std::ops::{Add, Mul, Sub};

use ekf_core::structured::row::Row;
use pulp::x86::V3;

use crate::arch::fma::Fused;

/// A row of two parameters of one run.
#[derive(Clone, Copy)]
pub struct Row2 {
    both: __m128d,
    simd: V3,
}

macro_rules! operator {
    ($trait:ident, $name:ident, $instruction:ident) => {
        impl $trait for Row2 {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self { both: self.simd.sse2.$instruction(self.both, other.both), simd: self.simd }
            }
        }
    };
}

operator!(Add, add, _mm_add_pd);
operator!(Sub, sub, _mm_sub_pd);
operator!(Mul, mul, _mm_mul_pd);

impl Row for Row2 {
    type Number = Fused<V3>;

    const LENGTH: usize = 2;
    const APART: bool = false;

    #[inline(always)]
    fn from_fn(witness: Fused<V3>, mut f: impl FnMut(usize) -> Fused<V3>) -> Self {
        Self { both: witness.simd.sse2._mm_setr_pd(f(0).x, f(1).x), simd: witness.simd }
    }

    #[inline(always)]
    fn every(x: Fused<V3>) -> Self {
        Self { both: x.simd.sse2._mm_set1_pd(x.x), simd: x.simd }
    }

    #[inline(always)]
    fn at(&self, i: usize) -> Fused<V3> {
        let sse2 = self.simd.sse2;
        let one = if i == 0 { self.both } else { sse2._mm_unpackhi_pd(self.both, self.both) };
        Fused { x: sse2._mm_cvtsd_f64(one), simd: self.simd }
    }

    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        Self { both: self.simd.fma._mm_fmadd_pd(self.both, a.both, b.both), simd: self.simd }
    }

    #[inline(always)]
    fn sum(self) -> Fused<V3> {
        self.at(0) + self.at(1)
    }
}
