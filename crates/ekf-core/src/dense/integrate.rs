//! From one instant to the next: Runge-Kutta on the coupled `(x, P)` equations (11)-(14), or the exact step.

use nalgebra::{SMatrix, SVector};

use crate::dense::belief::{Belief, symmetric_part};
use crate::dense::system::{Drive, Order, System, Transition};
use crate::error::StepError;

/// How a step is integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integrator {
    /// Second-order Runge-Kutta, midpoint: the paper's first-order filter. Can lose positive definiteness.
    Rk2,
    /// Fourth-order Runge-Kutta: the paper's second-order filter.
    Rk4,
    /// No integration error.
    Exact,
}

/// `x`, `P` and the transition matrix on their way through a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flow<const N: usize> {
    /// Mean.
    pub x: SVector<f64, N>,
    /// Covariance.
    pub P: SMatrix<f64, N, N>,
    /// `Phi` from the start of the step.
    pub Phi: SMatrix<f64, N, N>,
}

impl<const N: usize> Flow<N> {
    fn start(belief: &Belief<N>) -> Self {
        Self { x: belief.x, P: belief.P, Phi: SMatrix::identity() }
    }

    /// `self + h rate`.
    fn moved(&self, h: f64, rate: &Self) -> Self {
        Self { x: self.x + rate.x * h, P: self.P + rate.P * h, Phi: self.Phi + rate.Phi * h }
    }

    /// `x' = f`, `P' = F P + P F' + D Q D'`, `Phi' = F Phi` at `s` seconds of the segment.
    fn rate<S: System<N>>(&self, system: &S, drive: &Drive, s: f64, order: Order) -> Result<Self, StepError> {
        let rates = system.rates(&self.x, &self.P, drive.segment.value(s), order)?;
        let FP = rates.F * self.P;
        Ok(Self { x: rates.f, P: FP + FP.transpose() + rates.DQDt, Phi: rates.F * self.Phi })
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
        let start = Flow::start(belief);
        let h = drive.to - drive.from;
        let middle = drive.from + 0.5 * h;
        let k1 = start.rate(system, drive, drive.from, order)?;
        let k2 = start.moved(0.5 * h, &k1).rate(system, drive, middle, order)?;
        if self == Self::Rk2 {
            return Ok(start.moved(h, &k2));
        }
        let k3 = start.moved(0.5 * h, &k2).rate(system, drive, middle, order)?;
        let k4 = start.moved(h, &k3).rate(system, drive, drive.to, order)?;
        Ok(start.moved(h / 6.0, &k1).moved(h / 3.0, &k2).moved(h / 3.0, &k3).moved(h / 6.0, &k4))
    }
}

/// Abscissae on `[-1, 1]` and weights of the five-point Gauss-Legendre rule: exact to degree nine.
const RULE: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];

/// Points and weights of the five-point Gauss-Legendre rule on `[a, b]`.
pub(crate) fn nodes(a: f64, b: f64) -> impl Iterator<Item = (f64, f64)> {
    let half = 0.5 * (b - a);
    RULE.iter().map(move |&(s, weight)| (a + half * (1.0 + s), half * weight))
}
