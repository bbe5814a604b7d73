//! The paper's filters over a CSV of two channels: ACI and CWPA, linear sensor in first and cubic sensor in second order.
//!
//! `cargo run --release --example paper [FILE]`. Columns: time in s, output in m/s², position in m; a row may lack the
//! output or the position. Without a file it reads `record.csv` beside it: 1 s of a stage that shakes by ±10 m/s², sensor
//! k = 0.02, K0 = 0.1 m/s², K2 = 2e-3 (m/s²)⁻¹, K3 = 3e-4 (m/s²)⁻², noise 200 µg/√Hz, encoder 1 µm at every second sample.
#![allow(non_snake_case)] // K0, K2, K3 as in the paper

use std::io;

use ekf_core::{Aci, Belief, Cwpa, Engine, Filter, Form, Integrator, Interpolation, Order, Samples, Sensor};

/// Two-sided density of the output's noise, (m/s²)²/Hz.
const DENSITY: f64 = 1.9e-6;
/// Variance of an output, (m/s²)²: that density at 1667 samples per second.
const R_OUTPUT: f64 = DENSITY * 1667.0;
/// Variance of a position, m².
const R_POSITION: f64 = 1e-12;
/// Two-sided density of the jerk in CWPA, m²/s⁵: it moves the acceleration by 30 m/s² in 10 ms.
const JERK: f64 = 1e5;
/// Standard deviations of p, v and of k, K0, K2, K3 before the first sample, SI.
const MOTION: [f64; 2] = [1e-3, 0.1];
const SENSOR: [f64; 4] = [0.05, 0.5, 1e-2, 1e-3];
/// And of the acceleration in CWPA, m/s².
const ACCELERATION: f64 = 20.0;

/// One channel: stamps and samples.
#[derive(Default)]
struct Channel {
    t: Vec<f64>,
    y: Vec<f64>,
}

impl Channel {
    fn add(&mut self, t: f64, field: &str) -> io::Result<()> {
        if !field.is_empty() {
            self.t.push(t);
            self.y.push(number(field)?);
        }
        Ok(())
    }

    fn samples(&self) -> Samples<'_> {
        Samples { t: &self.t, y: &self.y }
    }
}

fn number(field: &str) -> io::Result<f64> {
    field.parse().map_err(|error| io::Error::new(io::ErrorKind::InvalidData, format!("{field:?}: {error}")))
}

/// Output and position of a CSV with a header.
fn channels(text: &str) -> io::Result<(Channel, Channel)> {
    let (mut output, mut position) = (Channel::default(), Channel::default());
    for line in text.lines().skip(1).filter(|line| !line.trim().is_empty()) {
        let mut fields = line.split(',').map(str::trim);
        let mut field = || fields.next().unwrap_or("");
        let t = number(field())?;
        output.add(t, field())?;
        position.add(t, field())?;
    }
    Ok((output, position))
}

/// Runs a filter and prints the parameters, which are the states from `first` on.
fn report<E: Engine<N>, const N: usize>(
    name: &str,
    filter: &E,
    prior: [f64; N],
    first: usize,
    (output, position): (&Channel, &Channel),
) -> io::Result<()> {
    let prior = Belief::independent([0.0; N], prior);
    let track = filter.run(&prior, output.samples(), position.samples(), |_, _| ())?;
    let belief = filter.belief(&track.state);
    print!("{name:36}");
    for (i, parameter) in (first..N).zip(["k", "K0", "K2", "K3"]) {
        print!("  {parameter} = {:.6}({:.6})", belief.x[i], belief.sigma(i));
    }
    println!("  ln L = {:.1}", track.log_likelihood);
    Ok(())
}

fn main() -> io::Result<()> {
    let text = match std::env::args().nth(1) {
        Some(path) => std::fs::read_to_string(path)?,
        None => include_str!("record.csv").to_owned(),
    };
    let (output, position) = channels(&text)?;
    let record = (&output, &position);

    let sensor = Sensor::constant(Form::Forward);
    let aci = Filter {
        interpolation: Interpolation::Cubic,
        integrator: Integrator::Rk2,
        ..Filter::new(Aci { sensor, q: DENSITY, tau: 0.0 }, R_POSITION, 0.0)
    };
    // Exact steps: under a jerk and a prior as wide as these RK2 loses positive definiteness, and says so.
    let cwpa = Filter::new(Cwpa { sensor, q: JERK, low_pass: None }, R_POSITION, R_OUTPUT);

    let ([p, v], [k, K0, K2, K3]) = (MOTION, SENSOR);
    report("ACI, linear, first order, RK2", &aci, [p, v, k, K0], 2, record)?;
    report("CWPA, linear, first order", &cwpa, [p, v, ACCELERATION, k, K0], 3, record)?;

    let aci = Filter { order: Order::Second, integrator: Integrator::Rk4, ..aci };
    let cwpa = Filter { order: Order::Second, ..cwpa };
    report("ACI, cubic, second order, RK4", &aci, [p, v, k, K0, K2, K3], 2, record)?;
    report("CWPA, cubic, second order", &cwpa, [p, v, ACCELERATION, k, K0, K2, K3], 3, record)
}
