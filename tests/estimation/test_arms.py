"""Sensors on arms about axles: how an angle is read, what is estimated, and what is said of what it leaves open."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import accelcal as ac
from accelcal import io
from accelcal.data.orientation import GRAVITY, WOBBLE, on_arm, unwrapped
from accelcal.data.quality import describe, summarise
from accelcal.data.recording import Origin
from accelcal.diagnosis.faults import examine
from accelcal.estimation import estimate, run as runs
from accelcal.estimation.estimate import complete, far_zeros
from accelcal.estimation.readings import AngleError
from accelcal.signals import processing

from .arms import Rigged, columns, record, sidecar

CHI2_5 = 25.7
"""Of five parameters, exceeded in 1e-4 of fits."""
ARMS = {
    "a swing about a level axle": Rigged(arm_error=3e-4, across=1e-3, zero=1e-3),
    "whole turns, wrapped, in degrees": Rigged(motion="turns", wrap=True, zero=-1e-3, seed=3),
    "whole turns in counts": Rigged(motion="turns", unit="count", wrap=True, input_axis="tangential", seed=4),
    "a vertical axle that leans": Rigged(motion="turns", axle="vertical", tilt=2e-3, unit="rad", seed=5),
    "a centrifuge": Rigged(motion="steps", axle="vertical", unit="rev", seed=6, seconds=48.0, delay=0.0),
    "a sensor on the axle": Rigged(arm=0.0, keys={"arm_std": '"2 mm"'}, seed=7),
}


def errors(rig: Rigged, fit: ac.Fit) -> tuple[float, np.ndarray]:
    """Normalised error squared of five parameters, and the error of each in standard deviations."""
    of_axle = ("axle_tilt.cos", rig.zero) if rig.axle == "horizontal" else ("axle_tilt.sin", rig.tilt)
    truth = {"bias": rig.bias, "scale_factor": rig.k, "time_offset": rig.delay, "lever_arm.x": rig.arm_error}
    truth |= dict([of_axle])
    at = [[e.name for e in fit.free].index(name) for name in truth]
    covariance = np.asarray(fit.covariance)[np.ix_(at, at)]
    off = np.array([fit[name].value - value for name, value in truth.items()])
    return float(off @ np.linalg.solve(covariance, off)), off / np.sqrt(np.diag(covariance))


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_gives_bias_scale_delay_length_and_tilt(tmp_path: Path, name: str) -> None:
    rig = ARMS[name]
    fit = ac.fit(record(rig, tmp_path))
    nees, z = errors(rig, fit)
    print(nees, z)
    assert nees < CHI2_5
    assert fit["lever_arm.z"].std == 0.0 == fit["lever_arm.z"].value


def test_a_wrong_arm_shows_about_a_level_axle(tmp_path: Path) -> None:
    rig = Rigged(arm_error=0.005, keys={"arm_std": '"1 um"'}, seconds=12.0)
    assert errors(rig, ac.fit(record(rig, tmp_path)))[0] > 2.0 * CHI2_5


def test_gravity_that_turns_is_not_cut_short_between_its_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 8 rad/s and 5 ms straight lines are (w h)²/8 = 2e-4 of gravity short halfway between samples."""
    rig = Rigged(arm=0.0, keys={"arm_std": '"1 nm"'}, motion="turns", delay=0.0, seconds=12.0)
    recording = record(replace(rig, density=1e-4), tmp_path)
    series = recording.side[GRAVITY]
    middle = 0.5 * (series.t[1:] + series.t[:-1])
    exact = CubicSpline(series.t, series.y)(middle)
    off = processing.resample(series, middle) - exact
    monkeypatch.setattr(processing, "DERIVED", ())
    straight = processing.resample(series, middle) - exact
    assert np.std(off[4:-4]) < 0.05 * np.std(straight[4:-4])


def test_the_plateaus_of_a_centrifuge_give_the_same_quadratic(tmp_path: Path) -> None:
    """Means of twelve plateaus on a² by weighted least squares, the arm known; the fit has the ramps as well, and may
    differ by what the plateaus leave open."""
    rig = Rigged(motion="steps", axle="vertical", seconds=48.0, delay=0.0, quadratic=2e-4, k=0.0, seed=9)
    rig = replace(rig, keys={"arm_std": '"1 nm"'})
    table, plateau = columns(rig), rig.seconds / 12
    t, read = table["t"], table["angle"]
    rows = []
    for n in range(12):
        flat = (t > (n + 0.32) * plateau) & (t < (n + 0.68) * plateau)
        angle = flat & np.isfinite(read)
        rate = np.polyfit(t[angle], np.radians(read[angle]), 1)[0]
        rows.append((-rig.arm * rate**2, np.mean(table["acc"][flat]), rig.density / np.sqrt(2.0 * 0.36 * plateau)))
    a, mean, std = np.array(rows).T
    matrix = np.column_stack([np.ones(12), a, a**2]) / std[:, None]
    value = np.linalg.lstsq(matrix, mean / std, rcond=None)[0][2]
    spread = np.sqrt(np.linalg.inv(matrix.T @ matrix)[2, 2])
    fit = ac.fit(record(rig, tmp_path), ac.Model.linear().add("quadratic"))["quadratic"]
    print(value, spread, fit.value, fit.std)
    assert fit.std < spread
    assert abs(fit.value - value) < 4.0 * np.sqrt(spread**2 - fit.std**2)
    assert abs(fit.value - rig.quadratic) < 4.0 * fit.std


@pytest.mark.parametrize(
    ("axis", "k"), [("radial", 0.0), ("radial", 0.1), ("tangential", 0.1), ("tangential", -0.1)], ids=str
)
def test_gravity_that_is_not_in_the_path_is_no_break(tmp_path: Path, axis: str, k: float) -> None:
    """None of 120 records of ten motions had a remark; before gravity was counted with the path, 22 had."""
    rig = Rigged(motion="dwells", input_axis=axis, arm=0.02, k=k, seconds=24.0, seed=11)
    assert examine(record(rig, tmp_path)).remarks() == []


def test_a_sensor_that_comes_loose_from_its_arm_is_a_break(tmp_path: Path) -> None:
    record(Rigged(motion="dwells", input_axis="tangential", k=0.1, seconds=24.0, seed=11), tmp_path)
    head, *lines = (tmp_path / "arm.csv").read_text().splitlines()
    loose = np.cumsum(np.random.default_rng(1).normal(0.0, 0.15, len(lines)))
    for n in range(4800, len(lines)):
        t, _, angle = lines[n].split(",")
        lines[n] = f"{t},{loose[n] - loose[4800]:.6f},{angle}"
    (tmp_path / "arm.csv").write_text("\n".join([head, *lines]) + "\n")
    (begin,) = examine(io.load(tmp_path / "arm.csv")).breaks
    assert begin == pytest.approx(12.0, abs=0.1)


def test_nothing_is_named_on_an_arm_and_an_eccentric_disk_is(tmp_path: Path) -> None:
    """False names come in at most 3 % of records (make bench-arms)."""
    rig = Rigged(motion="turns", delay=0.0, seed=2)
    recording = record(rig, tmp_path)
    diagnosis = ac.diagnose(ac.fit(recording), recording)
    assert diagnosis.verdict == "adequate", diagnosis.sentence
    recording = record(replace(rig, eccentricity=1e-3), tmp_path, "disk")
    diagnosis = ac.diagnose(ac.fit(recording), recording)
    assert "angle_eccentricity" in diagnosis.sentence, diagnosis.sentence


RESTS = Rigged(motion="dwells", seconds=24.0, quadratic=2e-4, delay=0.0, arm=0.02, density=5e-4)
CHI2_18 = 48.4
"""Of three coefficients of six records, exceeded in 1e-4 of sets."""


def squares_of_rests(rig: Rigged, folder: Path) -> float:
    """Normalised errors squared of bias, scale factor and quadratic, summed over six records."""
    total = 0.0
    for seed in range(6):
        at_zero = replace(rig, seed=seed, zero=1e-3 * np.random.default_rng(seed).standard_normal())
        fit = ac.fit(record(at_zero, folder), ac.Model.linear().add("quadratic"))
        truth = {"bias": rig.bias, "scale_factor": rig.k, "quadratic": rig.quadratic}
        at = [[e.name for e in fit.free].index(name) for name in truth]
        off = np.array([fit[name].value - value for name, value in truth.items()])
        total += float(off @ np.linalg.solve(np.asarray(fit.covariance)[np.ix_(at, at)], off))
    return total


@pytest.mark.parametrize(("count", "noise"), [(2e-3, 0.0), (2e-3, 0.2), (2e-5, 0.0)], ids=str)
def test_a_rest_has_one_rounding_error_of_its_angle(tmp_path: Path, count: float, noise: float) -> None:
    """At a rate of 1e-4; the noise dithers a share of a count."""
    assert squares_of_rests(replace(RESTS, count=count, angle_std=noise * count), tmp_path) < CHI2_18


def test_a_coarse_angle_taken_as_white_at_rest_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The twin of the test above, without the error that a rest shares."""
    monkeypatch.setattr(runs.PreparedRun, "angle_error", None)
    assert squares_of_rests(replace(RESTS, count=2e-3, angle_std=0.0), tmp_path) > 2.0 * CHI2_18


@pytest.mark.parametrize("count", [1e-3, 1.0])
@pytest.mark.parametrize("sigma", [0.0, 0.05, 0.1, 0.2, 0.3])
def test_the_error_that_a_rest_shares_is_that_of_simulated_readings(count: float, sigma: float) -> None:
    """Of three hundred rests of 400 readings, each behind a move of 40: their standard deviation is known to 4 %."""
    rng = np.random.default_rng(5)
    place = np.cumsum(rng.uniform(60.0, 90.0, 300))
    true = np.concatenate([np.concatenate([np.linspace(a, b, 40), np.full(400, b)]) for a, b in pairwise(place)])
    read = np.rint(true + sigma * rng.standard_normal(len(true)))
    error = AngleError.of(np.arange(len(true)) / 100.0, count * read)
    assert error is not None
    begin = np.searchsorted(np.arange(len(true)) / 100.0, error.spans)
    assert 299 <= len(begin) <= 300  # one flips for long
    means = np.array([np.mean((read - true)[a + 8 : b - 8]) for a, b in begin])
    left = np.sqrt(max(0.0, np.var(means) - error.resting / count**2 / 384.0))
    assert error.shared / count == pytest.approx(left, rel=0.2, abs=0.01)
    assert error.moving / count**2 == pytest.approx(sigma**2 + 1.0 / 12.0, rel=0.1)


@pytest.mark.parametrize("banded", [False, True])
def test_an_encoder_better_than_the_output_keeps_its_band_where_an_effect_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, banded: bool
) -> None:
    """Of d = 20 over white noise two thirds are left at least; the probability of less is below 1e-10.

    The twin is the same record, its fit in the band that its coloured innovations ask for.
    """
    if banded:
        monkeypatch.setattr(estimate, "needs_band", lambda state: state.coloured)
    rig = Rigged(motion="turns", axle="vertical", delay=0.0, eccentricity=4.7e-4, keys={"arm_std": '"0.2 mm"'}, seed=13)
    recording = record(rig, tmp_path)
    fit = ac.fit(recording)
    assert (fit.runs[0].noise.band is not None) == banded
    diagnosis = ac.diagnose(fit, recording)
    d = max(candidate.snr for candidate in diagnosis.scan.candidates if candidate.effect == "angle_eccentricity")
    print(d, diagnosis.sentence)
    assert (d > 20.0 * 2.0 / 3.0) != banded


def turned_about(vector: np.ndarray) -> np.ndarray:
    """Rotation matrices about vectors (n, 3) rad, (n, 3, 3)."""
    return Rotation.from_rotvec(vector).as_matrix()


@pytest.mark.parametrize("against", [1.0, -1.0])
def test_a_coning_axle_turns_the_frame_as_its_columns_say(against: float) -> None:
    """Rotation matrices of the whole arm, differentiated; along with the turn a cone adds constants but for the axis
    along the axle. First order in 1e-5 rad leaves 1e-5 of a column."""
    t, elevation, arm, size, phase = np.arange(0.0, 4.0, 1e-3), 0.7, 0.2, 1e-5, 0.7
    angle = 3.0 * t + 0.4 * np.sin(2.0 * t)
    up = np.array([np.sin(elevation), 0.0, np.cos(elevation)])  # the axle is x, an arm along y is level

    def reads(axis: np.ndarray, cone: float) -> np.ndarray:
        leaning = np.zeros((len(t), 3))
        leaning[:, 1] = cone * np.cos(angle + phase)
        leaning[:, 2] = -against * cone * np.sin(angle + phase)
        body = turned_about(leaning) @ turned_about(np.column_stack([angle, 0.0 * t, 0.0 * t]))
        place = body @ np.array([0.0, arm, 0.0])
        acceleration = CubicSpline(t, place)(t, 2)
        return np.einsum("ni,ni->n", body @ axis[[2, 0, 1]], acceleration + 9.80665 * up)

    for axis in (*np.eye(3)[:2], np.array([0.6, 0.0, 0.8])):
        change = ((reads(axis, size) - reads(axis, -size)) / (2.0 * size))[200:-200]
        side = {channel.name: channel.y[200:-200] for channel in on_arm(t, angle, arm, elevation, axis).further}
        column = np.cos(phase) * side[WOBBLE[0]] + np.sin(phase) * side[WOBBLE[1]]
        assert np.std(column) > 1.0
        if against > 0.0:
            np.testing.assert_allclose(change, column, atol=1e-4)
        elif not axis[2]:
            assert np.ptp(change) < 1e-4


def test_the_wobble_of_an_axle_is_estimated_and_named(tmp_path: Path) -> None:
    rig = Rigged(motion="turns", axle="vertical", wobble=1e-3, delay=0.0, seed=8)
    recording = record(rig, tmp_path)
    fit = ac.fit(recording, ac.Model.linear().add("axle_wobble"))
    for part, truth in (("sin", np.cos(0.7)), ("cos", np.sin(0.7))):
        estimate = fit[f"axle_wobble.{part}"]
        assert abs(estimate.value - rig.wobble * truth) < 4.0 * estimate.std < 0.2 * rig.wobble
    assert "axle_wobble" in ac.diagnose(ac.fit(recording), recording).sentence


def test_check_says_how_the_axis_turns_and_what_that_leaves_open(tmp_path: Path) -> None:
    level = record(Rigged(motion="steps", seconds=12.0), tmp_path)
    assert describe(level)["orientation"] == "angle"
    assert describe(level)["rest_s"] == []
    assert not [finding for finding in level.findings if finding.kind == "tie"]
    upright = summarise(record(Rigged(motion="turns", axle="vertical", seconds=12.0), tmp_path))
    assert "does not tell scale_factor from the length of the arm; turn the arm about a level axle" in upright
    assert "does not tell quadratic from arm bending" in upright


@pytest.mark.parametrize("axle", ["horizontal", "vertical"])
@pytest.mark.parametrize("axis", ["axial", "[0, 0, 1]"])
def test_an_axis_along_the_axle_reads_a_constant(tmp_path: Path, axis: str, axle: str) -> None:
    recording = record(Rigged(input_axis=axis, axle=axle, seconds=4.0), tmp_path)
    listed = {finding.channel: finding.text for finding in recording.findings if finding.kind == "tie"}
    assert set(listed) == {"scale_factor", "time_offset", "quadratic"}
    assert all("reads a constant however the arm turns" in text for text in listed.values())
    assert recording.rig.gravity == pytest.approx(9.80665 if axle == "vertical" else 0.0, abs=1e-12)
    with pytest.raises(ac.AccelcalError):
        ac.fit(recording)


def test_arms_of_different_length_are_not_fitted_together(tmp_path: Path) -> None:
    short = record(Rigged(motion="turns", axle="vertical", seconds=6.0), tmp_path, "short")
    long = record(Rigged(motion="turns", axle="vertical", arm=0.3, seconds=6.0, seed=2), tmp_path, "long")
    assert "another length" not in summarise(short)
    with pytest.raises(ac.RecordingError, match=r"arm = 200 mm, but .*arm = 300 mm; .*Fit each recording alone"):
        ac.fit([short, long])
    level = record(Rigged(motion="turns", seconds=6.0, seed=2), tmp_path, "level")
    with pytest.raises(ac.RecordingError, match=r"axle = 90 deg, but .*axle = 0 deg; .*tilt.*Fit each recording alone"):
        ac.fit([short, level])
    rig = Rigged(motion="turns", axle="vertical", seconds=6.0, seed=2, keys={"arm": '"200 mm"'})
    again = record(rig, tmp_path, "again")
    assert ac.fit([short, again]).runs[1].name == again.name


def turning_arm(rate: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and an angle, rad, of twelve seconds: there and back at a changing rate."""
    t = np.arange(0.0, 12.0, 0.005)
    return t, rate * t * (1.0 - t / 18.0) + 0.4 * np.sin(3.0 * t)


COUNT = 2.0 * np.pi / 20000
READ = {
    "whole turns": lambda y: y % (2.0 * np.pi),
    "half turns on either side": lambda y: (y + np.pi) % (2.0 * np.pi) - np.pi,
    "many turns": lambda y: y,
    "a counter that overflows": lambda y: (np.rint(y / COUNT) % 65536) * COUNT,
    "a counter little larger than a turn": lambda y: (np.rint(y / COUNT) % 20160) * COUNT,
}


@pytest.mark.parametrize("wrong", [(), ((700, 9.0), (1501, -2.2 * np.pi), (1503, 60.0))])
@pytest.mark.parametrize("name", READ)
def test_jumps_and_single_wrong_readings_are_distinguished(name: str, wrong: tuple[tuple[int, float], ...]) -> None:
    t, angle = turning_arm()
    read = READ[name](angle)
    for k, size in wrong:
        read[k] += size
    behind = unwrapped(t, read, COUNT if "counter" in name else 0.0)
    assert not len(behind.jumps)
    assert set(np.flatnonzero(~behind.valid)) <= {k for k, _ in wrong}
    right = np.setdiff1d(np.flatnonzero(behind.valid), [k for k, _ in wrong])
    off = (behind.angle - angle[behind.valid])[np.searchsorted(np.flatnonzero(behind.valid), right)]
    off -= 2.0 * np.pi * np.rint(off[0] / (2.0 * np.pi))
    assert np.max(np.abs(off)) < COUNT
    assert np.max(np.abs((behind.angle - angle[behind.valid] + np.pi) % (2.0 * np.pi) - np.pi)) < 1.0


def test_a_wrong_reading_beside_a_whole_turn_is_the_one_left_out() -> None:
    t = 0.005 * np.arange(40)
    angle = 2.0 * np.pi * (0.01 * np.arange(40) + 0.75)
    read = angle % (2.0 * np.pi)
    read[26] += 2.0 * np.pi * 2.17  # the reading before it is the first of the turn
    behind = unwrapped(t, read)
    assert np.flatnonzero(~behind.valid).tolist() == [26]
    np.testing.assert_allclose(behind.angle, angle[behind.valid], atol=1e-12)


def test_a_counter_that_runs_over_while_its_arm_is_jerked_is_exact() -> None:
    """A range that is wrong by one count is wrong by 1.3e-4 rad at every jump, and there are 27."""
    t, step = 0.005 * np.arange(1500), 2.0 * np.pi / 50000
    angle = 30.0 * t + 6.0 * np.sin(8.0 * t)
    behind = unwrapped(t, np.rint(angle / step) % 65536 * step, step)
    assert behind.modulus == pytest.approx(65536 * step, abs=1e-9)
    assert np.max(np.abs(behind.angle - angle)) < step


def test_jumps_that_nothing_explains_are_refused(tmp_path: Path) -> None:
    t, angle = turning_arm()
    slipped = angle + np.where(t > 5.0, 0.7 * 2.0 * np.pi, 0.0)
    for read in (slipped, turning_arm(900.0)[1], turning_arm(900.0)[1] % (2.0 * np.pi)):
        assert len(unwrapped(t, read).jumps)
    record(Rigged(seconds=4.0), tmp_path)
    head, *lines = (tmp_path / "arm.csv").read_text().splitlines()
    rows = [line.rsplit(",", 1) for line in lines]
    late = [f"{first},{float(y) + 250.0 * (k > 800) if y else y}" for k, (first, y) in enumerate(rows)]
    (tmp_path / "arm.csv").write_text("\n".join([head, *late]) + "\n")
    with pytest.raises(ac.RecordingError, match=r"angle: jumps .*: 1, .* by 0\.69\d+ turns; .*overflows\. Check"):
        io.load(tmp_path / "arm.csv")


def test_one_wrong_reading_leaves_the_fit_as_it_is(tmp_path: Path) -> None:
    rig = Rigged(motion="turns", wrap=True, seconds=12.0, seed=3)
    record(rig, tmp_path)
    head, *lines = (tmp_path / "arm.csv").read_text().splitlines()
    lines[2000] = lines[2000].rsplit(",", 1)[0] + ",7200"
    (tmp_path / "arm.csv").write_text("\n".join([head, *lines]) + "\n")
    recording = io.load(tmp_path / "arm.csv")
    assert [finding.count for finding in recording.findings if finding.kind == "wrong_angle"] == [1]
    assert errors(rig, ac.fit(recording))[0] < CHI2_5


def test_a_turn_across_lost_rows_is_not_called_fast(tmp_path: Path) -> None:
    record(Rigged(motion="turns", seconds=6.0, angle_std=1e-5), tmp_path)
    head, *lines = (tmp_path / "arm.csv").read_text().splitlines()
    (tmp_path / "arm.csv").write_text("\n".join([head, *lines[:900], *lines[1064:]]) + "\n")
    recording = io.load(tmp_path / "arm.csv")
    assert "gap" in {finding.kind for finding in recording.findings}
    assert "fast_angle" not in {finding.kind for finding in recording.findings}


def test_an_angle_zero_that_is_far_off_is_a_remark(tmp_path: Path) -> None:
    rig = Rigged(zero=0.05, seconds=12.0)
    fit = ac.fit([record(rig, tmp_path), record(replace(rig, seed=2), tmp_path, "second")])
    sentences = [note.sentence for note in fit.remarks if note.code == "angle_zero"]
    assert [sentence.split(":")[0] for sentence in sentences] == ["arm.csv", "second.csv"]
    assert all("level 2.8" in sentence and "degrees from" in sentence for sentence in sentences)
    mended = sidecar(rig).replace('unit = "deg"', f'unit = "deg", zero = "{-np.degrees(0.05):.6f} deg"')
    (tmp_path / "arm.toml").write_text(mended)
    fit = ac.fit(io.load(tmp_path / "arm.csv"))
    assert not [note for note in fit.remarks if note.code == "angle_zero"]
    assert errors(replace(rig, zero=0.0), fit)[0] < CHI2_5


@pytest.mark.parametrize(("axle", "expected"), [(0.0, [0.008]), (1.0, [0.008 / np.cos(1.0)]), (0.5 * np.pi, [])])
def test_an_angle_zero_is_judged_about_every_axle_but_a_vertical_one(axle: float, expected: list[float]) -> None:
    origin = Origin(scales={"angle": (-20000 / (2.0 * np.pi), "count")})
    run = SimpleNamespace(rig=ac.Rig(arm=0.2, axle=axle), recording=SimpleNamespace(title="arm", origin=origin))
    estimate = SimpleNamespace(name="axle_tilt.cos", run=None, value=0.008)
    remarks = list(far_zeros([estimate], [run]))
    assert [note.values["degrees"] for note in remarks] == pytest.approx(np.degrees(expected).tolist())
    assert [note.values["counts"] for note in remarks] == [
        f" ({-20000 * z / (2.0 * np.pi):.6g} count)" for z in expected
    ]


def test_a_zero_in_counts_is_right_with_the_counts_that_the_remark_names(tmp_path: Path) -> None:
    rig = Rigged(motion="turns", unit="count", zero=-0.03, seconds=12.0, seed=4)
    fit = ac.fit(record(rig, tmp_path))
    (counts,) = (str(note.values["counts"]) for note in fit.remarks if note.code == "angle_zero")
    zero = -float(counts.strip(" ()").removesuffix(" count"))
    assert zero == pytest.approx(0.03 * 4e6 / (2.0 * np.pi), rel=0.02)
    declared = sidecar(rig).replace('unit = "count"', f'unit = "count", zero = "{zero:.0f} count"')
    (tmp_path / "arm.toml").write_text(declared)
    assert not [note for note in ac.fit(io.load(tmp_path / "arm.csv")).remarks if note.code == "angle_zero"]


def test_priors_that_a_model_has_stay(tmp_path: Path) -> None:
    recording = record(Rigged(motion="turns", axle="vertical", seconds=4.0), tmp_path)
    declared = {name: ac.Prior(0.0, 1e-5) for name in ("lever_arm.x", "lever_arm.y", "lever_arm.z")}
    model = complete(ac.Model.linear().add("lever_arm", priors=declared), [recording])
    assert {name: model.priors[name] for name in declared} == declared
    assert set(model.priors) == {*declared, "axle_tilt.sin", "axle_tilt.cos"}
    assert "lever_arm.z" not in model.fixed
    usual = complete(ac.Model.linear(), [recording])
    assert usual.priors["lever_arm.x"] == ac.Prior(0.0, 1e-3)
    assert usual.fixed == {"lever_arm.z": 0.0}


WRONG = {
    "axle": ('axle = "horizontal"\n', "", "rig.axle: is missing beside channels.angle"),
    "axle word": ('"horizontal"', '"diagonal"', 'expected "horizontal", "vertical"'),
    "arm": ('arm = "0.2 m"\n', "", "rig.arm: is missing beside channels.angle"),
    "axis": ('input_axis = "radial"\n', "", "rig.input_axis: is missing beside channels.angle"),
    "counts": ('unit = "deg"', 'unit = "count"', 'no scale is declared .*; write.*scale = "4096 count/rev"'),
    "length": ('unit = "deg"', 'unit = "mm"', "does not measure an angle"),
    "position": ("angle =", 'position = { column = "acc", unit = "m" }\nangle =', "leave one of the two out"),
    "mount": ("[rig]\n", '[rig]\nmount = "reversed"\n', "rig.mount: beside channels.angle axle and input_axis say"),
    "no angle": ("angle =", "shaft_angle =", "rig.arm: is that of a sensor that turns by an angle"),
    "too steep": ('"horizontal"', '"120 deg"', "rig.axle: found '120 deg', expected an elevation from -90 deg to 90"),
    "axle unit": ('"horizontal"', '"-30"', 'rig.axle: "-30" has no unit'),
    "letter": ('"radial"', '"x"', "rig.input_axis: found 'x' beside channels.angle, expected .radial."),
    "zero": ('unit = "deg"', 'unit = "deg", zero = 3', "channels.angle.zero: 3 has no unit"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_declared_wrongly_is_refused_with_the_next_step(tmp_path: Path, name: str) -> None:
    old, new, message = WRONG[name]
    rig = Rigged(seconds=2.0)
    record(rig, tmp_path)
    assert sidecar(rig).count(old) == 1
    (tmp_path / "arm.toml").write_text(sidecar(rig).replace(old, new))
    with pytest.raises(ac.RecordingError, match=f"(?s){message}"):
        io.load(tmp_path / "arm.csv")


@pytest.mark.parametrize("axle", ["[0.8, 0.0, -0.6]", '"-30 deg"', '".5 rad"', '"-90 deg"', '"horizontal"'])
def test_the_elevation_of_an_axle_is_read_as_it_was_written(tmp_path: Path, axle: str) -> None:
    elevation = {"[": -np.arcsin(0.6), '"-3': -np.pi / 6.0, '".': 0.5, '"-9': -0.5 * np.pi, '"h': 0.0}
    recording = record(Rigged(seconds=2.0, keys={"axle": axle}), tmp_path)
    assert recording.rig.axle == pytest.approx(next(y for start, y in elevation.items() if axle.startswith(start)))
    io.write_sidecar(recording.rig, io.write_csv(recording, tmp_path / "part.csv"), tmp_path / "part.toml")
    assert io.load(tmp_path / "part.csv").rig.axle == pytest.approx(recording.rig.axle, abs=1e-15)


def test_a_word_for_an_axis_on_an_arm_is_none_beside_a_gyroscope(tmp_path: Path) -> None:
    rates = "".join(f'gyr_{axis} = {{ column = "angle", unit = "rad/s" }}\n' for axis in "xyz")
    head = '[channels]\ntime = { column = "t", unit = "s" }\naccel = { column = "acc", unit = "m/s^2" }\n'
    (tmp_path / "arm.toml").write_text(f'[rig]\ninput_axis = "radial"\n{head}{rates}')
    with pytest.raises(ac.RecordingError, match=r"input_axis: found 'radial' without .*, expected .x."):
        io.read_sidecar(tmp_path / "arm.toml")


def test_an_angle_that_never_changes_is_refused(tmp_path: Path) -> None:
    rig = Rigged(seconds=2.0)
    record(rig, tmp_path)
    lines = [line.rsplit(",", 1)[0] + ",12.5" for line in (tmp_path / "arm.csv").read_text().splitlines()[1:]]
    (tmp_path / "arm.csv").write_text("\n".join(["t,acc,angle", *lines]) + "\n")
    with pytest.raises(ac.RecordingError, match=r"0.218166 rad throughout; expected the angle of an arm that turns"):
        io.load(tmp_path / "arm.csv")


def test_an_arm_that_is_cut_keeps_its_priors(tmp_path: Path) -> None:
    recording = record(Rigged(axle="vertical", motion="turns", seconds=12.0), tmp_path)
    declared = io.write_csv(recording, tmp_path / "part.csv")
    io.write_sidecar(recording.rig, declared, tmp_path / "part.toml")
    again = io.load(tmp_path / "part.csv")
    assert (again.rig.arm, again.rig.arm_std, again.rig.axle) == (0.2, 1e-3, recording.rig.axle)
    first, second = ac.fit(recording), ac.fit(again)
    assert second["scale_factor"].std == pytest.approx(first["scale_factor"].std, rel=1e-3)


@pytest.mark.parametrize("axle", ["horizontal", "vertical"])
def test_a_centrifuge_of_two_loggers_is_aligned(tmp_path: Path, axle: str) -> None:
    """What the axis reads is gravity and omega² r there, hardly the path: without it nothing was alike, or was late."""
    rig = Rigged(motion="steps", axle=axle, seconds=60.0, rate=100.0, every=1)
    table, lines = columns(rig), sidecar(rig).splitlines()
    for name, column, shift in (("acc", "acc", 0.0), ("enc", "angle", 5.3)):
        text = "\n".join(f"{t:.6f},{y:.9g}" for t, y in zip(table["t"] + shift, table[column], strict=True))
        (tmp_path / f"{name}.csv").write_text(f"t,{column}\n{text}\n")
    output, stage = ("density", "arm", "axle", "input", "angle"), ("accel",)
    for name, channel in (("acc", output), ("enc", stage)):
        rest = [line for line in lines if not line.startswith(channel)]
        (tmp_path / f"{name}.toml").write_text("\n".join(rest))
    recording = ac.load(tmp_path / "acc.csv", position=tmp_path / "enc.csv")
    (note,) = [finding for finding in recording.findings if finding.kind == "alignment"]
    assert note.severity == "note"
    fit = ac.fit(recording)
    assert abs(fit["bias"].value - rig.bias) < 4.0 * fit["bias"].std
    delay = fit["time_offset"]
    assert abs(recording.accel.t[0] - 5.3 - delay.value + rig.delay) < 4.0 * delay.std


def test_a_quadratic_of_a_centrifuge_is_no_missed_count(tmp_path: Path) -> None:
    """The path of a radial axis is an integral: nothing in it can jump, whatever the model leaves."""
    t, speeds = np.arange(0.0, 60.0, 1 / 400), [1, 2, 3, 4, 5, 6, 7, 8, 7, 5, 3, 0.5]
    noise = np.random.default_rng(9).standard_normal((2, len(t)))
    rises = [((t - 5.0 * n - 1.0) / 0.3, 0.5 * size) for n, size in enumerate(np.diff(speeds, prepend=0.0))]
    a = -0.2 * sum(size * (1.0 + np.tanh(x - 0.002 / 0.3)) for x, size in rises) ** 2
    angle = sum(size * (t + 0.3 * np.log(np.cosh(x))) for x, size in rises) + 1e-5 * noise[1]
    y = 0.05 + 1.01 * a + 1e-3 * a**2 + 0.01 * noise[0]
    np.savez(tmp_path / "arm.npz", t=t, acc=y, t_angle=t[::2], angle=angle[::2])
    text = sidecar(Rigged(axle="vertical", density=7e-4, unit="rad"))
    text = text.replace('unit = "rad"', 'unit = "rad", time = { column = "t_angle", unit = "s" }')
    (tmp_path / "arm.toml").write_text(text)
    assert not [note for note in ac.fit(io.load(tmp_path / "arm.npz")).remarks if note.code == "position_step"]
