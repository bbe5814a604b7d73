//! A stream of events into a live filter, dense, factored or in blocks.

use arbitrary::{Result, Unstructured};
use ekf_core::dense::system::System;
use ekf_core::{Aci, Belief, Channel, Cwpa, Engine, Event, Filter, InBlocks, Live, RunError, StepError, Structured};

use crate::judge::require_belief;
use crate::numbers::{any, size};
use crate::setup::{Drawn, filter, prior};

/// Runs the target.
pub fn run(data: &[u8]) {
    let u = &mut Unstructured::new(data);
    // Bytes that end early are no case.
    let _ = match u.int_in_range(0..=7) {
        Ok(0) => dense::<Aci, 6>(u),
        Ok(1) => dense::<Aci, 4>(u),
        Ok(2) => dense::<Cwpa, 7>(u),
        Ok(3) => dense::<Cwpa, 8>(u), // with a low-pass
        Ok(4) => blocks::<Aci, 6>(u),
        Ok(5) => blocks::<Cwpa, 5>(u),
        Ok(6) => blocks::<Cwpa, 7>(u),
        _ => dense::<Aci, 5>(u), // no sensor has three parameters
    };
}

fn dense<S: System<N> + Drawn, const N: usize>(u: &mut Unstructured<'_>) -> Result<()>
where
    Filter<S>: Engine<N>,
{
    let filter = filter::<S>(u, N)?;
    let prior = prior::<N>(u, &S::SIGMA)?;
    live(filter, &prior, u)
}

fn blocks<S: System<N> + Drawn, const N: usize>(u: &mut Unstructured<'_>) -> Result<()>
where
    Filter<S>: Structured<N>,
{
    let filter = filter::<S>(u, N)?;
    let prior = prior::<N>(u, &S::SIGMA)?;
    if filter.has_kernel() { live(InBlocks(filter), &prior, u) } else { Ok(()) }
}

fn live<E: Engine<N>, const N: usize>(engine: E, prior: &Belief<N>, u: &mut Unstructured<'_>) -> Result<()> {
    let Ok(mut live) = Live::new(engine, prior) else { return Ok(()) };
    let judge = |live: &Live<E, N>| {
        require_belief(&live.belief());
        assert!(!live.track().log_likelihood.is_nan(), "the likelihood is not a number");
    };
    judge(&live);
    let mut t = any(u, 1.0)?;
    let mut failures = 0;
    while !u.is_empty() && failures < 8 {
        let channel = if u.arbitrary()? { Channel::Output } else { Channel::Position };
        let value = match channel {
            Channel::Output => any(u, 10.0)?,
            Channel::Position => any(u, 1e-3)?,
        };
        let before = (live.track().events, live.track().t);
        match live.push(Event { t, channel, value }, |_| ()) {
            Ok(()) => {}
            Err(RunError::Step { error: StepError::TimeOrder { .. } | StepError::Backlog { .. }, .. }) => {
                assert_eq!(before, (live.track().events, live.track().t), "a refused event moved the filter");
            }
            Err(_) => failures += 1,
        }
        judge(&live);
        if channel == Channel::Output || u.ratio(1, 4)? {
            t += if u.ratio(7, 8)? { 6e-4 } else { size(u, 1e-3)? };
        }
    }
    let _ = live.finish(|_| ());
    judge(&live);
    Ok(())
}
