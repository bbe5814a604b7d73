//! Number and row types that compile to one instruction set each.

pub mod fma;
pub mod instruction_set;
pub mod lanes;
#[cfg(target_arch = "x86_64")]
pub mod row2;
#[cfg(target_arch = "x86_64")]
pub mod row4;
