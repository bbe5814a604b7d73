//! Runs one workload for a number of steps, for an instruction counter: `steps structured 2 40000`.

#[cfg(target_arch = "x86_64")]
#[path = "../benches/workloads/mod.rs"]
mod workloads;

#[cfg(target_arch = "x86_64")]
fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, kernel, workload, steps] = arguments.as_slice() else {
        eprintln!("usage: steps structured|counted|arrays|portable|dense WORKLOAD STEPS");
        std::process::exit(2);
    };
    let workload: u32 = workload.parse().expect("a workload, 1 to 4");
    let data = workloads::data(steps.parse().expect("a number of steps"), 1);
    let ended = match kernel.as_str() {
        "structured" => workloads::structured(workload, &data, false),
        "counted" => workloads::structured(workload, &data, true),
        "arrays" => workloads::arrays(workload, &data),
        "portable" => workloads::portable(workload, &data),
        "dense" => workloads::dense(workload, &data),
        // What reading arguments and making the record costs, to be taken off.
        _ => Vec::new(),
    };
    println!("{ended:?}");
}

#[cfg(not(target_arch = "x86_64"))]
fn main() {
    println!("The counts are those of x86-64.");
}
