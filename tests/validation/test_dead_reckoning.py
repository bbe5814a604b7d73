"""Dead reckoning with effects: against one node after the other in plain Python, closed forms, and simulated noise."""

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.rig import Rig
from accelcal.effects import BUILT_IN, Effect, find, from_expression, is_local
from accelcal.estimation.values import Values
from accelcal.model import NOMINAL, terms_of
from accelcal.signals.processing import derivative, integral
from accelcal.signals.signals import Signals
from accelcal.validation.dead_reckoning import MOST_WORK, DeadReckoning, Simulation, Starts
from accelcal.validation.prediction import Prediction
from tests.worlds import Hidden, Nuisances, World

from ..effects.test_contract import middle

STEP = 0.004
NODES = 750
BEGIN = 400
"""Node at which the position is withheld."""
PERTURBED = (3e-4, 4e-3)
"""Error of position (m) and velocity (m/s) at that node: simulated motion is not the known one."""
SIZE = 0.02
"""Largest contribution of an effect, as a share of the acceleration."""


def record(start: float = 0.0, rig: Rig | None = None) -> tuple[Signals, np.ndarray]:
    """Signals of a motion of several sines, and the acceleration of its output."""
    rig = rig or Rig()
    t = start + STEP * np.arange(NODES)
    bare = sum(A * np.sin(2.0 * np.pi * f * (t - start) + phi) for A, f, phi in ((0.6, 0.5, 1.6), (1.1, 2.3, 0.4)))
    v = integral(bare, STEP)
    v -= np.mean(v)
    p = integral(v, STEP)
    a = rig.polarity * (bare + rig.gravity)
    needed = sorted({name for effect in BUILT_IN for name in effect.needs})
    side = {name: 0.4 * np.cos((1.0 + number) * t) for number, name in enumerate(needed)}
    jerk = rig.polarity * derivative(bare, STEP)
    return Signals(t=t, p=p, v=v, a=a, jerk=jerk, scale=1.02, rig=rig, cutoff=10.0, side=side), bare


def values_of(effect: Effect, s: Signals) -> Values:
    """Coefficients at which an effect contributes a share of the acceleration, or 20 µm to the reading."""
    shape = middle(effect, s)
    column = effect.column(s, **shape).reshape(len(s.t), -1)
    size = 2e-5 if effect.port == "position" else SIZE * np.std(s.a)
    terms = terms_of(effect, shape)
    moved = replace(s, a=s.a + 1e-6, a_corner=s.a_width, v_corner=s.v_width)
    bent = np.abs(effect.column(moved, **shape).reshape(len(s.t), -1) - column) / 1e-6
    ranges = np.maximum(np.ptp(column, axis=0), 4.0 * size * np.max(bent, axis=0))  # the output stays invertible
    ranges = np.maximum(ranges, 0.1 * np.max(np.abs(column), axis=0))
    items = [size / max(span, 1e-12) / len(terms) ** 0.5 for span in ranges]
    return Values({"scale_factor": 0.02} | dict(zip((term.name for term in terms), items, strict=True)), terms)


def reckoning(values: Values, signals: Signals, bare: np.ndarray, q: float = 0.0) -> DeadReckoning:
    v = integral(bare, STEP)
    h = STEP
    p = np.concatenate([[0.0], np.cumsum(h * v[:-1] + h**2 * (2.0 * bare[:-1] + bare[1:]) / 6.0)])
    return DeadReckoning(values, signals, bare, (v, p), q, np.zeros(len(bare)))


class OneNodeAfterTheOther:
    """The definition, in plain Python: trapezoid rule, effects at the node itself by iteration there."""

    def __init__(self, values: Values, signals: Signals, bare: np.ndarray) -> None:
        self.values, self.bare = values, bare
        self.motion = replace(signals, a_corner=signals.a_width, v_corner=signals.v_width)
        self.gain = signals.rig.polarity / values.scale
        self.terms = list(values.additive("output"))
        self.local = all(is_local(term.effect) for term, _ in self.terms)
        self.rows: list[tuple[float, ...]] = []

    def effects(self, node: int, p: float, v: float, a: float, jerk: float) -> float:
        signals = self.motion
        polarity, gravity = signals.rig.polarity, signals.rig.gravity
        self.rows[node - BEGIN :] = [(p, v, polarity * (a + gravity), polarity * jerk)]
        first = 0 if not self.local else node
        behind = BEGIN + (0 if self.local else 1)  # what lies behind the start is known motion
        new = np.array(self.rows[behind - BEGIN :]) if node >= behind else np.empty((0, 4))
        new = new[-1:] if self.local else new
        whole = [
            np.concatenate([y[first:behind] if not self.local else y[:0], new[:, i]])
            for i, y in enumerate((signals.p, signals.v, signals.a, signals.jerk))
        ]
        rows = slice(first, node + 1)
        side = {name: y[rows] for name, y in signals.side.items()}
        p_, v_, a_, jerk_ = whole
        s = replace(signals, t=signals.t[rows], p=p_, v=v_, a=a_, jerk=jerk_, side=side, whole=signals)
        return float(sum(c * term.column(s)[-1] for term, c in self.terms))

    def run(self, p: float, v: float, nodes: int) -> tuple[list[float], list[float]]:
        """Effects and displacement at the nodes from BEGIN on."""
        b, g, h = self.bare, self.gain, STEP
        jerk = derivative(b, h)
        dv = dp = 0.0
        E = self.settle(BEGIN, lambda E: (p, v, b[BEGIN] - g * E, jerk[BEGIN]), 0.0)
        result, displaced = [E], [0.0]
        for node in range(BEGIN + 1, BEGIN + nodes):
            v_bare = v + h * (b[node - 1] + b[node]) / 2.0
            p_bare = p + h * v + h**2 * (2.0 * b[node - 1] + b[node]) / 6.0
            last, dv_last, dp_last = E, dv, dp

            def motion(E, last=last, dv=dv_last, dp=dp_last, p=p_bare, v=v_bare, node=node):
                dp_new = dp + h * dv - g * h**2 * (2.0 * last + E) / 6.0
                dv_new = dv - g * h * (last + E) / 2.0
                return p + dp_new, v + dv_new, b[node] - g * E, jerk[node]

            E = self.settle(node, motion, E)
            dv, dp = dv_last - g * h * (last + E) / 2.0, dp_last + h * dv_last - g * h**2 * (2.0 * last + E) / 6.0
            p, v = p_bare, v_bare
            result.append(E)
            displaced.append(dp)
        return result, displaced

    def settle(self, node: int, motion, E: float) -> float:
        for _ in range(200):
            new = self.effects(node, *motion(E))
            if abs(new - E) <= 1e-15 * abs(E):
                break
            E = new
        return new


AHEAD = "shape_since_reversal", "temperature_rate", "presliding", "self_heating"
"""Effects that look at the whole motion: for its range, what it carries over, or a difference to either side."""
CAUSAL = [
    effect
    for effect in BUILT_IN
    if effect.port in ("output", "process") and effect.name not in (*NOMINAL, *AHEAD, "sensor_resonance", "bias")
]


def started(signals: Signals) -> Starts:
    values = np.array([0.0])
    p, v = signals.p[BEGIN] + PERTURBED[0], signals.v[BEGIN] + PERTURBED[1]
    return Starts(signals.t[[BEGIN]], values + p, values + v, values, np.zeros((1, 3)))


def consistent(values: Values, signals: Signals, bare: np.ndarray) -> Signals:
    """The known motion with the effects of the model subtracted from its acceleration."""
    gain, polarity, gravity = signals.rig.polarity / values.scale, signals.rig.polarity, signals.rig.gravity
    for _ in range(60):
        total = values.total("output", signals)
        corrected = bare if total is None else bare - gain * total
        signals = replace(signals, a=polarity * (corrected + gravity), jerk=polarity * derivative(corrected, STEP))
    return signals


@pytest.mark.parametrize("rig", [Rig(), Rig(mount="reversed", axis="up")], ids=["level", "reversed, upright"])
@pytest.mark.parametrize("effect", CAUSAL, ids=lambda effect: effect.name)
def test_windows_give_what_one_node_after_the_other_gives(effect: Effect, rig: Rig) -> None:
    signals, bare = record(rig=rig)
    values = values_of(effect, signals)
    signals = consistent(values, signals, bare)
    alone = OneNodeAfterTheOther(values, signals, bare)
    nodes = 120 if alone.local else 60
    starts = started(signals)
    _, expected = alone.run(float(starts.p[0]), float(starts.v[0]), nodes)
    t = signals.t[None, BEGIN : BEGIN + nodes]
    result, _ = reckoning(values, signals, bare).displacement(starts, t)
    largest = np.max(np.abs(expected))
    assert largest > 0.0 or effect.name in ("saturation", "dead_zone", "time_offset_step")
    np.testing.assert_allclose(result[0], expected, rtol=0.0, atol=1e-9 * largest + 1e-18)


@pytest.mark.parametrize("name", AHEAD)
def test_effects_that_look_ahead_satisfy_their_equation_on_the_whole_path(name: str) -> None:
    signals, bare = record()
    values = values_of(find(name), signals)
    signals = consistent(values, signals, bare)
    m, gain = NODES - BEGIN, 1.0 / values.scale
    starts = started(signals)
    p0, v0 = float(starts.p[0]), float(starts.v[0])
    b = bare[BEGIN:]
    v_bare = v0 + integral(b, STEP)
    p_bare = p0 + np.concatenate([[0.0], np.cumsum(STEP * v_bare[:-1] + STEP**2 * (2.0 * b[:-1] + b[1:]) / 6.0)])
    E = np.zeros(m)
    for _ in range(300):  # over the whole horizon at once, as long as it takes
        dv = -gain * integral(E, STEP)
        dp = np.concatenate([[0.0], np.cumsum(STEP * dv[:-1] - gain * STEP**2 * (2.0 * E[:-1] + E[1:]) / 6.0)])
        a, jerk = b - gain * E, derivative(bare, STEP)[BEGIN:]
        ahead = [p_bare + dp, v_bare + dv, a, jerk]
        whole = [
            np.concatenate([y[: BEGIN + 1], new[1:]])
            for y, new in zip((signals.p, signals.v, signals.a, signals.jerk), ahead, strict=True)
        ]
        s = replace(signals, p=whole[0], v=whole[1], a=whole[2], jerk=whole[3], whole=signals)
        E = values.total("output", s)[BEGIN:]
        E[0] = values.total("output", signals)[BEGIN]
    result, _ = reckoning(values, signals, bare).displacement(starts, signals.t[None, BEGIN:])
    last = slice(0, m - 8)  # differences are one-sided at the end of a path
    np.testing.assert_allclose(result[0, last], dp[last], rtol=0.0, atol=2e-4 * np.max(np.abs(dp[last])))


def test_an_effect_of_snap_is_that_of_the_output_alone() -> None:
    """A second derivative of simulated acceleration cannot be stepped; the output determines it on the whole record."""
    signals, bare = record()
    values = values_of(find("sensor_resonance"), signals)
    E = values.total("output", signals)[BEGIN:]
    dv = -integral(E, STEP) / values.scale
    moved = STEP * dv[:-1] - STEP**2 * (2.0 * E[:-1] + E[1:]) / (6.0 * values.scale)
    dp = np.concatenate([[0.0], np.cumsum(moved)])
    result, _ = reckoning(values, signals, bare).displacement(started(signals), signals.t[None, BEGIN:])
    np.testing.assert_allclose(result[0], dp, rtol=0.0, atol=1e-9 * np.max(np.abs(dp)))


READ = [effect for effect in BUILT_IN if effect.port == "position"]


@pytest.mark.parametrize("effect", READ, ids=lambda effect: effect.name)
def test_effects_on_the_reading_are_those_at_the_simulated_motion(effect: Effect) -> None:
    signals, bare = record()
    values = values_of(effect, signals)
    starts = started(signals)
    nodes = slice(BEGIN + 1, BEGIN + 200)
    t = signals.t[nodes]
    ahead = reckoning(values, signals, bare)
    since = t - signals.t[BEGIN]
    p = signals.p[BEGIN] + PERTURBED[0] + ahead.carried_p[nodes] - ahead.carried_p[BEGIN]
    p = p + since * (signals.v[BEGIN] + PERTURBED[1] - ahead.carried_v[BEGIN])
    v = signals.v[BEGIN] + PERTURBED[1] + ahead.carried_v[nodes] - ahead.carried_v[BEGIN]
    path = replace(
        signals,
        t=signals.t[: nodes.stop],
        p=np.concatenate([signals.p[: nodes.start], p]),
        v=np.concatenate([signals.v[: nodes.start], v]),
        a=signals.a[: nodes.stop],
        jerk=signals.jerk[: nodes.stop],
        side={name: y[: nodes.stop] for name, y in signals.side.items()},
        whole=signals,
        a_corner=signals.a_width,
        v_corner=signals.v_width,
    )
    expected = values.total("position", path)[nodes]
    result, _ = ahead.displacement(starts, t[None, :])
    np.testing.assert_allclose(result[0], expected, rtol=0.0, atol=1e-9 * np.max(np.abs(expected)) + 1e-18)


def only(name: str, c: float) -> Values:
    return Values({name: c}, terms_of(find(name)))


def at_rest(seconds: float, step: float) -> Signals:
    t = step * np.arange(int(seconds / step) + 2)
    zero = np.zeros(len(t))
    return Signals(t=t, p=zero, v=zero, a=zero, jerk=zero, scale=1.0, rig=Rig(), v_std=1e-4)


def coasting(values: Values, seconds: float, step: float, p0: float, v0: float) -> float:
    """Position after a time in which the output reads zero."""
    signals = at_rest(seconds, step)
    zero = np.zeros(len(signals.t))
    unit = np.array([0.0])
    ahead = DeadReckoning(values, signals, zero, (zero, zero), 0.0, zero)
    result, _ = ahead.displacement(Starts(unit, unit + p0, unit + v0, unit, np.zeros((1, 3))), np.array([[seconds]]))
    return p0 + v0 * seconds + float(result[0, 0])


def test_dry_friction_is_a_constant_while_it_slides_and_then_rest() -> None:
    result = coasting(only("coulomb", 0.05), 2.0, 0.001, 0.0, 0.2)
    assert result == pytest.approx(0.2 * 2.0 - 0.05 * 2.0, abs=1e-12)
    assert coasting(only("coulomb", 0.05), 10.0, 0.001, 0.0, 0.2) == pytest.approx(0.2**2 / 0.1, abs=1e-5)


@pytest.mark.parametrize(
    ("name", "c", "exact"),
    [
        ("velocity", 0.8, lambda t: 0.3 / 0.8 * (1.0 - np.exp(-0.8 * t))),
        ("rail_slope", 4.0, lambda t: 0.3 / 2.0 * np.sin(2.0 * t)),
        ("velocity_odd", 0.5, lambda t: np.log(1.0 + 0.5 * 0.3 * t) / 0.5),
    ],
)
def test_drag_and_spring_follow_their_closed_forms(name, c, exact) -> None:
    coarse, fine = (coasting(only(name, c), 5.0, step, 0.0, 0.3) - exact(5.0) for step in (0.02, 0.01))
    print(f"{name}: error {coarse:.2e} m with 20 ms, {fine:.2e} m with 10 ms")
    assert abs(fine) < 1e-4
    assert fine == pytest.approx(coarse / 4.0, rel=0.01)  # the trapezoid rule
    assert abs(fine - (coarse - fine) / 3.0) < 1e-8


@pytest.mark.parametrize("stiffness", [1e2, 1e3])
def test_no_friction_is_too_steep(stiffness: float) -> None:
    result = coasting(only("velocity", stiffness), 1.0, 0.001, 0.0, 0.3)
    assert result == pytest.approx(0.3 / stiffness, abs=0.001 * 0.3)


def test_starts_do_not_depend_on_each_other() -> None:
    signals, bare = record()
    values = Values({"coulomb": 0.05, "rail_slope": 1.0}, (*terms_of(find("coulomb")), *terms_of(find("rail_slope"))))
    ahead = reckoning(values, signals, bare)
    at = signals.t[[100, 205, 333]] + 0.3 * STEP
    p, v = np.interp(at, signals.t, signals.p), np.interp(at, signals.t, signals.v)
    all_at_once = Starts(at, p, v, np.zeros(3), np.zeros((3, 3)))
    t = at[:, None] + np.array([0.2, 0.9])
    together, _ = ahead.displacement(all_at_once, t)
    for i in range(3):
        alone, _ = ahead.displacement(all_at_once.part(slice(i, i + 1)), t[i : i + 1])
        np.testing.assert_allclose(alone[0], together[i], rtol=1e-10)


PATHS = 600


@pytest.mark.parametrize(("name", "c"), [("velocity", 1.5), ("velocity", -0.8), ("rail_slope", 6.0), ("coulomb", 0.1)])
def test_the_variance_contains_what_effects_make_of_errors(name: str, c: float) -> None:
    """Paths with simulated noise of the output: their scatter within 5 standard deviations of its own (600 paths:
    14 %; false alarm 6e-7 per case). The twin, that ignores the effect, must lie outside."""
    rng = np.random.default_rng(17)
    signals, bare = record()
    q, values = 1e-5, only(name, c)
    ahead = reckoning(values, signals, bare, q)
    spread = np.diag([1e-8, 4e-6])
    unit = np.array([0.0])
    first = Starts(unit, unit + signals.p[0], unit + signals.v[0], unit, np.array([[1e-8, 0.0, 4e-6]]))
    _, variance = ahead.displacement(first, signals.t[None, -1:])
    ends = []
    for _ in range(PATHS):
        noisy = bare + rng.normal(0.0, np.sqrt(q / STEP), NODES)
        dp, dv = rng.multivariate_normal([0.0, 0.0], spread)
        path = reckoning(values, signals, noisy)
        begin = replace(first, p=first.p + dp, v=first.v + dv)
        added, _ = path.displacement(begin, signals.t[None, -1:])
        span = signals.t[-1] - signals.t[0]
        bare_p = begin.p[0] + span * begin.v[0] + path.carried_p[-1]
        ends.append(bare_p + added[0, 0])
    scatter = float(np.var(ends, ddof=1))
    open_loop = q * span**3 / 3.0 + 1e-8 + span**2 * 4e-6
    print(f"{name} {c:g}: scatter {scatter:.3e}, variance {variance[0, 0]:.3e}, without feedback {open_loop:.3e} m²")
    deviation = np.sqrt(2.0 / (PATHS - 1))
    tolerance = 5.0 * deviation + (0.25 if name == "coulomb" else 0.03)  # a corner is linearised over its errors
    assert abs(scatter / variance[0, 0] - 1.0) < tolerance
    assert abs(scatter / open_loop - 1.0) > tolerance


def test_an_effect_of_ones_own_is_stepped_as_finely_as_a_house_effect() -> None:
    signals, bare = record()
    term = terms_of(from_expression("friction_of_mine", "tanh(v/0.002)", unit="m/s²", owner="rig").effect)
    starts, t = started(signals), signals.t[None, BEGIN + 1 :]
    result, _ = reckoning(Values({term[0].name: 0.05}, term), signals, bare).displacement(starts, t)
    alone = OneNodeAfterTheOther(Values({term[0].name: 0.05}, term), signals, bare)
    alone.local = True
    _, expected = alone.run(float(starts.p[0]), float(starts.v[0]), 200)
    np.testing.assert_allclose(result[0, :199], expected[1:], rtol=0.0, atol=1e-9 * np.max(np.abs(expected)))


def test_what_remembers_reversals_has_a_bound_of_work(tmp_path, monkeypatch):
    """A friction that sticks and slips converges in a few nodes at a time only: 2000 windows, six minutes."""
    world = World("interleaved", "CXL02", (Hidden("breakaway", 0.05),), seed=7, nuisances=Nuisances())
    recording = ac.load(world.record().write(tmp_path))
    added = ac.add(ac.fit(recording), recording, "shape_since_reversal")
    simulations, run = [], Simulation.run
    monkeypatch.setattr(Simulation, "run", lambda self, floor: simulations.append(self) or run(self, floor))
    coasting = Prediction.of(added, recording).at_horizon(5.0)
    print(f"{simulations[0].work / MOST_WORK:.2f} of the bound, {len(coasting.starts)} starts")
    assert any(simulation.hurried for simulation in simulations)  # else the bound is not what is tested
    assert max(simulation.work for simulation in simulations) < 5 * MOST_WORK
    assert len(coasting.starts) >= 10
    assert np.max(np.abs(coasting.frozen)) < 1.0


@pytest.mark.parametrize("name", ["cubic", "quadratic", "odd_quadratic", "coulomb"])
def test_effects_of_the_output_alone_are_solved_once_for_all_starts_as_path_by_path(name: str) -> None:
    signals, bare = record()
    values = values_of(find(name), signals)
    ahead = reckoning(values, consistent(values, signals, bare), bare)
    rng, many = np.random.default_rng(5), 40
    begin = np.sort(rng.uniform(0.1, 1.5, many))  # between nodes, as readings are
    begin[::4] = signals.t[np.searchsorted(signals.t, begin[::4])]
    p, v = np.interp(begin, signals.t, signals.p), np.interp(begin, signals.t, signals.v)
    starts = Starts(begin, p + 1e-4, v - 1e-3, np.zeros(many), np.zeros((many, 3)))
    t = begin[:, None] + np.concatenate([[1e-5, 0.3 * STEP], rng.uniform(STEP, 1.4, 6)])
    by_path, _ = ahead.displacement(starts, t)
    shared, variance = ahead.displacement(starts, t, floor=False)
    largest = np.max(np.abs(by_path))
    assert largest > 1e-5
    assert np.allclose(shared, by_path, rtol=0.0, atol=1e-9 * largest)
    assert not np.any(variance)
    # Friction follows the simulated velocity, and a constant is that of one start: neither is shared.
    assert ahead._follows_output_alone(starts) == (name != "coulomb")
    assert not ahead._follows_output_alone(replace(starts, constant=np.full(many, 1e-3)))
    if name != "coulomb":
        far, limit = ahead.displacement(starts, t, floor=False)[0], 0.5 * largest
        ended = ahead.displacement(starts, t, limit, floor=False)[0]
        assert np.array_equal(np.isnan(ended), np.abs(far) >= limit)
