//! The two-state filter over several parts of a record side by side: their innovations, their likelihood.
//!
//! One filter waits for its own division at every reading; `N` filters on `N` parts of equal length do not.

use crate::replay::{MotionCovariance, Noise, Prior, Readings, ReplayError};
use crate::signal::integrals::ConditionError;

/// One reading of each part.
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

/// Parts of equal length, side by side: one [`InterleavedReading`] for each reading, in order.
///
/// # Errors
/// [`ReplayError::Condition`] when readings are unusable or lengths differ.
#[inline(always)]
pub fn interleave<const N: usize>(
    parts: [(Readings<'_>, &[bool]); N],
) -> Result<impl Iterator<Item = InterleavedReading<N>>, ReplayError> {
    let n = parts.first().map_or(0, |(readings, _)| readings.t.len());
    for (readings, counts) in &parts {
        readings.check_samples()?;
        for found in [readings.t.len(), counts.len()] {
            if found != n {
                return Err(ConditionError::Length { expected: n, found }.into());
            }
        }
    }
    Ok((0..n).map(
        #[inline(always)]
        move |k| {
            let starts = parts.map(|(readings, _)| readings.starts(k));
            InterleavedReading {
                h: parts.map(|(readings, _)| if k == 0 { 0.0 } else { readings.t[k] - readings.t[k - 1] }),
                z: parts.map(|(readings, _)| readings.z[k]),
                first: parts.map(|(readings, _)| readings.first[k]),
                second: parts.map(|(readings, _)| readings.second[k]),
                counts: parts.map(|(_, counts)| if counts[k] { 1.0 } else { 0.0 }),
                starts,
                any_starts: starts.contains(&true),
            }
        },
    ))
}

/// Runs the filters; `take` gets each reading with the innovations `e` and their variances `S`.
#[inline(always)] // with the closure, or the parts do not stay side by side in registers
fn run_filters<const N: usize>(
    readings: impl Iterator<Item = InterleavedReading<N>>,
    noise: Noise,
    prior: Prior,
    mut take: impl FnMut(&InterleavedReading<N>, [f64; N], [f64; N]),
) -> Result<(), ReplayError> {
    noise.check()?;
    let Noise { q, R } = noise;
    let (mut p, mut v) = ([0.0; N], [0.0; N]);
    let (mut pp, mut pv, mut vv) = ([0.0; N], [0.0; N], [0.0; N]);
    for (index, one) in readings.enumerate() {
        for j in 0..N {
            let h = one.h[j];
            p[j] += h * v[j] + one.second[j];
            v[j] += one.first[j];
            let P = MotionCovariance { pp: pp[j], pv: pv[j], vv: vv[j] }.predict(h, q);
            (pp[j], pv[j], vv[j]) = (P.pp, P.pv, P.vv);
        }
        if one.any_starts {
            for j in (0..N).filter(|&j| one.starts[j]) {
                (p[j], v[j]) = (one.z[j], prior.v);
                (pp[j], pv[j], vv[j]) = (prior.P.pp, prior.P.pv, prior.P.vv);
            }
        }
        let (mut e, mut S) = ([0.0; N], [0.0; N]);
        for j in 0..N {
            S[j] = pp[j] + R;
            e[j] = one.z[j] - p[j];
            let inverse = 1.0 / S[j];
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
        take(&one, e, S);
    }
    Ok(())
}

/// Innovations of every part, m; `take` gets those of one reading, in order.
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
        |_, e, _| take(e),
    )
}

/// Readings whose variances are multiplied before one logarithm is taken.
const PRODUCT: usize = 8;

/// Sum over the parts of `-1/2 sum (e^2/S + ln 2 pi S)`, as [`crate::replay::log_likelihood`] of each.
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
        |one, e, S| {
            for j in 0..N {
                squares[j] += one.counts[j] * (e[j] * e[j] / S[j]);
                counted[j] += one.counts[j];
                product[j] *= one.counts[j] * S[j] + (1.0 - one.counts[j]);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay;

    const N: usize = 40;
    const PRIOR: Prior = Prior { v: 0.1, P: MotionCovariance { pp: 1e-8, pv: 2e-9, vv: 0.5 } };
    const NOISE: Noise = Noise { q: 3e-5, R: 4e-12 };

    /// Four parts of a record with its own gaps, restarts and readings that do not count.
    struct Parts {
        t: [[f64; N]; 4],
        z: [[f64; N]; 4],
        first: [[f64; N]; 4],
        second: [[f64; N]; 4],
        restart: [[bool; N]; 4],
        counts: [[bool; N]; 4],
    }

    impl Parts {
        fn new() -> Self {
            let at = |part: usize, k: usize| (k * 7 + part * 13) as f64;
            let each =
                |f: &dyn Fn(usize, usize) -> f64| core::array::from_fn(|part| core::array::from_fn(|k| f(part, k)));
            let mut t: [[f64; N]; 4] = each(&|part, k| 1e-3 * (k as f64 + 0.3 * libm::sin(at(part, k))));
            t[2][20..].iter_mut().for_each(|time| *time += 0.5);
            Self {
                t,
                z: each(&|part, k| 1e-5 * libm::cos(0.3 * at(part, k))),
                first: each(&|part, k| 1e-4 * libm::sin(0.1 * at(part, k))),
                second: each(&|part, k| 1e-8 * libm::cos(0.2 * at(part, k))),
                restart: core::array::from_fn(|part| core::array::from_fn(|k| k == 0 || (part == 2 && k == 20))),
                counts: core::array::from_fn(|part| core::array::from_fn(|k| k > 3 && (k + part) % 5 != 0)),
            }
        }

        fn part(&self, part: usize) -> (Readings<'_>, &[bool]) {
            let readings = Readings {
                t: &self.t[part],
                z: &self.z[part],
                first: &self.first[part],
                second: &self.second[part],
                restart: &self.restart[part],
            };
            (readings, &self.counts[part])
        }
    }

    fn packed<const M: usize>(parts: [(Readings<'_>, &[bool]); M]) -> [InterleavedReading<M>; N] {
        let mut rows = interleave(parts).unwrap();
        core::array::from_fn(|_| rows.next().unwrap())
    }

    #[test]
    fn parts_side_by_side_have_the_likelihood_of_each_alone() {
        let parts = Parts::new();
        let expected: f64 = (0..4)
            .map(|part| {
                let (readings, counts) = parts.part(part);
                replay::log_likelihood(readings, NOISE, PRIOR, counts).unwrap()
            })
            .sum();
        let found = log_likelihood(&packed([0, 1, 2, 3].map(|part| parts.part(part))), NOISE, PRIOR).unwrap();
        assert!((found - expected).abs() < 1e-12 * expected.abs(), "{found} {expected}"); // a hundred terms, double
        let single: f64 = (0..4).map(|k| log_likelihood(&packed([parts.part(k)]), NOISE, PRIOR).unwrap()).sum();
        assert!((single - expected).abs() < 1e-12 * expected.abs(), "{single} {expected}");
        let other = Noise { q: 4e-5, ..NOISE };
        let moved = log_likelihood(&packed([parts.part(0)]), other, PRIOR).unwrap();
        let is_constant = log_likelihood(&packed([parts.part(0)]), NOISE, PRIOR).unwrap();
        assert!((moved - is_constant).abs() > 1e-6 * is_constant.abs());
    }

    #[test]
    fn innovations_are_those_of_the_filter() {
        let parts = Parts::new();
        let mut found = [[0.0; 4]; N];
        let mut rows = found.iter_mut();
        let all = interleave([0, 1, 2, 3].map(|part| parts.part(part))).unwrap();
        innovations(all, NOISE, PRIOR, |e| *rows.next().unwrap() = e).unwrap();
        for part in 0..4 {
            let mut kept = [[0.0; N]; 9];
            let [e, S, gain_p, gain_v, p, v, pp, pv, vv] = &mut kept;
            let mut track = replay::Track { e, S, gain_p, gain_v, p, v, pp, pv, vv };
            replay::filter(parts.part(part).0, NOISE, PRIOR, &mut track).unwrap();
            for (k, row) in found.iter().enumerate() {
                // Readings and intermediate positions of 1e-4 m in double precision, forty steps.
                assert!((row[part] - kept[0][k]).abs() < 1e-15, "{part} {k}");
            }
        }
    }

    #[test]
    fn what_is_unusable_is_refused() {
        let parts = Parts::new();
        let (readings, counts) = parts.part(0);
        let short = ReplayError::Condition(ConditionError::Length { expected: N, found: N - 1 });
        assert_eq!(interleave([(readings, &counts[1..])]).err(), Some(short));
        let rows = packed([(readings, counts)]);
        assert!(matches!(log_likelihood(&rows, Noise { q: 0.0, R: 1.0 }, PRIOR), Err(ReplayError::Noise { .. })));
        let prior = Prior { v: 0.0, P: MotionCovariance { pp: -1.0, pv: 0.0, vv: 1.0 } };
        let lost = ReplayError::InnovationVariance { index: 0, S: NOISE.R - 1.0 };
        assert_eq!(log_likelihood(&rows, NOISE, prior), Err(lost));
    }
}
