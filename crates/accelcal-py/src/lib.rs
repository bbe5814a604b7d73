//! The only place that knows Python: views in, arrays out, the GIL released.
#![forbid(unsafe_code)]
#![allow(missing_docs)] // pyo3 generates public items of its own
#![allow(clippy::needless_pass_by_value)] // pyo3 hands views over by value
#![allow(non_snake_case)] // x, P, F, H, Q, R, S as in ekf-core

mod abreast;

mod bank;

mod effects;

mod filters;

mod fixed_rate;

mod replay;

/// The compiled core of accelcal.
#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    use super::replay::{ReplayTrack, drive};
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::abreast::{Parts, innovations};

    #[pymodule_export]
    use super::bank::Bank;

    #[pymodule_export]
    use super::effects::play_operator;

    #[pymodule_export]
    use super::filters::{FilterError, FilterRows, FilterSetup, FilterStream, run_filter, run_filter_batch, swap_form};

    #[pymodule_export]
    use super::fixed_rate::{FixedRateFilter, empty_call};

    #[pymodule_init]
    fn init(m: &Bound<'_, PyModule>) -> PyResult<()> {
        m.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
