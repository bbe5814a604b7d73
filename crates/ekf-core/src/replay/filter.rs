//! The two-state filter on position and velocity: over one record with its history kept, or over several at once.
//!
//! One filter waits for its own division at every reading; `N` filters on `N` records of equal length do not.

use crate::replay::{MotionCovariance, Noise, Prior, Readings, ReplayError, same_length};

/// The filter's own record, one entry per reading; callers own the memory.
#[derive(Debug)]
pub struct Track<'a> {
    /// Innovation `e = z - p`, m.
    pub e: &'a mut [f64],
    /// Innovation variance, m^2.
    pub S: &'a mut [f64],
    /// Gain on position, 1.
    pub gain_p: &'a mut [f64],
    /// Gain on velocity, 1/s.
    pub gain_v: &'a mut [f64],
    /// Predicted position, m.
    pub p: &'a mut [f64],
    /// Predicted velocity, m/s.
    pub v: &'a mut [f64],
    /// Predicted variance of position, m^2.
    pub pp: &'a mut [f64],
    /// Predicted covariance of position and velocity, m^2/s.
    pub pv: &'a mut [f64],
    /// Predicted variance of velocity, (m/s)^2.
    pub vv: &'a mut [f64],
}

/// A finished [`Track`], for reading.
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs)] // the fields of `Track`
pub struct TrackView<'a> {
    pub e: &'a [f64],
    pub S: &'a [f64],
    pub gain_p: &'a [f64],
    pub gain_v: &'a [f64],
    pub p: &'a [f64],
    pub v: &'a [f64],
    pub pp: &'a [f64],
    pub pv: &'a [f64],
    pub vv: &'a [f64],
}

/// One reading of each of `N` records.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InterleavedReading<const N: usize> {
    /// Time since the reading before, s.
    h: [f64; N],
    /// Readings, m.
    z: [f64; N],
    /// Integral of the input over the interval, m/s.
    first: [f64; N],
    /// Double integral of the input over the interval, m.
    second: [f64; N],
    /// 1 where the reading counts, else 0.
    counts: [f64; N],
    /// Where the filter starts again.
    starts: [bool; N],
    /// Whether any of them does.
    any_starts: bool,
}

/// The readings of `N` records of equal length, in order; `counts` says which of them enter a likelihood, none if `None`.
///
/// # Errors
/// [`ReplayError::Condition`] when readings are unusable or lengths differ.
#[inline(always)]
pub fn interleave<const N: usize>(
    parts: [Readings<'_>; N],
    counts: Option<[&[bool]; N]>,
) -> Result<impl Iterator<Item = InterleavedReading<N>>, ReplayError> {
    let n = parts.first().map_or(0, |readings| readings.t.len());
    for readings in &parts {
        readings.check_samples()?;
        same_length(n, readings.t.len())?;
    }
    for flags in counts.iter().flatten() {
        same_length(n, flags.len())?;
    }
    Ok((0..n).map(
        #[inline(always)]
        move |k| {
            let starts = parts.map(|readings| readings.starts(k));
            InterleavedReading {
                h: parts.map(|readings| if k == 0 { 0.0 } else { readings.t[k] - readings.t[k - 1] }),
                z: parts.map(|readings| readings.z[k]),
                first: parts.map(|readings| readings.first[k]),
                second: parts.map(|readings| readings.second[k]),
                counts: counts.map_or([0.0; N], |counts| counts.map(|flags| if flags[k] { 1.0 } else { 0.0 })),
                starts,
                any_starts: starts.contains(&true),
            }
        },
    ))
}

/// The filter at one reading of each record.
#[derive(Debug, Clone, Copy)]
struct Update<const N: usize> {
    /// Predicted position, m.
    p: [f64; N],
    /// Predicted velocity, m/s.
    v: [f64; N],
    /// Predicted covariance.
    P: [MotionCovariance; N],
    /// Innovation, m.
    e: [f64; N],
    /// Its variance, m^2.
    S: [f64; N],
    /// Gain on position.
    gain_p: [f64; N],
    /// Gain on velocity, 1/s.
    gain_v: [f64; N],
}

/// `N` filters of equal noise and prior, between two readings.
struct MotionFilter<const N: usize> {
    noise: Noise,
    prior: Prior,
    p: [f64; N],
    v: [f64; N],
    P: [MotionCovariance; N],
}

impl<const N: usize> MotionFilter<N> {
    #[inline(always)]
    fn new(noise: Noise, prior: Prior) -> Self {
        Self { noise, prior, p: [0.0; N], v: [0.0; N], P: [prior.P; N] }
    }

    /// Predicts to a reading; where a record starts, the reading and the prior replace the prediction.
    #[inline(always)]
    fn predict(&mut self, reading: &InterleavedReading<N>) {
        for j in 0..N {
            let h = reading.h[j];
            self.p[j] += h * self.v[j] + reading.second[j];
            self.v[j] += reading.first[j];
            self.P[j] = self.P[j].predict(h, self.noise.q);
        }
        if reading.any_starts {
            for j in (0..N).filter(|&j| reading.starts[j]) {
                (self.p[j], self.v[j], self.P[j]) = (reading.z[j], self.prior.v, self.prior.P);
            }
        }
    }

    /// Updates by the reading.
    #[inline(always)]
    fn update(&mut self, reading: &InterleavedReading<N>) -> Update<N> {
        let R = self.noise.R;
        let Self { p, v, P, .. } = *self;
        let none = [0.0; N];
        let mut update = Update { p, v, P, e: none, S: none, gain_p: none, gain_v: none };
        for j in 0..N {
            let (S, e) = (P[j].pp + R, reading.z[j] - p[j]);
            let inverse = 1.0 / S;
            let (gain_p, gain_v) = (P[j].pp * inverse, P[j].pv * inverse);
            self.p[j] += gain_p * e;
            self.v[j] += gain_v * e;
            self.P[j] = P[j].update(R, inverse);
            (update.e[j], update.S[j], update.gain_p[j], update.gain_v[j]) = (e, S, gain_p, gain_v);
        }
        update
    }
}

/// Runs the filters; `take` receives each reading with its update.
#[inline(always)] // with the closure, or the records do not stay side by side in registers
fn run_filters<const N: usize>(
    readings: impl Iterator<Item = InterleavedReading<N>>,
    noise: Noise,
    prior: Prior,
    mut take: impl FnMut(&InterleavedReading<N>, &Update<N>),
) -> Result<(), ReplayError> {
    noise.check()?;
    let mut filter = MotionFilter::new(noise, prior);
    for (index, reading) in readings.enumerate() {
        filter.predict(&reading);
        let update = filter.update(&reading);
        if let Some(&S) = update.S.iter().find(|&&variance| !(variance > 0.0)) {
            return Err(ReplayError::InnovationVariance { index, S });
        }
        take(&reading, &update);
    }
    Ok(())
}

/// Runs the filter over one record and keeps what the columns and the smoother need.
///
/// # Errors
/// [`ReplayError`] for unusable readings or noise; the track is then incomplete.
pub fn filter(readings: Readings<'_>, noise: Noise, prior: Prior, track: &mut Track<'_>) -> Result<(), ReplayError> {
    let n = readings.t.len();
    for found in [track.e.len(), track.S.len(), track.gain_p.len(), track.gain_v.len(), track.p.len()] {
        same_length(n, found)?;
    }
    for found in [track.v.len(), track.pp.len(), track.pv.len(), track.vv.len()] {
        same_length(n, found)?;
    }
    let mut k = 0;
    run_filters(interleave([readings], None)?, noise, prior, |_, update| {
        let Update { p: [p], v: [v], P: [P], e: [e], S: [S], gain_p: [gain_p], gain_v: [gain_v] } = *update;
        (track.e[k], track.S[k], track.gain_p[k], track.gain_v[k]) = (e, S, gain_p, gain_v);
        (track.p[k], track.v[k]) = (p, v);
        (track.pp[k], track.pv[k], track.vv[k]) = (P.pp, P.pv, P.vv);
        k += 1;
    })
}

/// Innovations of every record, m; `take` gets those of one reading, in order.
///
/// # Errors
/// [`ReplayError`] for unusable noise, or when a variance stops being positive.
#[inline(always)]
pub fn innovations<const N: usize>(
    readings: impl Iterator<Item = InterleavedReading<N>>,
    noise: Noise,
    prior: Prior,
    mut take: impl FnMut([f64; N]),
) -> Result<(), ReplayError> {
    run_filters(
        readings,
        noise,
        prior,
        #[inline(always)]
        |_, update| take(update.e),
    )
}

/// Readings whose variances are multiplied before their logarithm is computed.
const PRODUCT: usize = 8;

/// Sum over the records of `-1/2 sum (e^2/S + ln 2 pi S)` over the readings that count (derivations 6.3).
///
/// # Errors
/// [`ReplayError`] for unusable noise, or when a variance stops being positive.
#[inline(always)]
pub fn log_likelihood<const N: usize>(
    readings: &[InterleavedReading<N>],
    noise: Noise,
    prior: Prior,
) -> Result<f64, ReplayError> {
    let (mut squares, mut counted, mut logarithms) = ([0.0; N], [0.0; N], 0.0);
    let (mut product, mut held) = ([1.0; N], 0);
    run_filters(
        readings.iter().copied(),
        noise,
        prior,
        #[inline(always)]
        |reading, &Update { e, S, .. }| {
            for j in 0..N {
                squares[j] += reading.counts[j] * (e[j] * e[j] / S[j]);
                counted[j] += reading.counts[j];
                product[j] *= reading.counts[j] * S[j] + (1.0 - reading.counts[j]);
            }
            held += 1;
            if held == PRODUCT {
                logarithms += product.map(libm::log).iter().sum::<f64>();
                (product, held) = ([1.0; N], 0);
            }
        },
    )?;
    logarithms += product.map(libm::log).iter().sum::<f64>();
    let constant = counted.iter().sum::<f64>() * libm::log(core::f64::consts::TAU);
    Ok(-0.5 * (squares.iter().sum::<f64>() + logarithms + constant))
}
