//! The smoother behind the two-state filter, in the modified Bryson-Frazier form.

use crate::replay::filter::TrackView;
use crate::replay::{Noise, Readings, ReplayError, same_length};

/// Smooths a finished track: position, velocity and process noise given all readings.
///
/// Modified Bryson-Frazier form of the RTS smoother: no inverse, exact for any gap. `smoothed_noise[k]` is the
/// smoothed process noise of density `noise.q` at reading `k`, m/s^2; between two readings it is a straight line. Times
/// `1 + extra_q/q` of its interval it is all of the process noise there, and adding that to the input gives the
/// smoothed acceleration.
///
/// # Errors
/// [`ReplayError`] when a buffer has the wrong length or the readings are unusable.
pub fn smooth(
    readings: Readings<'_>,
    noise: Noise,
    track: TrackView<'_>,
    position: &mut [f64],
    velocity: &mut [f64],
    smoothed_noise: &mut [f64],
) -> Result<(), ReplayError> {
    readings.check(noise)?;
    let n = readings.t.len();
    let TrackView { e, S, gain_p, gain_v, p, v, pp, pv, vv } = track;
    for length in [e, S, gain_p, gain_v, p, v, pp, pv, vv, position, velocity, smoothed_noise].map(<[f64]>::len) {
        same_length(n, length)?;
    }
    let (mut r_p, mut r_v) = (0.0, 0.0); // the adjoint of (p, v) just after reading k
    for k in (0..n).rev() {
        r_p = e[k] / S[k] + (1.0 - gain_p[k]) * r_p - gain_v[k] * r_v;
        position[k] = p[k] + pp[k] * r_p + pv[k] * r_v;
        velocity[k] = v[k] + pv[k] * r_p + vv[k] * r_v;
        smoothed_noise[k] = noise.q * r_v;
        if readings.starts(k) {
            (r_p, r_v) = (0.0, 0.0);
        } else {
            r_v += (readings.t[k] - readings.t[k - 1]) * r_p;
        }
    }
    Ok(())
}
