//! Filters at a fixed rate against runs of the core's filters over the same samples.
#![allow(non_snake_case)] // as in the crates

mod common;

use ekf_core::structured::acceleration::{Driven, WithEffects};
use ekf_core::structured::aci::AciBlock;
use ekf_core::structured::aci_step::StepInput;
use ekf_core::structured::gauss_markov::GaussMarkovSet;
use ekf_core::structured::row::Plain;
use ekf_core::{
    Aci, Belief, Carrier, Consider, Correction, Cwpa, Engine, Filter, Form, GaussMarkov, InBlocks, Integrator,
    Interpolation, Order, Samples, Segment, Sensor, SetupError, StepError, Structured, dense::system::System,
};
use ekf_simd::fixed_rate::filter::{FixedRate, Histories, aci, aci_with_effects, cwpa};
use ekf_simd::fixed_rate::step::{EffectColumns, SampleInput};
use ekf_simd::{Batch, InstructionSet, Prior, run_aci, run_cwpa};
use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;

const DT: f64 = 1.0 / 1667.0;
const STEPS: usize = 200;
/// State in sigma, covariance in `sigma_i sigma_j`: fused and plain arithmetic over 200 steps.
const TOLERANCE: f64 = 1e-10;

fn sigma(motion: usize, i: usize) -> f64 {
    match i {
        0 => 1e-5,
        1 => 3e-3,
        2 if motion == 3 => 10.0,
        i => [1e-2, 0.1, 1e-3, 1e-4].get(i - motion).copied().unwrap_or(1e-3),
    }
}

fn record(phase: f64) -> (Vec<f64>, Vec<f64>) {
    let noise = |j: usize| ((j as f64 * 12.9898 + phase).sin() * 43_758.545_3).fract() - 0.5;
    let w = 30.0;
    let at = |j: usize| w * j as f64 * DT + phase;
    let u = (0..STEPS).map(|j| 0.05 + 1.01 * 8.0 * at(j).sin() + 0.02 * noise(j)).collect();
    let z = (0..STEPS)
        .map(|j| if j % 2 == 0 { -8.0 / (w * w) * (at(j).sin() - phase.sin()) + 2e-6 * noise(j + 7) } else { f64::NAN })
        .collect();
    (u, z)
}

#[derive(Debug, Clone, Copy)]
struct Choice {
    phase: f64,
    form: Form,
    integrator: Integrator,
    order: Order,
    interpolation: Interpolation,
    gauss_markov: GaussMarkov,
    gate: f64,
}

fn choices() -> impl Strategy<Value = Choice> {
    (
        0.0..6.0,
        prop_oneof![Just(Form::Inverse), Just(Form::Forward)],
        prop_oneof![Just(Integrator::Rk4), Just(Integrator::Exact)],
        prop_oneof![Just(Order::First), Just(Order::Second)],
        prop_oneof![Just(Interpolation::Hold), Just(Interpolation::Linear), Just(Interpolation::Cubic)],
        prop_oneof![Just(GaussMarkov::CONSTANT), Just(GaussMarkov { rate: 0.5, q: 1e-8 })],
        prop_oneof![Just(f64::INFINITY), Just(4.0)],
    )
        .prop_map(|(phase, form, integrator, order, interpolation, gauss_markov, gate)| Choice {
            phase,
            form,
            integrator,
            order,
            interpolation,
            gauss_markov,
            gate,
        })
}

impl Choice {
    fn filter<S>(&self, system: S) -> Filter<S> {
        Filter {
            system,
            interpolation: self.interpolation,
            integrator: self.integrator,
            order: self.order,
            carrier: Carrier::Dense,
            consider: Consider::NONE,
            R_position: 1e-12,
            R_output: 1e-4,
            gate: self.gate,
        }
    }

    fn sensor(&self) -> Sensor {
        Sensor {
            form: self.form,
            gauss_markov: [self.gauss_markov, GaussMarkov::CONSTANT, GaussMarkov::CONSTANT, self.gauss_markov],
        }
    }
}

fn agrees<S: System<N>, const N: usize>(
    filter: &Filter<S>,
    motion: usize,
    phase: f64,
    make: impl Fn(Prior<'_>) -> Box<dyn FixedRate>,
) where
    Filter<S>: Structured<N>,
    Filter<S>: Copy,
{
    let (u, z) = record(phase);
    let variance = SVector::<f64, N>::from_fn(|i, _| sigma(motion, i).powi(2));
    let prior = Belief { x: SVector::zeros(), P: SMatrix::from_diagonal(&variance) };
    let times: Vec<f64> = (0..STEPS).map(|j| j as f64 * DT).collect();
    let (stamps, readings): (Vec<f64>, Vec<f64>) =
        times.iter().zip(&z).filter(|(_, z)| !z.is_nan()).map(|(t, z)| (*t, *z)).unzip();
    let track = InBlocks(*filter)
        .run(&prior, Samples { t: &times, y: &u }, Samples { t: &stamps, y: &readings }, |_, _| ())
        .unwrap();
    let expected = filter.belief_of(&track.state);

    let (x, P) = (prior.x.as_slice(), prior.P.as_slice());
    let mut steps = make(Prior { states: N, x, P });
    let mut one = make(Prior { states: N, x, P });
    let (mut states, mut innovations, mut first) = (vec![0.0; N * STEPS], vec![0.0; STEPS], vec![0.0; N + 1]);
    let mut histories = Histories {
        states: Some(&mut states),
        variances: Some(&mut first),
        innovations: Some(&mut innovations),
        ..Histories::default()
    };
    one.over(&u, &z, &mut histories).unwrap();
    assert!(first[0] > 0.0 && first[N] == 0.0);
    for j in 0..STEPS {
        let actual = steps.step(&SampleInput { u: u[j], z: z[j], effects: None, suspects: None }).unwrap();
        assert_eq!(actual.map_or(f64::NAN, |actual| actual.e).to_bits(), innovations[j].to_bits());
        for i in 0..N {
            assert_eq!(steps.x(i).to_bits(), states[N * j + i].to_bits());
        }
    }
    assert_eq!((steps.samples(), steps.rejected()), (STEPS, track.rejected));
    // A sum of one term per sample or less, which may itself be near zero.
    let off = (steps.log_likelihood() - track.log_likelihood) / track.log_likelihood.abs().max(STEPS as f64);
    assert!(off.abs() < TOLERANCE, "{off}");
    for i in 0..N {
        let deviation = |i: usize| expected.P[(i, i)].sqrt();
        assert!((steps.x(i) - expected.x[i]).abs() < TOLERANCE * deviation(i));
        for j in 0..N {
            let off = (steps.P(i, j) - expected.P[(i, j)]) / (deviation(i) * deviation(j));
            assert!(off.abs() < TOLERANCE, "{off}");
        }
    }
}

/// The padded, fused kernel with effects against the core's own row of exactly as many parameters.
fn effects_agree<const N: usize, const M: usize>(choice: Choice) {
    let (u, z) = record(choice.phase);
    let (rest, tau) = (0.3, if choice.phase < 3.0 { 0.0 } else { 1e-3 });
    let gauss_markov: [GaussMarkov; M] =
        std::array::from_fn(|i| if i % 2 == 0 { choice.gauss_markov } else { GaussMarkov::CONSTANT });
    let x = [0.0; N];
    let P: Vec<f64> = (0..N * N).map(|at| if at / N == at % N { sigma(2, at / N).powi(2) } else { 0.0 }).collect();
    let system = Aci { sensor: choice.sensor(), q: 1e-6, tau };
    let prior = Prior { states: N, x: &x, P: &P };
    let mut steps = aci_with_effects(&choice.filter(system), Correction::None, DT, rest, &gauss_markov, prior).unwrap();
    let mut block = AciBlock::<Plain<f64, M>, M>::new(|i| x[i], |i, j| P[i * N + j]);
    let drift = GaussMarkovSet::new(0.0, gauss_markov);
    let column = |i: usize, j: usize| ((i + 1) as f64 * 0.3 * j as f64).cos();
    let lean = |i: usize, j: usize| if i.is_multiple_of(2) { 1e-2 * column(i, j + 3) } else { 0.0 };
    let mut rejected = 0;
    for j in 0..STEPS {
        let at = |j: usize| -> Vec<f64> { (0..M - 2).map(|i| column(i, j)).collect() };
        let (before, middle, here) = (at(j.saturating_sub(1)), at(j + STEPS), at(j));
        let position_columns: Vec<f64> = (0..M - 2).map(|i| lean(i, j)).collect();
        let columns = EffectColumns { over: [&before, &middle, &here], position: &position_columns, slopes: &[] };
        steps.step(&SampleInput { u: u[j], z: z[j], effects: Some(&columns), suspects: None }).unwrap();

        if j > 0 {
            // The last four samples on a clock of their own; too few are a line.
            let first = j.saturating_sub(3);
            let stamps: Vec<f64> = (first..=j).map(|j| j as f64 * DT).collect();
            let segment = Segment::between(&stamps, &u[first..=j], j - 1 - first, choice.interpolation);
            let input = |s: f64| {
                // Lagrange on 0, 1/2, 1.
                let x = s / DT;
                let parabola = |[a, b, c]: [f64; 3]| {
                    a * (x - 0.5) * (x - 1.0) * 2.0 - b * x * (x - 1.0) * 4.0 + c * x * (x - 0.5) * 2.0
                };
                let between =
                    |i: usize| if i < 2 { 0.0 } else { parabola([before[i - 2], middle[i - 2], here[i - 2]]) };
                Driven { u: segment.value(s), columns: Plain(std::array::from_fn(between)) }
            };
            let step_input = StepInput { model: WithEffects { rest }, order: choice.order, input, dt: DT };
            block.step(choice.integrator, 1e-6, &drift, &step_input).unwrap();
        }
        if !z[j].is_nan() {
            let b = Plain(std::array::from_fn(|i| if i < 2 { 0.0 } else { position_columns[i - 2] }));
            let (innovation, along) = block.innovate_with_effects(tau, &b, z[j], 1e-12);
            if innovation.e * innovation.e / innovation.s <= choice.gate {
                block.correct_with(&along, &innovation);
            } else {
                rejected += 1;
            }
        }
    }
    assert_eq!(steps.rejected(), rejected);
    for i in 0..N {
        let deviation = |i: usize| block.P(i, i).sqrt();
        let off = (steps.x(i) - block.x(i)) / deviation(i);
        assert!(off.abs() < TOLERANCE, "{off}");
        for j in 0..N {
            let off = (steps.P(i, j) - block.P(i, j)) / (deviation(i) * deviation(j));
            assert!(off.abs() < TOLERANCE, "{off}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(common::cases()) })]

    #[test]
    fn a_fixed_rate_gives_what_a_record_gives(choice in choices()) {
        // A cubic of a record looks ahead; at a fixed rate it looks back, as the test below does.
        prop_assume!(choice.interpolation != Interpolation::Cubic);
        let driven = choice.filter(Aci { sensor: choice.sensor(), q: 1e-6, tau: 0.0 });
        agrees::<_, 4>(&driven, 2, choice.phase, |prior| aci(&driven, Correction::None, DT, prior).unwrap());
        agrees::<_, 6>(&driven, 2, choice.phase, |prior| aci(&driven, Correction::None, DT, prior).unwrap());
        let read = choice.filter(Cwpa { sensor: choice.sensor(), q: 1e3, low_pass: None });
        agrees::<_, 5>(&read, 3, choice.phase, |prior| cwpa(&read, DT, prior).unwrap());
        agrees::<_, 7>(&read, 3, choice.phase, |prior| cwpa(&read, DT, prior).unwrap());
    }

    #[test]
    fn effects_at_a_fixed_rate_equal_the_core_s(choice in choices()) {
        effects_agree::<5, 3>(choice);
        effects_agree::<8, 6>(choice);
        effects_agree::<11, 9>(choice);
        effects_agree::<17, 15>(choice);
    }
}

const PLAIN: Choice = Choice {
    phase: 0.0,
    form: Form::Inverse,
    integrator: Integrator::Rk4,
    order: Order::First,
    interpolation: Interpolation::Linear,
    gauss_markov: GaussMarkov::CONSTANT,
    gate: f64::INFINITY,
};

/// A gate that is no number rejects every reading, and a negative variance weighs them the wrong way round: without a word.
#[test]
fn settings_that_the_core_refuses_are_refused() {
    let good = PLAIN.filter(Aci { sensor: PLAIN.sensor(), q: 1e-6, tau: 0.0 });
    let read = good.with_system(Cwpa { sensor: PLAIN.sensor(), q: 1e3, low_pass: None });
    let drifting = Sensor { gauss_markov: [GaussMarkov { rate: -1.0, q: 0.0 }; 4], ..PLAIN.sensor() };
    let P: [f64; 25] = std::array::from_fn(|at| if at % 6 == 0 { 1e-4 } else { 0.0 });
    let diagonal: [f64; 16] = std::array::from_fn(|at| if at % 5 == 0 { 1e-4 } else { 0.0 });
    let four = Prior { states: 4, x: &[0.0; 4], P: &diagonal };
    let five = Prior { states: 5, x: &[0.0; 5], P: &P };
    let batch = Batch { dt: DT, samples: 3, runs: 1, output: &[0.0; 3], position: &[0.0; 3] };
    let refused = |filter: Filter<Aci>, name: &'static str| {
        let value = |error| matches!(error, Some(SetupError::Setting { name: actual, .. }) if actual == name);
        let none = Correction::None;
        assert!(value(aci(&filter, none, DT, four).err()), "aci: {name}");
        assert!(value(aci_with_effects(&filter, none, DT, 0.0, &[], four).err()), "effects: {name}");
        assert!(value(run_aci(&filter, four, batch, true, InstructionSet::Portable, 1).err()), "batch: {name}");
    };
    refused(Filter { gate: f64::NAN, ..good }, "gate");
    refused(Filter { gate: 0.0, ..good }, "gate");
    refused(Filter { R_position: -1e-12, ..good }, "r_position");
    refused(Filter { system: Aci { q: -1.0, ..good.system }, ..good }, "q");
    refused(Filter { system: Aci { tau: f64::NAN, ..good.system }, ..good }, "tau");
    refused(Filter { system: Aci { sensor: drifting, ..good.system }, ..good }, "parameter rate");
    let effects = aci_with_effects(&good, Correction::None, DT, 0.0, &drifting.gauss_markov, four).err();
    assert_eq!(effects, Some(SetupError::Setting { name: "parameter rate", value: -1.0 }));
    for read in [Filter { R_output: f64::NAN, ..read }, read.with_system(Cwpa { q: -1.0, ..read.system })] {
        assert!(matches!(cwpa(&read, DT, five).err(), Some(SetupError::Setting { .. })));
        let batch = run_cwpa(&read, five, batch, true, InstructionSet::Portable, 1);
        assert!(matches!(batch.err(), Some(SetupError::Setting { .. })));
    }
}

#[test]
fn a_step_that_fails_leaves_the_filter_as_it_was() {
    let filter = PLAIN.filter(Aci { sensor: PLAIN.sensor(), q: 1e-6, tau: 0.0 });
    let P: Vec<f64> = (0..16).map(|at| if at % 5 == 0 { 1e-4 } else { 0.0 }).collect();
    let mut live = aci(&filter, Correction::None, DT, Prior { states: 4, x: &[0.0; 4], P: &P }).unwrap();
    live.step(&SampleInput { u: 1.0, z: 0.0, effects: None, suspects: None }).unwrap();
    let before: Vec<u64> = (0..4).map(|i| live.x(i).to_bits()).collect();
    let failed = live.step(&SampleInput { u: f64::INFINITY, z: 0.0, effects: None, suspects: None });
    assert_eq!(failed, Err(StepError::Innovation { e: f64::INFINITY }));
    let failed = live.step(&SampleInput { u: 1.0, z: f64::INFINITY, effects: None, suspects: None });
    assert_eq!(failed, Err(StepError::Innovation { e: f64::INFINITY }));
    assert_eq!(before, (0..4).map(|i| live.x(i).to_bits()).collect::<Vec<_>>());
    assert_eq!(live.samples(), 1);
}

/// States that correlate by -0.6 with each other in threes are no covariance, which no pair of them shows.
#[test]
fn a_prior_that_no_filter_could_have_neither_builds_one_nor_begins_it_anew() {
    let aci_of = |carrier| Filter { carrier, ..PLAIN.filter(Aci { sensor: PLAIN.sensor(), q: 1e-6, tau: 0.0 }) };
    let P = |within: f64| -> [f64; 16] {
        std::array::from_fn(|at| match (at / 4, at % 4) {
            (i, j) if i == j => 1.0,
            (0..3, 0..3) => within,
            _ => 0.0,
        })
    };
    let (good, indefinite) = (P(0.1), P(-0.6));
    let four = |P| Prior { states: 4, x: &[0.0; 4], P };
    let five = Prior { states: 5, x: &[0.0; 5], P: &[0.0; 25] };
    for carrier in [Carrier::Dense, Carrier::Factored] {
        let built = |P| aci(&aci_of(carrier), Correction::None, DT, four(P));
        let mut live = built(&good).unwrap();
        assert!(matches!(built(&indefinite).err(), Some(SetupError::Prior { .. })));
        assert!(matches!(live.begin(four(&indefinite)), Err(SetupError::Prior { .. })));
        assert_eq!(live.begin(five), Err(SetupError::Size { given: 5 }));
        assert_eq!(live.P(0, 1).to_bits(), 0.1_f64.to_bits());
    }
}
