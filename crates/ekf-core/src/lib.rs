#![doc = include_str!("../README.md")]
//! The mathematics of accelcal: sensor models, Kalman filters and the replay bank.
//!
//! `no_std`, no allocation, no unsafe code, no panics on data. Callers own every buffer.
//!
//! Five choices make a filter, each with one home: the sensor's [`Form`], the output's [`Interpolation`], the
//! [`Integrator`], the [`Order`] of the expansion and the [`Carrier`] of the covariance.
#![cfg_attr(not(feature = "std"), no_std)]
#![forbid(unsafe_code)]
#![deny(missing_docs)]
#![allow(non_snake_case)] // x, P, F, H, Q, R, S as in Bar-Shalom and the paper
#![allow(clippy::inline_always)] // a kernel must be compiled into whichever run calls it, with that run's instructions
#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(s > 0.0)` refuses NaN too

pub mod dense;
pub mod error;
pub mod hysteresis;
pub mod integration;
pub mod lag;
pub mod replay;
pub mod sensor;
pub mod signal;
pub mod splines;
pub mod stream;
pub mod structured;

pub use nalgebra;

pub use dense::aci::Aci;
pub use dense::belief::{Belief, Carrier};
pub use dense::consider::Consider;
pub use dense::cwpa::{Cwpa, LowPass};
pub use dense::filter::{Filter, Outcome};
pub use dense::smoother::smooth;
pub use dense::system::{GaussMarkov, Order};
pub use error::{DomainError, RunError, SetupError, StepError};
pub use integration::Integrator;
pub use sensor::polynomial::{Form, Parameters};
pub use sensor::states::Sensor;
pub use signal::channel::{Channel, Event};
pub use signal::interpolation::{Interpolation, Segment};
pub use signal::timeline::Samples;
pub use stream::engine::{Engine, Track};
pub use stream::live::Live;
pub use stream::own_sensor::OwnSensor;
pub use structured::errors_in_variables::Correction;
pub use structured::filter::{Corrected, InBlocks, Structured};
