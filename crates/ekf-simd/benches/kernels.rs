//! The kernels' table: structured against dense in one binary, interleaved; then criterion's own figures.
//!
//! Time is the process's own (others on the machine are left out), but for threads, which are measured by wall-clock time.
#![allow(missing_docs, non_snake_case)] // x and P as in the crates

#[cfg(target_arch = "x86_64")]
mod workloads;

#[cfg(target_arch = "x86_64")]
mod table {
    use std::hint::black_box;
    use std::time::Instant;

    use cpu_time::ProcessTime;
    use criterion::{Criterion, Throughput};
    use ekf_simd::InstructionSet;

    use crate::workloads::{WIDTHS, apart, batch, data, dense, many, portable, structured, with_effects};

    const STEPS: usize = 20_000;
    const ROUNDS: usize = 11;
    const RUNS: usize = 100;
    /// Largest allowed part of the dense twin's time, W1 to W4.
    const BARS: [f64; 4] = [0.20, 0.06, 0.20, 0.13];

    type Work<'a> = Box<dyn Fn() + 'a>;

    fn median(mut values: Vec<f64>) -> f64 {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    }

    /// What the work costs when nobody disturbs it.
    fn least(values: &[f64]) -> f64 {
        values.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Process time of every work in every round, ns per step, the works taking turns.
    fn rounds(works: &[Work<'_>], steps: usize) -> Vec<Vec<f64>> {
        let mut times = vec![Vec::new(); works.len()];
        for round in 0..=ROUNDS {
            for (work, times) in works.iter().zip(&mut times) {
                let start = ProcessTime::now();
                work();
                if round > 0 {
                    times.push(start.elapsed().as_secs_f64() * 1e9 / steps as f64);
                }
            }
        }
        times
    }

    /// Time against the number of parameters: 8 of them against W2, and the exponent of a power law.
    fn widths() {
        let data = data(STEPS, 1);
        let mut works: Vec<Work<'_>> = vec![Box::new(|| drop(black_box(structured(2, &data, false))))];
        for parameters in WIDTHS {
            let run = with_effects(parameters, &data);
            works.push(Box::new(move || drop(black_box(run()))));
        }
        let times = rounds(&works, STEPS);
        println!("\n| parameters, RK4 | ns per step | times W2 |\n|---|---|---|");
        let points: Vec<(f64, f64)> = WIDTHS
            .iter()
            .zip(&times[1..])
            .map(|(&parameters, measured)| {
                let ns = median(measured.clone());
                println!("| {parameters} | {ns:.1} | {:.2} |", ratio(measured, &times[0]));
                ((parameters as f64).ln(), ns.ln())
            })
            .collect();
        let eight = ratio(&times[3], &times[0]);
        let exponent = slope(&points);
        println!("\n8 parameters: {eight:.2} times W2 (bar <= 4.5, {}).", verdict(eight <= 4.5));
        println!("Cost grows as M^{exponent:.2} for M = 2..16 (bar <= 2, {}).", verdict(exponent <= 2.0));
    }

    /// Slope of the least-squares line.
    fn slope(points: &[(f64, f64)]) -> f64 {
        let n = points.len() as f64;
        let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), point| (x + point.0 / n, y + point.1 / n));
        let part = |of: fn(f64, f64) -> f64| points.iter().map(|point| of(point.0 - x, point.1 - y)).sum::<f64>();
        part(|x, y| x * y) / part(|x, _| x * x)
    }

    /// Median over rounds of the ratio within a round.
    fn ratio(one: &[f64], other: &[f64]) -> f64 {
        median(one.iter().zip(other).map(|(one, other)| one / other).collect())
    }

    fn verdict(met: bool) -> &'static str {
        if met { "met" } else { "missed" }
    }

    fn sequential() {
        println!("| | dense | portable | fused | with log-likelihood | fused / dense | bar | |");
        println!("|---|---|---|---|---|---|---|---|");
        let data = data(STEPS, 1);
        for workload in 1..=4_u32 {
            let off = apart(&structured(workload, &data, false), &dense(workload, &data));
            assert!(off < 1e-9, "W{workload}: structured and dense differ by {off:e} sigma");
            let works: [Work<'_>; 4] = [
                Box::new(|| drop(black_box(dense(workload, &data)))),
                Box::new(|| drop(black_box(portable(workload, &data)))),
                Box::new(|| drop(black_box(structured(workload, &data, false)))),
                Box::new(|| drop(black_box(structured(workload, &data, true)))),
            ];
            let times = rounds(&works, STEPS);
            let [d, p, f, c] = [0, 1, 2, 3].map(|i: usize| median(times[i].clone()));
            let (part, bar) = (ratio(&times[2], &times[0]), BARS[workload as usize - 1]);
            let met = verdict(part <= bar);
            println!("| W{workload} | {d:.0} | {p:.1} | {f:.1} | {c:.1} | {part:.3} | {bar:.2} | {met} |");
        }
    }

    fn batches() {
        let samples = 2_001;
        let data = &many(RUNS, samples - 1);
        let bars = [(InstructionSet::Fused, 1.0), (InstructionSet::Four, 0.50), (InstructionSet::Eight, 0.30)];
        let open: Vec<(InstructionSet, f64)> = bars.into_iter().filter(|(path, _)| path.is_available()).collect();
        let works: Vec<Work<'_>> = open
            .iter()
            .map(|&(path, _)| Box::new(move || drop(black_box(batch(data, RUNS, path, 1)))) as Work<'_>)
            .collect();
        let steps = RUNS * (samples - 1);
        let times = rounds(&works, steps);
        println!("\n| W2, {RUNS} runs | ns per run-step | of one run at a time | bar | |\n|---|---|---|---|---|");
        for (&(path, bar), measured) in open.iter().zip(&times) {
            let ns = least(measured);
            let part = ns / least(&times[0]);
            println!("| {path:?} | {ns:.1} | {part:.2} | {bar:.2} | {} |", verdict(part <= bar));
        }
    }

    /// By the clock on the wall, over runs so long that starting a thread does not count.
    fn threads() {
        let data = many(RUNS, STEPS);
        let mut times = [Vec::new(), Vec::new()];
        for _ in 0..ROUNDS {
            for (threads, times) in (1..).zip(&mut times) {
                let start = Instant::now();
                drop(black_box(batch(&data, RUNS, InstructionSet::best(), threads)));
                times.push(start.elapsed().as_secs_f64());
            }
        }
        let gain = least(&times[0]) / least(&times[1]);
        println!("\nW5, two threads: {gain:.2} times one (bar >= 1.25, {}).\n", verdict(gain >= 1.25));
    }

    pub fn criterion() {
        sequential();
        widths();
        batches();
        threads();
        let mut criterion = Criterion::default()
            .warm_up_time(std::time::Duration::from_millis(300))
            .measurement_time(std::time::Duration::from_secs(1))
            .sample_size(10)
            .configure_from_args();
        let data = data(STEPS, 1);
        for workload in 1..=4_u32 {
            let mut group = criterion.benchmark_group(format!("W{workload}"));
            group.throughput(Throughput::Elements(STEPS as u64));
            group.bench_function("structured", |b| b.iter(|| structured(workload, &data, false)));
            group.bench_function("dense", |b| b.iter(|| dense(workload, &data)));
            group.finish();
        }
        criterion.final_summary();
    }
}

fn main() {
    #[cfg(target_arch = "x86_64")]
    table::criterion();
    #[cfg(not(target_arch = "x86_64"))]
    println!("The table compares x86-64's vector units; this processor has none of them.");
}
