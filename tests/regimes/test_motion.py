"""Motion is exact: integrals against quadrature and differences, poles against a solver, continuity everywhere."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from tests.regimes.motion import (
    Motion,
    Piecewise,
    from_design,
    from_pieces,
    rc,
    residues,
    resonance,
    through_structure,
)
from tests.regimes.profiles import MARGIN, PROFILES, SPEED, STEP
from tests.worlds.numerics import stream


def few() -> Motion:
    """A motion of five pieces of different lengths, with jumps."""
    lengths = np.array([0.13, 0.021, 0.3, 0.0007, 0.4])
    return from_pieces(-0.1, lengths, np.array([0.0, 2.0, -1.5, 3.0, 0.5]), np.array([1.0, 2.0, -2.5, -3.0, 0.0]))


def integral(function, begin: float, end: float, knots: np.ndarray) -> float:
    inside = knots[(knots > begin) & (knots < end)]
    edges = [begin, *inside.tolist(), end]
    return sum(quad(function, low, high, epsabs=1e-14)[0] for low, high in pairwise(edges))


def test_velocity_and_position_are_the_integrals_of_acceleration() -> None:
    motion = few()
    for t in (-0.05, 0.03, 0.0512, 0.2, 0.7):
        v = integral(lambda x: float(motion.a.at(np.array([x]))[0]), -0.1, t, motion.a.knots)
        p = integral(lambda x: float(motion.velocity(np.array([x]))[0]), -0.1, t, motion.a.knots)
        assert motion.velocity(np.array([t]))[0] == pytest.approx(v, abs=1e-13)  # quad's own error
        assert motion.position(np.array([t]))[0] == pytest.approx(p, abs=1e-13)


@pytest.mark.parametrize("name", PROFILES)
def test_the_second_difference_of_position_is_acceleration(name: str) -> None:
    motion = PROFILES[name](5.0, stream(3, 1))
    step = 2e-5
    t = np.linspace(0.1, 4.9, 400)
    i, s = motion.a.place(t)
    t = t[(s > step) & (s < motion.a.lengths[i] - step)]  # inside one piece the difference of a cubic is exact
    p = [motion.position(t + k * step) for k in (-1, 0, 1)]
    assert len(t) > 100
    # rounding of 0.3 m: 4 * 6e-17 / step^2
    np.testing.assert_allclose((p[0] - 2 * p[1] + p[2]) / step**2, motion.a.at(t), atol=1e-6)


@pytest.mark.parametrize("name", PROFILES)
def test_position_and_velocity_are_continuous_and_begin_and_end_at_rest(name: str) -> None:
    motion = PROFILES[name](5.0, stream(4, 1))
    knots = motion.a.knots[1:-1][:: max(1, len(motion.a.knots) // 2000)]
    gap = 1e-9
    speed, push = max(np.max(np.abs(motion.v0)), 1e-3), max(motion.largest(), 1e-3)
    jump = np.abs(motion.position(knots + gap) - motion.position(knots - gap))
    assert np.all(jump <= 2.1 * gap * speed + 1e-15)
    assert np.all(np.abs(motion.velocity(knots + gap) - motion.velocity(knots - gap)) <= 2.1 * gap * push + 1e-13)
    ends = np.array([-MARGIN, -MARGIN / 2, 5.0 + MARGIN / 2])
    np.testing.assert_allclose(motion.velocity(ends), 0.0, atol=1e-9)  # summed over 60 000 pieces


def test_moves_have_the_steps_that_controllers_make() -> None:
    def steps(name: str) -> tuple[float, float]:
        """Largest step of acceleration, and of jerk."""
        a = PROFILES[name](20.0, stream(5, 1)).a
        return float(np.max(np.abs(a.first[1:] - a.last[:-1]))), float(np.max(np.abs(np.diff(a.slope))))

    assert 1.0 < steps("trapezoid")[0] < 3.0
    assert steps("s_curve")[0] < 1e-9
    assert 100.0 < steps("s_curve")[1] < 900.0  # twice dJ where a short hold is skipped
    assert 50.0 < steps("cosine")[1] < 450.0
    assert steps("smooth")[1] < 20.0  # only the pieces of the grid
    assert np.max(np.abs(PROFILES["trapezoid"](20.0, stream(5, 1)).v0)) <= SPEED * (1 + 1e-9)


@pytest.mark.parametrize("poles", [rc(159.0), rc(20.0) + resonance(90.0, 3.0), resonance(30.0, 2**-0.5)])
def test_a_signal_behind_poles_equals_a_fine_solution(poles: list[complex]) -> None:
    motion = few()
    coefficients = np.real(np.poly(poles))
    m = len(poles)

    def rates(t: float, x: np.ndarray, u: Piecewise, k: int) -> np.ndarray:
        force = u.first[k] + u.slope[k] * (t - u.knots[k])
        return np.append(x[1:], coefficients[-1] * force - coefficients[:0:-1] @ x)

    x, positions, at = np.zeros(m), [], []
    for k in range(len(motion.a.first)):  # piece by piece, so that the solver never crosses a jump
        begin, end = motion.a.knots[k : k + 2]
        inside = np.linspace(begin, end, 5)
        solved = solve_ivp(rates, (begin, end), x, args=(motion.a, k), rtol=1e-11, atol=1e-13, t_eval=inside)
        x = solved.y[:, -1]
        positions += solved.y[0].tolist()
        at += inside.tolist()
    np.testing.assert_allclose(motion.a.behind(poles)(np.array(at)), positions, atol=1e-9)  # of the solver
    away = motion.a.behind([1.05 * p for p in poles])(np.array(at))
    assert np.max(np.abs(away - positions)) > 1e-3


def test_pieces_of_one_length_and_of_many_give_one_answer() -> None:
    uniform = PROFILES["random"](1.0, stream(6, 1))
    t = np.linspace(0.0, 1.0, 777)
    halves = uniform.a.refined(0.7 * STEP)
    assert len(halves.first) == 2 * len(uniform.a.first)
    np.testing.assert_allclose(halves.behind(rc(159.0))(t), uniform.a.behind(rc(159.0))(t), atol=1e-12)
    uneven = Motion.of(Piecewise(np.insert(uniform.a.knots, 1, uniform.a.knots[0] + STEP / 3), *_split(uniform.a)))
    np.testing.assert_allclose(uneven.a.behind(rc(159.0))(t), uniform.a.behind(rc(159.0))(t), atol=1e-12)
    np.testing.assert_allclose(uneven.position(t), uniform.position(t), atol=1e-15)


def _split(a: Piecewise) -> tuple[np.ndarray, np.ndarray]:
    second = a.first[0] + a.slope[0] * STEP / 3
    return np.insert(a.first, 1, second), np.insert(a.slope, 0, a.slope[0])


def test_refined_motion_is_the_same_motion() -> None:
    motion = few()
    t = np.linspace(-0.09, 0.7, 999)
    np.testing.assert_allclose(motion.refined(1e-3).position(t), motion.position(t), atol=1e-15)
    assert motion.refined(1e-3).a.lengths.max() <= 1e-3 * (1 + 1e-9)


def test_a_lagging_position_obeys_its_equation() -> None:
    motion, tau, step = few(), 0.02, 1e-6
    t = np.linspace(0.0, 0.7, 50)
    rate = (motion.lagged_position(t + step, tau) - motion.lagged_position(t - step, tau)) / (2 * step)
    np.testing.assert_allclose(tau * rate + motion.lagged_position(t, tau), motion.position(t), atol=1e-11)


def test_designed_positions_are_followed_as_a_cubic_spline() -> None:
    k = np.arange(401.0)
    p = 0.01 * np.where((k > 50) & (k < 350), np.sin(np.pi * (k - 50) / 300) ** 4, 0.0)
    motion = from_design(0.0, 1e-3, p)
    met = (p[:-2] + 4 * p[1:-1] + p[2:]) / 6
    np.testing.assert_allclose(motion.position(k[1:-1] * 1e-3), met, atol=1e-14)


def test_a_structure_rings_at_its_frequency_and_turns_a_step_into_a_ramp() -> None:
    set_point = few()
    stage = through_structure(set_point, 60.0, 3.0, 1e-4)
    jumps = np.abs(stage.a.first[1:] - stage.a.last[:-1])
    assert np.max(jumps) < 1e-9
    t = np.arange(0.352, 0.74, 1e-4)  # after the last step
    ringing = stage.a.at(t) - set_point.a.at(t)
    spectrum = np.abs(np.fft.rfft(ringing * np.hanning(len(t)), 2**16))
    damped = 60.0 * np.sqrt(1 - 1 / (4 * 3.0**2))
    assert np.argmax(spectrum) / 2**16 * 1e4 == pytest.approx(damped, abs=3.0)  # a line of 10 Hz width
    with pytest.raises(ValueError, match="differ"):
        residues([-1.0, -1.0])
    with pytest.raises(ValueError, match="known"):
        set_point.position(np.array([2.0]))
