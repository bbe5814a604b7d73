//! Numbers from bytes: mostly ordinary ones, often extreme ones, sometimes none.

use arbitrary::{Result, Unstructured};

/// Numbers at which arithmetic changes its ways.
const SPECIAL: [f64; 16] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN,
    f64::MIN_POSITIVE,
    5e-324,
    -5e-324,
    f64::EPSILON,
    1e154,
    1e-154,
    4_294_967_296.0,
];

/// A number around `scale`, or one of any size, a special one or any bits at all.
///
/// # Errors
/// If no bytes are left.
pub fn any(u: &mut Unstructured<'_>, scale: f64) -> Result<f64> {
    Ok(match u.int_in_range(0..=15)? {
        0 => *u.choose(&SPECIAL)?,
        1 => f64::from_bits(u.arbitrary()?),
        2 | 3 => {
            let magnitude = 10.0_f64.powi(u.int_in_range(-320..=308)?);
            if u.arbitrary()? { magnitude } else { -magnitude }
        }
        _ => scale * ordinary(u)?,
    })
}

/// As `any`, not negative unless it is special.
///
/// # Errors
/// If no bytes are left.
pub fn size(u: &mut Unstructured<'_>, scale: f64) -> Result<f64> {
    any(u, scale).map(|x| if u.ratio(15, 16).unwrap_or(true) { x.abs() } else { x })
}

/// From -4 to 4.
fn ordinary(u: &mut Unstructured<'_>) -> Result<f64> {
    Ok(f64::from(u.arbitrary::<i16>()?) / 8192.0)
}

/// Times that rise by steps around `step`, unless a step is zero, negative or no number.
///
/// # Errors
/// If no bytes are left.
pub fn times(u: &mut Unstructured<'_>, count: usize, step: f64) -> Result<Vec<f64>> {
    let mut t = any(u, 1.0)?;
    let mut all = Vec::with_capacity(count);
    for _ in 0..count {
        all.push(t);
        let uneven = size(u, step)?;
        t += if u.ratio(7, 8)? { step } else { uneven };
    }
    Ok(all)
}

/// Numbers around `scale`.
///
/// # Errors
/// If no bytes are left.
pub fn values(u: &mut Unstructured<'_>, count: usize, scale: f64) -> Result<Vec<f64>> {
    (0..count).map(|_| any(u, scale)).collect()
}

/// A length that mostly is `count`.
///
/// # Errors
/// If no bytes are left.
pub fn nearly(u: &mut Unstructured<'_>, count: usize) -> Result<usize> {
    if u.ratio(1, 32)? { u.int_in_range(0..=count + 2) } else { Ok(count) }
}
