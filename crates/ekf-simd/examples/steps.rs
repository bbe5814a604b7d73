//! Runs one workload for a number of steps, for an instruction counter: `steps structured 2 40000`.

#[cfg(target_arch = "x86_64")]
#[path = "../benches/workloads/mod.rs"]
mod workloads;

#[cfg(target_arch = "x86_64")]
use std::hint::black_box;

#[cfg(target_arch = "x86_64")]
use ekf_simd::InstructionSet;

/// Runs side by side that share the steps.
#[cfg(target_arch = "x86_64")]
const RUNS: usize = 4;

#[cfg(target_arch = "x86_64")]
fn in_runs(path: InstructionSet, steps: usize) -> Vec<f64> {
    let ended = workloads::batch(&workloads::many(RUNS, steps / RUNS), RUNS, path, 1);
    ended.into_iter().flat_map(|run| run.x).collect()
}

#[cfg(target_arch = "x86_64")]
fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, kernel, workload, steps] = arguments.as_slice() else {
        eprintln!("usage: steps structured|counted|arrays|portable|dense|alone|four|effects WORKLOAD STEPS");
        std::process::exit(2);
    };
    let workload: u32 = workload.parse().expect("a workload, 1 to 4, or a number of parameters");
    let steps = steps.parse().expect("a number of steps");
    let data = workloads::data(steps, 1);
    let ended = match kernel.as_str() {
        "structured" => workloads::structured(workload, &data, false),
        "counted" => workloads::structured(workload, &data, true),
        "arrays" => workloads::arrays(workload, &data),
        "portable" => workloads::portable(workload, &data),
        "dense" => workloads::dense(workload, &data),
        "effects" => workloads::with_effects(workload as usize, &data)(),
        // What making the columns of effects costs, to be taken off.
        "columns" => {
            drop(black_box(workloads::with_effects(workload as usize, &data)));
            Vec::new()
        }
        "alone" => in_runs(InstructionSet::Fused, steps),
        "four" => in_runs(InstructionSet::Four, steps),
        // What making the records of several runs costs, to be taken off.
        "runs" => black_box(workloads::many(RUNS, steps / RUNS)).u.into_iter().take(1).collect(),
        // What reading arguments and making the record costs, to be taken off.
        _ => Vec::new(),
    };
    println!("{ended:?}");
}

#[cfg(not(target_arch = "x86_64"))]
fn main() {
    println!("The counts are those of x86-64.");
}
