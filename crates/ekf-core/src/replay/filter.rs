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
    /// Density of the process noise of the interval beyond that of the record, (m/s^2)^2/Hz.
    extra_q: [f64; N],
    /// Variance of the reading beyond that of the record, m^2.
    extra_R: [f64; N],
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
                extra_q: parts.map(|readings| readings.extra_q[k]),
                extra_R: parts.map(|readings| readings.extra_variance(k)),
                counts: counts.map_or([0.0; N], |counts| counts.map(|flags| if flags[k] { 1.0 } else { 0.0 })),
                starts,
                any_starts: starts.contains(&true),
            }
        },
    ))
}

/// The predictions of `N` filters at one reading: references, since a copy would keep them out of registers.
struct Prediction<'a, const N: usize> {
    /// Position, m.
    p: &'a [f64; N],
    /// Velocity, m/s.
    v: &'a [f64; N],
    /// Variance of position.
    pp: &'a [f64; N],
    /// Covariance of position and velocity.
    pv: &'a [f64; N],
    /// Variance of velocity.
    vv: &'a [f64; N],
}

/// Runs the filters; `predicted` receives each prediction, `take` each reading with its innovations `e` and variances `S`.
#[inline(always)] // with the closures, or the records do not stay in registers
fn run_filters<const N: usize>(
    readings: impl Iterator<Item = InterleavedReading<N>>,
    noise: Noise,
    prior: Prior,
    mut predicted: impl FnMut(&Prediction<'_, N>, &InterleavedReading<N>),
    mut take: impl FnMut(&InterleavedReading<N>, [f64; N], [f64; N]),
) -> Result<(), ReplayError> {
    noise.check()?;
    let Noise { q, R } = noise;
    let (mut p, mut v) = ([0.0; N], [0.0; N]);
    let (mut pp, mut pv, mut vv) = ([0.0; N], [0.0; N], [0.0; N]);
    for (index, reading) in readings.enumerate() {
        for j in 0..N {
            let h = reading.h[j];
            p[j] += h * v[j] + reading.second[j];
            v[j] += reading.first[j];
            let P = MotionCovariance { pp: pp[j], pv: pv[j], vv: vv[j] }.predict(h, q + reading.extra_q[j]);
            (pp[j], pv[j], vv[j]) = (P.pp, P.pv, P.vv);
        }
        if reading.any_starts {
            // The reading and the prior replace the prediction.
            for j in (0..N).filter(|&j| reading.starts[j]) {
                (p[j], v[j]) = (reading.z[j], prior.v);
                (pp[j], pv[j], vv[j]) = (prior.P.pp, prior.P.pv, prior.P.vv);
            }
        }
        predicted(&Prediction { p: &p, v: &v, pp: &pp, pv: &pv, vv: &vv }, &reading);
        let (mut e, mut S) = ([0.0; N], [0.0; N]);
        for j in 0..N {
            let R = R + reading.extra_R[j];
            S[j] = pp[j] + R;
            e[j] = reading.z[j] - p[j];
            let inverse = 1.0 / S[j];
            // The factor `R/S` keeps `pp` positive.
            let (gain_p, gain_v, keep) = (pp[j] * inverse, pv[j] * inverse, R * inverse);
            p[j] += gain_p * e[j];
            v[j] += gain_v * e[j];
            vv[j] -= pv[j] * gain_v;
            pp[j] *= keep;
            pv[j] *= keep;
        }
        if let Some(&S) = S.iter().find(|&&variance| !(variance > 0.0)) {
            return Err(ReplayError::InnovationVariance { index, S });
        }
        take(&reading, e, S);
    }
    Ok(())
}

/// Runs the filter over one record and keeps what the columns and the smoother need.
///
/// # Errors
/// [`ReplayError`] for unusable readings or noise; the track is then incomplete.
pub fn filter(readings: Readings<'_>, noise: Noise, prior: Prior, track: &mut Track<'_>) -> Result<(), ReplayError> {
    let n = readings.t.len();
    for length in [track.e.len(), track.S.len(), track.gain_p.len(), track.gain_v.len(), track.p.len()] {
        same_length(n, length)?;
    }
    for length in [track.v.len(), track.pp.len(), track.pv.len(), track.vv.len()] {
        same_length(n, length)?;
    }
    let (mut k, mut n) = (0, 0);
    run_filters(
        interleave([readings], None)?,
        noise,
        prior,
        |&Prediction { p: [p], v: [v], pp: [pp], pv: [pv], vv: [vv] }, reading| {
            let inverse = 1.0 / (pp + (noise.R + reading.extra_R[0]));
            (track.gain_p[k], track.gain_v[k]) = (pp * inverse, pv * inverse);
            (track.p[k], track.v[k], track.pp[k], track.pv[k], track.vv[k]) = (*p, *v, *pp, *pv, *vv);
            k += 1;
        },
        |_, [e], [S]| {
            (track.e[n], track.S[n]) = (e, S);
            n += 1;
        },
    )
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
        |_, _| (),
        #[inline(always)]
        |_, e, _| take(e),
    )
}

/// What drives one of several filters with the same times, starts and noise.
#[derive(Debug, Clone, Copy)]
pub struct Driven<'a> {
    /// Readings, m.
    pub z: &'a [f64],
    /// Integral of the input over each interval, m/s.
    pub first: &'a [f64],
    /// Double integral of the input over each interval, m.
    pub second: &'a [f64],
}

/// Products of the innovations of `N` filters with each other, m^2, summed over blocks of time.
///
/// All have the times, starts and noise of `shared`, so that one covariance serves them. `edges` are the times at which the
/// blocks begin, s, rising; only `settled` readings enter, and those before the first edge belong to the first block. `take`
/// gets the products of each block and the readings in it.
///
/// # Errors
/// Those of [`innovations`], and when lengths differ.
#[inline(always)]
pub fn block_products<const N: usize>(
    shared: Readings<'_>,
    driven: [Driven<'_>; N],
    (noise, prior): (Noise, Prior),
    settled: &[bool],
    edges: &[f64],
    mut take: impl FnMut(&[[f64; N]; N], usize),
) -> Result<(), ReplayError> {
    let n = shared.t.len();
    for length in driven.iter().flat_map(|d| [d.z.len(), d.first.len(), d.second.len()]).chain([settled.len()]) {
        same_length(n, length)?;
    }
    let (mut p, mut v, mut products, mut count) = ([0.0; N], [0.0; N], [[0.0; N]; N], 0);
    let mut ahead = edges.get(1..).unwrap_or(&[]);
    let mut k = 0;
    run_filters(
        interleave([shared], None)?,
        noise,
        prior,
        #[inline(always)]
        |&Prediction { pp: [pp], pv: [pv], .. }, reading| {
            let inverse = 1.0 / (pp + (noise.R + reading.extra_R[0]));
            let (gain_p, gain_v, h) = (pp * inverse, pv * inverse, reading.h[0]);
            let mut e = [0.0; N];
            for j in 0..N {
                let z = driven[j].z[k];
                p[j] += h * v[j] + driven[j].second[k];
                v[j] += driven[j].first[k];
                if reading.any_starts {
                    (p[j], v[j]) = (z, prior.v);
                }
                e[j] = z - p[j];
                p[j] += gain_p * e[j];
                v[j] += gain_v * e[j];
            }
            if settled[k] {
                while let Some((_, later)) = ahead.split_first().filter(|&(&edge, _)| shared.t[k] >= edge) {
                    take(&products, count);
                    (products, count, ahead) = ([[0.0; N]; N], 0, later);
                }
                for i in 0..N {
                    for j in 0..N {
                        products[i][j] += e[i] * e[j];
                    }
                }
                count += 1;
            }
            k += 1;
        },
        |_, _, _| (),
    )?;
    for _ in 0..=ahead.len() {
        take(&products, count);
        (products, count) = ([[0.0; N]; N], 0);
    }
    Ok(())
}

/// Readings whose variances are multiplied before their logarithm is computed.
const PRODUCT: usize = 8;

/// Sum over the records of `-1/2 sum (e^2/S + ln 2 pi S)` over the readings that count (derivations 6.3).
///
/// # Errors
/// [`ReplayError`] for unusable noise, when a variance stops being positive, or when the sum is not finite.
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
        |_, _| (),
        #[inline(always)]
        |reading, e, S| {
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
    let value = -0.5 * (squares.iter().sum::<f64>() + logarithms + constant);
    if value.is_finite() { Ok(value) } else { Err(ReplayError::LogLikelihood { value }) }
}
