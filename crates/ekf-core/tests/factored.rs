//! The portable factored filter against the dense factored one, and single against double precision.
#![allow(non_snake_case)] // as in the crate

mod common;

use common::{DT, Draw, cases, distance, orders, prior, read};
use ekf_core::dense::system::Drive;
use ekf_core::dense::ud::factorise;
use ekf_core::structured::acceleration::{
    AccelerationModel, Driven, ForwardCubic, InverseCubic, InverseLinear, MixedPartials, WithEffects,
};
use ekf_core::structured::aci::{AciBlock, StepIntegrals};
use ekf_core::structured::aci_step::StepInput;
use ekf_core::structured::aci_ud::AciFactored;
use ekf_core::structured::errors_in_variables::{AciCorrected, Correction};
use ekf_core::structured::gauss_markov::GaussMarkovSet;
use ekf_core::structured::number::Real;
use ekf_core::structured::row::Plain;
use ekf_core::structured::taps::Taps;
use ekf_core::structured::watch::{Passage, STARTS, Suspect, SuspectColumn, Watch, posterior};
use ekf_core::{
    Aci, Belief, Carrier, Engine, Filter, Form, GaussMarkov, InBlocks, Integrator, Interpolation, Order, Segment,
    Sensor, SetupError,
};
use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;
use std::array::from_fn;

const R: f64 = 1e-12;
const Q: f64 = 1e-6;

fn from_belief<T: Real, const N: usize, const M: usize>(
    belief: &Belief<N>,
    of: impl Fn(f64) -> T,
) -> AciFactored<T, N, M> {
    let (U, D) = factorise(&belief.P).unwrap();
    AciFactored::new(|i| of(belief.x[i]), |i, j| of(U[(i, j)]), |i| of(D[i]))
}

/// One step under a straight output, the second-order term from `spread`.
fn step<T: Real>(filter: &mut AciFactored<T, 6, 4>, integrator: Integrator, order: Order, from: T, slope: T) {
    let P_theta: [_; 4] = core::array::from_fn(|i| Plain(core::array::from_fn(|j| filter.P(i + 2, j + 2))));
    let table = AccelerationModel::<_, 4>::table(&InverseCubic, &filter.theta, &P_theta, order);
    let input = |s: f64| from + slope * from.like(s);
    let push = StepIntegrals::over::<_, 4>(integrator, DT, from.like(Q), &InverseCubic, &table, input).unwrap();
    filter.predict(from.like(DT), &push);
}

#[test]
fn a_sample_that_is_no_number_is_seen_in_single_precision() {
    let start = Belief::independent([0.0; 6], [1e-5, 3e-3, 1e-2, 0.1, 1e-3, 1e-4]);
    #[allow(clippy::cast_possible_truncation)] // single precision is intended
    let mut filter = from_belief::<f32, 6, 4>(&start, |x| x as f32);
    step(&mut filter, Integrator::Exact, Order::First, 1.0, 0.0);
    assert_eq!(filter.checked(), Ok(()));
    step(&mut filter, Integrator::Exact, Order::First, f32::NAN, 0.0);
    assert!(filter.checked().is_err());
}

/// Where every name of the crate is in scope, a filter's belief is still one thing.
mod everything {
    #[allow(clippy::wildcard_imports)] // as a user may
    use ekf_core::*;

    #[test]
    fn no_two_traits_of_the_crate_share_a_method() {
        let filter = Filter::new(Aci { sensor: Sensor::constant(Form::Forward), q: super::Q, tau: 0.0 }, super::R, 0.0);
        let start = Belief::independent([0.0; 4], [1e-5, 3e-3, 1e-2, 0.1]);
        let state = filter.initial(&start).unwrap();
        assert_eq!(filter.belief(&state), start);
    }
}

#[test]
fn a_choice_that_the_kernel_lacks_is_refused() {
    let aci = Filter::new(Aci { sensor: Sensor::constant(Form::Forward), q: Q, tau: 0.0 }, R, 0.0);
    let start = Belief::independent([0.0; 4], [1e-5, 3e-3, 1e-2, 0.1]);
    assert!(InBlocks(aci).initial(&start).is_ok());
    let factored = InBlocks(Filter { carrier: Carrier::Factored, ..aci });
    assert_eq!(factored.initial(&start), Err(SetupError::NoKernel));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(cases()) })]

    #[test]
    fn the_portable_filter_equals_the_dense_factored_one(
        seed in any::<u64>(),
        order in orders(),
        integrator in prop_oneof![Just(Integrator::Rk4), Just(Integrator::Exact)],
    ) {
        let mut draw = Draw(seed);
        let system = Aci { sensor: Sensor { form: Form::Inverse, gauss_markov: [GaussMarkov::CONSTANT; 4] }, q: Q, tau: 0.0 };
        let sigma = [1e-5, 3e-3, 1e-2, 0.1, 1e-3, 1e-4];
        let mut dense = prior::<6>(&mut draw, sigma, [0.0; 6]);
        let mut filter = from_belief::<f64, 6, 4>(&dense, |x| x);
        for _ in 0..60 {
            let c = [8.0 * draw.next(), 500.0 * draw.next(), 0.0, 0.0];
            let drive = Drive::held(Segment { c }, 0.0, DT);
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
    let table = AccelerationModel::<_, 4>::table(&InverseCubic, &theta, &[Plain([0.0; 4]); 4], Order::First);
    let (u, slope) = (3.0, 200.0);
    let exact = |slope: f64| {
        let input = |s: f64| u + slope * (s - 0.5 * DT);
        StepIntegrals::over::<_, 4>(Integrator::Exact, DT, Q, &InverseCubic, &table, input).unwrap()
    };
    let at = AccelerationModel::<_, 4>::at(&InverseCubic, &table, u).unwrap();
    let held = StepIntegrals::held(DT, Q, &at);
    let same = |x: f64, y: f64| assert!((x - y).abs() <= 1e-14 * y.abs(), "{x} {y}"); // ten products and sums
    let is_constant = exact(0.0);
    same(held.dp, is_constant.dp);
    same(held.dv, is_constant.dv);
    for i in 0..4 {
        same(held.to_p.0[i], is_constant.to_p.0[i]);
        same(held.to_v.0[i], is_constant.to_v.0[i]);
    }
    for i in 0..3 {
        same(held.Q[i], is_constant.Q[i]);
    }

    let lever = held.dp - exact(slope).dp;
    let expected = at.slope * slope * DT.powi(3) / 12.0;
    assert!((lever / expected - 1.0).abs() < 1e-3, "{lever} {expected}"); // the sensor bends by 1e-4 over the step
}

/// The motion of the long runs: two tones, seen by a sensor with a bias, a scale error and noise.
struct Motion;

impl Motion {
    const TONES: [(f64, f64); 2] = [(5.0, 2.0 * core::f64::consts::PI * 1.3), (3.0, 2.0 * core::f64::consts::PI * 3.1)];

    fn acceleration(t: f64) -> f64 {
        Self::TONES.iter().map(|(a, w)| a * (w * t).sin()).sum()
    }

    fn velocity(t: f64) -> f64 {
        Self::TONES.iter().map(|(a, w)| -a / w * (w * t).cos()).sum()
    }

    fn position(t: f64) -> f64 {
        Self::TONES.iter().map(|(a, w)| -a / (w * w) * (w * t).sin()).sum()
    }

    fn output(t: f64) -> f64 {
        0.05 + Self::acceleration(t) / 0.99
    }

    /// What up to four effects add per unit: `a^2`, `a^3`, `10 v`, and a slow drift.
    fn effect(i: usize, t: f64) -> f64 {
        let a = Self::acceleration(t);
        [a * a, a * a * a, 10.0 * Self::velocity(t), (0.01 * t).sin()][i]
    }
}

/// Diagonal prior whose parameters have variances around `variance`.
fn diagonal<const N: usize>(variance: f64) -> Belief<N> {
    let scale = [1.0, 1.0, 1e-2, 1e-4, 1e-2, 1.0];
    let P = SMatrix::from_fn(|i, j| match i {
        _ if i != j => 0.0,
        0 => 1e-10,
        1 => 1e-2,
        i => variance * scale[i - 2],
    });
    Belief { x: SVector::from_fn(|i, _| if i == 1 { Motion::velocity(0.0) } else { 0.0 }), P }
}

/// One precision of a filter with `M - 2` effects.
fn stepped<T: Real, const N: usize, const M: usize>(filter: &mut AciFactored<T, N, M>, i: usize, u: [f64; 2]) {
    let witness = filter.p;
    let P_theta: [_; M] = core::array::from_fn(|i| Plain(core::array::from_fn(|j| filter.P(i + 2, j + 2))));
    let sensor = WithEffects { rest: 0.0 };
    let table = AccelerationModel::<_, M>::table(&sensor, &filter.theta, &P_theta, Order::First);
    let input = |s: f64| {
        let t = i as f64 * DT + s;
        let effect = |i: usize| witness.like(if i < 2 { 0.0 } else { Motion::effect(i - 2, t) });
        Driven { u: witness.like(u[0] + (u[1] - u[0]) / DT * s), columns: Plain(core::array::from_fn(effect)) }
    };
    let push = StepIntegrals::over::<_, M>(Integrator::Rk4, DT, witness.like(Q), &sensor, &table, input).unwrap();
    filter.predict(witness.like(DT), &push);
}

/// Runs both precisions side by side; the worst distance in sigma after the first tenth.
#[allow(clippy::cast_possible_truncation)] // single precision is the subject
fn worst_distance<const N: usize, const M: usize>(steps: usize, variance: f64) -> f64 {
    let belief = diagonal::<N>(variance);
    let mut double = from_belief::<f64, N, M>(&belief, |x| x);
    let mut single = from_belief::<f32, N, M>(&belief, |x| x as f32);
    let mut draw = Draw(7);
    let mut worst = 0.0_f64;
    for i in 0..steps {
        let (now, then) = (i as f64 * DT, (i + 1) as f64 * DT);
        let u = [Motion::output(now) + 0.01 * draw.next(), Motion::output(then)];
        stepped(&mut double, i, u);
        stepped(&mut single, i, u);
        if i % 2 == 1 {
            let z = Motion::position(then) + 1e-6 * draw.next();
            double.correct(R, &double.innovate(z, R));
            single.correct(R as f32, &single.innovate(z as f32, R as f32));
        }
        assert!(single.d.iter().chain(&single.D.0).all(|pivot| *pivot > 0.0));
        assert!(double.d.iter().chain(&double.D.0).all(|pivot| *pivot > 0.0));
        if i > steps / 10 {
            for j in 0..M {
                let off = (f64::from(single.theta.0[j]) - double.theta.0[j]).abs();
                worst = worst.max(off / double.P(j + 2, j + 2).sqrt());
            }
        }
    }
    worst
}

/// Four to eight states, priors from diffuse to sharp.
fn single_precision_stays_near(steps: usize) {
    for variance in [1.0, 1e-2, 1e-4] {
        let actual = [
            worst_distance::<4, 2>(steps, variance),
            worst_distance::<5, 3>(steps, variance),
            worst_distance::<6, 4>(steps, variance),
            worst_distance::<7, 5>(steps, variance),
            worst_distance::<8, 6>(steps, variance),
        ];
        println!("prior {variance:e}, 4 to 8 states: {actual:.3?} sigma over {steps} steps");
        assert!(actual.iter().all(|worst| *worst < 0.1), "{actual:?}"); // a tenth of what the filter does not know
    }
}

/// The covariance form in double precision, the same motion: every step must leave a covariance.
fn variances_stay_positive<const N: usize, const M: usize>(steps: usize) {
    let drift = GaussMarkovSet::new(0.0, [GaussMarkov::CONSTANT; M]);
    for integrator in [Integrator::Rk4, Integrator::Exact] {
        for variance in [1.0, 1e-2, 1e-4] {
            let belief = diagonal::<N>(variance);
            let mut block = AciBlock::<Plain<f64, M>, M>::new(|i| belief.x[i], |i, j| belief.P[(i, j)]);
            let mut draw = Draw(7);
            for i in 0..steps {
                let (now, then) = (i as f64 * DT, (i + 1) as f64 * DT);
                let (from, to) = (Motion::output(now) + 0.01 * draw.next(), Motion::output(then));
                let input = |s: f64| {
                    let effect = |i: usize| if i < 2 { 0.0 } else { Motion::effect(i - 2, now + s) };
                    Driven { u: from + (to - from) / DT * s, columns: Plain(core::array::from_fn(effect)) }
                };
                let step_input = StepInput { model: WithEffects { rest: 0.0 }, order: Order::First, input, dt: DT };
                block.step(integrator, Q, &drift, &step_input).unwrap();
                if i % 2 == 1 {
                    let z = Motion::position(then) + 1e-6 * draw.next();
                    block.correct(0.0, R, &block.innovate(0.0, z, R));
                }
                assert_eq!(block.checked(), Ok(()), "{integrator:?}, prior {variance:e}, step {i}");
                assert!((0..N).all(|i| block.P(i, i) > 0.0), "{integrator:?}, prior {variance:e}, step {i}");
            }
        }
    }
}

#[test]
fn single_precision_stays_near_double_precision() {
    single_precision_stays_near(30_000);
}

#[test]
fn variances_stay_positive_in_double_precision() {
    variances_stay_positive::<4, 2>(30_000);
    variances_stay_positive::<8, 6>(30_000);
}

#[test]
#[ignore = "ten minutes of record; make test-long"]
fn single_precision_stays_near_double_precision_over_ten_minutes() {
    single_precision_stays_near(1_000_000);
}

#[test]
#[ignore = "ten minutes of record; make test-long"]
fn variances_stay_positive_in_double_precision_over_ten_minutes() {
    variances_stay_positive::<4, 2>(1_000_000);
    variances_stay_positive::<6, 4>(1_000_000);
    variances_stay_positive::<8, 6>(1_000_000);
}

/// What a filter with the correction knows after a record of a noisy sensor, in one precision.
fn corrected<T: Real>(steps: usize, witness: T, taps: Option<&Taps>) -> AciCorrected<T, 4, 2> {
    watched(steps, witness, taps, 0.0, None)
}

/// What is done behind a step: its number, and what it did to errors of the mean.
type AfterStep<'a, T> = &'a mut dyn FnMut(usize, &Passage<T, 2>);

/// The same of an output that drifts by `rate` m/s^3, with a watch for drifts beside it.
fn watched<T: Real>(
    steps: usize,
    witness: T,
    taps: Option<&Taps>,
    rate: f64,
    mut watch: Option<AfterStep<T>>,
) -> AciCorrected<T, 4, 2> {
    const NOISE: f64 = 1.0; // of one output, m/s^2
    let q = NOISE * NOISE * DT;
    let belief = diagonal::<4>(1e-2);
    let mut filter = AciCorrected::new(from_belief::<T, 4, 2>(&belief, |x| witness.like(x)));
    let drift = GaussMarkovSet::new(witness, [GaussMarkov::CONSTANT; 2]);
    let mut draw = Draw(11);
    let mut gauss = || (0..12).map(|_| 0.5 * draw.next()).sum::<f64>(); // uniform on [-1, 1]: variance 12/12
    let mut from = Motion::output(0.0);
    let correction = if taps.is_some() { Correction::EstimateAndScores } else { Correction::None };
    filter.passage = watch.is_some().then(|| Passage::none(witness));
    for i in 0..steps {
        let now = (i + 1) as f64 * DT;
        let to = Motion::output(now) + NOISE * gauss() + rate * now;
        let z = Motion::position(now) + 1e-6 * gauss();
        let input = |s: f64| witness.like(from + (to - from) / DT * s);
        let step_input = StepInput { model: InverseLinear, order: Order::First, input, dt: DT };
        filter.exact(witness.like(q), &drift, &step_input, taps.map(|taps| (taps, DT))).unwrap();
        filter.passed();
        let (zero, variance) = (witness.like(0.0), witness.like(1e-12));
        let (innovation, reading) =
            filter.filter.innovate_with_effects(zero, &Plain([zero; 2]), witness.like(z), variance);
        filter.correct_with(zero, variance, &reading, &innovation, correction);
        if let (Some(watch), Some(passage)) = (&mut watch, &filter.passage) {
            watch(i, passage);
        }
        from = to;
    }
    filter
}

fn drift(i: usize) -> SuspectColumn<f64> {
    SuspectColumn { over: [0.0, 0.5, 1.0].map(|share| (i as f64 + share) * DT), position: 0.0, slope: 0.0 }
}

/// The watch's two hypotheses from two suspects: one of all steps, one of the steps since the newest start.
#[test]
fn a_watch_weighs_what_has_always_been_and_what_began_lately() {
    let taps = Taps::even(Interpolation::Linear, true);
    let (steps, least, scale) = (30_000, 20_000, 1.0);
    let mut watch = Watch::new([Suspect::<f64, 2>::new(0.0, scale)], least);
    let mut later = Watch::new([Suspect::<f64, 2>::new(0.0, scale)], u64::MAX);
    watched(
        steps,
        0.0,
        Some(&taps),
        0.0,
        Some(&mut |i, passage| {
            watch.advance(passage, |_| drift(i), |x| x);
            if i as u64 >= least {
                later.advance(passage, |_| drift(i), |x| x);
            }
            assert_eq!(watch.steps(), i as u64 + 1);
        }),
    );
    let [always, lately] = [&watch, &later].map(|watch| {
        let [b, G] = watch.suspects[0].sums();
        posterior(b, G, scale)
    });
    let evidence = watch.evidence(0, |x| x).unwrap();
    let expected = (0.5 * always.0.exp() + 0.5 / f64::from(STARTS) * lately.0.exp()).ln();
    assert!((evidence.log_e - expected).abs() < 1e-9, "{} is not {expected}", evidence.log_e);
    assert!((evidence.size - always.1).abs() < 1e-12 && evidence.since == 0, "{evidence:?}");
    assert_eq!(watch.evidence(1, |x: f64| x), None);
}

/// A drift that the filter lacks: its size within 4.5 standard deviations (one normal number: 7e-6), and beyond doubt.
#[test]
fn a_watch_measures_what_the_filter_lacks() {
    let taps = Taps::even(Interpolation::Linear, true);
    let says = |rate: f64| {
        let mut watch = Watch::new([Suspect::<f64, 2>::new(0.0, 0.01)], u64::MAX);
        let mut step = |i: usize, passage: &Passage<f64, 2>| watch.advance(passage, |_| drift(i), |x| x);
        watched(40_000, 0.0, Some(&taps), rate, Some(&mut step));
        watch.evidence(0, |x| x).unwrap()
    };
    let (none, planted) = (says(0.0), says(0.05));
    println!("{none:?}\n{planted:?}");
    assert!(none.log_e < 3.0 && (none.size / none.std).abs() < 4.5, "{none:?}");
    assert!(planted.log_e > 10.0 && ((planted.size - 0.05) / planted.std).abs() < 4.5, "{planted:?}");
}

#[test]
fn a_motion_that_begins_anew_forgets_what_an_effect_did_to_it() {
    let passage = Passage { dt: DT, ..Passage::none(0.0) };
    let mut moved = Suspect::<f64, 2>::new(0.0, 1.0);
    moved.advance(&passage, &drift(0));
    assert_ne!(moved, Suspect::new(0.0, 1.0));
    moved.interrupt();
    assert_eq!(moved, Suspect::new(0.0, 1.0)); // no reading: nothing of the parameters
}

fn corrected_precisions_agree(steps: usize) {
    let taps = Taps::even(Interpolation::Linear, true);
    let (double, single) = (corrected::<f64>(steps, 0.0, Some(&taps)), corrected::<f32>(steps, 0.0, Some(&taps)));
    for i in 2..4 {
        let sigma = double.filter.P(i, i).sqrt();
        let apart = (f64::from(single.filter.x(i)) - double.filter.x(i)) / sigma;
        println!("state {i}: {apart:.3} sigma of {sigma:.2e} apart after {steps} steps");
        assert!(apart.abs() < 0.1, "state {i}: {apart} sigma");
    }
    let off = |filter: &AciCorrected<f64, 4, 2>| (filter.filter.x(2) - 0.01) / filter.filter.P(2, 2).sqrt();
    let (with, without) = (off(&double), off(&corrected::<f64>(steps, 0.0, None)));
    println!("scale factor: {with:.2} sigma off, {without:.2} without the correction");
    assert!(with.abs() < 4.5 && without.abs() > 9.0); // one normal number: 7e-6
}

#[test]
fn the_correction_needs_no_double_precision() {
    corrected_precisions_agree(100_000);
}

#[test]
#[ignore = "ten minutes of record; make test-long"]
fn the_correction_needs_no_double_precision_over_a_million_steps() {
    corrected_precisions_agree(1_000_000);
}

/// `d2a/(du dtheta)` and `da/du` of a model against differences of its own gradient and acceleration.
fn mixed_partials_are_slopes<E: MixedPartials<Plain<f64, 4>, 4, Input = f64>>(model: E) {
    const H: f64 = 1e-4;
    let theta = Plain([0.02, 0.3, 2e-3, -4e-4]);
    let table = model.table(&theta, &[Plain([0.0; 4]); 4], Order::First);
    for u in [-7.0, -0.4, 0.3, 5.0] {
        let (mixed, slope) = model.mixed(&theta, u).unwrap();
        let [low, high] = [u - H, u + H].map(|u| model.at(&table, u).unwrap());
        let differences: [f64; 4] = from_fn(|i| (high.g.0[i] - low.g.0[i]) / (2.0 * H));
        for (value, difference) in mixed.0.iter().zip(differences) {
            assert!((value - difference).abs() < 1e-6 * (1.0 + difference.abs()), "{value} is not {difference} at {u}");
        }
        assert!((slope - (high.a - low.a) / (2.0 * H)).abs() < 1e-7, "{slope} at {u}");
    }
}

#[test]
fn noise_of_the_output_enters_the_gradient_by_the_mixed_partials() {
    mixed_partials_are_slopes(InverseLinear);
    mixed_partials_are_slopes(InverseCubic);
    mixed_partials_are_slopes(ForwardCubic);
}
