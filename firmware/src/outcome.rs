//! A run over the record and what comes out of it: all bits of all beliefs in one number, and the last estimate.

use ekf_core::structured::aci_ud::AciFactored;

use crate::record::{Record, TRUTH};
use crate::{Number, Sample, Tracker};

/// What two machines must agree on, and what the estimate is worth.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Outcome {
    /// Fowler-Noll-Vo over the bits of mean and factors after every step.
    pub digest: u64,
    /// Estimates of k, K0, K2, K3, SI.
    pub estimate: [f64; 4],
    /// Their variances.
    pub variance: [f64; 4],
    /// What the record was drawn with.
    pub truth: [f64; 4],
}

/// `steps` steps of the record, each taken by `step`.
#[inline(always)]
pub fn run(steps: u32, mut step: impl FnMut(&mut Tracker<Number>, Sample)) -> (u64, Tracker<Number>) {
    let mut record = Record::new();
    let mut tracker = Tracker::new(record.sample().output.into());
    let mut digest = 0xcbf2_9ce4_8422_2325;
    for _ in 0..steps {
        step(&mut tracker, record.sample());
        digest = with(digest, &tracker.filter);
    }
    #[cfg(feature = "panic")]
    core::hint::black_box(TRUTH[core::hint::black_box(steps) as usize]);
    (digest, tracker)
}

/// The run as a C function, for the host.
#[allow(unsafe_code)] // a name for the linker
// SAFETY: no other function of the library, and none of C's, has this name.
#[unsafe(no_mangle)]
pub extern "C" fn outcome(steps: u32) -> Outcome {
    let (digest, tracker) = run(steps, |tracker, sample| {
        tracker.step(sample.output.into(), sample.position.map(Number::from));
    });
    let filter = tracker.filter;
    Outcome {
        digest,
        estimate: filter.theta.0.map(f64::from),
        variance: core::array::from_fn(|i| filter.P(i + 2, i + 2).into()),
        truth: TRUTH.map(f64::from),
    }
}

/// The digest with one more belief.
fn with(digest: u64, filter: &AciFactored<Number, 6, 4>) -> u64 {
    let AciFactored { p, v, theta, upv, up, uv, U, d, D } = filter;
    let digest = [[*p, *v], [*upv, 0.0], *d].iter().fold(digest, |digest, row| with_row(digest, row));
    [theta, up, uv, D].into_iter().chain(U).fold(digest, |digest, row| with_row(digest, &row.0))
}

/// Out of line: unrolled, it would be a fifth of the image.
#[inline(never)]
fn with_row(digest: u64, row: &[Number]) -> u64 {
    row.iter().fold(digest, |digest, x| (digest ^ u64::from(x.to_bits())).wrapping_mul(0x0100_0000_01b3))
}
