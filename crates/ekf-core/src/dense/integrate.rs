//! From one instant to the next: Runge-Kutta on the coupled `(x, P)` equations (11)-(14), or the exact step.

use nalgebra::{SMatrix, SVector};

use crate::dense::belief::{Belief, symmetric_part};
use crate::dense::system::{Drive, Order, System, Transition};
use crate::error::StepError;
use crate::integration::{Derivative, Integrator, Stage, runge_kutta};

/// `x`, `P` and the transition matrix within a step.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Flow<const N: usize> {
    x: SVector<f64, N>,
    P: SMatrix<f64, N, N>,
    /// From the start of the step.
    Phi: SMatrix<f64, N, N>,
}

impl<const N: usize> Flow<N> {
    fn start(belief: &Belief<N>) -> Self {
        Self { x: belief.x, P: belief.P, Phi: SMatrix::identity() }
    }
}

impl<const N: usize> Stage for Flow<N> {
    fn moved(&self, h: f64, rate: &Self) -> Self {
        Self { x: self.x + rate.x * h, P: self.P + rate.P * h, Phi: self.Phi + rate.Phi * h }
    }
}

/// `x' = f`, `P' = F P + P F' + D Q D'`, `Phi' = F Phi`; time counts from the start of the segment.
struct FlowRate<'a, S> {
    system: &'a S,
    drive: &'a Drive,
    order: Order,
}

impl<S: System<N>, const N: usize> Derivative<Flow<N>> for FlowRate<'_, S> {
    type Error = StepError;

    fn rate(&self, y: &Flow<N>, s: f64) -> Result<Flow<N>, StepError> {
        let rates = self.system.rates(&y.x, &y.P, self.drive.segment.value(s), self.order)?;
        let FP = rates.F * y.P;
        Ok(Flow { x: rates.f, P: FP + FP.transpose() + rates.DQDt, Phi: rates.F * y.Phi })
    }
}

impl Integrator {
    /// The step of a dense belief, and its transition matrix.
    ///
    /// # Errors
    /// [`StepError::Domain`]; [`StepError::Variance`] or [`StepError::Correlation`] if `P` is no covariance any more.
    pub fn step<const N: usize, S: System<N>>(
        self,
        system: &S,
        belief: &Belief<N>,
        drive: &Drive,
        order: Order,
    ) -> Result<(Belief<N>, SMatrix<f64, N, N>), StepError> {
        let (x, P, Phi) = if self == Self::Exact {
            let Transition { x, Phi, Q } = system.transition(&belief.x, &belief.P, drive, order)?;
            (x, symmetric_part(&(Phi * belief.P * Phi.transpose())) + Q, Phi)
        } else {
            let flow = self.flow(system, belief, drive, order)?;
            (flow.x, flow.P, flow.Phi)
        };
        Ok((Belief { x, P }.checked()?, Phi))
    }

    /// Mean, `Phi` and `Q_d` of the step, for a factored covariance.
    ///
    /// Mean and `Phi` are this integrator's; `Q_d` is always the exact one, because the `Q_d` that goes with RK2 is
    /// indefinite and has no factors.
    ///
    /// # Errors
    /// [`StepError::Domain`].
    pub fn transition<const N: usize, S: System<N>>(
        self,
        system: &S,
        belief: &Belief<N>,
        drive: &Drive,
        order: Order,
    ) -> Result<Transition<N>, StepError> {
        let exact = system.transition(&belief.x, &belief.P, drive, order)?;
        if self == Self::Exact {
            return Ok(exact);
        }
        let flow = self.flow(system, belief, drive, order)?;
        Ok(Transition { x: flow.x, Phi: flow.Phi, Q: exact.Q })
    }

    fn flow<const N: usize, S: System<N>>(
        self,
        system: &S,
        belief: &Belief<N>,
        drive: &Drive,
        order: Order,
    ) -> Result<Flow<N>, StepError> {
        runge_kutta(self, &FlowRate { system, drive, order }, &Flow::start(belief), drive.from, drive.to)
    }
}
