//! How long the properties are tried.

/// Cases a property is tried on: 16, or 600 with `ACCELCAL_HYPOTHESIS=long`, as in Python.
pub fn cases() -> u32 {
    if std::env::var("ACCELCAL_HYPOTHESIS").is_ok_and(|value| value == "long") { 600 } else { 16 }
}
