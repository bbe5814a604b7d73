//! One trait for the blocks of ACI and CWPA.

use ekf_core::structured::aci::AciBlock;
use ekf_core::structured::aci_ud::AciFactored;
use ekf_core::structured::cwpa::CwpaBlock;
use ekf_core::structured::errors_in_variables::AciCorrected;
use ekf_core::structured::number::Number;
use ekf_core::structured::row::{Plain, Row};
use ekf_core::structured::watch::Passage;
use ekf_core::structured::whitening::Score;

/// The motion's states first, then `M` parameters.
pub trait Block<V: Row, const M: usize>: Copy {
    /// States before the parameters.
    const MOTION: usize;

    /// Blocks of a prior: means `x(i)`, covariances `P(i, j)`, `j <= i`.
    #[must_use]
    fn new(x: impl Fn(usize) -> V::Number, P: impl Fn(usize, usize) -> V::Number) -> Self;

    /// State `i`.
    #[must_use]
    fn x(&self, i: usize) -> V::Number;

    /// Covariance of states `i` and `j`.
    #[must_use]
    fn P(&self, i: usize, j: usize) -> V::Number;

    /// The least variance of the motion; and the sum of its variances and means, not finite if one of them is not.
    ///
    /// The mean of a parameter needs no look: what is not finite makes the motion so at the next step.
    #[inline(always)]
    #[must_use]
    fn motion_least_and_sum(&self) -> (V::Number, V::Number) {
        let (mut least, mut sum) = (self.P(0, 0), self.P(0, 0) + self.x(0));
        for i in 1..Self::MOTION {
            least = self.P(i, i).least(least);
            sum = sum + (self.P(i, i) + self.x(i));
        }
        (least, sum)
    }

    /// The least variance of the parameters, and the sum of all of them.
    #[inline(always)]
    #[must_use]
    fn parameters_least_and_sum(&self) -> (V::Number, V::Number) {
        let first = self.P(Self::MOTION, Self::MOTION);
        let (mut least, mut sum) = (first, first);
        for i in Self::MOTION + 1..Self::MOTION + M {
            least = self.P(i, i).least(least);
            sum = sum + self.P(i, i);
        }
        (least, sum)
    }

    /// The newest innovation as its monitors see it; `None` of blocks that have no whitening.
    #[must_use]
    fn score(&self) -> Option<Score<V::Number>> {
        None
    }

    /// What the newest step did to errors of the mean, for a watch; `None` of blocks that cannot have one.
    fn passage(&mut self) -> Option<&mut Option<Passage<V::Number, M>>> {
        None
    }
}

macro_rules! block {
    ($($block:ident, $motion:literal;)*) => {
        $(impl<V: Row, const M: usize> Block<V, M> for $block<V, M> {
            const MOTION: usize = $motion;

            #[inline(always)]
            fn new(x: impl Fn(usize) -> V::Number, P: impl Fn(usize, usize) -> V::Number) -> Self {
                $block::new(x, P)
            }

            #[inline(always)]
            fn x(&self, i: usize) -> V::Number {
                $block::x(self, i)
            }

            #[inline(always)]
            fn P(&self, i: usize, j: usize) -> V::Number {
                $block::P(self, i, j)
            }
        })*
    };
}

block!(
    AciBlock, 2;
    CwpaBlock, 3;
);

impl<const N: usize, const M: usize> Block<Plain<f64, M>, M> for AciCorrected<f64, N, M> {
    const MOTION: usize = 2;

    /// Of a prior that is no covariance only the diagonal; whoever builds a filter refuses it first.
    fn new(x: impl Fn(usize) -> f64, P: impl Fn(usize, usize) -> f64) -> Self {
        let diagonal = |_| AciFactored::new(&x, |_, _| 0.0, |i| P(i, i));
        Self::new(AciFactored::factored(&x, &P).unwrap_or_else(diagonal))
    }

    #[inline(always)]
    fn x(&self, i: usize) -> f64 {
        self.filter.x(i)
    }

    #[inline(always)]
    fn P(&self, i: usize, j: usize) -> f64 {
        self.filter.P(i, j)
    }

    fn score(&self) -> Option<Score<f64>> {
        self.score
    }

    fn passage(&mut self) -> Option<&mut Option<Passage<f64, M>>> {
        Some(&mut self.passage)
    }
}
