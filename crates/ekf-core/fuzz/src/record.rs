//! A whole record through a filter, then smoothed.

use arbitrary::{Result, Unstructured};
use ekf_core::dense::system::System;
use ekf_core::{Aci, Cwpa, Engine, Filter, Outcome, Samples, smooth};

use crate::judge::require_belief;
use crate::numbers::{nearly, times, values};
use crate::setup::{Drawn, filter, prior};

/// Runs the target.
pub fn run(data: &[u8]) {
    let u = &mut Unstructured::new(data);
    // Bytes that end early are no case.
    let _ = match u.int_in_range(0..=4) {
        Ok(0) => whole::<Aci, 4>(u),
        Ok(1) => whole::<Cwpa, 5>(u),
        Ok(2) => whole::<Cwpa, 6>(u), // with a low-pass
        Ok(3) => whole::<Cwpa, 7>(u),
        _ => whole::<Aci, 6>(u),
    };
}

fn whole<S: System<N> + Drawn, const N: usize>(u: &mut Unstructured<'_>) -> Result<()>
where
    Filter<S>: Engine<N, Outcome = Outcome<N>>,
{
    let filter = filter::<S>(u, N)?;
    let prior = prior::<N>(u, &S::SIGMA)?;
    let (outputs, positions) = (u.int_in_range(0..=12)?, u.int_in_range(0..=12)?);
    let (t_u, t_z) = (times(u, outputs, 6e-4)?, times(u, positions, 6e-4)?);
    let (n_u, n_z) = (nearly(u, outputs)?, nearly(u, positions)?);
    let (y_u, y_z) = (values(u, n_u, 10.0)?, values(u, n_z, 1e-3)?);
    let mut outcomes = Vec::new();
    let finished = filter.run(&prior, Samples { t: &t_u, y: &y_u }, Samples { t: &t_z, y: &y_z }, |track, outcome| {
        require_belief(&outcome.belief);
        assert!(!track.log_likelihood.is_nan(), "the likelihood is not a number");
        outcomes.push(*outcome);
    });
    if finished.is_ok() {
        assert_eq!(outcomes.len(), outputs + positions);
        if smooth(&filter, &prior, &mut outcomes).is_ok() {
            for outcome in &outcomes {
                for i in 0..N {
                    let variance = outcome.belief.P[(i, i)];
                    assert!(variance >= 0.0 && variance.is_finite(), "smoothed variance {variance} of state {i}");
                    assert!(outcome.belief.x[i].is_finite(), "smoothed mean {} of state {i}", outcome.belief.x[i]);
                }
            }
        }
    }
    Ok(())
}
