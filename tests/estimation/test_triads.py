"""Three outputs of one sensor in one fit, on records of an independent simulator."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import scipy
import yaml
from scipy.spatial.transform import Rotation

import accelcal as ac
from accelcal import io
from accelcal.calibration.export import PARAMETERS, NotExportable, SensorMatrix, c_files, rust_module
from accelcal.data import GRAVITY, GRAVITY_NOISE, Recording, RecordingError, orientation
from accelcal.data.orientation import Strapdown, carried, smoothed_random_process, turning
from accelcal.diagnosis import clean_fit
from accelcal.diagnosis.faults import examine
from accelcal.diagnosis.verdict import AxesDiagnosis
from accelcal.estimation import estimate, noise
from accelcal.estimation.gauss_newton import Layout, Output, initial_states, iterate, outputs_of, solve
from accelcal.estimation.remarks import remark
from accelcal.estimation.rows import normal_equations
from accelcal.estimation.run import prepare
from accelcal.io import orientation as orientation_of_files
from accelcal.results.json import from_json
from accelcal.validation.evaluation import accel_residual
from accelcal.validation.prediction import Prediction
from accelcal.verbs import require_relation
from tests.estimation.triads import G, Triad

CUBIC = 3e-5
"""(m/s²)⁻², about 20 standard deviations on these records."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("triads")


@pytest.fixture(scope="module")
def curved(folder: Path) -> tuple[Triad, tuple[Recording, ...], ac.Fit]:
    """A record whose y output has a cubic, and its linear fit."""
    triad = Triad(71, law=lambda t, f, warm: CUBIC * f**3, hidden=1)
    axes = ac.load_axes(triad.write(folder))
    return triad, axes, ac.fit(axes)


def nees(fit: ac.Fit, truth: dict[tuple[str, str], float]) -> float:
    errors = np.array([e.value - truth[e.name, e.axis] for e in fit.free])
    return float(errors @ np.linalg.solve(fit.covariance, errors))


def test_parameters_of_all_axes_are_as_right_as_they_say(folder):
    # False alarms: once in 1000 of 24 degrees of freedom; the twin has one lever arm off by six standard deviations.
    triad = Triad(72)
    fit = ac.fit(ac.load_axes(triad.write(folder)))
    truth, most = triad.true_values(), scipy.stats.chi2.ppf(0.999, 24)
    assert len(fit.free) == 24
    assert fit.axes == ("x", "y", "z")
    assert nees(fit, truth) < most
    std = next(e.std for e in fit.free if (e.name, e.axis) == ("lever_arm.y", "x"))
    assert nees(fit, truth | {("lever_arm.y", "x"): truth["lever_arm.y", "x"] + 6.0 * std}) > most


def test_a_cubic_on_y_is_named_on_y_and_its_size_is_right(curved):
    triad, axes, fit = curved
    judged = ac.diagnose(fit, axes)
    assert judged.verdict in ("named", "tied")
    assert "cubic" in judged["y"].effects
    assert [judged[axis].verdict for axis in "xz"] == ["adequate", "adequate"]
    assert "cubic_on_y" in judged.effects
    better = ac.add(fit, axes, "cubic_on_y")
    e = better["cubic_on_y"]
    assert abs(e.value - CUBIC) < 4.5 * e.std
    assert e.axis == ""
    assert "cubic" in better.of_axis("y").model.effects
    assert "cubic_on_y" not in better.of_axis("x").model.effects
    assert nees(better, triad.true_values() | {("cubic_on_y", ""): CUBIC}) < scipy.stats.chi2.ppf(0.999, 25)
    assert better.runs[1].noise.all.density < 0.8 * fit.runs[1].noise.all.density
    assert [row["axis"] for row in judged.table().rows] == ["x", "y", "z"]


def test_a_cubic_is_that_of_the_force_at_the_sensor_and_not_at_the_tracked_point(tmp_path):
    """The estimate was off by 4 %, 6.6 standard deviations. False alarm: 1e-5."""
    triad = Triad(72, seconds=40.0, law=lambda t, f, warm: 3e-4 * f**3, hidden=1)
    triad.truth["lever"][1] = 0.03, -0.05, 0.04
    y = ac.load(triad.write(tmp_path), axis="y")
    fit = ac.fit(y, model=ac.Model.linear().add("cubic"))
    assert abs(fit["cubic"].value - 3e-4) < 4.5 * fit["cubic"].std
    ahead = Prediction.of(fit, y)  # a comparison shows its residual over the same force
    t, _, motion = accel_residual(ahead, 4.0)
    force = triad.force(t, triad.truth["lever"][1])[:, 1]
    assert np.std(motion.a - force) < 0.3 * np.std(triad.force(t, np.zeros(3))[:, 1] - force)


@pytest.mark.parametrize("noise", [1e-3, 2e-4])
@pytest.mark.parametrize("about", [(0.0, 0.0, 1.0), (0.0, 0.6, 0.8)])
def test_noise_of_the_attitude_is_no_turning_that_shows_a_lever_arm(tmp_path, noise, about):
    """The lever arm along the only axis of turning was wrong by up to 9 standard deviations. False alarm: 1e-5 each."""
    for seed in (81, 82):
        triad = Triad(seed, seconds=20.0, noise=1e-3, attitude_noise=noise)
        frequencies, sizes, phases = triad.waves[5]
        triad.waves[3:] = [(frequencies, 3.0 * part * sizes, phases) for part in about]
        x = ac.load(triad.write(tmp_path), axis="x")
        fit, truth = ac.fit(x), triad.truth["lever"][0]
        rows = [[e.name for e in fit.free].index(f"lever_arm.{part}") for part in "xyz"]
        error = np.array([fit.free[k].value for k in rows]) - truth
        for v in (about, (1.0, 0.0, 0.0), np.cross(about, (1.0, 0.0, 0.0))):
            std = float(np.sqrt(v @ fit.covariance[np.ix_(rows, rows)] @ v))
            assert abs(error @ v) < 4.5 * std
            assert (std > 0.1) == (v is about)
        assert [f for f in x.findings if f.channel == "lever_arm.z" and "turn faster, about an axis across" in f.text]


def test_a_body_that_turns_about_all_axes_keeps_its_levers():
    triad, rng = Triad(81, turning=0.3), np.random.default_rng(81)
    t = np.arange(0.0, 30.0, 0.01)
    place, attitude = triad.series(t)
    noisy = attitude * Rotation.from_rotvec(1e-3 * rng.standard_normal(place.shape))
    axis = np.array([0.0, 0.0, 1.0])
    levers, exact = (
        np.array([c.y for c in turning(t, place, (t, q.as_quat(scalar_first=True)), axis, "sensor to ENU").levers])
        for q in (noisy, attitude)
    )
    assert np.all(np.std(levers - exact, axis=1) < 0.1 * np.std(exact, axis=1))


def test_what_is_no_sensor_is_said_before_the_numbers(curved):
    """Three axes have a note on their noise each, behind which it was among the further ones."""
    _, _, fit = curved
    notes = [remark("measured_spectrum", recording=name) for name in "xyz"]
    wrong = remark("implausible_scale", scale=0.44, cause="the orientation?")
    shown = replace(fit, remarks=(*notes, wrong)).table()
    assert [text for text in shown.alarms if text.startswith("1 + k = 0.44 is implausible")]
    assert not [text for text in (*shown.notes, *shown.detail) if "implausible" in text]


def test_the_fit_of_one_axis_is_the_same_numbers(curved):
    _, _axes, fit = curved
    alone = fit.of_axis("z")
    wanted = {e.name: (e.value, e.std) for e in fit.estimates if e.axis in ("", "z")}
    assert {e.name: (e.value, e.std) for e in alone.estimates} == wanted
    assert np.allclose(np.sqrt(np.diag(alone.covariance)), [e.std for e in alone.free], rtol=1e-12)
    assert alone.of_axis("z") is alone
    assert not alone.axes
    assert fit.values(2).by_name == alone.values().by_name
    assert fit.values(2).by_name != fit.values(1).by_name


def test_a_model_file_keeps_axes(curved, tmp_path):
    _, _, fit = curved
    fit.save(tmp_path / "m.json")
    again = ac.load_model(tmp_path / "m.json")
    assert again.estimates == fit.estimates
    assert again.axes == fit.axes
    text = (tmp_path / "m.json").read_text().replace('"axis": "x"', '"axis": "y"', 1)
    (tmp_path / "wrong.json").write_text(text)
    with pytest.raises(ac.AccelcalError, match="once for all runs, or once for each"):
        ac.load_model(tmp_path / "wrong.json")


def test_the_joint_solution_is_that_of_the_stacked_rows(curved):
    # One step of the joint solve against one least-squares problem of all rows, written out: to 1e-9.
    _, axes, fit = curved
    states = initial_states(fit.model, [prepare(run) for run in axes], [None] * 3)
    layout = Layout.of(fit.model, outputs_of(axes))
    belief, at = layout.prior_information(fit.model), layout.gather([state.values for state in states])
    left = layout.prior_mean(fit.model) - at
    information, score = np.diag(belief), belief * left
    blocks, right = [np.diag(np.sqrt(belief))], [np.sqrt(belief) * left]
    names = [(term.name, layout.whose(runs)[1]) for term, runs in layout.slots]
    for index, (state, run) in enumerate(zip(states, axes, strict=True)):
        normal = normal_equations(state, fit.model.free)
        rows = layout.rows(index)
        information[np.ix_(rows, rows)] += normal.gram
        score[rows] += normal.score
        values, vectors = np.linalg.eigh(normal.gram)
        root = np.sqrt(np.maximum(values, 1e-300))[:, None] * vectors.T  # root' root = gram
        block = np.zeros((len(root), len(names)))
        for k, term in enumerate(fit.model.free):
            block[:, names.index((term.name, run.axis if (term.name, run.axis) in names else ""))] = root[:, k]
        blocks.append(block)
        right.append(np.linalg.lstsq(root.T, normal.score, rcond=None)[0])
    step, covariance = solve(information, score, layout)
    stacked, y = np.vstack(blocks), np.concatenate(right)
    size = np.linalg.norm(stacked, axis=0)
    expected = np.linalg.lstsq(stacked / size, y, rcond=None)[0] / size
    assert np.max(np.abs(step - expected) / np.sqrt(np.diag(covariance))) < 1e-9 * max(
        1.0, float(np.max(np.abs(expected) / np.sqrt(np.diag(covariance))))
    )


def test_two_recordings_of_three_axes_share_the_sensor_and_not_the_delay(folder):
    # False alarms: once in 1000 of 25 degrees of freedom; the twin takes the delay of one recording for both.
    motions = [Triad(78, seconds=30.0, motion=number) for number in (1, 2)]
    runs = [ac.load_axes(triad.write(folder)) for triad in motions]
    fit = ac.fit([axis for pair in zip(*runs, strict=True) for axis in pair])
    delays = [e for e in fit.estimates if e.name == "time_offset"]
    assert [e.run for e in delays] == [0, 1]
    assert len([e for e in fit.estimates if e.name == "scale_factor"]) == 3
    truth, most = motions[0].true_values(), scipy.stats.chi2.ppf(0.999, len(fit.free))
    assert nees(fit, truth) < most
    assert nees(fit, truth | {("time_offset", ""): truth["time_offset", ""] + 8.0 * delays[0].std}) > most
    assert fit.of_axis("y").runs[1].name == fit.runs[3].name
    assert fit.values(3).by_name["bias"] == fit.of_axis("y").values(1).by_name["bias"]
    with pytest.raises(ac.AccelcalError, match="no such coefficient for three outputs"):
        ac.fit([*runs[0], *runs[1]], ac.Model.linear().vary("scale_factor"))


class Named(NamedTuple):
    name: str
    axis: str
    digest: str = ""
    session: str = ""


def test_rows_of_the_joint_solve_belong_to_axes_and_recordings():
    outputs = outputs_of([Named("a.csv x", "x"), Named("a.csv y", "y"), Named("b.csv x", "x"), Named("b.csv y", "y")])
    assert outputs == (Output(0, "x"), Output(0, "y"), Output(1, "x"), Output(1, "y"))
    layout = Layout.of(ac.Model.linear(), outputs)
    assert [(term.name, runs) for term, runs in layout.slots] == [
        ("bias", (0, 2)),
        ("bias", (1, 3)),
        ("scale_factor", (0, 2)),
        ("scale_factor", (1, 3)),
        ("time_offset", (0, 1)),
        ("time_offset", (2, 3)),
    ]
    assert [layout.whose(runs) for _, runs in layout.slots][3:5] == [(None, "y"), (0, "")]
    assert outputs_of([Named("a.csv", ""), Named("a.csv", "")]) == (Output(0), Output(1))
    elsewhere = [Named("run.csv x", "x", "1"), Named("run.csv y", "y", "2")]  # of two folders
    assert outputs_of(elsewhere) == (Output(0, "x"), Output(1, "y"))


def test_the_command_line_takes_three_outputs(curved, folder, tmp_path):
    path = folder / "triad_71.csv"

    def run(*arguments: object, code: int = 0) -> str:
        command = [sys.executable, "-m", "accelcal", *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
        assert done.returncode == code, done.stderr
        return done.stdout + done.stderr

    assert "scale_factor [y]" in run("fit", path, "-o", "m.json")
    assert f"{path.name} z" in run("check", path)
    for style, word in (("kalibr", "T_i_b"), ("ros", "SM:"), ("imu_tk", "0")):
        assert "M along x" in run("export", "m.json", "--parameters", f"{style}.txt", "--style", style)
        assert word in (tmp_path / f"{style}.txt").read_text()
    matrix = from_json(SensorMatrix, run("export", "m.json", "--json"))
    assert np.allclose(matrix.M, SensorMatrix.of(curved[2]).M, rtol=1e-9)
    assert "expected one" in run("export", "m.json", "--filter", "c", "--rate", "200", code=2)
    assert "add --effect" in run("improve", path, code=3)
    judged = from_json(AxesDiagnosis, run("diagnose", "m.json", path, "--json"))
    assert judged.axes == ("x", "y", "z")
    assert "cubic_on_y" in judged.effects


SIDECAR_ERRORS = {
    'accel_y = { column = "accel_y", unit = "m/s^2" }\n': ("", "channels.accel_y"),
    "[channels]\n": (
        '[channels]\naccel = { column = "accel_x", unit = "m/s^2" }\n',
        "channels.accel beside .* is one too many",
    ),
}


@pytest.mark.parametrize("result", SIDECAR_ERRORS)
def test_a_sidecar_of_three_outputs_that_is_wrong_gets_a_sentence(folder, result):
    path = Triad(73, seconds=2.0).write(folder)
    instead, sentence = SIDECAR_ERRORS[result]
    path.with_suffix(".toml").write_text(path.with_suffix(".toml").read_text().replace(result, instead, 1))
    with pytest.raises(RecordingError, match=sentence):
        ac.load_axes(path)


def test_one_output_is_asked_for_by_its_axis(folder):
    path = Triad(74, seconds=4.0).write(folder)
    with pytest.raises(RecordingError, match="load_axes reads all three"):
        ac.load(path)
    assert ac.load(path, axis="y").name == f"{path.name} y"
    assert [run.axis for run in io.load_declared(path)] == ["x", "y", "z"]  # type: ignore[union-attr]


GYROSCOPE_MATRIX = np.eye(3) + np.random.default_rng(5).normal(0.0, 0.01, (3, 3))
GYROSCOPE_BIAS = np.array([0.02, -0.01, 0.015])


def carried_by(noise: float, gap: tuple[float, float]) -> tuple[Strapdown, np.ndarray, Triad]:
    """A strapdown by a gyroscope with a noise of a sample, rad/s, its errors, (n, 3) rad, and the truth."""
    triad, rng = Triad(73, attitude_noise=1e-3), np.random.default_rng(73)
    t, stamps = np.arange(0.0, 40.0, 0.005), np.arange(0.0, 40.0, 0.05)
    late, h = t - triad.truth["delay"], 1e-4
    rates = (triad.series(late - h)[1].inv() * triad.series(late + h)[1]).as_rotvec() / (2.0 * h)
    rates = rates @ GYROSCOPE_MATRIX + GYROSCOPE_BIAS + noise * rng.standard_normal(rates.shape)
    readings = triad.series(stamps)[1] * Rotation.from_rotvec(1e-3 * rng.standard_normal((len(stamps), 3)))
    outside = (stamps <= gap[0]) | (stamps >= gap[1])
    body = carried((stamps[outside], readings[outside]), (t, rates), 1e-3)
    return body, (triad.series(body.t)[1].inv() * body.attitude).as_rotvec(), triad


def test_a_gyroscope_carries_an_attitude_across_a_gap_and_below_its_noise():
    # In the middle of 6 s a walk is noise sqrt(h 6 s/4), 0.09 mrad; the ends are known to 0.35 mrad. The twin: 1.7.
    body, errors, triad = carried_by(1e-3, (15.0, 21.0))
    twin, of_twin, _ = carried_by(2e-2, (15.0, 21.0))
    within_gap = (body.t > 15.0) & (body.t < 21.0)
    most = 5.0 * np.hypot(0.09e-3, 0.35e-3)
    assert np.max(np.abs(errors[within_gap])) < most < np.max(np.abs(of_twin[(twin.t > 15.0) & (twin.t < 21.0)]))
    assert np.sqrt(np.mean(errors[~within_gap] ** 2)) < 2e-4  # of 1e-3 that a reading has
    assert body.bias == pytest.approx(GYROSCOPE_BIAS, abs=2e-4)
    assert body.matrix == pytest.approx(np.linalg.inv(GYROSCOPE_MATRIX.T), abs=1e-3)
    assert body.delay == pytest.approx(float(triad.truth["delay"]), abs=1e-4)
    assert 0.8 < body.disagreement < 1.2


@pytest.mark.parametrize("noise", [1e-3, 1e-2, 0.3])
def test_the_density_of_a_carried_attitude_is_that_of_its_errors(noise):
    # Over 40 s the mean power below 0.25 Hz has some 60 degrees of freedom: a factor of 2 is four standard deviations.
    body, errors, _ = carried_by(noise, (50.0, 50.0))
    f, power = scipy.signal.welch(errors, 200.0, nperseg=4096, axis=0)
    low = 0.5 * np.mean(power[(f > 0.0) & (f < 0.25)])
    assert low < 2.0 * np.median(body.noise)
    assert np.median(body.noise) < (3.0 if noise < 0.1 else 30.0) * 1e-6 * 0.05
    assert np.max(0.5 * np.mean(power[f > 10.0], axis=1)) < np.median(body.noise)


def test_a_smoothed_process_is_that_of_the_recursions():
    # Rauch, Tung and Striebel, forwards and back, with a variance of a reading of 1 and a beginning that is not known.
    rng, ratio = np.random.default_rng(8), 0.7
    t = np.cumsum(rng.uniform(0.1, 2.0, 40))
    y = np.cumsum(rng.normal(size=40)) + rng.normal(size=40)
    at, variance = [y[0]], [1.0]
    for step, reading in zip(np.diff(t) / ratio, y[1:], strict=True):
        gain = (variance[-1] + step) / (variance[-1] + step + 1.0)
        at.append(at[-1] + gain * (reading - at[-1]))
        variance.append(gain)
    path = at[-1:]
    for x, P, step in zip(at[-2::-1], variance[-2::-1], np.diff(t)[::-1] / ratio, strict=True):
        path.append(x + P / (P + step) * (path[-1] - x))
    assert smoothed_random_process(t, y[:, None], ratio)[:, 0] == pytest.approx(path[::-1], abs=1e-12)


MUTATED = {
    "in deg/s": (lambda g: np.degrees(g), "turn otherwise than the attitude"),
    "of another body": (lambda g: g[::-1], "turn otherwise than the attitude"),
    "at rest": (lambda g: 0.0 * g, "turn otherwise than the attitude"),
    "of five seconds": (lambda g: np.where(np.arange(len(g))[:, None] < 900, g, np.nan), "expected 32 over 5 s"),
    "in turn": (lambda g: np.where(np.arange(len(g))[:, None] % 3 == np.arange(3), g, np.nan), "share 0 instants"),
    "with a hole": (lambda g: np.where(abs(np.arange(len(g)) - 2000)[:, None] < 50, np.nan, g), "1 holes, the first"),
}


@pytest.fixture(scope="module")
def with_gyroscope(tmp_path_factory) -> tuple[Path, Triad]:
    triad = Triad(74, seconds=30.0, attitude_noise=1e-3, gyroscope=1e-3)
    return triad.write(tmp_path_factory.mktemp("gyroscope")), triad


def with_rates(path: Path, to: Path, change) -> Path:
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    table[:, -3:] = change(table[:, -3:])
    rows = (",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in table.tolist())
    to.write_text("\n".join([path.read_text().splitlines()[0], *rows]) + "\n")
    to.with_suffix(".toml").write_text(path.with_suffix(".toml").read_text())
    return to


@pytest.mark.parametrize(("change", "sentence"), MUTATED.values(), ids=MUTATED)
def test_a_gyroscope_that_is_not_that_of_the_body_is_refused(with_gyroscope, tmp_path, change, sentence):
    with pytest.raises(RecordingError, match=sentence):
        io.load(with_rates(with_gyroscope[0], tmp_path / "run.csv", change), axis="x")


def test_a_gyroscope_with_other_axes_is_allowed_for_and_said(with_gyroscope, tmp_path):
    plain = io.load(with_gyroscope[0], axis="x")
    swapped = io.load(with_rates(with_gyroscope[0], tmp_path / "run.csv", lambda g: g[:, [1, 2, 0]]), axis="x")
    messages = [finding.text for finding in swapped.findings if finding.kind == "carried"]
    assert ["its axes are not those of the attitude" in text for text in messages] == [True]
    assert swapped.side[GRAVITY].y == pytest.approx(plain.side[GRAVITY].y, abs=2e-3)


def test_a_gyroscope_of_a_part_leaves_the_rest_out_and_says_so(with_gyroscope, tmp_path):
    part = with_rates(
        with_gyroscope[0], tmp_path / "run.csv", lambda g: np.where(np.arange(len(g))[:, None] < 3000, g, np.nan)
    )
    recording = io.load(part, axis="x")
    assert 14.0 < recording.position.t[-1] < 15.0
    assert any("beyond it are left out" in finding.text for finding in recording.findings)


def test_noise_of_the_attitude_is_in_the_model_and_a_gyroscope_lowers_what_the_lever_arm_meets(folder, monkeypatch):
    # The output is declared right, 0.00098: what is fitted beside noise of the attitude is that, and without it more.
    noisy = Triad(74, attitude_noise=1e-3)
    noisy.truth["lever"] *= 0.0
    level = io.load_axes(noisy.write(folder))[0]
    density = level.side[GRAVITY_NOISE].y
    across = 1.0 - (level.side[GRAVITY].y / G) ** 2
    most = across > 0.9
    assert np.median(density[most]) == pytest.approx(1e-6 * G**2 / noisy.rate * np.median(across[most]), rel=0.1)
    without = replace(level, side={name: c for name, c in level.side.items() if name != GRAVITY_NOISE})
    fitted = [ac.fit(recording).runs[0].noise.all.density for recording in (level, without)]
    assert fitted[0] == pytest.approx(noisy.noise, rel=0.25)
    assert fitted[1] > 1.3 * noisy.noise
    # Carried by a gyroscope it falls with frequency. Its density at rest, in the model, would take all of the output's.
    carrier = io.load_axes(Triad(74, attitude_noise=1e-3, gyroscope=1e-3, every=2).write(folder))[0]
    assert ac.fit(carrier).runs[0].noise.all.density == pytest.approx(noisy.noise, rel=0.25)
    monkeypatch.setattr(noise, "least_density", lambda run: 0.0)
    assert ac.fit(carrier).runs[0].noise.all.density < 0.25 * noisy.noise
    far = [Triad(75, attitude_noise=1e-3, gyroscope=gyroscope) for gyroscope in (None, 1e-3)]
    for triad in far:
        triad.truth["lever"] = np.full((3, 3), 0.05)
    at_arm = [ac.fit(io.load(triad.write(folder), axis="x")).runs[0].noise.all.density for triad in far]
    assert at_arm[1] < 1.5 * noisy.noise < 0.7 * at_arm[0]


def test_an_attitude_slower_than_the_place_tells_its_turning(folder):
    """Of a 50 Hz attitude beside a 200 Hz place: the lever columns are those of the truth to 2 % of their size."""
    t = np.arange(0.0, 20.0, 0.005)
    triad, rng = Triad(78), np.random.default_rng(78)
    place, attitude = triad.series(t)
    readings = triad.series(t[::4])[1] * Rotation.from_rotvec(3e-4 * rng.standard_normal((len(t[::4]), 3)))
    x = np.array([1.0, 0.0, 0.0])
    motion = turning(t, place, (t[::4], readings.as_quat(scalar_first=True)), x, "sensor to ENU")
    true = turning(t, place, (t, attitude.as_quat(scalar_first=True)), x, "sensor to ENU")
    inside = (motion.levers[1].t > 1.0) & (motion.levers[1].t < 19.0)
    errors = (motion.levers[1].y - np.interp(motion.levers[1].t, t, true.levers[1].y))[inside]
    assert np.std(errors) < 0.1 * np.std(true.levers[1].y)


def test_a_band_that_is_known_is_not_sought_again_and_changes_no_estimate(folder, monkeypatch):
    """The output y needs a band, x has an outlier: without it all three are fitted in bands once, to the same."""
    x, y, z = ac.load_axes(Triad(81, seconds=30.0, place_noise=1e-3).write(folder))
    spiked = x.accel.y.copy()
    spiked[3000] += 0.5
    axes = [replace(x, accel=replace(x.accel, y=spiked)), y, z]
    bands = list[Sequence[float | None]]()

    def counted(model, runs, asked, *rest):
        bands.append(asked)
        return iterate(model, runs, asked, *rest)

    monkeypatch.setattr(estimate, "iterate", counted)
    monkeypatch.setattr(estimate, "needs_band", lambda state: state.run.recording.axis == "y")
    fits = [ac.fit(axes)]
    first, second, *others = bands
    assert first == [None] * 3
    assert second[1] is not None
    assert others
    assert others == [second] * len(others)
    monkeypatch.setattr(clean_fit, "in_its_band", lambda run, *_: run)
    fits.append(ac.fit(axes))
    assert len(bands) == 4 + 3 * len(others)
    apart = [(e.value - f.value) / f.std for e, f in zip(*(fit.free for fit in fits), strict=True)]
    assert np.max(np.abs(apart)) < 1e-9
    assert any(note.code == "outliers_rejected" for note in fits[0].remarks)


def test_three_outputs_are_read_as_each_alone_and_their_body_is_solved_for_once(with_gyroscope, monkeypatch):
    alone = [io.load(with_gyroscope[0], axis=axis) for axis in "xyz"]
    calls = list[str]()

    def counted(function):
        return lambda *given: [calls.append(function.__name__), function(*given)][1]

    monkeypatch.setattr(orientation_of_files, "carried", counted(orientation_of_files.carried))
    monkeypatch.setattr(orientation, "moving", counted(orientation.moving))
    for run, other in zip(ac.load_axes(with_gyroscope[0]), alone, strict=True):
        assert run.side.keys() == other.side.keys()
        assert np.array_equal(run.position.y, other.position.y)
        assert all(np.array_equal(run.side[name].y, other.side[name].y) for name in run.side)
        assert run.findings == other.findings
    assert calls == ["carried", "moving"]


def left_open(triad: Triad, folder: Path, held: tuple[int, ...] = ()) -> set[tuple[str, str]]:
    for number in held:
        triad.waves[number] = (triad.waves[number][0], 0.0 * triad.waves[number][1], triad.waves[number][2])
    axes = ac.load_axes(triad.write(folder))
    return {(run.axis, finding.channel) for run in axes for finding in run.findings if finding.kind == "tie"}


def test_what_the_turning_leaves_open_is_said_before_the_fit(folder):
    assert not left_open(Triad(76), folder)
    about_up = left_open(Triad(75, seconds=20.0), folder, (3, 4))
    assert {(axis, "lever_arm.z") for axis in "xyz"} <= about_up
    assert not {name for _, name in about_up} & {"bias", "scale_factor", "time_offset"}
    still = {name for _, name in left_open(Triad(77, seconds=20.0), folder, (3, 4, 5))}
    assert {"bias", "the tilt of the reference", "lever_arm.x", "lever_arm.y", "lever_arm.z"} <= still


def test_the_matrix_is_that_of_the_truth_and_every_format_says_the_same(curved):
    triad, axes, fit = curved
    better = ac.add(fit, axes, "cubic_on_y")
    m = SensorMatrix.of(better)
    assert np.all(np.abs(m.M - triad.truth["matrix"]) < 5.0 * m.M_std)
    (S, R), (L, Q) = m.upper, m.lower
    for left, right in ((S, R), (L, Q)):
        assert np.allclose(left @ right, m.M, atol=1e-14)
        assert np.allclose(right @ right.T, np.eye(3), atol=1e-14)
    assert np.allclose(np.tril(S, -1), 0.0, atol=1e-15)
    assert np.allclose(np.triu(L, 1), 0.0, atol=1e-15)
    f = np.array([[1.0, 2.0, 9.5], [0.0, -9.8, 0.4]])
    y = m.bias + f @ m.M.T
    assert np.allclose(m.correct(y), f, atol=1e-12)
    of_kalibr = yaml.safe_load(PARAMETERS["kalibr"](m))["imu0"]
    C = np.array(of_kalibr["T_i_b"])[:3, :3]
    assert np.allclose(f @ C.T @ np.array(of_kalibr["accelerometers"]["M"]).T + m.bias, y, atol=1e-7)
    assert np.array(of_kalibr["T_i_b"])[:3, 3] == pytest.approx(-C @ m.lever[0])  # the tracked point from the x element
    assert np.array(of_kalibr["accelerometers"]["ry_i"]) == pytest.approx(C @ (m.lever[1] - m.lever[0]), abs=1e-8)
    assert of_kalibr["time_offset"] == pytest.approx(-m.delay)
    of_ros = yaml.safe_load(PARAMETERS["ros"](m))
    assert np.allclose(y @ np.reshape(of_ros["SM"], (3, 3)).T - of_ros["bias"], f, atol=1e-7)
    T, K, b = (np.loadtxt(part.splitlines(), ndmin=2) for part in PARAMETERS["imu_tk"](m).strip().split("\n\n"))
    assert np.allclose(np.linalg.norm((y - b.ravel()) @ (T @ K).T, axis=1), np.linalg.norm(f, axis=1), atol=1e-6)
    with pytest.raises(NotExportable, match="needs all three"):
        SensorMatrix.of(better.of_axis("x"))


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_and_rust_of_three_outputs_undo_the_sensor(curved, tmp_path):
    _, axes, fit = curved
    better = ac.add(fit, axes, "cubic_on_y")
    m, cubic = SensorMatrix.of(better), better["cubic_on_y"].value
    random = np.random.default_rng(1)
    f = random.uniform(-9.0, 9.0, (200, 3))
    y = m.bias + f @ m.M.T
    y[:, 1] += cubic * f[:, 1] ** 3
    for name, text in c_files(better, "imu.h").items():
        (tmp_path / name).write_text(text)
    (tmp_path / "main.c").write_text(
        '#include "imu.h"\n#include <stdio.h>\nint main(void) { double y[3], f[3];\n'
        'while (scanf("%lf %lf %lf", y, y + 1, y + 2) == 3) { unsigned o = imu_specific_force(y, f);\n'
        'printf("%.17g %.17g %.17g %u\\n", f[0], f[1], f[2], o); } return 0; }\n'
    )
    subprocess.run(["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "main.c", "-o", "main"], cwd=tmp_path, check=True)
    text = "\n".join(" ".join(map(repr, row)) for row in y.tolist())
    out = subprocess.run([tmp_path / "main"], input=text, capture_output=True, text=True, check=True).stdout
    back = np.loadtxt(out.splitlines())
    assert np.max(np.abs(back[:, :3] - f)) < 1e-9
    assert np.max(np.abs(m.correct(y) - f)) > 1e-3  # the twin: without the cubic
    if shutil.which("rustc") is not None:
        (tmp_path / "imu.rs").write_text(rust_module(better))
        subprocess.run(["rustc", "--crate-type", "lib", "-D", "warnings", "imu.rs"], cwd=tmp_path, check=True)


def test_an_attitude_that_maps_the_other_way_round_is_named(tmp_path):
    path = Triad(79, seconds=20.0, rate=100.0, turning=0.3).write(tmp_path)
    sidecar = path.with_suffix(".toml")
    require_relation([examine(axis) for axis in ac.load_axes(path)])  # the twin: as it is recorded
    sidecar.write_text(sidecar.read_text().replace("sensor to ENU", "ENU to sensor"))
    with pytest.raises(ac.AccelcalError, match='maps = "sensor to ENU" and maps = "ENU to sensor"') as caught:
        ac.fit(ac.load_axes(path))
    assert "mount =" not in str(caught.value)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_a_gap_of_all_columns_is_no_other_scale_and_hides_none(tmp_path, factor):
    # Twin: an output that is doubled behind the gap still is one of another scale.
    path = Triad(201, motion=1).write(tmp_path)
    names, *rows = path.read_text().splitlines()
    outside = [[float(cell) for cell in row.split(",")] for row in rows if not 20.0 < float(row.split(",")[0]) < 30.0]
    for row in outside:
        row[2] *= factor if row[0] > 45.0 else 1.0
    np.savetxt(path, outside, fmt="%.9g", delimiter=",", header=names, comments="")
    codes = {axis.axis: [note.code for note in examine(axis).remarks()] for axis in ac.load_axes(path)}
    assert ("other_scale" in codes["y"]) == (factor != 1.0)
    assert "other_scale" not in codes["x"] + codes["z"]
