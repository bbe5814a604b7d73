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
    for found in [track.e.len(), track.vv.len(), position.len(), velocity.len(), smoothed_noise.len()] {
        same_length(n, found)?;
    }
    let (mut r_p, mut r_v) = (0.0, 0.0); // the adjoint of (p, v) just after reading k
    for k in (0..n).rev() {
        r_p = track.e[k] / track.S[k] + (1.0 - track.gain_p[k]) * r_p - track.gain_v[k] * r_v;
        position[k] = track.p[k] + track.pp[k] * r_p + track.pv[k] * r_v;
        velocity[k] = track.v[k] + track.pv[k] * r_p + track.vv[k] * r_v;
        smoothed_noise[k] = noise.q * r_v;
        if readings.starts(k) {
            (r_p, r_v) = (0.0, 0.0);
        } else {
            r_v += (readings.t[k] - readings.t[k - 1]) * r_p;
        }
    }
    Ok(())
}
