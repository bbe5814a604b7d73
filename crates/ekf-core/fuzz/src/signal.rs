//! Samples on two clocks: checks, interpolation, integrals, the order of events, the play operator.

use arbitrary::{Result, Unstructured};
use ekf_core::hysteresis::play;
use ekf_core::signal::integrals::{Conditioning, check_samples, drive};
use ekf_core::signal::timeline::Timeline;
use ekf_core::{Channel, Interpolation, Samples, Segment};

use crate::judge::require_finite;
use crate::numbers::{any, nearly, size, times, values};

/// Runs the target.
pub fn run(data: &[u8]) {
    let _ = case(&mut Unstructured::new(data)); // bytes that end early are no case
}

fn case(u: &mut Unstructured<'_>) -> Result<()> {
    let interpolation = *u.choose(&[Interpolation::Hold, Interpolation::Linear, Interpolation::Cubic])?;
    let (n, m) = (u.int_in_range(0..=12)?, u.int_in_range(0..=12)?);
    let (t, at) = (times(u, n, 1e-3)?, times(u, m, 1e-3)?);
    let given = nearly(u, n)?;
    let y = values(u, given, 10.0)?;
    let i = u.int_in_range(0..=20)?;
    let _ = Segment::between(&t, &y, i, interpolation).integrals(any(u, 1e-3)?, any(u, 1e-3)?);
    let usable = check_samples(&t, &y).is_ok();
    let conditioning = Conditioning {
        interpolation,
        tau: if u.arbitrary()? { size(u, 1e-3)? } else { 0.0 },
        delay: if u.arbitrary()? { any(u, 1e-3)? } else { 0.0 },
        hole: if u.arbitrary()? { f64::INFINITY } else { size(u, 1e-2)? },
    };
    let lengths = [nearly(u, m)?, nearly(u, m)?, nearly(u, m)?];
    let [mut first, mut second] = [vec![f64::NAN; lengths[0]], vec![f64::NAN; lengths[1]]];
    let mut covered = vec![true; lengths[2]];
    let driven = drive(Samples { t: &t, y: &y }, conditioning, &at, &mut first, &mut second, &mut covered);
    if driven.is_ok() {
        assert!(usable, "unusable samples were integrated");
        assert!(covered.first() != Some(&true), "the first instant ends no interval");
        let ordinary = y.iter().all(|x| x.abs() < 1e9) && t.iter().all(|x| x.abs() < 1e6);
        let steep = t.windows(2).all(|pair| pair[1] - pair[0] > 1e-9) && conditioning.tau.abs() < 1e6;
        if ordinary && steep {
            require_finite("integral", &first);
            require_finite("double integral", &second);
        }
        for k in (0..m).filter(|&k| !covered[k]) {
            assert!(first[k] == 0.0 && second[k] == 0.0, "an interval that is not covered adds something");
        }
    }
    let (output, position) = (Samples { t: &t, y: &y }, Samples { t: &at, y: &at });
    if output.check(Channel::Output, 2).is_ok() && position.check(Channel::Position, 1).is_ok() {
        let mut last = f64::NEG_INFINITY;
        let mut events = 0;
        for event in Timeline::new(output, position) {
            assert!(event.t >= last, "time ran back");
            last = event.t;
            events += 1;
            let _ = output.piece(events, interpolation);
        }
        assert_eq!(events, n + m, "an event was lost");
    }
    let mut followed = vec![0.0; nearly(u, given)?];
    play(&y, any(u, 1.0)?, any(u, 1.0)?, &mut followed);
    Ok(())
}
