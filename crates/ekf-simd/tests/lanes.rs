//! Lanes, threads and instructions change the speed of a batch, not its answer.
#![allow(non_snake_case)] // as in the crate

mod common;

use ekf_core::{
    Aci, Belief, Carrier, Consider, Cwpa, Engine, Filter, Form, GaussMarkov, Integrator, Interpolation, Order, Samples,
    Sensor,
};
use ekf_simd::{Batch, Final, InstructionSet, Prior, run_aci, run_cwpa};
use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;

const DT: f64 = 1.0 / 1667.0;
const RUNS: usize = 11; // fills no group of lanes
const SIGMA: [f64; 4] = [1e-2, 0.1, 1e-3, 1e-4];

#[derive(Debug, Clone, Copy)]
struct Choice {
    seed: u64,
    samples: usize,
    cubic: bool,
    filter: Filter<Sensor>,
    tau: f64,
}

fn choices() -> impl Strategy<Value = Choice> {
    let integrator = prop_oneof![Just(Integrator::Rk4), Just(Integrator::Exact)];
    let interpolation = prop_oneof![Just(Interpolation::Hold), Just(Interpolation::Linear), Just(Interpolation::Cubic)];
    let form = prop_oneof![Just(Form::Inverse), Just(Form::Forward)];
    let order = prop_oneof![Just(Order::First), Just(Order::Second)];
    let tau = prop_oneof![Just(0.0), Just(1e-3)];
    let rest = (form, order, integrator, interpolation, any::<bool>(), tau);
    (any::<u64>(), 2..200_usize, any::<bool>(), rest).prop_map(|(seed, samples, cubic, rest)| {
        let (form, order, integrator, interpolation, moving, tau) = rest;
        let gauss_markov =
            SIGMA.map(|s| if moving { GaussMarkov { rate: 0.5, q: s * s } } else { GaussMarkov::CONSTANT });
        let filter = Filter {
            system: Sensor { form, gauss_markov },
            interpolation,
            integrator,
            order,
            carrier: Carrier::Dense,
            consider: Consider::NONE,
            R_position: 1e-12,
            R_output: 1e-4,
            gate: f64::INFINITY,
        };
        Choice { seed, samples, cubic, filter, tau }
    })
}

impl Choice {
    /// Records of all runs; positions are missing, at other instants in every run, and outputs too if `gaps`.
    fn records(&self, gaps: bool) -> (Vec<f64>, Vec<f64>) {
        let mut state = self.seed;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let (mut u, mut z) = (Vec::new(), Vec::new());
        for run in 0..RUNS {
            let w = 20.0 + run as f64;
            for j in 0..self.samples {
                let t = j as f64 * DT;
                let output = 0.05 + 1.01 * 6.0 * (w * t).cos() + 1e-2 * draw();
                u.push(if gaps && draw() > 0.9 { f64::NAN } else { output });
                let position = 6.0 / (w * w) * (1.0 - (w * t).cos()) + 1e-6 * draw();
                z.push(if j > 0 && draw() > 0.3 { f64::NAN } else { position });
            }
        }
        (u, z)
    }
}

fn prior(motion: &[f64], states: usize) -> (Vec<f64>, Vec<f64>) {
    let sigma = |i: usize| if i < motion.len() { motion[i] } else { SIGMA[i - motion.len()] };
    let P = (0..states * states).map(|at| if at % (states + 1) == 0 { sigma(at / states).powi(2) } else { 0.0 });
    (vec![0.0; states], P.collect())
}

/// Largest difference, in sigma, in `sigma_i sigma_j`, and relative in the log-likelihood.
fn apart(one: &Final, other: &Final) -> f64 {
    let N = other.x.len();
    let sigma = |i: usize| other.P[i * N + i].sqrt();
    let mut worst = ((one.log_likelihood - other.log_likelihood) / other.log_likelihood.abs().max(1.0)).abs();
    for i in 0..N {
        worst = worst.max((one.x[i] - other.x[i]).abs() / sigma(i));
        for j in 0..N {
            worst = worst.max((one.P[i * N + j] - other.P[i * N + j]).abs() / (sigma(i) * sigma(j)));
        }
    }
    worst
}

/// One answer on every path with every number of threads; the portable one is returned.
fn agree(run: impl Fn(InstructionSet, usize) -> Vec<Final>) -> Result<Vec<Final>, TestCaseError> {
    let alone = run(InstructionSet::Portable, 1);
    prop_assert_eq!(alone.len(), RUNS);
    prop_assert!(alone.iter().all(|run| run.fault.is_none() && run.x.iter().all(|x| x.is_finite())));
    prop_assert_eq!(&run(InstructionSet::Portable, 3), &alone);
    let fused = run(InstructionSet::Fused, 1);
    for (fused, alone) in fused.iter().zip(&alone) {
        let off = apart(fused, alone);
        // A fused operation rounds once instead of twice, and a variance that falls by 1e5 magnifies what was rounded off.
        prop_assert!(off < 1e-10, "fused: {}", off);
    }
    for path in [InstructionSet::Fused, InstructionSet::Four, InstructionSet::Eight] {
        let one = run(path, 1);
        for (one, fused) in one.iter().zip(&fused) {
            prop_assert_eq!((&one.x, &one.P), (&fused.x, &fused.P)); // lanes: the same operations in the same order
            // Lanes whose readings are missing at other instants take logarithms at other instants.
            prop_assert!(apart(one, fused) < 1e-12, "{:?}: {:e}", path, apart(one, fused));
        }
        prop_assert_eq!(&run(path, 3), &one); // threads: the same bits
    }
    Ok(alone)
}

fn aci<const N: usize>(choice: &Choice) -> Result<(), TestCaseError> {
    let filter = choice.filter.with_system(Aci { sensor: choice.filter.system, q: 1e-6, tau: choice.tau });
    let (output, position) = choice.records(false);
    let (x, P) = prior(&[1e-5, 3e-3], N);
    let n = choice.samples;
    let batch = Batch { dt: DT, samples: n, runs: RUNS, output: &output, position: &position };
    let prior = Prior { states: N, x: &x, P: &P };
    let ended = agree(|path, threads| run_aci(&filter, prior, batch, true, path, threads).unwrap())?;
    for (run, ended) in ended.iter().enumerate().take(2) {
        let t: Vec<f64> = (0..n).map(|j| j as f64 * DT).collect();
        let present = |j: &usize| !position[run * n + j].is_nan();
        let (tz, z): (Vec<f64>, Vec<f64>) = (0..n).filter(present).map(|j| (t[j], position[run * n + j])).unzip();
        let belief = Belief::<N> { x: SVector::from_column_slice(&x), P: SMatrix::from_row_slice(&P) };
        let (output, position) = (Samples { t: &t, y: &output[run * n..][..n] }, Samples { t: &tz, y: &z });
        let track = filter.run(&belief, output, position, |_, _| ()).unwrap();
        let dense = track.state.belief();
        let (x, P) = (dense.x.as_slice().to_vec(), dense.P.as_slice().to_vec());
        let off = apart(ended, &Final { x, P, log_likelihood: track.log_likelihood, fault: None });
        prop_assert!(off < 1e-10, "dense: {}", off); // two ways to round, 200 steps
    }
    Ok(())
}

fn cwpa<const N: usize>(choice: &Choice) -> Result<(), TestCaseError> {
    let filter = choice.filter.with_system(Cwpa { sensor: choice.filter.system, q: 25.0, low_pass: None });
    let (output, position) = choice.records(true);
    let (x, P) = prior(&[1e-5, 3e-3, 10.0], N);
    let batch = Batch { dt: DT, samples: choice.samples, runs: RUNS, output: &output, position: &position };
    let prior = Prior { states: N, x: &x, P: &P };
    agree(|path, threads| run_cwpa(&filter, prior, batch, true, path, threads).unwrap()).map(|_| ())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(common::cases()) })]

    #[test]
    fn a_batch_of_aci_has_one_answer(choice in choices()) {
        if choice.cubic { aci::<6>(&choice)? } else { aci::<4>(&choice)? }
    }

    #[test]
    fn a_batch_of_cwpa_has_one_answer(choice in choices()) {
        if choice.cubic { cwpa::<7>(&choice)? } else { cwpa::<5>(&choice)? }
    }
}
