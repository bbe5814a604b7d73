//! W3 with adskalman: the linear prediction as it stands, and the output's reading linearised by an observation model.

use adskalman::{CovarianceUpdateMethod, ObservationModel, StateAndCovariance, TransitionModelLinearNoControl};
use nalgebra::{Matrix1, Matrix5, Matrix5x1, RowVector5, Vector1, Vector5};

use crate::workloads::{DT, Data, JERK, R_OUTPUT, R_POSITION, variance};

struct WhiteJerk {
    F: Matrix5<f64>,
    FT: Matrix5<f64>,
    Q: Matrix5<f64>,
}

impl WhiteJerk {
    fn new() -> Self {
        let mut F = Matrix5::identity();
        F[(0, 1)] = DT;
        F[(0, 2)] = 0.5 * DT * DT;
        F[(1, 2)] = DT;
        let mut Q = Matrix5::zeros();
        let powers = [
            [DT.powi(5) / 20.0, DT.powi(4) / 8.0, DT.powi(3) / 6.0],
            [DT.powi(4) / 8.0, DT.powi(3) / 3.0, DT * DT / 2.0],
            [DT.powi(3) / 6.0, DT * DT / 2.0, DT],
        ];
        for (i, row) in powers.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                Q[(i, j)] = JERK * value;
            }
        }
        Self { F, FT: F.transpose(), Q }
    }
}

impl TransitionModelLinearNoControl<f64, nalgebra::U5> for WhiteJerk {
    fn F(&self) -> &Matrix5<f64> {
        &self.F
    }

    fn FT(&self) -> &Matrix5<f64> {
        &self.FT
    }

    fn Q(&self) -> &Matrix5<f64> {
        &self.Q
    }
}

/// A scalar reading, linear about the state that it was made for.
struct Reading {
    H: RowVector5<f64>,
    HT: Matrix5x1<f64>,
    R: Matrix1<f64>,
    expected: fn(&Vector5<f64>) -> f64,
}

impl Reading {
    fn position() -> Self {
        let H = RowVector5::new(1.0, 0.0, 0.0, 0.0, 0.0);
        Self { H, HT: H.transpose(), R: Matrix1::new(R_POSITION), expected: |x| x[0] }
    }

    /// K0 + (1 + k) a.
    fn output(x: &Vector5<f64>) -> Self {
        let H = RowVector5::new(0.0, 0.0, 1.0 + x[3], x[2], 1.0);
        Self { H, HT: H.transpose(), R: Matrix1::new(R_OUTPUT), expected: |x| x[4] + (1.0 + x[3]) * x[2] }
    }
}

impl ObservationModel<f64, nalgebra::U5, nalgebra::U1> for Reading {
    fn predict_observation(&self, state: &Vector5<f64>) -> Vector1<f64> {
        Vector1::new((self.expected)(state))
    }

    fn H(&self) -> &RowVector5<f64> {
        &self.H
    }

    fn HT(&self) -> &Matrix5x1<f64> {
        &self.HT
    }

    fn R(&self) -> &Matrix1<f64> {
        &self.R
    }
}

/// Final x and diagonal of P.
pub fn run(data: &Data, joseph: bool) -> Vec<f64> {
    let method = if joseph { CovarianceUpdateMethod::JosephForm } else { CovarianceUpdateMethod::OptimalKalman };
    let motion = WhiteJerk::new();
    let position = Reading::position();
    let diagonal = Vector5::from_fn(|i, _| variance(3, i));
    let mut belief = StateAndCovariance::new(Vector5::zeros(), Matrix5::from_diagonal(&diagonal));
    for j in 1..data.u.len() {
        belief = motion.predict(&belief);
        let output = Reading::output(belief.state());
        belief = output.update(&belief, &Vector1::new(data.u[j]), method).expect("a covariance");
        if !data.z[j].is_nan() {
            belief = position.update(&belief, &Vector1::new(data.z[j]), method).expect("a covariance");
        }
    }
    belief.state().iter().chain(belief.covariance().diagonal().iter()).copied().collect()
}
