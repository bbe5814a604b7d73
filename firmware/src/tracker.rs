//! The filter as a device holds it: one call per output, with the encoder's reading where there is one.

use ekf_core::Order;
use ekf_core::structured::acceleration::{AccelerationModel, InverseCubic};
use ekf_core::structured::aci::StepIntegrals;
use ekf_core::structured::aci_ud::AciFactored;
use ekf_core::structured::number::Real;
use ekf_core::structured::row::Plain;

use crate::record::DT;

/// Density of the output's noise, (m/s²)²/Hz.
const DENSITY: f64 = 1e-4 * DT;
/// Variance of a reading, m².
const VARIANCE: f64 = 1e-12;
/// Standard deviations before the first sample: p, v, k, K0, K2, K3, SI.
const PRIOR: [f64; 6] = [1e-5, 1.0, 0.05, 0.5, 0.01, 0.001];

/// ACI with the inverse cubic sensor, `P = U D U'`, in whatever precision `T` has.
pub struct Tracker<T> {
    /// The estimate.
    pub filter: AciFactored<T, 6, 4>,
    before: T,
}

impl<T: Real> Tracker<T> {
    /// Initial state: at rest at zero, with the variance of the prior; `output` is the first sample, m/s².
    pub fn new(output: T) -> Self {
        let zero = output.like(0.0);
        let variance = |i: usize| output.like(PRIOR.get(i).map_or(0.0, |sigma| sigma * sigma));
        Self { filter: AciFactored::new(|_| zero, |_, _| zero, variance), before: output }
    }

    /// One sample on, to `output` in m/s²; `position` in m if the encoder was read.
    #[inline(always)]
    pub fn step(&mut self, output: T, position: Option<T>) {
        self.predict(output);
        if let Some(z) = position {
            let R = z.like(VARIANCE);
            let innovation = self.filter.innovate(z, R);
            self.filter.correct(R, &innovation);
        }
    }

    /// The mean of the last output and this one drives the step.
    #[inline(always)]
    fn predict(&mut self, output: T) {
        let between = output.like(0.5) * (self.before + output);
        self.before = output;
        let P_theta = [Plain([output.like(0.0); 4]); 4]; // only the second order looks at it
        let table = AccelerationModel::<_, 4>::table(&InverseCubic, &self.filter.theta, &P_theta, Order::First);
        if let Ok(at) = AccelerationModel::<_, 4>::at(&InverseCubic, &table, between) {
            self.filter.predict(output.like(DT), &StepIntegrals::held(DT, output.like(DENSITY), &at));
        }
    }
}
