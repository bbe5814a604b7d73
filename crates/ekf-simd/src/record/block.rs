//! One trait for the blocks of ACI and CWPA.

use ekf_core::structured::aci::AciBlock;
use ekf_core::structured::cwpa::CwpaBlock;
use ekf_core::structured::row::Row;

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
