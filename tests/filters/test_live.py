"""Live filters that track effects of the catalogue: agreement with the replay, honesty, laws and refusals."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from accelcal._support.errors import AccelcalError
from accelcal.data.rig import Rig, Sensor
from accelcal.effects import BUILT_IN, CATALOGUE, effect as declare, find
from accelcal.estimation.estimate import estimate
from accelcal.filters.choice import FilterChoice, GaussMarkov
from accelcal.filters.live_model import LiveModel, refusal
from accelcal.filters.stream import fixed_rate
from accelcal.model import Model, Prior
from accelcal.signals.signals import Signals
from accelcal.simulation.sensor import CXL02_RIG, simulate
from tests.filters.worlds import MODEL, NOISE, RATE, READING, RIG, TRUE, World, followed, world

SEEDS = range(1, 4)
FALSE_ALARM = 1e-3
"""Of a two-sided test on the mean normalised error of all seeds."""
FREE = list(TRUE)
REPLAY_SHARE = 0.5
"""Rms difference from the replay on the same record, in standard deviations: the same noise seen twice."""


def live_filter(model: Model, rig: Rig = RIG, **more: object) -> LiveModel:
    given: dict[str, object] = {"rate": RATE, "q": NOISE**2 / 2, "r_position": READING**2, "position": 0.0}
    return LiveModel(model, rig, **given | more)  # type: ignore[arg-type]


def normalised(live: LiveModel) -> float:
    """Mean squared error of all free coefficients, in standard deviations of their joint covariance."""
    rows = [live.names.index(name) for name in FREE if name in live.names]
    error = live.values[rows] - [TRUE[live.names[row]] for row in rows]
    return float(error @ np.linalg.solve(live.covariance[np.ix_(rows, rows)], error) / len(rows))


@pytest.fixture(scope="module")
def records() -> list[World]:
    return [world(seed) for seed in SEEDS]


def test_inputs_of_a_live_model_that_are_none_are_refused_in_a_sentence() -> None:
    live = LiveModel(Model.linear(), RIG, rate=RATE, q=1e-6, r_position=1e-12, position=0.0)
    nan, ones = float("nan"), np.ones(5)
    for call, message in (
        (lambda: live.step(nan, 0.0), r"LiveModel.step: output nan.*Leave this sample out"),
        (lambda: live.step(1.0, 0.0, early=5.0), r"early 5\.0; expected .* less than a step"),
        (lambda: live.run(ones, ones[1:]), r"arrays of shapes \(5,\), \(4,\); expected \(n,\) each"),
        (lambda: live.named(2.0), r"alpha = 2; expected a probability"),
    ):
        with pytest.raises(AccelcalError, match=message):
            call()
    with pytest.raises(TypeError, match=r"watch is 'cubic'; expected a list"):
        LiveModel(Model.linear(), RIG, rate=RATE, q=1e-6, r_position=1e-12, position=0.0, watch="cubic")
    assert live.step(1.0, 0.0) is not None  # nothing was changed


def test_a_record_of_other_packages_is_run_as_that_of_numpy() -> None:
    pd = pytest.importorskip("pandas")

    u, z, unread = 0.1 + 0.01 * np.arange(8), 1e-6 * np.arange(8), np.arange(8) % 2 == 1
    values = []
    for outputs, readings in (
        (u, np.where(unread, np.nan, z)),
        (u, np.ma.masked_array(z, unread)),
        (pd.Series(u, index=range(5, 13)), pd.Series(z).where(~unread, None)),
    ):
        live = live_filter(Model.linear())
        live.run(outputs, readings)
        values.append(live.values.tolist())
    assert values[0] == values[1] == values[2]


def test_a_sample_that_no_stage_gives_is_refused_and_leaves_the_filter_as_it_was() -> None:
    narrow = replace(RIG, sensor=replace(RIG.sensor, range=20.0))
    for rig, u, z in ((RIG, 1e200, None), (RIG, 1e7, None), (RIG, 0.1, 1e80), (narrow, 41.0, 0.0)):
        live = live_filter(Model.linear().add("quadratic"), rig)
        live.step(0.1, 0.0)
        before = live.values
        with pytest.raises(AccelcalError, match=r"output of at most .* position of at most .* Leave this sample out"):
            live.step(u, z)
        assert np.array_equal(live.values, before)
        assert live.step(0.1, 0.0) is not None


def test_live_estimates_of_effects_are_honest_and_near_the_replay(records: list[World]) -> None:
    errors, apart = [], []
    for record in records:
        live = followed(MODEL, record)
        errors.append(normalised(live))
        replayed = estimate(MODEL, record.recording)
        shift = replayed.origins.temperature - 25.0
        bias = replayed["bias"].value - replayed["temperature_bias"].value * shift
        for name in FREE[1:]:
            apart.append((live[name].value - replayed[name].value) / replayed[name].std)
        assert abs(bias - live["bias"].value) < 4 * live["bias"].std
    dof = len(SEEDS) * len(FREE)
    low, high = stats.chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], dof) / dof
    mean, rms = float(np.mean(errors)), float(np.sqrt(np.mean(np.square(apart))))
    print(f"\n{len(SEEDS)} seeds: normalised error {mean:.2f} in [{low:.2f}, {high:.2f}]; off the replay {rms:.2f} std")
    assert low < mean < high
    assert rms < REPLAY_SHARE


def test_a_live_filter_without_the_effect_is_found_out(records: list[World]) -> None:
    poor = MODEL.drop("quadratic")
    dof = len(SEEDS) * (len(FREE) - 1)
    high = stats.chi2.ppf(1 - FALSE_ALARM / 2, dof) / dof
    assert np.mean([normalised(followed(poor, record)) for record in records]) > high


@pytest.mark.parametrize(
    "rig", [dataclasses.replace(RIG, axis="up"), dataclasses.replace(RIG, axis="down", mount="reversed")]
)
def test_mount_and_gravity_are_subtracted(rig: Rig) -> None:
    live = followed(MODEL, world(3, rig=rig), rig=rig)
    # False alarm 1e-4 for one record of six coefficients.
    assert normalised(live) * len(FREE) < stats.chi2.ppf(1 - 1e-4, len(FREE))


def test_a_declared_low_pass_is_undone_before_effects_are_evaluated() -> None:
    rig = dataclasses.replace(CXL02_RIG, resolution=None)
    truth = {"bias": 0.05, "scale_factor": 0.01, "quadratic": 1e-3}
    rng = np.random.default_rng(5)
    simulation = simulate("bursts", seconds=12.0, rig=rig, parameters=truth, rng=rng, a_rms=5.0, position_noise=READING)
    z = np.full(len(simulation.recording.accel), np.nan)
    z[::2] = simulation.recording.position.y
    model = Model.linear().add("quadratic").freeze(time_offset=0.0)
    assert rig.sensor.noise is not None

    def worst(declared_rig: Rig) -> float:
        live = live_filter(model, declared_rig, q=rig.sensor.noise**2 / 2, position=float(z[0]))  # type: ignore[operator]
        live.run(simulation.recording.accel.y, z)
        return max(abs(live[name].value - value) / live[name].std for name, value in truth.items())

    assert worst(rig) < 4.5
    assert worst(dataclasses.replace(rig, lowpass=None)) > 4.5  # the twin that must fail: 7


def test_a_small_time_offset_is_tracked() -> None:
    rng = np.random.default_rng(6)
    truth = {"bias": 0.05, "time_offset": 1e-4}
    simulation = simulate("bursts", seconds=12.0, rig=RIG, parameters=truth, rng=rng, a_rms=5.0, position_noise=READING)
    z = np.full(len(simulation.recording.accel), np.nan)
    z[::2] = simulation.recording.position.y
    live = live_filter(Model.linear(), position=float(z[0]))
    live.run(simulation.recording.accel.y, z)
    assert live["time_offset"].std < 2e-6
    assert abs(live["time_offset"].value - 1e-4) < 4.5 * live["time_offset"].std


def test_without_effects_it_is_the_forward_filter() -> None:
    truth = world(2, seconds=2.0)
    model = Model.linear().freeze(time_offset=0.0)
    live = followed(model, truth)
    choice = FilterChoice("aci", "linear", interpolation="cubic", carrier="factored", corrected=True)
    P0 = np.diag([1e4 * READING**2, 1.0, 0.3**2, 3.0**2])
    given = {"q": NOISE**2 / 2, "r_position": READING**2, "x0": [truth.z[0], 0.0, 0.0, 0.0], "P0": P0}
    same = fixed_rate(choice, dt=1 / RATE, **given)  # type: ignore[arg-type]
    same.run(truth.u, truth.z)
    deviation = np.sqrt(np.diag(same.covariance))[2:]
    assert (
        np.max(np.abs(live.values[:2] - same.x[2:]) / deviation) < 1e-7
    )  # two ways to round, 3334 steps, variances that fall by 1e8


def test_a_gauss_markov_coefficient_keeps_its_uncertainty() -> None:
    truth = world(4, seconds=4.0)
    constant, walking = (
        LiveModel(
            MODEL,
            RIG,
            rate=RATE,
            q=NOISE**2 / 2,
            r_position=READING**2,
            position=float(truth.z[0]),
            gauss_markov=processes,
        )
        for processes in ({}, {"bias": GaussMarkov(1e-4)})
    )
    for live in (constant, walking):
        live.run(truth.u, truth.z, temperature=truth.temperature)
    assert walking["bias"].std > 2 * constant["bias"].std


def test_a_random_scale_factor_is_tracked_as_one_more_state() -> None:
    """Scale factor and process at the end of 3 records, simulated by the exact recursion, against the truth."""
    sigma, tau = 0.02, 2.0
    shapes = {"scale_gauss_markov": {"start": 0.0, "length": 6.0, "tau": tau}}
    linear = Model.linear().freeze(time_offset=0.0)
    model = linear.add("scale_gauss_markov", shapes=shapes)
    model = replace(model, priors={term.name: Prior(0.0, sigma) for term in model.terms if term.effect.width > 1})
    at_end, without = [], []
    for seed in range(3):
        rng = np.random.default_rng([17, seed])
        rig = replace(RIG, sensor=Sensor(noise=NOISE))
        simulation = simulate("bursts", seconds=6.0, rig=rig, parameters={}, rng=rng, a_rms=5.0, position_noise=READING)
        t, n = simulation.recording.accel.t, len(simulation.recording.accel.t)
        keep = np.exp(-1.0 / (RATE * tau))
        process = np.empty(n)
        process[0] = sigma * rng.standard_normal()
        for k, shock in enumerate(sigma * np.sqrt(1.0 - keep**2) * rng.standard_normal(n - 1), 1):
            process[k] = keep * process[k - 1] + shock
        u = simulation.recording.accel.y + process * simulation.truth.motion.derivatives(t)[2]
        z = np.full(n, np.nan)
        z[::2] = simulation.recording.position.y
        for tracked, result in ((model, at_end), (linear, without)):
            live = live_filter(tracked, position=float(z[0]))
            live.run(u, z)
            rows = [live.names.index(name) for name in live.names if name.startswith("scale")]
            variance = float(np.sum(live.covariance[np.ix_(rows, rows)]))
            result.append(float(np.sum(live.values[rows]) - process[-1]) ** 2 / variance)
    low, high = stats.chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], 3)
    print(f"\nnormalised square of 3: {sum(at_end):.1f} in [{low:.1f}, {high:.1f}]; constant {sum(without):.0f}")
    assert low < sum(at_end) < high
    assert sum(without) > 10.0 * high
    assert live_filter(model)["scale_gauss_markov"].std == pytest.approx(sigma)


@pytest.mark.parametrize("tau", [3.0, np.inf])
def test_behind_a_hole_a_process_is_as_old_as_the_hole_is_long(tau: float) -> None:
    """Against a filter that takes in the hole without a reading, whose coefficients it leaves alone."""
    sigma, q = 0.02, 1e-4
    moves = GaussMarkov(2.0 * sigma**2 / tau if tau < np.inf else q, tau)
    u, z, _ = small_record()
    through, behind = (
        live_filter(Model.linear().freeze(time_offset=0.0), rate=SMALL, gauss_markov={"bias": moves}) for _ in range(2)
    )
    for live in (through, behind):
        live.run(u, z)
    gap = 400
    for _ in range(gap):
        through.step(0.0)
    behind.restart(0.0, 0.0, (len(u) - 1 + gap) / SMALL)
    np.testing.assert_allclose(behind.values, through.values, rtol=1e-9)
    np.testing.assert_allclose(behind.covariance, through.covariance, rtol=1e-9)
    before = behind.covariance
    behind.restart(0.0, 0.0, (len(u) - 1 + gap) / SMALL)
    np.testing.assert_allclose(behind.covariance, before, rtol=1e-12)


def test_behind_a_hole_nothing_is_left_of_what_effects_added_before_it() -> None:
    live = live_filter(model_with("quadratic"), rate=SMALL)
    live.run(*small_record()[:2])
    assert np.any(live._columns)
    live.restart(0.0, 0.0, 100.0)
    assert not np.any(live._columns)
    assert not np.any(live._constant)


SHAPES = {"low": -0.5, "high": 0.5, "tau": 0.05, "width": 1e-3, "period": 0.05, "frequency": 5.0, "start": 0.0}
SHAPES |= {"length": 1.0, "instant": 0.5, "level": 3.0, "centre": 0.0, "ripple": 0.0}
"""Shape parameters of effects that run on a small record; 1 for all others."""


def model_with(name: str) -> Model:
    """A model with one effect of the catalogue, as a fit may leave it."""
    base = Model.linear() if name == "time_offset" else Model.linear().freeze(time_offset=0.0)
    if name in base.effects:
        return base
    effect = find(name)
    given = {shape: SHAPES.get(shape, 1.0) for shape in effect.shapes}
    model = base.add(name, shapes={name: given} if given else None)
    processes = [term.name for term in model.terms if term.effect.port == "process"]
    return replace(model, priors={**model.priors, **{term: Prior(0.0, effect.prior.scale) for term in processes}})


SMALL = 200.0
"""Rate of a small record of 1.5 s, Hz."""


def small_record(needs: tuple[str, ...] = ()) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Output and position of a stage that turns back several times, and side channels."""
    t, rng = np.arange(300) / SMALL, np.random.default_rng(11)
    motions = [(0.12, 5.0, 0.4), (0.03, 17.0, 1.1)]
    p = sum(size * np.sin(w * t + phase) for size, w, phase in motions)
    a = sum(-size * w**2 * np.sin(w * t + phase) for size, w, phase in motions)
    u = 0.05 + 1.01 * a + NOISE * np.sqrt(SMALL / 2) * rng.standard_normal(len(t))
    side = {name: 0.5 + 0.3 * np.sin((1.3 + i) * t) for i, name in enumerate(needs)}
    return u, p - p[0] + READING * rng.standard_normal(len(t)), side


@pytest.mark.parametrize("name", [effect.name for effect in BUILT_IN])
def test_every_effect_of_the_catalogue_runs_and_its_estimate_moves(name: str) -> None:
    effect = find(name)
    assert refusal(effect) is None
    live = live_filter(model_with(name), rate=SMALL)
    before = {estimate.name: estimate for estimate in live.estimates}
    u, z, side = small_record(effect.needs)
    live.run(u, z, **side)
    assert np.all(np.isfinite(live.values))
    tracked = [e for e in live.estimates if e.name.split(".")[0] == name]
    assert bool(tracked) == (effect.port != "noise")
    moved = [before[e.name].value != e.value and before[e.name].std != e.std for e in tracked]
    assert all(moved) if effect.width == 1 else any(moved) or not tracked  # a spline may lie where no motion is


def planted(name: str, t: np.ndarray, p: np.ndarray, a: np.ndarray) -> np.ndarray:
    """What one unit of an effect with memory adds, by a loop of its own in small steps of the formula."""
    h, x, at, y = t[1] - t[0], 0.0, float(p[0]), np.empty(len(t))
    play_a, steps = 0.0, 20
    for k in range(len(t)):
        for _ in range(steps if k else 0):
            x += h / steps / 0.05 * (0.5 * (a[k - 1] + a[k]) - x)
        at = min(max(at, p[k] - 5e-4), p[k] + 5e-4)
        play_a = min(max(play_a, a[k] - 0.5), a[k] + 0.5)
        y[k] = {"creep": x, "hysteresis": play_a, "encoder_backlash": (p[k] - at) / 1e-3}[name]
    return y


@pytest.mark.parametrize(("name", "size"), [("creep", 0.02), ("hysteresis", 0.02), ("encoder_backlash", 4e-5)])
def test_an_effect_with_memory_is_estimated_or_subtracted(name: str, size: float) -> None:
    rate, rng = 500.0, np.random.default_rng(23)
    t = np.arange(3000) / rate
    motions = [(0.15, 3.0, 0.4), (0.05, 7.0, 1.1), (0.012, 17.0, 2.0)]
    p, a = (
        sum(
            size * w**n * (-1.0) ** (n // 2) * (np.sin(w * t + phase) - (n == 0) * np.sin(phase))
            for size, w, phase in motions
        )
        for n in (0, 2)
    )
    u = 0.05 + 1.01 * a + NOISE * np.sqrt(rate / 2) * rng.standard_normal(len(t))
    z = p + READING * rng.standard_normal(len(t))
    added = size * planted(name, t, p, a)
    u, z = (u, z + added) if find(name).port == "position" else (u + added, z)
    shapes = {name: {"tau": 0.05, "start": 0.0, "width": 1e-3 if find(name).unit == "m" else 1.0}}
    shapes[name] = {shape: shapes[name][shape] for shape in find(name).shapes}
    priors = {"bias": Prior(0.05, 5e-3), "scale_factor": Prior(0.01, 1e-3)}  # of a fit; then the velocity is known, too
    model = Model.linear().freeze(time_offset=0.0).add(name, shapes=shapes, priors=priors)

    def errors(model: Model) -> dict[str, float]:
        live = live_filter(model, rate=rate)
        live.run(u, z)
        truth = {"bias": 0.05, "scale_factor": 0.01, name: size}
        return {e.name: (e.value - truth[e.name]) / e.std for e in live.estimates if e.std > 0.0}

    result, subtracted, without = errors(model), errors(model.freeze(**{name: size})), errors(model.drop(name))
    print(f"\n{name}: estimated {result}; subtracted {subtracted}; left out {without}")
    assert set(result) == {"bias", "scale_factor", name}
    assert max(map(abs, result.values())) < 5.0
    assert set(subtracted) == {"bias", "scale_factor"}
    assert max(map(abs, subtracted.values())) < 5.0
    assert max(map(abs, without.values())) > 8.0  # the twin


def test_an_own_effect_is_tracked_where_it_looks_at_the_present_alone() -> None:
    with CATALOGUE.apart():

        @declare("own_present", unit="(m/s²)⁻⁴", symbol="K5", scale=1e-6)
        def present(s: Signals) -> np.ndarray:
            """Fifth power."""
            return s.a**5

        @declare("own_past", unit="1", symbol="c", scale=1e-3)
        def past(s: Signals) -> np.ndarray:
            """Sum of all before."""
            return np.cumsum(s.a)

        assert live_filter(Model.linear().add("own_present")).names[-1] == "own_present"
        with pytest.raises(
            ValueError, match="own_past cannot be tracked live: an effect of your own that looks at other"
        ):
            live_filter(Model.linear().add("own_past"))


def test_an_unknown_instant_is_asked_for() -> None:
    with pytest.raises(ValueError, match="bias_step needs a value of instant"):
        Model.linear().add("bias_step")


def test_a_side_channel_that_was_never_given_is_asked_for() -> None:
    live = live_filter(Model.linear().add("temperature_bias"))
    with pytest.raises(ValueError, match="temperature_bias needs the channel 'temperature'"):
        live.step(0.0, 0.0)
    live.step(0.0, 0.0, temperature=21.0)
    live.step(0.0, 0.0)  # the last value holds


def test_too_many_coefficients_are_refused() -> None:
    names = ("shape_of_position", "shape_of_velocity")
    with pytest.raises(ValueError, match="room for 14 coefficients beside bias and scale_factor; the model has 19"):
        live_filter(Model.linear().add(*names, shapes={name: {"low": -1.0, "high": 1.0} for name in names}))


def test_a_process_of_a_missing_coefficient_is_refused() -> None:
    with pytest.raises(ValueError, match="cubic not in the model"):
        live_filter(Model.linear(), gauss_markov={"cubic": GaussMarkov(1.0)})


@pytest.mark.parametrize("corrected", [True, False])
def test_noise_of_the_output_in_an_effect_is_corrected(corrected: bool) -> None:
    """The gradient by a cubic term is the third power of the noisy output: false-alarm rate 3e-5; 6 sigma without."""
    rate, noise, n = 200.0, 3e-2, 6000
    rng, t = np.random.default_rng(4107), np.arange(n) / rate
    w, size = np.array([2.0, 5.0, 9.0]), np.array([1.5, 1.0, 0.7])
    s = np.sin(w[:, None] * t + rng.uniform(0, 6, (3, 1)))
    a = size @ s
    u = 0.05 + 1.01 * a + 2e-3 * a**2 + 3e-4 * a**3 + rng.standard_normal(n) * noise * np.sqrt(rate / 2.0)
    z = -(size / w**2) @ s + 3e-8 * rng.standard_normal(n)
    model = Model.cubic().freeze(time_offset=0.0)
    live = LiveModel(model, Rig(), rate=rate, q=noise**2 / 2, r_position=9e-16, position=float(z[0]))
    assert [part.effect.name for part in live._parts if part.noisy] == ["quadratic", "cubic"]
    if not corrected:
        live._parts = [replace(part, noisy=False) for part in live._parts]
    live.run(u, z)
    truth = {"scale_factor": 0.01, "quadratic": 2e-3, "cubic": 3e-4}
    worst = max(abs(live[name].value - value) / live[name].std for name, value in truth.items())
    print(f"worst of {list(truth)}: {worst:.2f} sigma")
    assert worst < 4.5 if corrected else worst > 6.0
