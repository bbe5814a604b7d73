//! The parameters of one run in vector registers: four per register.

use std::ops::{Add, Mul, Sub};

use ekf_core::structured::row::Row;
use pulp::x86::V3;
use std::arch::x86_64::__m256d;

use crate::arch::fma::Fused;

/// A row of `4 Q` parameters of one run; places beyond the parameters hold zeros.
#[derive(Clone, Copy)]
pub struct Row4<const Q: usize> {
    quads: [__m256d; Q],
    simd: V3,
}

impl<const Q: usize> Row4<Q> {
    #[inline(always)]
    fn with(mut self, other: Self, f: impl Fn(__m256d, __m256d) -> __m256d) -> Self {
        for (x, y) in self.quads.iter_mut().zip(other.quads) {
            *x = f(*x, y);
        }
        self
    }
}

impl<const Q: usize> Add for Row4<Q> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |x, y| self.simd.avx._mm256_add_pd(x, y))
    }
}

impl<const Q: usize> Sub for Row4<Q> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |x, y| self.simd.avx._mm256_sub_pd(x, y))
    }
}

impl<const Q: usize> Mul for Row4<Q> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |x, y| self.simd.avx._mm256_mul_pd(x, y))
    }
}

impl<const Q: usize> Row for Row4<Q> {
    type Number = Fused<V3>;

    const LENGTH: usize = 4 * Q;
    const APART: bool = false;

    #[inline(always)]
    fn from_fn(witness: Fused<V3>, mut f: impl FnMut(usize) -> Fused<V3>) -> Self {
        let avx = witness.simd.avx;
        let mut quads = [avx._mm256_setzero_pd(); Q];
        for (q, four) in quads.iter_mut().enumerate() {
            *four = avx._mm256_setr_pd(f(4 * q).x, f(4 * q + 1).x, f(4 * q + 2).x, f(4 * q + 3).x);
        }
        Self { quads, simd: witness.simd }
    }

    #[inline(always)]
    fn every(x: Fused<V3>) -> Self {
        Self { quads: [x.simd.avx._mm256_set1_pd(x.x); Q], simd: x.simd }
    }

    #[inline(always)]
    fn at(&self, i: usize) -> Fused<V3> {
        let V3 { avx, sse2, .. } = self.simd;
        let four = self.quads[i / 4];
        let pair = if i % 4 < 2 { avx._mm256_castpd256_pd128(four) } else { avx._mm256_extractf128_pd::<1>(four) };
        let x = sse2._mm_cvtsd_f64(if i.is_multiple_of(2) { pair } else { sse2._mm_unpackhi_pd(pair, pair) });
        Fused { x, simd: self.simd }
    }

    #[inline(always)]
    fn times_plus(mut self, a: Self, b: Self) -> Self {
        for ((x, a), b) in self.quads.iter_mut().zip(a.quads).zip(b.quads) {
            *x = self.simd.fma._mm256_fmadd_pd(*x, a, b);
        }
        self
    }

    #[inline(always)]
    fn sum(self) -> Fused<V3> {
        let V3 { avx, sse2, .. } = self.simd;
        let mut total = self.quads[0];
        for x in &self.quads[1..] {
            total = avx._mm256_add_pd(total, *x);
        }
        let pair = sse2._mm_add_pd(avx._mm256_castpd256_pd128(total), avx._mm256_extractf128_pd::<1>(total));
        Fused { x: sse2._mm_cvtsd_f64(sse2._mm_add_sd(pair, sse2._mm_unpackhi_pd(pair, pair))), simd: self.simd }
    }
}
