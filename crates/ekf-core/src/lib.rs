//! The mathematics of accelcal: sensor models, Kalman filters and the replay bank.
//!
//! `no_std`, no allocation, no unsafe code, no panics on data. Callers own every buffer.
//!
//! Five choices make a filter, each with one home: the sensor's [`Form`], the output's [`Interpolation`], the
//! [`Integrator`], the [`Order`] of the expansion and the [`Carrier`] of the covariance.
#![cfg_attr(not(feature = "std"), no_std)]
#![forbid(unsafe_code)]
#![allow(non_snake_case)] // x, P, F, H, Q, R, S as in Bar-Shalom and the paper
#![allow(clippy::inline_always)] // a kernel must be compiled into whichever run calls it, with that run's instructions
#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(s > 0.0)` refuses NaN too

pub mod abreast;
pub mod accelerometer;
pub mod aci;
pub mod aci_block;
pub mod aci_factored;
pub mod aci_push;
pub mod aci_staged;
pub mod bank;
pub mod belief;
pub mod condition;
pub mod cwpa;
pub mod cwpa_block;
pub mod effect;
pub mod engine;
pub mod error;
pub mod factored;
pub mod filter;
pub mod integrate;
pub mod interpolate;
pub mod live;
pub mod number;
pub mod output;
pub mod play;
pub mod replay;
pub mod row;
pub mod sensor;
pub mod smooth;
pub mod structured;
pub mod system;
pub mod timeline;
pub mod update;
pub mod wandering;

pub use accelerometer::{Form, Parameters};
pub use aci::Aci;
pub use belief::{Belief, Carrier};
pub use cwpa::{Cwpa, LowPass};
pub use engine::{Engine, InBlocks};
pub use error::{DomainError, RunError, SetupError, StepError};
pub use filter::{Filter, Outcome, Track};
pub use integrate::Integrator;
pub use interpolate::{Interpolation, Segment};
pub use live::Live;
pub use sensor::Sensor;
pub use smooth::smooth;
pub use structured::{Structured, StructuredTrack};
pub use system::{Order, Wander};
pub use timeline::{Channel, Event, Samples};
