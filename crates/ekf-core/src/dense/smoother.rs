//! The fixed-interval smoother in the modified Bryson-Frazier form.
//!
//! Equal to Rauch-Tung-Striebel (derivations 6.4) without inverting the predicted `P`, which constant parameters and exactly
//! known ones make singular (Bierman 1977, ch. X).

use nalgebra::{SMatrix, SVector};

use crate::dense::belief::{Belief, symmetric_part};
use crate::dense::filter::Outcome;

/// Replaces the filtered belief of every outcome by the smoothed one.
///
/// `outcomes` are all the outcomes of one run in time order. The linearisation of the filter is kept. Under Runge-Kutta the
/// result equals Rauch-Tung-Striebel up to the integration error of `P`.
pub fn smooth<const N: usize>(outcomes: &mut [Outcome<N>]) {
    let mut lambda = SVector::<f64, N>::zeros();
    let mut Lambda = SMatrix::<f64, N, N>::zeros();
    for outcome in outcomes.iter_mut().rev() {
        let Belief { x, P } = outcome.belief;
        outcome.belief = Belief { x: x - P * lambda, P: symmetric_part(&(P - P * Lambda * P)) };
        if let Some(correction) = outcome.correction.filter(|correction| correction.reading.accepted) {
            let H = correction.H;
            let s = correction.reading.innovation.s;
            let IKH = SMatrix::<f64, N, N>::identity() - correction.gain * H;
            lambda = IKH.transpose() * lambda - H.transpose() * (correction.reading.innovation.e / s);
            Lambda = symmetric_part(&(IKH.transpose() * Lambda * IKH)) + H.transpose() * H / s;
        }
        lambda = outcome.Phi.transpose() * lambda;
        Lambda = symmetric_part(&(outcome.Phi.transpose() * Lambda * outcome.Phi));
    }
}
