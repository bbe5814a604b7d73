//! The acceleration as a function of output and parameters: value, gradient, and `M` times the gradient.
//!
//! Parameters have the order `k, K0` (linear) or `k, K0, K2, K3` (cubic), further effects last.

use crate::dense::system::Order;
use crate::error::DomainError;
use crate::sensor::polynomial::{Form, Parameters};
use crate::structured::number::Number;
use crate::structured::row::{Row, product, row};

/// The acceleration at one instant of a step with constant parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccelerationPartials<V: Row> {
    /// `a(u, theta)`, and `+ 1/2 tr(a_theta,theta M)` in second order, m/s^2.
    pub a: V::Number,
    /// `g = da/dtheta`.
    pub g: V,
    /// `h = M g`.
    pub h: V,
    /// `da/du`: how the output's noise enters.
    pub slope: V::Number,
}

/// How acceleration follows from the output and the parameters.
pub trait AccelerationModel<V: Row, const M: usize>: Copy {
    /// The input at every instant.
    type Input: Copy;
    /// Coefficients computed once per estimate.
    type Table: Copy;

    /// The table for the parameters `theta` with covariance `M`; both stay as they are between two readings.
    fn table(&self, theta: &V, P_theta: &[V; M], order: Order) -> Self::Table;

    /// The acceleration under `input`.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    fn at(&self, table: &Self::Table, input: Self::Input) -> Result<AccelerationPartials<V>, DomainError>;
}

/// A model whose gradient's noise is known: what the correction for errors in variables needs of it.
pub trait MixedPartials<V: Row, const M: usize>: AccelerationModel<V, M> {
    /// `d2a/(du dtheta)` and `da/du` for the parameters `theta`: how the output's noise enters the gradient, and `a`.
    ///
    /// # Errors
    /// [`DomainError`] where the sensor has no inverse.
    fn mixed(&self, theta: &V, input: Self::Input) -> Result<(V, V::Number), DomainError>;
}

const SCALE: usize = 0;
const BIAS: usize = 1;
const SECOND: usize = 2;
const THIRD: usize = 3;

#[inline(always)]
fn unit<V: Row>(witness: V::Number, i: usize, x: V::Number) -> V {
    V::from_fn(witness, |j| if i == j { x } else { witness.like(0.0) })
}

/// The inverse linear sensor (5), `a = (1 - k) w`, `w = u - K0`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InverseLinear;

/// What [`InverseLinear`] needs of the estimate; `-(1 - k)` and, at an instant, `-w`, because both enter `g`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearTable<V: Row> {
    minus_slope: V::Number,
    bias: V::Number,
    curvature: V::Number,
    h: [V; 2],
}

impl<V: Row, const M: usize> AccelerationModel<V, M> for InverseLinear {
    type Input = V::Number;
    type Table = LinearTable<V>;

    #[inline(always)]
    fn table(&self, theta: &V, P_theta: &[V; M], order: Order) -> LinearTable<V> {
        const { assert!(M >= 2, "the sensor has two parameters") };
        let bias = theta.at(BIAS);
        let minus_slope = theta.at(SCALE) - bias.like(1.0);
        let curvature = if order == Order::Second { P_theta[SCALE].at(BIAS) } else { bias.like(-0.0) };
        LinearTable { minus_slope, bias, curvature, h: [P_theta[BIAS].scaled(minus_slope), P_theta[SCALE]] }
    }

    #[inline(always)]
    fn at(&self, table: &LinearTable<V>, u: V::Number) -> Result<AccelerationPartials<V>, DomainError> {
        let minus_w = table.bias - u;
        let slope = table.minus_slope;
        let g = V::from_fn(u, |i| match i {
            SCALE => minus_w,
            BIAS => slope,
            _ => u.like(0.0),
        });
        Ok(AccelerationPartials {
            a: slope.times_plus(minus_w, table.curvature),
            g,
            h: table.h[0].plus(minus_w, table.h[1]),
            slope: -slope,
        })
    }
}

impl<V: Row, const M: usize> MixedPartials<V, M> for InverseLinear {
    #[inline(always)]
    fn mixed(&self, theta: &V, _: V::Number) -> Result<(V, V::Number), DomainError> {
        let k = theta.at(SCALE);
        Ok((unit(k, SCALE, k.like(-1.0)), k.like(1.0) - k))
    }
}

/// The inverse cubic sensor (6), `a = (1 - k) w + K2 w^2 + K3 w^3`.
///
/// `g` and `h = M g` are cubic polynomials in `w` with coefficients that only a reading changes: three multiplications per
/// instant instead of a product with `M`. Where elements are separate numbers, `g = (-w, -slope, w^2, w^3)` is used directly, with
/// equal bits.
///
/// With fewer than four parameters it does not compile:
///
/// ```compile_fail
/// use ekf_core::structured::acceleration::InverseCubic;
/// use ekf_core::{Belief, Engine, OwnSensor, Samples};
///
/// let samples = Samples { t: &[0.0, 1.0], y: &[0.0, 0.0] };
/// let filter = OwnSensor::<_, 2>::new(InverseCubic, 1e-6, 1e-12);
/// let _ = filter.run(&Belief::independent([0.0; 4], [1.0; 4]), samples, samples, |_, _| ());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InverseCubic;

/// What [`InverseCubic`] needs of the estimate: coefficients of `w^0..w^3`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CubicTable<V: Row> {
    bias: V::Number,
    a: [V::Number; 4],
    g: [V; 4],
    h: [V; 4],
    slope: [V::Number; 3],
}

impl<V: Row, const M: usize> AccelerationModel<V, M> for InverseCubic {
    type Input = V::Number;
    type Table = CubicTable<V>;

    #[inline(always)]
    fn table(&self, theta: &V, P_theta: &[V; M], order: Order) -> CubicTable<V> {
        const { assert!(M >= 4, "the sensor has four parameters") };
        let bias = theta.at(BIAS);
        let (K2, K3) = (theta.at(SECOND), theta.at(THIRD));
        let c = |x: f64| bias.like(x);
        let slope = [c(1.0) - theta.at(SCALE), c(2.0) * K2, c(3.0) * K3];
        let mut a = [c(0.0), slope[0], K2, K3];
        if order == Order::Second {
            let row = &P_theta[BIAS];
            a[0] = K2.times_plus(row.at(BIAS), row.at(SCALE));
            a[1] = slope[2].times_plus(row.at(BIAS), c(-2.0).times_plus(row.at(SECOND), a[1]));
            a[2] = c(-3.0).times_plus(row.at(THIRD), a[2]);
        }
        let column = |i: usize, x: f64, j: usize| {
            unit::<V>(bias, BIAS, -slope[j]) + if i == BIAS { V::every(c(0.0)) } else { unit(bias, i, c(x)) }
        };
        CubicTable {
            bias,
            a,
            g: [column(BIAS, 0.0, 0), column(SCALE, -1.0, 1), column(SECOND, 1.0, 2), unit(bias, THIRD, c(1.0))],
            h: [
                P_theta[BIAS].scaled(-slope[0]),
                P_theta[SCALE].scaled(c(-1.0)).plus(-slope[1], P_theta[BIAS]),
                P_theta[SECOND].plus(-slope[2], P_theta[BIAS]),
                P_theta[THIRD],
            ],
            slope,
        }
    }

    #[inline(always)]
    fn at(&self, table: &CubicTable<V>, u: V::Number) -> Result<AccelerationPartials<V>, DomainError> {
        let w = u - table.bias;
        let w2 = w * w;
        let [a0, a1, a2, a3] = table.a;
        let [s0, s1, s2] = table.slope;
        let (linear, squared) = (V::every(w), V::every(w2));
        let slope = w2.times_plus(s2, w.times_plus(s1, s0));
        Ok(AccelerationPartials {
            a: w2.times_plus(w.times_plus(a3, a2), w.times_plus(a1, a0)),
            g: if V::APART { row([-w, -slope, w2, w2 * w]) } else { cubic(linear, squared, &table.g) },
            h: cubic(linear, squared, &table.h),
            slope,
        })
    }
}

impl<V: Row, const M: usize> MixedPartials<V, M> for InverseCubic {
    #[inline(always)]
    fn mixed(&self, theta: &V, u: V::Number) -> Result<(V, V::Number), DomainError> {
        let (w, K2, K3) = (u - theta.at(BIAS), theta.at(SECOND), theta.at(THIRD));
        let c = |x: f64| u.like(x);
        let curvature = c(2.0).times_plus(K2, c(6.0) * K3 * w);
        let slope = (c(1.0) - theta.at(SCALE)) + w * c(2.0).times_plus(K2, c(3.0) * K3 * w);
        Ok((row([c(-1.0), -curvature, c(2.0) * w, c(3.0) * w * w]), slope))
    }
}

/// `b0 + b1 w + b2 w^2 + b3 w^3` in every place; a function, because a closure is compiled without the run's instructions.
#[inline(always)]
fn cubic<V: Row>(w: V, squared: V, b: &[V; 4]) -> V {
    squared.times_plus(w.times_plus(b[3], b[2]), w.times_plus(b[1], b[0]))
}

/// The forward linear sensor (3), `a = w / (1 + k)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ForwardLinear;

/// What [`ForwardLinear`] needs of the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForwardTable<V: Row> {
    bias: V::Number,
    slope: V::Number,
    /// `1/2 tr(a_theta,theta M) = (M_kk a + M_k,K0) / (1 + k)^2`: what multiplies `a`, and the rest.
    curvature: [V::Number; 2],
    h: [V; 2],
}

impl<V: Row, const M: usize> AccelerationModel<V, M> for ForwardLinear {
    type Input = V::Number;
    type Table = ForwardTable<V>;

    #[inline(always)]
    fn table(&self, theta: &V, P_theta: &[V; M], order: Order) -> ForwardTable<V> {
        const { assert!(M >= 2, "the sensor has two parameters") };
        let bias = theta.at(BIAS);
        let one = bias.like(1.0);
        let slope = one / (one + theta.at(SCALE));
        let squared = if order == Order::Second { slope * slope } else { bias.like(0.0) };
        let row = &P_theta[SCALE];
        let curvature = [squared.times_plus(row.at(SCALE), one), squared * row.at(BIAS)];
        ForwardTable { bias, slope, curvature, h: [P_theta[BIAS].scaled(-slope), row.scaled(-slope)] }
    }

    #[inline(always)]
    fn at(&self, table: &ForwardTable<V>, u: V::Number) -> Result<AccelerationPartials<V>, DomainError> {
        let slope = table.slope;
        let a = slope * (u - table.bias);
        let g = V::from_fn(a, |i| match i {
            SCALE => -(a * slope),
            BIAS => -slope,
            _ => a.like(0.0),
        });
        Ok(AccelerationPartials {
            a: a.times_plus(table.curvature[0], table.curvature[1]),
            g,
            h: table.h[0].plus(a, table.h[1]),
            slope,
        })
    }
}

impl<V: Row, const M: usize> MixedPartials<V, M> for ForwardLinear {
    #[inline(always)]
    fn mixed(&self, theta: &V, _: V::Number) -> Result<(V, V::Number), DomainError> {
        let one = theta.at(SCALE).like(1.0);
        let slope = one / (one + theta.at(SCALE));
        Ok((unit(one, SCALE, -(slope * slope)), slope))
    }
}

/// The forward cubic sensor (4), `w = (1 + k) a + K2 a^2 + K3 a^3` solved for `a`; one run at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ForwardCubic;

impl<V: Row<Number = f64>, const M: usize> AccelerationModel<V, M> for ForwardCubic {
    type Input = f64;
    type Table = (V, [V; M], Order);

    #[inline(always)]
    fn table(&self, theta: &V, P_theta: &[V; M], order: Order) -> (V, [V; M], Order) {
        const { assert!(M >= 4, "the sensor has four parameters") };
        (*theta, *P_theta, order)
    }

    /// With `J = dw/da`, `C = d^2w/da^2` and `m = dJ/dtheta`: `1/2 tr(a_theta,theta M) = -(m'h + C g'h / 2) / J`.
    #[inline(always)]
    fn at(&self, (theta, P_theta, order): &(V, [V; M], Order), u: f64) -> Result<AccelerationPartials<V>, DomainError> {
        let at = |i: usize| theta.at(i);
        let parameters = Parameters { k: at(SCALE), K0: at(BIAS), K2: at(SECOND), K3: at(THIRD) };
        let (mut a, J, C) = Form::Forward.solved(u, &parameters)?;
        let slope = 1.0 / J;
        let along = |values: [f64; 4]| V::from_fn(slope, |i| values.get(i).copied().unwrap_or(0.0));
        let g = along([-a * slope, -slope, -a * a * slope, -a * a * a * slope]);
        let h = product(P_theta, &g);
        if *order == Order::Second {
            let m = along([1.0, 0.0, 2.0 * a, 3.0 * a * a]);
            a -= slope * (m.dot(h) + 0.5 * C * g.dot(h));
        }
        Ok(AccelerationPartials { a, g, h, slope })
    }
}

impl<V: Row<Number = f64>, const M: usize> MixedPartials<V, M> for ForwardCubic {
    /// Of `a_theta = -phi / J` with `phi = (a, 1, a^2, a^3)`: `-(phi' - C phi / J) / J^2`.
    #[inline(always)]
    fn mixed(&self, theta: &V, u: f64) -> Result<(V, f64), DomainError> {
        let at = |i: usize| theta.at(i);
        let parameters = Parameters { k: at(SCALE), K0: at(BIAS), K2: at(SECOND), K3: at(THIRD) };
        let (a, J, C) = Form::Forward.solved(u, &parameters)?;
        let (slope, bent) = (1.0 / J, C / J);
        let phi: V = row([a, 1.0, a * a, a * a * a]);
        let rising: V = row([1.0, 0.0, 2.0 * a, 3.0 * a * a]);
        Ok((rising.plus(-bent, phi).scaled(-slope * slope), slope))
    }
}

/// The forward linear sensor with further effects that add to its output, `u = K0 + (1 + k) f + sum c_j e_j`.
///
/// `f` is the specific force along the input axis, the acceleration `f - rest`. The effects `e_j` are given at every instant
/// and follow `k, K0` among the parameters; their dependence on the state is left out of the gradient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WithEffects {
    /// Specific force while the stage is at rest, m/s^2.
    pub rest: f64,
}

/// The output, and the effects in the places of their coefficients; zero in the places of the sensor's own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Driven<V: Row> {
    /// `u`, m/s^2.
    pub u: V::Number,
    /// `e_j`, m/s^2 per unit of the coefficient.
    pub columns: V,
}

/// What [`WithEffects`] needs of the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectsTable<V: Row, const M: usize> {
    slope: V::Number,
    theta: V,
    P_theta: [V; M],
    order: Order,
}

impl<V: Row, const M: usize> AccelerationModel<V, M> for WithEffects {
    type Input = Driven<V>;
    type Table = EffectsTable<V, M>;

    #[inline(always)]
    fn table(&self, theta: &V, P_theta: &[V; M], order: Order) -> EffectsTable<V, M> {
        const { assert!(M >= 2, "the sensor has two parameters") };
        let one = theta.at(SCALE).like(1.0);
        EffectsTable { slope: one / (one + theta.at(SCALE)), theta: *theta, P_theta: *P_theta, order }
    }

    /// `g = -(f, 1, e) / (1 + k)`; with `h = M g`, `1/2 tr(a_theta,theta M) = -h_k / (1 + k)`.
    #[inline(always)]
    fn at(&self, table: &EffectsTable<V, M>, input: Driven<V>) -> Result<AccelerationPartials<V>, DomainError> {
        let EffectsTable { slope, theta, P_theta, order } = table;
        let force = *slope * (input.u - theta.at(BIAS) - theta.dot(input.columns));
        let g = (unit::<V>(force, SCALE, force) + unit(force, BIAS, force.like(1.0)) + input.columns).scaled(-*slope);
        let h = product(P_theta, &g);
        let mut a = force - force.like(self.rest);
        if *order == Order::Second {
            a = a - *slope * h.at(SCALE);
        }
        Ok(AccelerationPartials { a, g, h, slope: *slope })
    }
}

/// [`WithEffects`] whose effects follow from the output, noise and all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WithNoisyEffects<V> {
    /// The sensor and what is given of the effects.
    pub effects: WithEffects,
    /// `de_j/du` over the step, per unit of the coefficient; zero in the places of the sensor's own.
    pub slopes: V,
}

impl<V: Row, const M: usize> AccelerationModel<V, M> for WithNoisyEffects<V> {
    type Input = Driven<V>;
    type Table = EffectsTable<V, M>;

    #[inline(always)]
    fn table(&self, theta: &V, P_theta: &[V; M], order: Order) -> EffectsTable<V, M> {
        self.effects.table(theta, P_theta, order)
    }

    #[inline(always)]
    fn at(&self, table: &EffectsTable<V, M>, input: Driven<V>) -> Result<AccelerationPartials<V>, DomainError> {
        self.effects.at(table, input)
    }
}

impl<V: Row, const M: usize> MixedPartials<V, M> for WithNoisyEffects<V> {
    #[inline(always)]
    fn mixed(&self, theta: &V, _: Driven<V>) -> Result<(V, V::Number), DomainError> {
        let one = theta.at(SCALE).like(1.0);
        let slope = one / (one + theta.at(SCALE));
        Ok(((unit::<V>(one, SCALE, slope) + self.slopes).scaled(-slope), slope))
    }
}
