//! The replay: its filter, likelihood and smoother, the grid and the columns through its gains.

use arbitrary::{Result, Unstructured};
use ekf_core::replay::columns::{Gains, ReadingSpan, Response, filter_input_columns, filter_reading_columns, prepare};
use ekf_core::replay::filter::{Track, TrackView, filter, innovations, interleave, log_likelihood};
use ekf_core::replay::grid::Grid;
use ekf_core::replay::smoother::smooth;
use ekf_core::replay::{MotionCovariance, Noise, Prior, Readings, ReplayError};

use crate::numbers::{any, nearly, size, times, values};

/// Runs the target.
pub fn run(data: &[u8]) {
    let _ = case(&mut Unstructured::new(data)); // bytes that end early are no case
}

fn sizes(u: &mut Unstructured<'_>, count: usize, scale: f64) -> Result<Vec<f64>> {
    (0..count).map(|_| if u.ratio(3, 4)? { Ok(0.0) } else { size(u, scale) }).collect()
}

fn flags(u: &mut Unstructured<'_>, count: usize) -> Result<Vec<bool>> {
    (0..count).map(|_| u.ratio(1, 8)).collect()
}

fn case(u: &mut Unstructured<'_>) -> Result<()> {
    let n = u.int_in_range(0..=12)?;
    let noise = Noise { q: size(u, 1e-6)?, R: size(u, 1e-12)? };
    let P = MotionCovariance { pp: size(u, 1e-8)?, pv: 0.0, vv: size(u, 1e-4)? };
    let prior = Prior { v: any(u, 0.1)?, P };
    let t = times(u, n, 1e-3)?;
    let lengths: [usize; 6] = [
        nearly(u, n)?,
        nearly(u, n)?,
        nearly(u, n)?,
        nearly(u, n)?,
        nearly(u, n)?,
        if u.arbitrary()? { nearly(u, n)? } else { 0 },
    ];
    let z = values(u, lengths[0], 1e-3)?;
    let (first, second) = (values(u, lengths[1], 1e-2)?, values(u, lengths[2], 1e-5)?);
    let restart = flags(u, lengths[3])?;
    let (extra_q, extra_R) = (sizes(u, lengths[4], 1e-6)?, sizes(u, lengths[5], 1e-12)?);
    let readings = Readings {
        t: &t,
        z: &z,
        first: &first,
        second: &second,
        restart: &restart,
        extra_q: &extra_q,
        extra_R: &extra_R,
    };
    let mut series: [Vec<f64>; 9] = core::array::from_fn(|_| vec![0.0; n]);
    let [e, S, gain_p, gain_v, p, v, pp, pv, vv] = &mut series;
    let ran = filter(readings, noise, prior, &mut Track { e, S, gain_p, gain_v, p, v, pp, pv, vv });
    let counts = flags(u, n)?;
    if let Ok(interleaved) = interleave([readings], Some([&counts])) {
        let interleaved: Vec<_> = interleaved.collect();
        let likelihood = log_likelihood(&interleaved, noise, prior);
        let alone = innovations(interleaved.iter().copied(), noise, prior, |_| ());
        match likelihood {
            Err(ReplayError::LogLikelihood { value }) => {
                assert!(ran.is_ok() && !value.is_finite(), "a log-likelihood of {value} is refused");
                let usual = |(e, S): (&f64, &f64)| e * e / S < 1e300 && (1e-38..1e38).contains(S);
                assert!(!series[0].iter().zip(&series[1]).all(usual), "no innovation is out of range");
            }
            _ => assert_eq!(ran.is_ok(), likelihood.is_ok(), "one loop refuses what the other takes"),
        }
        assert_eq!(ran.is_ok(), alone.is_ok(), "one loop refuses what the other takes");
    } else {
        assert!(ran.is_err(), "unusable readings were filtered");
    }
    if ran.is_err() {
        return Ok(());
    }
    let [e, S, gain_p, gain_v, p, v, pp, pv, vv] = &series;
    for (index, &variance) in S.iter().enumerate() {
        assert!(variance > 0.0, "variance {variance} of innovation {index}");
    }
    let track = TrackView { e, S, gain_p, gain_v, p, v, pp, pv, vv };
    let [mut position, mut velocity, mut acceleration] = [vec![0.0; nearly(u, n)?], vec![0.0; n], vec![0.0; n]];
    let smoothed = smooth(readings, noise, track, &mut position, &mut velocity, &mut acceleration);
    assert_eq!(smoothed.is_ok(), position.len() == n);

    let grid = Grid { start: any(u, 1.0)?, step: size(u, 1e-3)? };
    let grid = if u.ratio(3, 4)? { Grid { start: t.first().copied().unwrap_or(0.0), step: 1e-3 } } else { grid };
    let rows = u.int_in_range(0..=40)?;
    let counted = nearly(u, n)?;
    let counts = flags(u, counted)?;
    let gains = Gains { t: &t, restart: &restart, gain_p, gain_v, S };
    let before = if u.arbitrary()? { Some(any(u, 1.0)?) } else { None };
    let (mut cells, mut prepared) = (vec![], vec![]);
    if prepare(gains, &counts, (grid, rows), before, |cell| cells.push(cell), |reading| prepared.push(reading)).is_err()
    {
        return Ok(());
    }
    let group = u.int_in_range(0..=4)?;
    let span = ReadingSpan { readings: &prepared, cells: &cells, group };
    let sums = nearly(u, prepared.iter().filter(|reading| reading.counts).count() / group.max(1))?;
    let mut sums = [vec![0.0; sums], vec![0.0; sums]];
    let [one, two] = &mut sums;
    let (on_grid, on_readings) = (nearly(u, rows)?, nearly(u, n)?);
    let column = values(u, on_grid, 1.0)?;
    let mut response = Response::<2>::default();
    let _ = filter_input_columns(span, [&column, &column], any(u, 1.0)?, &mut response, [one, two]);
    assert_eq!(
        sums[0].iter().map(|x| x.to_bits()).collect::<Vec<_>>(),
        sums[1].iter().map(|x| x.to_bits()).collect::<Vec<_>>()
    );
    let [one, two] = &mut sums;
    let column = values(u, on_readings, 1e-3)?;
    let _ = filter_reading_columns(span, [&column, &column], &mut response, [one, two]);
    Ok(())
}
