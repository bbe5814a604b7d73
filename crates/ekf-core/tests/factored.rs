//! The portable factored filter against the dense factored one, and single against double precision.
#![allow(non_snake_case)] // as in the crate

mod common;

use common::{DT, Draw, distance, orders, prior, read};
use ekf_core::aci_block::Push;
use ekf_core::aci_factored::AciFactored;
use ekf_core::effect::{Effect, InverseCubic};
use ekf_core::factored::factorise;
use ekf_core::number::Real;
use ekf_core::row::Plain;
use ekf_core::system::Drive;
use ekf_core::{Aci, Belief, Form, Integrator, Order, Segment, Sensor, Wander};
use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;

const R: f64 = 1e-12;
const Q: f64 = 1e-6;

fn from_belief<T: Real>(belief: &Belief<6>, of: impl Fn(f64) -> T) -> AciFactored<T, 6, 4> {
    let (U, D) = factorise(&belief.P).unwrap();
    AciFactored::new(|i| of(belief.x[i]), |i, j| of(U[(i, j)]), |i| of(D[i]))
}

/// One step under a straight output, the second-order term from `spread`.
fn step<T: Real>(filter: &mut AciFactored<T, 6, 4>, integrator: Integrator, order: Order, from: T, slope: T) {
    let spread: [_; 4] = core::array::from_fn(|i| Plain(core::array::from_fn(|j| filter.P(i + 2, j + 2))));
    let table = Effect::<_, 4>::table(&InverseCubic, &filter.theta, &spread, order);
    let input = |s: f64| from + slope * from.like(s);
    let push = Push::over::<_, 4>(integrator, DT, from.like(Q), &InverseCubic, &table, input).unwrap();
    filter.predict(from.like(DT), &push);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(64) })]

    #[test]
    fn the_portable_filter_equals_the_dense_factored_one(
        seed in any::<u64>(),
        order in orders(),
        integrator in prop_oneof![Just(Integrator::Rk4), Just(Integrator::Exact)],
    ) {
        let mut draw = Draw(seed);
        let system = Aci { sensor: Sensor { form: Form::Inverse, wander: [Wander::CONSTANT; 4] }, q: Q, tau: 0.0 };
        let sigma = [1e-5, 3e-3, 1e-2, 0.1, 1e-3, 1e-4];
        let mut dense = prior::<6>(&mut draw, sigma, [0.0; 6]);
        let mut filter = from_belief(&dense, |x| x);
        for _ in 0..60 {
            let c = [8.0 * draw.next(), 500.0 * draw.next(), 0.0, 0.0];
            let drive = Drive { segment: Segment { c }, from: 0.0, to: DT };
            // Mean and Phi of the integrator, Q exact: as the dense filter does with its factors.
            let moved = integrator.transition(&system, &dense, &drive, order).unwrap();
            let P = moved.Phi * dense.P * moved.Phi.transpose() + moved.Q;
            dense = Belief { x: moved.x, P: (P + P.transpose()) * 0.5 };
            step(&mut filter, integrator, order, c[0], c[1]);
            if draw.next() > 0.0 {
                let z = dense.x[0] + 1e-6 * draw.next();
                dense = read(&system, &dense, R, z);
                filter.correct(R, &filter.innovate(z, R));
            }
        }
        let x = [filter.p, filter.v, filter.theta.0[0], filter.theta.0[1], filter.theta.0[2], filter.theta.0[3]];
        let off = distance(&dense, |i| x[i], |i, j| filter.P(i, j));
        prop_assert!(off < 1e-10, "{}", off); // two ways to round, 60 steps
    }
}

#[test]
fn a_held_push_is_the_exact_one_and_lacks_the_lever_of_a_slope() {
    let theta = Plain([0.02, 0.1, 1e-3, 1e-4]);
    let table = Effect::<_, 4>::table(&InverseCubic, &theta, &[Plain([0.0; 4]); 4], Order::First);
    let (u, slope) = (3.0, 200.0);
    let exact = |slope: f64| {
        let input = |s: f64| u + slope * (s - 0.5 * DT);
        Push::over::<_, 4>(Integrator::Exact, DT, Q, &InverseCubic, &table, input).unwrap()
    };
    let at = Effect::<_, 4>::at(&InverseCubic, &table, u).unwrap();
    let held = Push::held(DT, Q, &at);
    let same = |x: f64, y: f64| assert!((x - y).abs() <= 1e-14 * y.abs(), "{x} {y}"); // ten products and sums
    let still = exact(0.0);
    same(held.dp, still.dp);
    same(held.dv, still.dv);
    for i in 0..4 {
        same(held.to_p.0[i], still.to_p.0[i]);
        same(held.to_v.0[i], still.to_v.0[i]);
    }
    for i in 0..3 {
        same(held.Q[i], still.Q[i]);
    }

    let lever = held.dp - exact(slope).dp;
    let expected = at.slope * slope * DT.powi(3) / 12.0;
    assert!((lever / expected - 1.0).abs() < 1e-3, "{lever} {expected}"); // the sensor bends by 1e-4 over the step
}

/// Runs both precisions side by side over a motion of two tones; the worst distance in sigma after the first tenth.
#[allow(clippy::cast_possible_truncation)] // single precision is the subject
fn worst_distance(steps: usize, variance: f64) -> f64 {
    let mut P = SMatrix::<f64, 6, 6>::zeros();
    let scale = [1.0, 1.0, 1e-2, 1e-4];
    P[(0, 0)] = 1e-10;
    P[(1, 1)] = 1e-2;
    for (i, scale) in scale.iter().enumerate() {
        P[(i + 2, i + 2)] = variance * scale;
    }
    let belief = Belief { x: SVector::zeros(), P };
    let mut double = from_belief(&belief, |x| x);
    let mut single = from_belief(&belief, |x| x as f32);
    let mut draw = Draw(7);
    let tones = [(5.0, 2.0 * core::f64::consts::PI * 1.3), (3.0, 2.0 * core::f64::consts::PI * 3.1)];
    let acceleration = |t: f64| tones.iter().map(|(a, w)| a * (w * t).sin()).sum::<f64>();
    let position = |t: f64| tones.iter().map(|(a, w)| -a / (w * w) * (w * t).sin()).sum::<f64>();
    let output = |t: f64| 0.05 + acceleration(t) / 0.99;
    double.v = tones.iter().map(|(a, w)| -a / w).sum();
    single.v = double.v as f32;
    let mut worst = 0.0_f64;
    for i in 0..steps {
        let (now, then) = (i as f64 * DT, (i + 1) as f64 * DT);
        let (from, to) = (output(now) + 0.01 * draw.next(), output(then));
        let slope = (to - from) / DT;
        step(&mut double, Integrator::Rk4, Order::First, from, slope);
        step(&mut single, Integrator::Rk4, Order::First, from as f32, slope as f32);
        if i % 2 == 1 {
            let z = position(then) + 1e-6 * draw.next();
            double.correct(R, &double.innovate(z, R));
            single.correct(R as f32, &single.innovate(z as f32, R as f32));
        }
        assert!(single.d.iter().chain(&single.D.0).all(|pivot| *pivot > 0.0));
        if i > steps / 10 {
            for j in 0..4 {
                let off = (f64::from(single.theta.0[j]) - double.theta.0[j]).abs();
                worst = worst.max(off / double.P(j + 2, j + 2).sqrt());
            }
        }
    }
    worst
}

#[test]
fn single_precision_stays_near_double_precision() {
    for variance in [1.0, 1e-2, 1e-4] {
        let worst = worst_distance(100_000, variance);
        println!("prior {variance:e}: {worst:.3} sigma over 1e5 steps");
        assert!(worst < 0.15); // a seventh of what the filter does not know
    }
}

#[test]
#[ignore = "ten minutes of record; make test-long"]
fn single_precision_stays_near_double_precision_over_ten_minutes() {
    for variance in [1.0, 1e-2, 1e-4] {
        let worst = worst_distance(1_000_000, variance);
        println!("prior {variance:e}: {worst:.3} sigma over 1e6 steps");
        assert!(worst < 0.15);
    }
}
