//! The replay bank of `ekf-core` compiled for the widest registers of this processor.
//!
//! The operations are those of the plain loops, in their order and none of them fused, so the bits are the same.

use ekf_core::replay::ReplayError;
use ekf_core::replay::columns::{self, ReadingSpan, Response};
use pulp::{Arch, NullaryFnOnce};

/// Columns that add to the acceleration: [`columns::carry_inputs`].
///
/// # Errors
/// Those of the plain loop.
pub fn filter_input_columns<const N: usize>(
    span: ReadingSpan<'_>,
    columns: [&[f64]; N],
    factor: f64,
    response: &mut Response<N>,
    sums: [&mut [f64]; N],
) -> Result<(), ReplayError> {
    Arch::new().dispatch(Inputs { span, columns, factor, response, sums })
}

/// Columns that add to the reading: [`columns::carry_readings`].
///
/// # Errors
/// Those of the plain loop.
pub fn filter_reading_columns<const N: usize>(
    span: ReadingSpan<'_>,
    columns: [&[f64]; N],
    response: &mut Response<N>,
    sums: [&mut [f64]; N],
) -> Result<(), ReplayError> {
    Arch::new().dispatch(Readings { span, columns, response, sums })
}

struct Inputs<'a, const N: usize> {
    span: ReadingSpan<'a>,
    columns: [&'a [f64]; N],
    factor: f64,
    response: &'a mut Response<N>,
    sums: [&'a mut [f64]; N],
}

impl<const N: usize> NullaryFnOnce for Inputs<'_, N> {
    type Output = Result<(), ReplayError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        columns::filter_input_columns(self.span, self.columns, self.factor, self.response, self.sums)
    }
}

struct Readings<'a, const N: usize> {
    span: ReadingSpan<'a>,
    columns: [&'a [f64]; N],
    response: &'a mut Response<N>,
    sums: [&'a mut [f64]; N],
}

impl<const N: usize> NullaryFnOnce for Readings<'_, N> {
    type Output = Result<(), ReplayError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        columns::filter_reading_columns(self.span, self.columns, self.response, self.sums)
    }
}
