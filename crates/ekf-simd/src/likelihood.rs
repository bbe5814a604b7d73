//! The log-likelihood of a run, with one logarithm per eight readings.

use ekf_core::aci_block::Surprise;
use ekf_core::number::Number;
use pulp::Simd;

use crate::fused::Fused;
use crate::lanes::Lanes;

/// Readings between two logarithms.
const EVERY: u32 = 8;

/// `sum of -(e^2 / S + ln 2 pi S) / 2` on its way.
///
/// `S` is gathered as a product of eight, so every `S` must lie between `1e-38` and `1e38`.
#[derive(Debug, Clone, Copy)]
pub struct Likelihood<T> {
    nis: T,
    product: T,
    logarithms: T,
    waiting: u32,
}

/// A number whose logarithm can be taken, lane by lane.
pub trait Logarithm: Number {
    /// Natural logarithm.
    #[must_use]
    fn ln(self) -> Self;
}

impl Logarithm for f64 {
    #[inline(always)]
    fn ln(self) -> Self {
        f64::ln(self)
    }
}

impl<S: Simd> Logarithm for Fused<S> {
    #[inline(always)]
    fn ln(self) -> Self {
        Self { x: self.x.ln(), simd: self.simd }
    }
}

impl<S: Simd> Logarithm for Lanes<S> {
    #[inline(always)]
    fn ln(self) -> Self {
        Self::from_fn(self.simd(), |lane| self.lane(lane).ln())
    }
}

impl<T: Logarithm> Likelihood<T> {
    /// No reading yet.
    #[inline(always)]
    pub fn new(kind: T) -> Self {
        let zero = kind.like(0.0);
        Self { nis: zero, product: kind.like(1.0), logarithms: zero, waiting: 0 }
    }

    /// One reading in every lane.
    #[inline(always)]
    pub fn add(&mut self, taken: &Surprise<T>) {
        let i = taken.e.like(1.0) / taken.s;
        self.gather(taken.e * taken.e * i, taken.e.like(std::f64::consts::TAU) * taken.s);
    }

    /// One reading where `weight` is one, none where it is zero.
    #[inline(always)]
    pub fn add_some(&mut self, taken: &Surprise<T>, weight: T) {
        let one = weight.like(1.0);
        let s = weight.times_plus(weight.like(std::f64::consts::TAU) * taken.s, one - weight);
        self.gather(weight * taken.e * taken.e / taken.s, s);
    }

    #[inline(always)]
    fn gather(&mut self, nis: T, s: T) {
        self.nis = self.nis + nis;
        self.product = self.product * s;
        self.waiting += 1;
        if self.waiting == EVERY {
            self.logarithms = self.total();
            self.product = s.like(1.0);
            self.waiting = 0;
        }
    }

    #[inline(always)]
    fn total(&self) -> T {
        self.logarithms + self.product.ln()
    }

    /// The log-likelihood of the readings so far.
    #[inline(always)]
    pub fn value(&self) -> T {
        self.nis.like(-0.5) * (self.nis + self.total())
    }
}
