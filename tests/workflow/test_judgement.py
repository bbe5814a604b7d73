"""What a diagnosis states besides a name: importance of the effect, rejected outliers, and data beyond the trained
range."""

import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel
from accelcal.data.rig import STANDARD_GRAVITY
from accelcal.diagnosis.findings import Size, split
from accelcal.estimation.estimate import estimate
from accelcal.results import json as results_json
from accelcal.simulation import CXL02_RIG
from accelcal.simulation.motion import motion
from accelcal.simulation.sensor import Vibration
from accelcal.validation.evaluation import compare
from accelcal.verbs import diagnose, improve
from tests.workflow.test_figures import record as record_of

TRUTH = {"bias": 0.05, "scale_factor": 0.01}
MG = 1e-3 * STANDARD_GRAVITY


def record(seed, seconds=40.0, rig=CXL02_RIG, profile="interleaved", vibration=None, **more):
    rng = np.random.default_rng(seed)
    truth = {**TRUTH, **more}
    return ac.simulate(profile, seconds=seconds, rig=rig, parameters=truth, rng=rng, vibration=vibration).recording


# ---- units -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [1.0, 1000.0, 0.4])
def test_nothing_is_named_and_nothing_is_adequate_beside_a_scale_that_no_sensor_has(factor):
    plain = record(61, seconds=20.0)
    position = dataclasses.replace(plain.position, y=factor * plain.position.y)
    changed = dataclasses.replace(plain, position=position, rig=dataclasses.replace(plain.rig, resolution=None))
    fit = ac.fit(changed)
    diagnosis, result = diagnose(fit, changed), improve(changed, most=1)
    assert (diagnosis.verdict, result.verdict) == (("adequate",) * 2 if factor == 1.0 else ("unexplained",) * 2)
    assert (diagnosis.effects, result.effects) == ((), ())
    for verdict in (diagnosis, result.diagnosis):
        messages = [remark.sentence for remark in verdict.remarks if remark.code == "implausible_scale"]
        assert messages == [remark.sentence for remark in fit.remarks if remark.code == "implausible_scale"]
        assert bool(messages) == (factor != 1.0)
        assert verdict.nameable == (factor == 1.0)


# ---- tolerance -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def nonlinear():
    return record(2, quadratic=1e-3)


@pytest.mark.parametrize(("factor", "kind"), [(0.5, "matters"), (2.0, "below")])
def test_a_declared_tolerance_splits_the_effects_by_their_largest_contribution(nonlinear, factor, kind):
    # By hand: K2 a² at the largest acceleration of the planned motion.
    rng = np.random.default_rng(2).spawn(4)[0]
    a = motion("interleaved", 40.0, rng).derivatives(nonlinear.accel.t)[2]
    largest = 1e-3 * float(np.max(a**2))
    rig = dataclasses.replace(nonlinear.rig, tolerance=factor * largest)
    diagnosis = diagnose(estimate(ac.Model.linear(), nonlinear), dataclasses.replace(nonlinear, rig=rig))
    content = results_json.content(diagnosis)
    assert content["effects"] == ["quadratic"]
    assert content["importance"][kind] == ["quadratic"]
    assert content["importance"]["tolerance"] == factor * largest
    size = content["sizes"]["quadratic"]
    assert size["value"] == pytest.approx(largest, rel=0.1)  # smoothed at a peak, K2 known to some percent


def test_without_a_declared_tolerance_nothing_is_split(nonlinear):
    improvement = improve(nonlinear)
    assert improvement.importance is None
    assert improvement.diagnosis.sizes["quadratic"].value > 0.0


def test_metres_are_not_compared_with_an_acceleration():
    sizes = {"cubic": Size(0.02), "encoder_cyclic": Size(1.0, at_encoder=True), "velocity": Size(0.001)}
    result = split(("cubic", "encoder_cyclic", "velocity", "whiteness"), sizes, 0.01)
    assert (result.matters, result.below) == (("cubic",), ("velocity",))
    assert result.not_comparable == ("encoder_cyclic", "whiteness")


# ---- channels and outliers -----------------------------------------------------------------------------------------


def test_channels_are_tested_anew_once_an_effect_has_entered():
    shaken = record(11, quadratic=1e-3, vibration=Vibration(0.05, 230.0))
    improvement = improve(shaken)
    assert improvement.effects == ("quadratic", "vibration")
    # The sister: nothing shakes, nothing is heard.
    assert improve(record(11, quadratic=1e-3)).effects == ("quadratic",)


def outlying(recording, channel, sizes, seed=5, share=1e-3):
    """One reading in a thousand wrong by a size between two; not at the ends, where no spectrum tells them apart."""
    rng = np.random.default_rng(seed)
    good = getattr(recording, channel)
    hit = (rng.random(len(good)) < share) & (good.t > good.t[0] + 0.5) & (good.t < good.t[-1] - 0.5)
    wrong = hit * rng.choice([-1.0, 1.0], len(good)) * rng.uniform(*sizes, len(good))
    other = Channel(good.name, good.t, good.y + wrong, good.unit)
    return dataclasses.replace(recording, **{channel: other}), good.t[hit]


@pytest.mark.parametrize(
    ("effect", "channel", "sizes"),
    [("accelerometer_outliers", "accel", (0.3, 1.0)), ("encoder_outliers", "position", (12e-6, 40e-6))],
)
def test_outliers_are_rejected_and_no_longer_inflate_the_noise(effect, channel, sizes):
    clean = record(12)
    spoiled, at = outlying(clean, channel, sizes)
    level = {"accel": lambda f: f.runs[0].noise.all.density, "position": lambda f: f.runs[0].noise.all.reading}[channel]
    good, bad = (level(estimate(ac.Model.linear(), run)) for run in (clean, spoiled))
    diagnosis = diagnose(estimate(ac.Model.linear(), clean), spoiled)
    assert effect in diagnosis.effects
    assert bad > 1.2 * good
    assert level(diagnosis.fit) == pytest.approx(good, rel=0.03)  # 2 % is what the likelihood knows of either noise
    (dropped,) = diagnosis.dropped
    assert (dropped.channel, dropped.of) == (channel, len(getattr(clean, channel)))
    assert 0.95 * len(at) <= dropped.count <= len(at)  # a few of them may also be jumps of the motion


@pytest.mark.parametrize("number", [1, 5])
def test_one_outlier_is_left_out_and_no_property_of_the_noise(number):
    clean = record(12)
    y = clean.position.y.copy()
    y[np.linspace(2000, len(y) - 2000, number + 2).astype(int)[1:-1]] += 25e-6
    spoiled = dataclasses.replace(clean, position=dataclasses.replace(clean.position, y=y))
    diagnosis = diagnose(estimate(ac.Model.linear(), clean), spoiled)
    assert [dropped.count for dropped in diagnosis.dropped] == [number]
    assert ("encoder_outliers" in diagnosis.effects) is (number > 1)


def test_what_a_missing_effect_leaves_is_no_scatter_of_the_readings():
    # By hand: 500 Hz, K3, an encoder of 0.5 µm. Nothing stands out, but what the search found leaves heavy tails.
    rng = np.random.default_rng(11)
    w, size, phase = 2 * np.pi * np.array([0.7, 1.3, 2.9, 5.1, 7.7]), np.array([3, 2.5, 2, 2, 1.5]), rng.random(5) * 6.3
    t, at = np.arange(6000) / 500.0, np.arange(3000) / 250.0 + 1e-4
    a = np.sin(np.outer(t, w) + phase) @ size
    z = -np.sin(np.outer(at, w) + phase) @ (size / w**2)
    u = 0.08 + 1.012 * a + 8e-4 * a**3 + 2e-3 * rng.standard_normal(6000)
    z = 5e-7 * np.round(z / 5e-7) + 2e-7 * rng.standard_normal(3000)
    run = ac.Recording.from_arrays(t, u, z, position_t=at, units={"accel": "m/s^2", "position": "m"})
    fit = ac.fit(run)
    diagnosis = diagnose(fit, run)
    assert diagnosis.effects == ("cubic",)
    assert diagnose(ac.add(fit, run, *diagnosis.effects), run).effects == ()


def test_nothing_is_left_out_of_a_good_record():
    # Each channel raises a false alarm once in ten thousand records.
    good = record(12)
    assert diagnose(estimate(ac.Model.linear(), good), good).dropped == ()


def test_held_out_data_lose_their_outliers_for_every_step():
    spoiled, _ = outlying(record(13, quadratic=1e-3), "position", (12e-6, 40e-6))
    test, at = outlying(record(14, quadratic=1e-3), "position", (12e-6, 40e-6), seed=6)
    improvement = improve(spoiled, holdout=test)
    assert improvement.effects == ("quadratic", "encoder_outliers")
    lost = [d for d in improvement.diagnosis.dropped if d.recording.startswith("held out")]
    assert [d.channel for d in lost] == ["position"]
    assert 0.9 * len(at) <= lost[0].count <= len(at)
    assert len({len(step.heldout.residual[0]) for step in improvement.steps}) == 1
    clean = improve(record(13, quadratic=1e-3), holdout=record(14, quadratic=1e-3))
    assert improvement.steps[-1].heldout.one_step_rms < 1.02 * clean.steps[-1].heldout.one_step_rms


# ---- beyond the trained range ----------------------------------------------------------------------------------------


def test_readings_outside_the_trained_range_are_counted_and_scored_apart():
    small = record(21, profile="tones", cubic=1e-3)
    fitted = estimate(ac.Model.linear(), small)
    rng = np.random.default_rng(22)
    simulation = ac.simulate(
        "tones", seconds=40.0, rig=CXL02_RIG, parameters={**TRUTH, "cubic": 1e-3}, rng=rng, a_rms=8.0
    )
    comparison = compare(fitted, simulation.recording)
    of_a = next(o for o in comparison.outside if o.variable == "a")
    low, high = of_a.range
    a = simulation.truth.motion.derivatives(simulation.recording.position.t)[2]
    truly = int(np.sum((a < low) | (a > high)))
    assert truly > 1000
    assert of_a.count == pytest.approx(truly, rel=0.05)  # the encoder's own acceleration, noisy, ends left out
    inside, outside = of_a.one_step
    assert outside > inside  # cubic is missing, and grows with a
    assert of_a.count < comparison.outside[-1].of
    assert comparison.outside[-1].variable == "any"
    assert comparison.outside[-1].count >= max(o.count for o in comparison.outside)
    assert sum(of_a.starts[1.0]) == comparison.coast_starts[1.0]
    content = results_json.content(comparison)["outside"]
    assert (content[0]["variable"], content[0]["count"]) == ("a", of_a.count)


def test_errors_inside_and_outside_add_up_to_the_whole():
    fitted = estimate(ac.Model.linear(), record(23, profile="bursts"))
    comparison = compare(fitted, record(24, profile="interleaved"))
    for region in comparison.outside:
        for horizon, (near, far) in region.coast.items():
            n, m = region.starts[horizon]
            total = (n * (near or 0.0) ** 2 + m * (far or 0.0) ** 2) / max(1, n + m)
            assert np.sqrt(total) == pytest.approx(comparison.coast_rms[horizon], rel=1e-9)


def test_temperature_beyond_the_calibrated_range_is_counted():
    cold, warm = record(25), record(26)
    t = cold.accel.t

    def at(recording, low, high):
        y = np.linspace(low, high, len(t))
        return dataclasses.replace(recording, side={"temperature": Channel("temperature", t, y, "degC")})

    fitted = estimate(ac.Model.linear(), at(cold, 20.0, 25.0))
    comparison = compare(fitted, at(warm, 22.0, 28.0))
    region = next(o for o in comparison.outside if o.variable == "temperature")
    assert region.range == pytest.approx((20.0, 25.0), abs=0.01)
    assert region.count == pytest.approx(0.5 * region.of, rel=0.05)  # half of the ramp lies above 25 degC
    assert compare(fitted, at(warm, 20.5, 24.5)).outside[-2].count == 0


def test_the_sentence_says_the_sigma_of_the_effect_that_it_names():
    recording = record_of(3, lambda m: 1e-3 * m.a**2, seconds=10.0)
    diagnosis = diagnose(ac.fit(recording), recording)
    (named, first), (_, second) = ((item.effect, f"{item.snr:.0f}") for item in diagnosis.scan.candidates[:2])
    assert named == "quadratic"
    assert first != second
    assert diagnosis.sentence.startswith(f"quadratic explains what the model lacks ({first} sigma; ")
