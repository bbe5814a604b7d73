//! A stage on two tones and the sensor on it, by `+ - *` on single precision alone: with equal bits on every machine.

/// Time between two samples, s.
pub(crate) const DT: f64 = 0.0006;
/// The sensor: k, K0, K2, K3 in inverse form, SI.
pub(crate) const TRUTH: [f32; 4] = [0.01, 0.05, 1e-3, 1e-4];

/// Angle per step and amplitude in m: 2.5 Hz and 1 Hz.
const TONES: [(f64, f64); 2] = [(15.7 * DT, 0.04), (6.3 * DT, 0.05)];
const OUTPUT_NOISE: f32 = 0.01;
const ENCODER_NOISE: f32 = 1e-6;

/// What one instant brings.
#[derive(Clone, Copy)]
pub struct Sample {
    /// The sensor's output, m/s².
    pub output: f32,
    /// The encoder's reading of every second sample, m.
    pub position: Option<f32>,
}

/// An endless record.
pub(crate) struct Record {
    /// Cosine and sine of each tone's phase.
    phases: [(f32, f32); 2],
    random: u32,
    odd: bool,
}

impl Record {
    /// From the start.
    pub(crate) const fn new() -> Self {
        Self { phases: [(1.0, 0.0); 2], random: 0x1234_5678, odd: false }
    }

    /// The next sample.
    pub(crate) fn sample(&mut self) -> Sample {
        let (mut p, mut a) = (0.0, 0.0);
        for ((cos, sin), (angle, amplitude)) in self.phases.iter_mut().zip(TONES) {
            let rate = angle / DT;
            p += amplitude as f32 * *sin;
            a -= (amplitude * rate * rate) as f32 * *sin;
            let (c, s) = (cosine(angle) as f32, sine(angle) as f32);
            (*cos, *sin) = (c * *cos - s * *sin, s * *cos + c * *sin);
        }
        self.odd = !self.odd;
        let output = sensed(a) + OUTPUT_NOISE * self.noise();
        let position = p + ENCODER_NOISE * self.noise();
        Sample { output, position: self.odd.then_some(position) }
    }

    /// Near enough normal, variance one: four draws of a xorshift generator added up.
    fn noise(&mut self) -> f32 {
        let mut sum = -131_070;
        for _ in 0..4 {
            self.random ^= self.random << 13;
            self.random ^= self.random >> 17;
            self.random ^= self.random << 5;
            sum += (self.random >> 16).cast_signed();
        }
        sum as f32 * (1.0 / 37_837.0)
    }
}

/// The output at `a`: (6) solved for `w` by fixed-point iteration, which gains a digit a round.
fn sensed(a: f32) -> f32 {
    let [k, K0, K2, K3] = TRUTH;
    let mut w = a;
    for _ in 0..6 {
        w = a + w * (k - w * (K2 + w * K3));
    }
    K0 + w
}

/// Of a small angle.
const fn sine(x: f64) -> f64 {
    x * (1.0 - x * x / 6.0 * (1.0 - x * x / 20.0))
}

/// Of a small angle.
const fn cosine(x: f64) -> f64 {
    1.0 - x * x / 2.0 * (1.0 - x * x / 12.0)
}
