"""Files of every regime: noise levels, stamps, holes, loading; and lines of the judge, each with one that must fail."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accelcal.io import load
from tests.regimes import hidden
from tests.regimes.judge import Line, errors, false_names, hidden_lines, lines, rows, unreachable
from tests.regimes.motion import Motion, resonance
from tests.regimes.noise import behind_poles, flicker, held, holes, ornstein_uhlenbeck, student
from tests.regimes.regimes import ADXL105, CXL02, FAILING, TABLE, Regime, phone, reference_noise
from tests.regimes.rig import G0, UG, Clocks, Planted, Reference, Rig, Sensor
from tests.regimes.trials import Trial, plan, plan_hidden, run
from tests.worlds.numerics import stream

RNG = [7]


def low_noise(rig: Rig, profile: str = "rest", seconds: float = 10.0) -> Regime:
    return Regime("test", profile, rig, seconds)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.statistics] * (k % 4 > 0)) for k, name in enumerate(TABLE)]
)
def test_the_file_of_a_regime_is_read_by_the_product(name: str, tmp_path: Path) -> None:
    regime = TABLE[name]
    record = regime.build(11, seconds=4.0)
    read = load(record.write(tmp_path))
    clocks = regime.rig.clocks
    tick = 1 / regime.rig.sensor.rate if clocks.held else 0.0  # stamps are coarse, the instants of the product are not
    near = max(1e-8, 0.55 * clocks.rounding)  # nine decimals in the file
    at = np.minimum(np.searchsorted(record.t_accel, read.accel.t - near), len(record.t_accel) - 1)
    np.testing.assert_allclose(read.accel.t, record.t_accel[at], atol=near + tick)
    np.testing.assert_allclose(read.accel.y, record.accel[at], rtol=1e-8, atol=1e-12)
    if regime.rig.clocks.held is None:  # of held values the product keeps one each
        assert len(at) == np.count_nonzero(~np.isnan(record.accel))
    assert len(record.accel) == pytest.approx((4.0 - regime.rig.clocks.gap) * regime.rig.sensor.rate, abs=2)
    assert len(read.position) == np.count_nonzero(~np.isnan(record.position))
    declared = regime.rig.sensor.declared or regime.rig.sensor.density
    if not regime.rig.bare:
        assert read.rig.sensor.noise == pytest.approx(declared * UG)


def test_names_and_failing_beginnings_fit_the_table() -> None:
    assert len(TABLE) > 150
    assert all(any(name.startswith(prefix) for name in TABLE) for prefix in FAILING)
    assert all(name == regime.name for name, regime in TABLE.items())
    trials = list(plan(list(TABLE), None, 1))
    assert len({t.key for t in trials}) == len({t.record_seed for t in trials}) == len(trials) >= 600


@pytest.mark.parametrize(
    ("sensor", "expected"),
    [
        (replace(ADXL105, corner=None), 225 * UG * np.sqrt(1667.03 / 2)),
        (ADXL105, 225 * UG * np.sqrt(np.pi / 2 * 159.0)),  # noise bandwidth of an RC: pi/2 of its corner
        (replace(CXL02, freedom=4.0), 20 * UG * np.sqrt(np.pi / 2 * 159.0)),
        (Sensor(1.0, corner=None), UG * np.sqrt(1667.03 / 2)),
    ],
)
def test_noise_of_the_file_is_the_declared_density(sensor: Sensor, expected: float) -> None:
    record = low_noise(Rig(sensor)).build(1)
    # 16 670 samples, correlated over two: 1.1 %; with t(4) tails 2 % more
    assert np.std(record.accel - record.truth["bias"]) == pytest.approx(expected, rel=0.05)


def test_noise_behind_poles_has_the_power_that_the_poles_leave() -> None:
    poles = resonance(100.0, 2**-0.5)
    y = behind_poles(40_000, 1e-3, 2.0, poles, np.random.default_rng(RNG))
    f = np.linspace(0.0, 5e4, 400_000)
    s = 2j * np.pi * f
    gain = np.abs(np.prod([-p / (s - p) for p in poles], axis=0)) ** 2
    assert np.var(y) == pytest.approx(4.0 * np.trapezoid(gain, f), rel=0.04)


def test_flicker_has_a_flat_allan_deviation_at_its_instability() -> None:
    rng = np.random.default_rng(RNG)
    results = []
    for _ in range(20):
        means = flicker(20_000, 1e-2, 3.0, rng).reshape(-1, 200).mean(axis=1)  # 2 s
        results.append(np.mean(np.diff(means) ** 2) / 2)
    assert np.sqrt(np.mean(results)) == pytest.approx(3.0, rel=0.08)  # 2000 pairs: 2 %; averaging below 1/(2 s): 3 %


def test_heavy_tails_and_drift_have_their_variance() -> None:
    rng = np.random.default_rng(RNG)
    assert np.std(student(200_000, 5.0, rng)) == pytest.approx(1.0, rel=0.03)
    t = np.cumsum(rng.uniform(0.5, 1.5, 50_000))
    y = ornstein_uhlenbeck(t, 2.0, 10.0, rng.standard_normal(len(t)))
    assert np.std(y) == pytest.approx(2.0, rel=0.05)
    assert np.corrcoef(y[:-1], y[1:])[0, 1] == pytest.approx(np.exp(-0.1), abs=0.01)


def test_position_noise_rounding_and_zeroing() -> None:
    sharp = low_noise(Rig(reference=Reference(3e-6, None))).build(2)
    assert np.std(sharp.position) == pytest.approx(3e-6, rel=0.05)
    coarse = low_noise(Rig(reference=Reference(1e-6, 20e-6)), "smooth").build(2)
    np.testing.assert_allclose(coarse.position / 20e-6, np.rint(coarse.position / 20e-6), atol=1e-6)
    for faulty in (Reference(zeroed=True), Reference(lost=5e-4)):
        record = low_noise(Rig(reference=faulty), "smooth", 20.0).build(3)
        error = record.position - record.motion.position(record.t_position)
        assert np.count_nonzero(np.abs(np.diff(error)) > 1e-4) == 1


def test_a_reference_meets_the_sensor_at_its_crossover() -> None:
    sigma = reference_noise(225.0, 1e4, 2000.0)
    displacement = 2 * sigma**2 / 1e4  # one-sided density, m^2/Hz
    assert displacement * (2 * np.pi * 2000.0) ** 4 == pytest.approx((225 * UG) ** 2)
    assert sigma == pytest.approx(1e-9, rel=0.05)  # frontier.md, H1: 10 kHz, 1 nm, ADXL105, fc/rate 0.20


def test_stamps_are_rounded_and_samples_held_or_missing() -> None:
    rounded = Rig(phone(200.7), Reference(2e-4, None, 120.0), Clocks(rounding=1e-3))
    record = low_noise(rounded).build(4)
    np.testing.assert_allclose(record.t_accel * 1e3, np.rint(record.t_accel * 1e3), atol=1e-9)
    assert np.all(np.diff(record.t_accel) > 0)
    logger = low_noise(Rig(replace(ADXL105, rate=1000.0, corner=None), clocks=Clocks(held=400.0)), "random").build(4)
    assert np.mean(np.diff(logger.accel) == 0.0) == pytest.approx(0.6, abs=0.01)
    rng = np.random.default_rng(RNG)
    assert np.all(np.diff(held(np.arange(0.1, 1, 1e-3), 400.0, rng)) >= 0)
    for length in (1, 100):
        lost = holes(20_000, 0.3, length, rng)
        assert np.mean(lost) == pytest.approx(0.3, abs=0.02)
        assert np.count_nonzero(np.diff(lost.astype(int)) == 1) < (5000 if length == 1 else 120)


def test_output_is_late_by_the_time_offset() -> None:
    rig = Rig(replace(ADXL105, density=1e-3, corner=None), clocks=Clocks(offset=5e-3))
    record = low_noise(rig, "random").build(5)
    t, truth = record.t_accel, record.truth
    a = record.motion.a.at(t - truth["time_offset"])
    assert 2.5e-3 <= abs(truth["time_offset"]) <= 5e-3
    np.testing.assert_allclose(record.accel, (1 + truth["scale_factor"]) * a + truth["bias"], atol=1e-5)
    assert np.max(np.abs(record.accel - record.motion.a.at(t))) > 0.1


def test_a_turning_sensor_feels_its_tilt() -> None:
    still = low_noise(Rig(replace(phone(100.0), tilt=3.0)), seconds=60.0).build(6)
    tilt = np.degrees((still.accel - still.truth["bias"]) / G0)
    assert np.std(tilt) == pytest.approx(3.0, rel=0.2)


@pytest.mark.parametrize("name", hidden.EFFECTS)
def test_planted_effects_have_the_strength_that_is_asked(name: str) -> None:
    regime = replace(TABLE["a-random-cxl02"], seconds=6.0)
    magnitude, instant = hidden.at_strength(regime, name, 3)
    motion = regime.motion(3).refined(hidden.FINE)
    added = hidden.EFFECTS[name][0](motion, magnitude, instant)
    assert hidden.strength(regime, motion, name, magnitude, instant) == pytest.approx(hidden.STRENGTH, rel=0.02)
    assert hidden.strength(regime, motion, "base", 3.0) < 1e-3  # what the base explains has no strength
    planted, plain = (regime.build(3, p) for p in (hidden.plant(regime, name, 3), Planted()))
    if name != "sensor_lag":
        difference = planted.accel - plain.accel
        expected = added.behind([complex(-2 * np.pi * 159.0)])(planted.t_accel - plain.truth["time_offset"])
        np.testing.assert_allclose(difference, expected, atol=1e-9)


def test_what_cannot_be_reached_is_said() -> None:
    creeping = replace(TABLE["l-creep"], seconds=6.0)
    with pytest.raises(hidden.OutOfReach, match=r"full scale|trace|reach|largest"):
        hidden.at_strength(creeping, "cubic", 1)
    with pytest.raises(hidden.OutOfReach, match="jitter"):
        hidden.plant(creeping, "timing_jitter", 1)
    skipped = {"regime": "l-creep", "hidden": "cubic", "skipped": "why"}
    assert unreachable([skipped]) == ["l-creep + cubic: why"]
    assert {t.hidden for t in plan_hidden(["l-creep"], 1, 1)} == set(hidden.PLANTED)


def test_wrong_samples_are_as_many_as_planted() -> None:
    size = hidden.wrong_size(TABLE["a-random-cxl02"])
    surprise = 20 * UG * np.sqrt(2 * np.pi * 159.0 / 4)
    assert 2 * surprise < size < 9 * surprise
    regime = low_noise(Rig(CXL02))
    difference = regime.build(8, Planted(wrong=20, wrong_size=0.5)).accel - regime.build(8).accel
    assert np.count_nonzero(np.abs(np.abs(difference) - 0.5) < 1e-9) == 20


def outcome(regime: str = "a-mixed-adxl105", hidden: str = "", z: float = 0.1, **more: object) -> dict:
    results = {n: [1.0 + z * 0.1, 0.1, 1.0] for n in ("bias", "scale_factor", "time_offset")}
    plain = {"effects": [], "classes": [], "verdict": "adequate", "estimates": results, "seconds": 3.0}
    return {"regime": regime, "hidden": hidden, "key": "", **plain, **more}


def draws(n: int = 400, scale: float = 1.0) -> list[dict]:
    """Outcomes with unit normal errors, spread over two regimes."""
    z = np.random.default_rng(RNG).standard_normal(n)
    z *= scale / np.sqrt(np.mean(z**2))
    return [outcome(("a-mixed-adxl105", "p-temp-noisy")[k % 2], z=float(score)) for k, score in enumerate(z)]


def line(results: list[Line], claim: str) -> Line:
    return next(row for row in results if claim in row.claim)


def test_lines_hold_for_right_outcomes() -> None:
    assert all(line.holds for line in lines(draws())), [line.text for line in lines(draws())]


@pytest.mark.parametrize(
    ("claim", "wrong"),
    [
        ("false name", [outcome(effects=["cubic"])] * 9),
        ("4 sigma", [outcome(z=5.0)] * 6),
        ("rms z of bias", draws(400, 1.2)),
        ("regime by regime", [outcome("l-creep", z=3.5)] * 12),
        ("laid on the sensor", [outcome(verdict="unexplained")] * 9),
        ("expected verdict", [outcome("c-phone-turning", verdict="adequate")]),
        ("crashes", [{"regime": "l-rest", "hidden": "", "error": "x", "seconds": 1.0}]),
        ("refusals", [{"regime": "a-trap-servo", "hidden": "", "refused": "x", "seconds": 1.0}]),
        ("processor time", [outcome(seconds=31.0)]),
        ("at rest", [outcome("l-rest"), {"regime": "l-rest", "hidden": "", "refused": "x", "seconds": 1.0}]),
    ],
)
def test_each_line_fails_where_its_claim_is_wrong(claim: str, wrong: list[dict]) -> None:
    assert not line(lines([*draws(), *wrong]), claim).holds


def test_names_are_false_unless_they_are_in_the_record_or_its_class() -> None:
    assert false_names(outcome("i-student", effects=["accelerometer_outliers", "cubic"])) == ["cubic"]
    tied = outcome("s-two-clocks", effects=["sensor_lag"], classes=[["sensor_lag", "time_offset"]])
    assert false_names(tied) == []
    assert false_names(outcome(hidden="cubic", effects=["cubic", "tone"])) == ["tone"]
    assert len(errors(outcome("e-gnss-multipath"))) == 2
    assert "| a-mixed-adxl105 | 2 | 1 |" in "\n".join(rows([outcome(), outcome(effects=["tone"])]))


def test_hidden_lines_hold_and_fail() -> None:
    right = [outcome(hidden=name, effects=[name], classes=[[name]]) for name in hidden.PLANTED]
    assert all(hidden_line.holds for hidden_line in hidden_lines(right))
    missed = [{**o, "effects": [], "classes": []} for o in right]
    assert [o.holds for o in hidden_lines(missed)[:3]] == [False, False, False]
    extra = [{**o, "effects": [*o["effects"], "tone"]} for o in right]
    assert not line(hidden_lines(extra), "extra").holds


def test_a_clean_record_runs_through_the_product_and_a_refusal_is_an_outcome() -> None:
    result = run(Trial("j-10s", 0, 1))
    assert "error" not in result
    assert set(result["estimates"]) == {"bias", "scale_factor", "time_offset"}
    assert all(abs(z) < 5 for z in errors(result))
    assert result["seconds"] < 30.0
    assert run(Trial("l-creep", 0, 1, "cubic"))["skipped"]


def test_motion_of_two_seeds_differs_and_of_one_is_the_same() -> None:
    regime = TABLE["a-trap-str60"]
    t = np.linspace(0, 3, 50)
    here, again, other = (regime.motion(seed, 3.0).position(t) for seed in (1, 1, 2))
    assert np.array_equal(here, again)
    assert not np.array_equal(here, other)
    assert isinstance(regime.motion(1, 3.0), Motion)
    assert stream(1, 1).random() == stream(1, 1).random()
