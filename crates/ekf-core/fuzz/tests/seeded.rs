//! Every target on its stored corpus and on seeded bytes: what libFuzzer drives, on any toolchain.
//!
//! `ACCELCAL_FUZZ=100000` sets the cases of each target, `ACCELCAL_FUZZ_FIRST` the number of the first; a failure names
//! its target and number, and `case` makes it again.

use std::fs;
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::path::Path;

use ekf_core_fuzz::judge::{require_belief, require_finite};
use ekf_core_fuzz::{TARGETS, Target};
use nalgebra::{SMatrix, SVector};

/// Cases of each target in a run of the whole test suite.
const SLICE: u64 = 20_000;
/// Bytes of a case at most: a set-up and some forty events.
const LONGEST: u64 = 700;

fn setting(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).map_or(otherwise, |value| value.parse().expect("a whole number"))
}

fn splitmix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The bytes of one case: a function of the target and the number.
fn case(target: &str, number: u64) -> Vec<u8> {
    let mut state = target.bytes().fold(number, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    let words = splitmix(&mut state) % (LONGEST / 8);
    (0..words).flat_map(|_| splitmix(&mut state).to_le_bytes()).collect()
}

/// What a target says of some bytes; `None` where it keeps its promises.
fn failure(run: fn(&[u8]), data: &[u8]) -> Option<String> {
    let panic = catch_unwind(AssertUnwindSafe(|| run(data))).err()?;
    let words =
        panic.downcast_ref::<String>().cloned().or_else(|| panic.downcast_ref::<&str>().map(ToString::to_string));
    Some(words.unwrap_or_default())
}

/// Runs every case of every target and fails with the number and the words of the first that fail.
fn require_promises(cases: impl Fn(&str) -> Vec<(String, Vec<u8>)>) {
    panic::set_hook(Box::new(|_| ())); // failures are told together
    let mut failed = Vec::new();
    for (name, run) in TARGETS {
        let all = cases(name);
        let words = all.iter().filter_map(|(case, data)| Some(format!("{name} {case}: {}", failure(run, data)?)));
        let broken: Vec<_> = words.collect();
        println!("{name}: {} of {} cases break a promise (0)", broken.len(), all.len());
        failed.extend(broken.into_iter().take(9));
    }
    let _ = panic::take_hook();
    assert!(failed.is_empty(), "{failed:#?}");
}

fn stored(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
    let files = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    files
        .map(|file| file.expect("a readable folder").path())
        .map(|path| (path.display().to_string(), fs::read(&path).expect("a readable file")))
        .collect()
}

#[test]
fn the_stored_corpus_keeps_every_promise() {
    for (name, _) in TARGETS {
        assert!(stored(name).len() >= 10, "{name} has too few stored cases");
    }
    require_promises(stored);
}

#[test]
fn seeded_bytes_keep_every_promise() {
    let (first, count) = (setting("ACCELCAL_FUZZ_FIRST", 0), setting("ACCELCAL_FUZZ", SLICE));
    require_promises(|name| (first..first + count).map(|number| (number.to_string(), case(name, number))).collect());
}

/// The judges must be able to fail, else nothing above can.
#[test]
fn a_broken_promise_is_seen() {
    let negative = ekf_core::Belief { x: SVector::<f64, 2>::zeros(), P: -SMatrix::identity() };
    assert!(catch_unwind(|| require_belief(&negative)).is_err());
    assert!(catch_unwind(|| require_finite("x", &[0.0, f64::NAN])).is_err());
    let broken: Target = ("broken", |data| assert!(data.len() < 600, "a long case"));
    assert!((0..99).any(|number| failure(broken.1, &case(broken.0, number)).is_some()));
}
