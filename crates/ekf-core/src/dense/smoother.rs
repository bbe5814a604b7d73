//! The fixed-interval smoother: means in the modified Bryson-Frazier form, covariances from the square root of information.
//!
//! Equal to Rauch-Tung-Striebel (derivations 6.4) without inverting the predicted `P`, which constant parameters and exactly
//! known ones make singular (Bierman 1977, ch. X). The information `Y = R'R` of all later readings runs backward by
//! orthogonal transformations alone; with `P = L L'` of the filter, `(I + L'Y L)^-1` of the smoother needs no difference,
//! so no smoothed variance is negative and none exceeds the filtered one.

use nalgebra::{RowSVector, SMatrix, SVector};

use crate::dense::belief::{Belief, check_mean, symmetric_part};
use crate::dense::filter::{Correction, Filter, Outcome};
use crate::dense::system::{Drive, System};
use crate::dense::ud::factorise_within;
use crate::error::{RunError, StepError};

/// A reading without noise counts as one with this share of its innovation variance, which is below rounding.
const NOISELESS: f64 = f64::EPSILON * f64::EPSILON;

/// A squared length below this counts as zero: its inverse could overflow.
const NEGLIGIBLE: f64 = 1e-280;
/// A pivot of `P` this share of its variance below zero is rounding: the share that a squared correlation may exceed one by.
const SLACK: f64 = 1e-6;

/// Replaces the filtered belief of every outcome by the smoothed one.
///
/// `outcomes` are all the outcomes of one run of `filter` from `prior`, in time order. The linearisation of the filter is
/// kept. Under Runge-Kutta the result equals Rauch-Tung-Striebel up to the integration error of `P`, since the noise of
/// its steps is taken without integration error.
///
/// # Errors
/// [`RunError::Step`] with the outcome, and [`StepError::Variance`] where `P` of the filter has a negative pivot: Runge-Kutta
/// can lose positive definiteness in more than two states at once, which the filter does not see. [`StepError::Mean`] or
/// [`StepError::Variance`] where a product overflows.
pub fn smooth<S: System<N>, const N: usize>(
    filter: &Filter<S>,
    prior: &Belief<N>,
    outcomes: &mut [Outcome<N>],
) -> Result<(), RunError> {
    let mut lambda = SVector::<f64, N>::zeros();
    let mut information = Information::<N>::none();
    for at in (0..outcomes.len()).rev() {
        let before = if at == 0 { *prior } else { outcomes[at - 1].belief };
        let outcome = &mut outcomes[at];
        let t = outcome.event.t;
        let failed = |error: StepError| RunError::Step { event: at, t, error };
        let Belief { x, P } = outcome.belief;
        outcome.belief = Belief { x: x - P * lambda, P: information.reduce(&P).map_err(failed)? };
        require_finite(&outcome.belief).map_err(failed)?;
        if let Some(correction) = outcome.correction.filter(|correction| correction.reading.accepted) {
            let Correction { reading, H, gain, R } = correction;
            let IKH = SMatrix::<f64, N, N>::identity() - gain * H;
            lambda = IKH.transpose() * lambda - H.transpose() * (reading.innovation.e / reading.innovation.s);
            information.read(&H, R.max(reading.innovation.s * NOISELESS));
        }
        if let Some(drive) = &outcome.drive {
            lambda = outcome.Phi.transpose() * lambda;
            information.back(filter, &before, drive, &outcome.Phi).map_err(failed)?;
        }
    }
    Ok(())
}

/// Refuses what has overflowed: gains and transitions of absurd size can be finite where their products are not.
fn require_finite<const N: usize>(belief: &Belief<N>) -> Result<(), StepError> {
    check_mean(N, |i| belief.x[i])?;
    match (0..N).find(|&i| !belief.P[(i, i)].is_finite()) {
        Some(state) => Err(StepError::Variance { state, variance: belief.P[(state, state)] }),
        None => Ok(()),
    }
}

/// The square root `R` of the information of later readings, `R'R = Y`: upper triangular.
struct Information<const N: usize>(SMatrix<f64, N, N>);

impl<const N: usize> Information<N> {
    fn none() -> Self {
        Self(SMatrix::zeros())
    }

    /// `L (I + L'Y L)^-1 L'` for `P = L L'`.
    fn reduce(&self, P: &SMatrix<f64, N, N>) -> Result<SMatrix<f64, N, N>, StepError> {
        let root = square_root(P)?;
        let mut triangle = SMatrix::<f64, N, N>::identity();
        let mut rows = self.0 * root;
        triangularise(&mut triangle, &mut rows, None);
        // M T = L, column by column; no element of T's diagonal is below one.
        let mut reduced = root;
        for j in 0..N {
            for i in 0..N {
                let explained: f64 = (0..j).map(|k| reduced[(i, k)] * triangle[(k, j)]).sum();
                reduced[(i, j)] = (reduced[(i, j)] - explained) / triangle[(j, j)];
            }
        }
        Ok(symmetric_part(&(reduced * reduced.transpose())))
    }

    /// Adds a reading of `H x` with variance `R`.
    fn read(&mut self, H: &RowSVector<f64, N>, R: f64) {
        let mut rows = SMatrix::<f64, N, N>::zeros();
        rows.set_row(0, &(H / libm::sqrt(R)));
        triangularise(&mut self.0, &mut rows, None);
    }

    /// Information about the state at the start of a step: the noise of the step is eliminated.
    fn back<S: System<N>>(
        &mut self,
        filter: &Filter<S>,
        before: &Belief<N>,
        drive: &Drive,
        Phi: &SMatrix<f64, N, N>,
    ) -> Result<(), StepError> {
        let Q = filter.system.transition(&before.x, &before.P, drive, filter.order)?.Q;
        let mut noise = SMatrix::<f64, N, N>::identity();
        let mut pushed = self.0 * square_root(&Q)?;
        let mut triangle = SMatrix::<f64, N, N>::zeros();
        let mut rows = self.0 * Phi;
        triangularise(&mut noise, &mut pushed, Some((&mut triangle, &mut rows)));
        self.0 = SMatrix::zeros();
        triangularise(&mut self.0, &mut rows, None);
        Ok(())
    }
}

/// `L` with `L L' = P`.
fn square_root<const N: usize>(P: &SMatrix<f64, N, N>) -> Result<SMatrix<f64, N, N>, StepError> {
    let (U, D) = factorise_within(P, SLACK).map_err(|(state, variance)| StepError::Variance { state, variance })?;
    Ok(U * SMatrix::from_diagonal(&D.map(libm::sqrt)))
}

/// Householder reflections that bring `[triangle; rows]` to `[triangle; 0]`; further columns `[top; bottom]` go along.
fn triangularise<const N: usize>(
    triangle: &mut SMatrix<f64, N, N>,
    rows: &mut SMatrix<f64, N, N>,
    mut along: Option<(&mut SMatrix<f64, N, N>, &mut SMatrix<f64, N, N>)>,
) {
    for j in 0..N {
        let below = rows.column(j).norm_squared();
        if below < NEGLIGIBLE {
            rows.column_mut(j).fill(0.0);
            continue;
        }
        let pivot = triangle[(j, j)];
        let length = libm::copysign(libm::sqrt(pivot * pivot + below), pivot);
        let lead = pivot + length;
        let column: SVector<f64, N> = rows.column(j).into_owned();
        let scale = 1.0 / (length * lead);
        let reflect = |top: &mut SMatrix<f64, N, N>, bottom: &mut SMatrix<f64, N, N>, k: usize| {
            let share = (lead * top[(j, k)] + column.dot(&bottom.column(k))) * scale;
            top[(j, k)] -= share * lead;
            for i in 0..N {
                bottom[(i, k)] -= share * column[i];
            }
        };
        for k in j + 1..N {
            reflect(triangle, rows, k);
        }
        if let Some((top, bottom)) = along.as_mut() {
            for k in 0..N {
                reflect(top, bottom, k);
            }
        }
        triangle[(j, j)] = -length;
        rows.column_mut(j).fill(0.0);
    }
}
