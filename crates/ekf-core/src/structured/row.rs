//! One number per parameter: gradients, cross covariances and the rows of the parameters' covariance.

use core::ops::{Add, Mul, Sub};

use crate::structured::number::Number;

/// A row of `LENGTH` numbers with element-wise arithmetic.
pub trait Row: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// What it is a row of.
    type Number: Number;

    /// How many.
    const LENGTH: usize;

    /// Whether elements are separate numbers, so that a known zero saves its operation.
    const APART: bool;

    /// `f(i)` at place `i`; `witness` carries the vector-unit token, its value is ignored.
    #[must_use]
    fn from_fn(witness: Self::Number, f: impl FnMut(usize) -> Self::Number) -> Self;

    /// One number in every place.
    #[must_use]
    fn every(x: Self::Number) -> Self;

    /// The number at place `i`.
    #[must_use]
    fn at(&self, i: usize) -> Self::Number;

    /// `self a + b`, element by element.
    #[must_use]
    fn times_plus(self, a: Self, b: Self) -> Self;

    /// The sum of all elements, in one fixed order.
    #[must_use]
    fn sum(self) -> Self::Number;

    /// `self a`.
    #[inline(always)]
    #[must_use]
    fn scaled(self, a: Self::Number) -> Self {
        self * Self::every(a)
    }

    /// `self + a other`.
    #[inline(always)]
    #[must_use]
    fn plus(self, a: Self::Number, other: Self) -> Self {
        other.times_plus(Self::every(a), self)
    }

    /// The inner product.
    #[inline(always)]
    #[must_use]
    fn dot(self, other: Self) -> Self::Number {
        (self * other).sum()
    }
}

/// A row in memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plain<T, const M: usize>(pub [T; M]);

impl<T: Number, const M: usize> Plain<T, M> {
    #[inline(always)]
    fn with(mut self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        for (x, y) in self.0.iter_mut().zip(other.0) {
            *x = f(*x, y);
        }
        self
    }
}

impl<T: Number, const M: usize> Add for Plain<T, M> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |x, y| x + y)
    }
}

impl<T: Number, const M: usize> Sub for Plain<T, M> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |x, y| x - y)
    }
}

impl<T: Number, const M: usize> Mul for Plain<T, M> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |x, y| x * y)
    }
}

impl<T: Number, const M: usize> Row for Plain<T, M> {
    type Number = T;

    const LENGTH: usize = M;
    const APART: bool = true;

    #[inline(always)]
    fn from_fn(_: T, f: impl FnMut(usize) -> T) -> Self {
        Self(core::array::from_fn(f))
    }

    #[inline(always)]
    fn every(x: T) -> Self {
        Self([x; M])
    }

    #[inline(always)]
    fn at(&self, i: usize) -> T {
        self.0[i]
    }

    #[inline(always)]
    fn times_plus(mut self, a: Self, b: Self) -> Self {
        for ((x, a), b) in self.0.iter_mut().zip(a.0).zip(b.0) {
            *x = x.times_plus(a, b);
        }
        self
    }

    /// One after the other; with a multiple of four, four partial sums as a vector register holds them.
    #[inline(always)]
    fn sum(self) -> T {
        if M.is_multiple_of(4) {
            let mut part = [self.0[0], self.0[1], self.0[2], self.0[3]];
            for (i, x) in self.0.iter().enumerate().skip(4) {
                part[i % 4] = part[i % 4] + *x;
            }
            return (part[0] + part[2]) + (part[1] + part[3]);
        }
        let mut total = self.0[0];
        for x in &self.0[1..] {
            total = total + *x;
        }
        total
    }
}

/// The first elements, and zeros.
#[inline(always)]
pub(crate) fn row<V: Row>(first: [V::Number; 4]) -> V {
    V::from_fn(first[0], |i| if i < 4 { first[i] } else { first[0].like(0.0) })
}

/// `rows a`, for symmetric rows: the combination of the rows with the weights `a`.
#[inline(always)]
#[must_use]
pub fn product<V: Row, const M: usize>(rows: &[V; M], a: &V) -> V {
    let mut total = rows[0].scaled(a.at(0));
    for (i, row) in rows.iter().enumerate().skip(1) {
        total = total.plus(a.at(i), *row);
    }
    total
}

/// Adds `column column' factor` to symmetric rows, which remain symmetric to the last bit.
///
/// The products are there before `factor`, for which a correction waits; numbers apart are computed on one side only.
#[inline(always)]
pub(crate) fn add_outer<V: Row, const M: usize>(rows: &mut [V; M], column: &V, factor: V::Number) {
    for (j, row) in rows.iter_mut().enumerate() {
        *row = row.plus(factor, column.scaled(column.at(j)));
    }
    if V::APART {
        let lower = *rows;
        *rows = core::array::from_fn(|i| V::from_fn(factor, |j| lower[i.max(j)].at(i.min(j))));
    }
}

/// `rows + h rates`.
#[inline(always)]
pub(crate) fn moved_rows<V: Row, const M: usize>(rows: &[V; M], h: V::Number, rates: &[V; M]) -> [V; M] {
    let mut moved = *rows;
    for (row, rate) in moved.iter_mut().zip(rates) {
        *row = row.plus(h, *rate);
    }
    moved
}
