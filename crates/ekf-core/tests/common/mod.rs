//! What the comparisons share: drawn settings, priors, and the distance of two beliefs in standard deviations.
#![allow(dead_code)] // every test binary uses a part of it

use ekf_core::dense::update::{correct, innovate};
use ekf_core::{Belief, GaussMarkov, Integrator, Order, dense::system::System};
use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;

/// Time between two output samples, s.
pub const DT: f64 = 1.0 / 1667.0;

/// Cases a property is tried on: 24, or 600 with `ACCELCAL_HYPOTHESIS=long`, as in Python.
pub fn cases() -> u32 {
    if std::env::var("ACCELCAL_HYPOTHESIS").is_ok_and(|value| value == "long") { 600 } else { 24 }
}

/// Uniform on [-1, 1], from a counter: every number of a test can be drawn again.
pub struct Draw(pub u64);

impl Draw {
    pub fn next(&mut self) -> f64 {
        // splitmix64
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// A prior with standard deviations `sigma` and correlations of any sign.
pub fn prior<const N: usize>(draw: &mut Draw, sigma: [f64; N], mean: [f64; N]) -> Belief<N> {
    let B = SMatrix::<f64, N, N>::from_fn(|i, j| if i == j { 1.5 } else { 0.4 * draw.next() });
    let C = B * B.transpose();
    let P = SMatrix::<f64, N, N>::from_fn(|i, j| C[(i, j)] / (C[(i, i)] * C[(j, j)]).sqrt() * sigma[i] * sigma[j]);
    let x = SVector::from_fn(|i, _| mean[i] + sigma[i] * draw.next());
    Belief { x, P: (P + P.transpose()) * 0.5 }
}

/// Largest difference of means in sigma and of covariances in `sigma_i sigma_j`.
pub fn distance<const N: usize>(dense: &Belief<N>, x: impl Fn(usize) -> f64, P: impl Fn(usize, usize) -> f64) -> f64 {
    let sigma = |i: usize| dense.P[(i, i)].sqrt();
    let mut worst = 0.0_f64;
    for i in 0..N {
        let off = (x(i) - dense.x[i]).abs() / sigma(i);
        worst = if off.is_nan() { f64::NAN } else { worst.max(off) };
        for j in 0..N {
            let off = (P(i, j) - dense.P[(i, j)]).abs() / (sigma(i) * sigma(j));
            assert!(!off.is_nan());
            worst = worst.max(off);
        }
    }
    worst
}

pub fn integrators() -> impl Strategy<Value = Integrator> {
    prop_oneof![Just(Integrator::Rk2), Just(Integrator::Rk4), Just(Integrator::Exact)]
}

pub fn orders() -> impl Strategy<Value = Order> {
    prop_oneof![Just(Order::First), Just(Order::Second)]
}

/// Constants, random walks or Gauss-Markov processes, as fast as the test can tell apart.
pub fn drawn_processes(draw: &mut Draw, kind: u8, scale: &[f64]) -> Vec<GaussMarkov> {
    scale
        .iter()
        .map(|scale| match kind {
            0 => GaussMarkov::CONSTANT,
            1 => GaussMarkov { rate: 0.0, q: scale * scale * (1.5 + draw.next()) },
            _ => GaussMarkov { rate: 1.0 + draw.next(), q: scale * scale * (1.5 + draw.next()) },
        })
        .collect()
}

/// The dense filter takes a position in.
pub fn read<const N: usize, S: System<N>>(system: &S, belief: &Belief<N>, R: f64, z: f64) -> Belief<N> {
    let reading = system.position(&belief.x);
    let (innovation, gain) = innovate(belief, &reading, R, z).unwrap();
    correct(belief, &reading, R, &innovation, &gain)
}
