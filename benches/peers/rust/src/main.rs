//! One workload on one kernel, timed: `peers fused|dense|joseph|optimal|batch WORKLOAD FILE ROUNDS`.
//!
//! FILE holds two rows of f64: outputs, then positions (for `batch` as many rows of each as there are runs). Printed are
//! the least process time of a round, s, then x and the diagonal of P, each on a line.
#![allow(non_snake_case)] // x and P as in the crates

mod adskalman_cwpa;
#[path = "../../../../crates/ekf-simd/benches/workloads/mod.rs"]
mod workloads;

use std::hint::black_box;

use cpu_time::ProcessTime;
use ekf_core::{Aci, Carrier, Consider, Filter, Form, GaussMarkov, Integrator, Interpolation, Order, Sensor};
use ekf_simd::{Batch, InstructionSet, Prior, run_aci};
use workloads::{DT, Data, QV, R_OUTPUT, R_POSITION};

/// Runs of the workload W5.
const RUNS: usize = 100;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, kernel, workload, file, rounds] = arguments.as_slice() else {
        eprintln!("usage: peers fused|dense|joseph|optimal|batch WORKLOAD FILE ROUNDS");
        std::process::exit(2);
    };
    let workload: u32 = workload.parse().expect("a workload, 1 to 5");
    let rounds: usize = rounds.parse().expect("a number of rounds");
    let data = read(file);
    let mut least = f64::INFINITY;
    let mut ended = Vec::new();
    for _ in 0..=rounds {
        let start = ProcessTime::now();
        ended = black_box(match kernel.as_str() {
            "fused" => workloads::structured(workload, &data, false),
            "dense" => workloads::dense(workload, &data),
            "joseph" => adskalman_cwpa::run(&data, true),
            "optimal" => adskalman_cwpa::run(&data, false),
            "batch" => batch(&data),
            unknown => panic!("{unknown}: no such kernel"),
        });
        least = least.min(start.elapsed().as_secs_f64());
    }
    if kernel == "fused" {
        ended.pop(); // the log-likelihood, which was not asked for
    }
    let (x, variances) = ended.split_at(ended.len() / 2);
    println!("{least:e}");
    for row in [x, variances] {
        println!("{}", row.iter().map(f64::to_string).collect::<Vec<_>>().join(" "));
    }
}

fn read(file: &str) -> Data {
    let bytes = std::fs::read(file).expect("a file of f64");
    let numbers: Vec<f64> =
        bytes.chunks_exact(8).map(|eight| f64::from_le_bytes(eight.try_into().expect("eight bytes"))).collect();
    let (u, z) = numbers.split_at(numbers.len() / 2);
    Data { u: u.to_vec(), z: z.to_vec() }
}

/// W5 as the product runs it: all states of all runs, then all variances.
fn batch(data: &Data) -> Vec<f64> {
    let sensor = Sensor { form: Form::Inverse, gauss_markov: [GaussMarkov::CONSTANT; 4] };
    let filter = Filter {
        system: Aci { sensor, q: QV, tau: 0.0 },
        interpolation: Interpolation::Linear,
        integrator: Integrator::Rk4,
        order: Order::Second,
        carrier: Carrier::Dense,
        consider: Consider::NONE,
        R_position: R_POSITION,
        R_output: R_OUTPUT,
        gate: f64::INFINITY,
    };
    let x = [0.0; 6];
    let P: Vec<f64> = (0..36).map(|at| if at % 7 == 0 { workloads::variance(2, at / 7) } else { 0.0 }).collect();
    let prior = Prior { states: 6, x: &x, P: &P };
    let batch = Batch { dt: DT, samples: data.u.len() / RUNS, runs: RUNS, output: &data.u, position: &data.z };
    let finals = run_aci(&filter, prior, batch, false, InstructionSet::best(), 1).expect("a batch");
    let states = finals.iter().flat_map(|run| run.x.iter().copied());
    let variances = finals.iter().flat_map(|run| run.P.iter().step_by(7).copied());
    states.chain(variances).collect()
}
