//! Integration over a step: the choice of integrator, Runge-Kutta on any state, and Gauss-Legendre quadrature.

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

/// A state, or its rate of change, as Runge-Kutta combines them.
pub(crate) trait Stage: Copy {
    /// `self + h rate`.
    fn moved(&self, h: f64, rate: &Self) -> Self;
}

/// The right-hand side of `y' = f(y, s)`; a trait, because a closure is compiled without the run's instructions.
pub(crate) trait Derivative<Y> {
    /// Why the rate may not exist.
    type Error;

    /// `f(y, s)`, `s` in seconds.
    fn rate(&self, y: &Y, s: f64) -> Result<Y, Self::Error>;
}

/// `y` at `to` from `y` at `from`, by midpoint (RK2) or classical RK4.
pub(crate) fn runge_kutta<Y: Stage, D: Derivative<Y>>(
    integrator: Integrator,
    derivative: &D,
    start: &Y,
    from: f64,
    to: f64,
) -> Result<Y, D::Error> {
    let h = to - from;
    let middle = from + 0.5 * h;
    // Of each stage: where it is, how far its rate carries to the next, its weight in the sum. A loop, because the rate is
    // compiled into it: thousands of instructions, for every kernel.
    let midpoint = [(from, 0.5 * h, 0.0), (middle, 0.0, h)];
    let classical = [(from, 0.5 * h, h / 6.0), (middle, 0.5 * h, h / 3.0), (middle, h, h / 3.0), (to, 0.0, h / 6.0)];
    let (mut y, mut sum) = (*start, *start);
    for &(s, ahead, weight) in if integrator == Integrator::Rk2 { &midpoint[..] } else { &classical[..] } {
        let rate = derivative.rate(&y, s)?;
        y = start.moved(ahead, &rate);
        sum = sum.moved(weight, &rate);
    }
    Ok(sum)
}

/// Points of the quadrature.
pub(crate) const POINTS: usize = 5;

/// Abscissae on `[-1, 1]` and weights of the five-point Gauss-Legendre rule: exact to degree nine.
const RULE: [(f64, f64); POINTS] = [
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
