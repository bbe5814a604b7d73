//! A sensor of one's own behind `AccelerationModel`: the scale factor differs between the signs of the acceleration.
//!
//! Output `u = K0 + (1 + k) a + s |a|`. With `w = u - K0` the acceleration is `w / (1 + k + s)` for positive `w` and
//! `w / (1 + k - s)` for negative. Parameters: k, K0, s.
#![allow(non_snake_case)] // as in the paper
#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(slope > 0.0)` refuses NaN too

use ekf_core::structured::acceleration::{AccelerationModel, AccelerationPartials};
use ekf_core::structured::row::{Plain, product};
use ekf_core::{Belief, DomainError, Engine, Interpolation, Order, OwnSensor, RunError, Samples};

#[derive(Clone, Copy)]
struct TwoSlopes;

type Row = Plain<f64, 3>;

impl AccelerationModel<Row, 3> for TwoSlopes {
    type Input = f64;
    type Table = (Row, [Row; 3]);

    fn table(&self, theta: &Row, P_theta: &[Row; 3], _: Order) -> Self::Table {
        (*theta, *P_theta)
    }

    fn at(&self, (theta, P_theta): &Self::Table, u: f64) -> Result<AccelerationPartials<Row>, DomainError> {
        let [k, K0, s] = theta.0;
        let w = u - K0;
        let slope = 1.0 + k + s * w.signum();
        if !(slope > 0.0) {
            return Err(DomainError::Slope { slope });
        }
        let a = w / slope;
        let g = Plain([-a / slope, -1.0 / slope, -a.abs() / slope]); // da/dk, da/dK0, da/ds
        Ok(AccelerationPartials { a, g, h: product(P_theta, &g), slope: 1.0 / slope })
    }
}

fn main() -> Result<(), RunError> {
    // Two sines, so that the asymmetry is no bias: ±9 m/s².
    let (k, K0, s) = (0.02, 0.1, -0.005);
    let t: Vec<f64> = (0..8_335).map(|i| f64::from(i) / 1667.0).collect();
    let wave = |t: f64, power: i32| -> f64 {
        [(6.0, 150.0_f64), (3.0, 70.0)].iter().map(|(A, w)| A * (w * t).cos() / w.powi(power)).sum()
    };
    let output: Vec<f64> = t.iter().map(|t| wave(*t, 0)).map(|a| K0 + (1.0 + k) * a + s * a.abs()).collect();
    let position: Vec<f64> = t.iter().map(|t| wave(0.0, 2) - wave(*t, 2)).collect();

    let filter = OwnSensor { interpolation: Interpolation::Cubic, ..OwnSensor::<_, 3>::new(TwoSlopes, 1e-6, 1e-12) };
    let prior = Belief::independent([0.0; 5], [1e-5, 0.1, 0.05, 0.5, 0.05]);
    let (output, position) = (Samples { t: &t, y: &output }, Samples { t: &t, y: &position });
    let belief = filter.belief(&filter.run(&prior, output, position, |_, _| ())?.state);
    for (i, name) in [(2, "k"), (3, "K0"), (4, "s")] {
        println!("{name} = {:.5}({:.5})", belief.x[i], belief.sigma(i));
    }
    Ok(())
}
