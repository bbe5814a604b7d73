//! A filter at a fixed rate in single precision, one call per sample, as an interrupt of a microcontroller would make it.
//!
//! Everything but the simulated stage and the printing is `no_std` and allocates nothing: `crates/ekf-core` with
//! `default-features = false, features = ["f32"]`. States: p, v, k, K0.
#![allow(non_snake_case)] // as in the paper
#![allow(clippy::cast_possible_truncation)] // the stage moves in double precision

use ekf_core::structured::acceleration::{AccelerationModel, ForwardLinear};
use ekf_core::structured::aci::StepIntegrals;
use ekf_core::structured::aci_ud::AciFactored;
use ekf_core::structured::row::Plain;
use ekf_core::{DomainError, Order};

/// Time between two samples, s.
const DT: f64 = 1.0 / 1667.0;
/// Two-sided density of the output's noise, (m/s²)²/Hz.
const DENSITY: f32 = 1e-6;
/// Variance of a position, m².
const VARIANCE: f32 = 1e-12;
/// Standard deviations of p, v, k, K0 before the first sample, SI.
const PRIOR: [f32; 4] = [1e-5, 1.0, 0.05, 0.5];

struct Tracker {
    filter: AciFactored<f32, 4, 2>,
    before: f32,
}

impl Tracker {
    /// At rest at zero; `output` is the first sample, m/s².
    fn new(output: f32) -> Self {
        let filter = AciFactored::new(|_| 0.0, |_, _| 0.0, |i| PRIOR[i] * PRIOR[i]);
        Self { filter, before: output }
    }

    /// One sample on: the mean of two outputs drives the step, a position corrects where there is one. In the place of what
    /// is no number the output before it is held, and nothing is read: it would stay in the estimate for ever.
    fn step(&mut self, output: f32, position: Option<f32>) -> Result<(), DomainError> {
        let output = if output.is_finite() { output } else { self.before };
        let between = 0.5 * (self.before + output);
        self.before = output;
        let unused = [Plain([0.0; 2]); 2]; // the covariance of the parameters counts in second order only
        let table = ForwardLinear.table(&self.filter.theta, &unused, Order::First);
        let at = AccelerationModel::<_, 2>::at(&ForwardLinear, &table, between)?;
        self.filter.predict(DT as f32, &StepIntegrals::held(DT, DENSITY, &at));
        if let Some(z) = position.filter(|z| z.is_finite()) {
            let innovation = self.filter.innovate(z, VARIANCE);
            self.filter.correct(VARIANCE, &innovation);
        }
        Ok(())
    }
}

fn main() -> Result<(), DomainError> {
    // ±8 m/s² at 20 rad/s, k = 0.02, K0 = 0.1 m/s²; the encoder answers every second sample. Faster than that, the mean of
    // two outputs costs a scale factor of (rate DT)²/6: 6e-4 at 100 rad/s.
    let (k, K0, rate) = (0.02, 0.1, 20.0);
    let phase = |i: u32| rate * DT * f64::from(i);
    let output = |i: u32| (K0 + (1.0 + k) * 8.0 * phase(i).cos()) as f32;
    let mut tracker = Tracker::new(output(0));
    for i in 1..=16_670 {
        let position = (i % 2 == 0).then(|| (8.0 / (rate * rate) * (1.0 - phase(i).cos())) as f32);
        tracker.step(output(i), position)?;
    }
    let Tracker { filter, .. } = tracker;
    if let Err(error) = filter.checked() {
        println!("begin anew: {error}"); // on a device once in a while
    }
    let sigma = |i: usize| filter.P(i, i).sqrt();
    println!(
        "after 10 s: k = {:.5}({:.5}), K0 = {:.5}({:.5}) m/s²",
        filter.theta.0[0],
        sigma(2),
        filter.theta.0[1],
        sigma(3)
    );
    Ok(())
}
