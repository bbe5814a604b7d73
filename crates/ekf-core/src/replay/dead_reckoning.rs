//! Motion integrated from acceleration alone: what effects add to it, and its covariance.

use crate::replay::MotionCovariance;

/// What effects on the output have added to the motion up to a node.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Displacement {
    /// Acceleration, m/s^2.
    pub a: f64,
    /// Velocity, m/s.
    pub v: f64,
    /// Position, m.
    pub p: f64,
}

impl Displacement {
    /// The displacement `h` s later, where the added acceleration is `a`; it is straight in between.
    #[must_use]
    pub fn after(self, h: f64, a: f64) -> Self {
        Self { a, v: self.v + 0.5 * h * (self.a + a), p: self.p + h * (self.v + h * (2.0 * self.a + a) / 6.0) }
    }
}

/// Added acceleration at a node of a trial path, and what the effects give for the motion of that path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// Displacement that the trial's accelerations have led to.
    pub at: Displacement,
    /// Added acceleration that the effects give at that motion, m/s^2.
    pub acceleration: f64,
    /// How it falls with position and velocity.
    pub slopes: Slopes,
}

impl Displacement {
    /// The displacement `h` s later whose acceleration is that of the effects, linear about a trial: one step of
    /// Newton's method for the path, exact for linear drag and springs of any strength.
    #[must_use]
    pub fn corrected(self, h: f64, trial: Trial) -> Self {
        let coasted = self.after(h, 0.0);
        let Slopes { p, v } = trial.slopes;
        let acceleration = trial.acceleration - p * (coasted.p - trial.at.p) - v * (coasted.v - trial.at.v);
        self.after(h, acceleration / (1.0 + h * (0.5 * v + h * p / 6.0)))
    }
}

/// How the acceleration falls with position and velocity where effects depend on them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Slopes {
    /// -da/dp, 1/s^2.
    pub p: f64,
    /// -da/dv, 1/s.
    pub v: f64,
}

/// What adds to the covariance over one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepNoise {
    /// Two-sided density of the noise on acceleration, (m/s^2)^2/Hz.
    pub q: f64,
    /// Variance of the velocity that is lost within the step, m^2/s^2.
    pub lost: f64,
}

impl MotionCovariance {
    /// The covariance a step of `h` s later, slopes `from` at its begin and `to` at its end.
    ///
    /// `x' = A x + w` by the trapezoid rule, `(I - h A1/2) x1 = (I + h A0/2) x0`, which no slope of a friction makes
    /// unstable; exact without slopes.
    #[must_use]
    pub fn dead_reckoned(self, h: f64, from: Slopes, to: Slopes, noise: StepNoise) -> Self {
        let half = 0.5 * h;
        // Phi = (I - half A1)^-1 (I + half A0), A = [[0, 1], [-p, -v]]
        let determinant = 1.0 + half * to.v + half * half * to.p;
        let (a, b) = ((1.0 + half * to.v) / determinant, half / determinant);
        let (c, d) = (-half * to.p / determinant, 1.0 / determinant);
        let (e, f) = (-half * from.p, 1.0 - half * from.v);
        let phi = [[a + b * e, a * half + b * f], [c + d * e, c * half + d * f]];
        let across = |row: [f64; 2]| [row[0] * self.pp + row[1] * self.pv, row[0] * self.pv + row[1] * self.vv];
        let (first, second) = (across(phi[0]), across(phi[1]));
        Self {
            pp: first[0] * phi[0][0] + first[1] * phi[0][1] + noise.q * h * h * h / 3.0,
            pv: first[0] * phi[1][0] + first[1] * phi[1][1] + noise.q * h * h / 2.0,
            vv: second[0] * phi[1][0] + second[1] * phi[1][1] + noise.q * h + noise.lost,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: MotionCovariance = MotionCovariance { pp: 4e-12, pv: 1e-10, vv: 9e-8 };

    fn after(seconds: f64, steps: u32, slopes: Slopes, q: f64) -> MotionCovariance {
        let h = seconds / f64::from(steps);
        (0..steps).fold(START, |P, _| P.dead_reckoned(h, slopes, slopes, StepNoise { q, lost: 0.0 }))
    }

    #[test]
    fn a_straight_acceleration_is_integrated_exactly() {
        let start = Displacement { a: 1.0, v: -2.0, p: 0.5 };
        let once = start.after(0.8, 1.0 + 3.0 * 0.8);
        let twice = start.after(0.3, 1.0 + 3.0 * 0.3).after(0.5, 1.0 + 3.0 * 0.8);
        let p = 0.5 - 2.0 * 0.8 + 0.5 * 0.64 + 3.0 * 0.512 / 6.0;
        for actual in [once, twice] {
            assert!((actual.p - p).abs() < 1e-15 && (actual.v - (-2.0 + 0.8 + 1.5 * 0.64)).abs() < 1e-15);
        }
    }

    #[test]
    fn linear_effects_are_solved_at_once_from_any_trial() {
        for (p, v) in [(4.0, 0.0), (0.0, 3.0), (2.0, 1e6), (0.0, -0.5)] {
            let (slopes, h) = (Slopes { p, v }, 0.01);
            let (p0, v0) = (0.2, -0.7);
            let mut at = Displacement { a: -p * p0 - v * v0, v: 0.0, p: 0.0 };
            let mut guess = at;
            for step in 1..200 {
                let t = h * f64::from(step);
                guess = guess.after(h, (7.3 * t).sin());
                let acceleration = -p * (p0 + v0 * t + guess.p) - v * (v0 + guess.v);
                at = at.corrected(h, Trial { at: guess, acceleration, slopes });
                let exact = -p * (p0 + v0 * t + at.p) - v * (v0 + at.v);
                assert!((at.a - exact).abs() <= 1e-9 * (1.0 + v.abs()), "{p} {v} {step}: {} {exact}", at.a);
            }
        }
    }

    #[test]
    fn without_slopes_it_is_the_double_integral_of_white_noise() {
        let (q, t) = (1e-6, 3.0);
        let P = after(t, 7, Slopes::default(), q);
        let expected = q * t.powi(3) / 3.0 + START.pp + 2.0 * t * START.pv + t * t * START.vv;
        assert!((P.pp / expected - 1.0).abs() < 1e-12);
    }

    #[test]
    fn drag_bounds_the_velocity_at_its_stationary_variance() {
        let (q, drag) = (1e-6, 5.0);
        let P = after(10.0, 20_000, Slopes { p: 0.0, v: drag }, q);
        assert!((P.vv / (q / (2.0 * drag)) - 1.0).abs() < 1e-2);
    }

    #[test]
    fn a_spring_turns_an_error_of_velocity_into_one_of_position() {
        let w: f64 = 2.0;
        let quarter = core::f64::consts::FRAC_PI_2 / w;
        let P = after(quarter, 20_000, Slopes { p: w * w, v: 0.0 }, 0.0);
        assert!((P.pp / (START.vv / (w * w)) - 1.0).abs() < 1e-6);
        assert!((P.vv / (START.pp * w * w) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn no_slope_of_a_friction_makes_it_grow() {
        let P = after(1.0, 500, Slopes { p: 0.0, v: 1e6 }, 0.0);
        assert!(P.vv <= START.vv && P.pp.is_finite());
    }
}
