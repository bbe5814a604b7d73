//! The log-likelihood of a run, with one logarithm per eight readings.

use ekf_core::structured::aci::MaskedInnovation;
use ekf_core::structured::number::Number;
use pulp::Simd;

use crate::arch::lanes::Lanes;

/// Readings between two logarithms.
const EVERY: u32 = 8;

/// `sum of -(e^2 / S + ln 2 pi S) / 2` over the readings so far.
///
/// `S` is gathered as a product of eight, so every `S` must lie between `1e-38` and `1e38`.
#[derive(Debug, Clone, Copy)]
pub struct LogLikelihood<T> {
    counted: bool,
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

impl<S: Simd> Logarithm for Lanes<S> {
    #[inline(always)]
    fn ln(self) -> Self {
        Self::from_fn(self.simd(), |lane| self.lane(lane).ln())
    }
}

impl<T: Logarithm> LogLikelihood<T> {
    /// No reading yet; of `witness` only its type is used.
    #[inline(always)]
    #[must_use]
    pub fn new(witness: T, counted: bool) -> Self {
        let zero = witness.like(0.0);
        Self { counted, nis: zero, product: witness.like(1.0), logarithms: zero, waiting: 0 }
    }

    /// Adds one reading.
    #[inline(always)]
    pub fn add(&mut self, innovation: &MaskedInnovation<T>) {
        if !self.counted {
            return;
        }
        let &MaskedInnovation { e, s, present } = innovation;
        let one = e.like(1.0);
        let scaled = e.like(std::f64::consts::TAU) * s;
        let (nis, s) = match present {
            None => (e * e * (one / s), scaled),
            Some(present) => (e * e * (present / s), present.times_plus(scaled, one - present)),
        };
        self.nis = self.nis + nis;
        self.product = self.product * s;
        self.waiting += 1;
        if self.waiting == EVERY {
            self.logarithms = self.total();
            self.product = one;
            self.waiting = 0;
        }
    }

    /// The log-likelihood of the readings so far; zero where it is not counted.
    #[inline(always)]
    pub fn value(&self) -> T {
        self.nis.like(-0.5) * (self.nis + self.total())
    }

    #[inline(always)]
    fn total(&self) -> T {
        self.logarithms + self.product.ln()
    }
}
