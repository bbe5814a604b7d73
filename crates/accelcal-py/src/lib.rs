//! The only place that knows Python: views in, arrays out, the GIL released.
#![forbid(unsafe_code)]
#![allow(missing_docs)] // pyo3 generates public items of its own
#![allow(clippy::needless_pass_by_value)] // pyo3 hands views over by value
#![allow(non_snake_case)] // x, P, F, H, Q, R, S as in ekf-core

mod batch;
mod failure;
mod fixed_rate;
mod memory;
mod replay;
mod run;
mod setup;
mod splines;
mod stream;

/// The compiled core of accelcal.
#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    use super::replay::track::{ReplayTrack, drive};
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::replay::parallel::{Parts, block_products, innovations};

    #[pymodule_export]
    use super::replay::columns::Bank;

    #[pymodule_export]
    use super::replay::dead_reckoning::{corrected, dead_reckoning_variance, displaced};

    #[pymodule_export]
    use super::memory::{cascade, lagged_at, play_operator};

    #[pymodule_export]
    use super::splines::spline_weights;

    #[pymodule_export]
    use super::setup::{FilterError, FilterSetup, swap_form};

    #[pymodule_export]
    use super::run::{FilterRows, run_filter};

    #[pymodule_export]
    use super::batch::run_filter_batch;

    #[pymodule_export]
    use super::stream::FilterStream;

    #[pymodule_export]
    use super::fixed_rate::{FixedRateFilter, empty_call};

    #[pymodule_init]
    fn init(m: &Bound<'_, PyModule>) -> PyResult<()> {
        m.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
