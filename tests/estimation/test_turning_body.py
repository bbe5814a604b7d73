"""A sensor on a body that turns, from a small simulator of its own: closed forms of place and attitude, no formula of
the product."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal import io
from accelcal.data.orientation import GRAVITY, LEVERS, TURNED, path_along
from accelcal.data.quality import summarise
from accelcal.data.recording import Channel
from accelcal.diagnosis.checks import slow_residual
from accelcal.diagnosis.faults import RelationColumns
from accelcal.estimation.estimate import estimate, tied_sum
from accelcal.estimation.run import prepare
from accelcal.filters.choice import FilterChoice
from accelcal.model import Model
from accelcal.simulation import CXL02_RIG

G = 9.80665
K, BIAS = 0.013, 0.21
RATE, SECONDS = 250.0, 24.0


@dataclass
class World:
    """What a body did, (n, 3) or (n,) at `t`."""

    t: np.ndarray
    p: np.ndarray
    a: np.ndarray
    R: np.ndarray
    """(n, 3, 3), from axes of the sensor to east, north, up."""
    omega: np.ndarray
    """About the axes of the sensor, rad/s."""


def world(seed: int = 1, degrees: float = 8.0, still: bool = False, seconds: float = SECONDS) -> World:
    """Sums of sines along three directions, and roll, pitch and yaw as sums of slow ones."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, seconds, 1.0 / RATE)
    p, a = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    for axis in range(3):
        for f in (0.31, 0.83, 1.9, 3.7):
            w, phase = 2.0 * np.pi * f * rng.uniform(0.8, 1.2), rng.uniform(0.0, 2.0 * np.pi)
            size = 1.5 / w**2
            p[:, axis] += size * np.sin(w * t + phase)
            a[:, axis] -= size * w**2 * np.sin(w * t + phase)
    angles = np.zeros((3, len(t)))
    for angle in angles:
        for f in (0.05, 0.13, 0.4):
            angle += rng.uniform(0.5, 1.0) * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 2.0 * np.pi))
    angles *= np.radians(degrees) / np.sqrt(np.mean(angles[1] ** 2))
    if still:
        angles[0] = angles[2] = 0.0
        p[:, 1:] = a[:, 1:] = 0.0
    R = np.array([turn(2, yaw) @ turn(1, pitch) @ turn(0, roll) for roll, pitch, yaw in angles.T])
    between = np.einsum("nij,nik->njk", R[:-1], R[1:])  # from one sample to the next, in axes of the sensor
    pairs = ((2, 1), (0, 2), (1, 0))
    step = 0.5 * RATE * np.column_stack([between[:, i, j] - between[:, j, i] for i, j in pairs])
    omega = 0.5 * (np.vstack([step[:1], step]) + np.vstack([step, step[-1:]]))
    return World(t, p, a, R, omega)


def turn(axis: int, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = -s, s
    return R


def quaternion(R: np.ndarray) -> np.ndarray:
    """(n, 4) w, x, y, z; turns here stay far from half a turn."""
    w = 0.5 * np.sqrt(1.0 + np.trace(R, axis1=1, axis2=2))
    u = np.column_stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]])
    return np.column_stack([w, u / (4.0 * w[:, None])])


def sensed(truth: World, axis: np.ndarray, lever: np.ndarray | None = None) -> np.ndarray:
    """What an ideal sensor along `axis` reads, at `lever` m from the tracked point."""
    a = truth.a
    if lever is not None:
        place = truth.R @ lever
        a = a + np.gradient(np.gradient(place, 1.0 / RATE, axis=0), 1.0 / RATE, axis=0)
    return np.einsum("ni,ni->n", truth.R @ axis, a + np.array([0.0, 0.0, G]))


def columns(truth: World, axis: np.ndarray, lever: np.ndarray | None = None, seed: int = 2) -> dict[str, np.ndarray]:
    rng, n = np.random.default_rng(seed), len(truth.t)
    output = (1.0 + K) * sensed(truth, axis, lever) + BIAS + 0.01 * rng.standard_normal(n)
    place = truth.p + 2e-5 * rng.standard_normal((n, 3))
    mean = np.mean(truth.R @ axis, axis=0)
    results = {"t": truth.t, "acc": output, "pos": place @ (mean / np.linalg.norm(mean))}
    results |= dict(zip(("e", "n", "u"), place.T, strict=True))
    results |= dict(zip(("q_w", "q_x", "q_y", "q_z"), quaternion(truth.R).T, strict=True))
    rates = truth.omega + [0.01, -0.02, 0.015] + 1e-3 * rng.standard_normal((n, 3))
    return results | dict(zip(("wx", "wy", "wz"), rates.T, strict=True))


ONE_AXIS = '[rig]\naxis = "level"\n[channels]\n'
BASE = 'time = { column = "t", unit = "s" }\naccel = { column = "acc", unit = "m/s^2" }\n'
ALONG = 'position = { column = "pos", unit = "m" }\n'
PLACE = "".join(f'position_{c} = {{ column = "{c}", unit = "m" }}\n' for c in "enu")
ATTITUDE = '[channels.attitude]\ncolumns = ["q_w", "q_x", "q_y", "q_z"]\nmaps = "sensor to ENU"\n'
TRACKED = f'[rig]\ninput_axis = "x"\n[channels]\n{BASE}{PLACE}{ATTITUDE}'
RATES = "".join(f'gyr_{c} = {{ column = "w{c}", unit = "rad/s" }}\n' for c in "xyz")
TURNING = f'[rig]\naxis = "level"\ninput_axis = "x"\n[channels]\n{BASE}{ALONG}{RATES}'


def read(folder: Path, table: dict[str, np.ndarray], sidecar: str, name: str = "run") -> ac.Recording:
    path = folder / f"{name}.csv"
    rows = np.column_stack(list(table.values()))
    lines = [",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in rows]
    path.write_text("\n".join([",".join(table), *lines]) + "\n")
    path.with_suffix(".toml").write_text(sidecar)
    return io.load(path)


X = np.array([1.0, 0.0, 0.0])


def test_place_and_attitude_give_the_scale_factor_and_the_one_axis_does_not(tmp_path: Path) -> None:
    table = columns(world(), X)
    fit = estimate(Model.linear(), read(tmp_path, table, TRACKED))
    print(fit)
    assert abs(fit["scale_factor"].value - K) < 4.0 * fit["scale_factor"].std < 0.01
    assert abs(fit["bias"].value - BIAS) < 4.0 * fit["bias"].std < 0.02
    assert fit.noise().q == pytest.approx(0.01**2 / RATE, rel=0.3)
    one_axis = read(tmp_path, table, ONE_AXIS + BASE + ALONG, "one")
    blind = ac.fit(one_axis)
    assert abs(blind["scale_factor"].value - K) > 50.0 * fit["scale_factor"].std
    assert blind["scale_factor"].std > 100.0 * fit["scale_factor"].std
    assert blind.tilt > 1.0
    assert blind.remarks[0].code == "slow_residual"
    assert "gravity along a turning axis" in tied_sum(blind, blind["scale_factor"])


def test_a_known_orientation_needs_no_remark_and_predicts_unseen_motion(tmp_path: Path) -> None:
    fitted = ac.fit(read(tmp_path, columns(world(3), X), TRACKED))
    assert fitted.tilt == 0.0
    other = columns(world(5), X, seed=6)
    evaluation = ac.compare(fitted, read(tmp_path, other, TRACKED, "other"), band=5.0)[0]
    assert evaluation.accel_rms < 0.01
    assert evaluation.coast_rms[1.0] < 0.01
    # The twin: the same sensor, fitted and judged along the mean axis.
    text = ONE_AXIS + BASE + ALONG
    with pytest.raises(ac.RecordingError, match="lever_arm of the model needs the channel lever_x"):
        ac.compare(fitted, read(tmp_path, other, text, "other"))[0]
    blind = estimate(Model.linear(), read(tmp_path, columns(world(3), X), text))
    twin = ac.compare(blind, read(tmp_path, other, text, "twin"), band=5.0)[0]
    assert twin.accel_rms > 0.5
    assert twin.coast_rms[1.0] > 0.1


def test_either_sense_any_axis_and_holes(tmp_path: Path) -> None:
    axis = np.array([0.0, 0.6, 0.8])
    table = columns(world(7), axis)
    for name in ("q_x", "q_y", "q_z"):
        table[name] = -table[name]
    for name in ("e", "n", "u", "q_w"):  # 0.2 s without the reference
        table[name][2000:2050] = np.nan
    text = TRACKED.replace('"x"', "[0.0, 0.6, 0.8]").replace("sensor to ENU", "ENU to sensor")
    fit = estimate(Model.linear(), read(tmp_path, table, text))
    assert abs(fit["scale_factor"].value - K) < 4.0 * fit["scale_factor"].std < 0.02
    wrong = estimate(Model.linear(), read(tmp_path, table, text.replace("ENU to sensor", "sensor to ENU"), "wrong"))
    assert abs(wrong["scale_factor"].value - K) > 10.0 * fit["scale_factor"].std


def test_a_written_part_is_read_back_as_it_was(tmp_path: Path) -> None:
    recording = read(tmp_path, columns(world(), X), TRACKED).part(2.0, 22.0)
    sources = io.write_csv(recording, tmp_path / "part.csv")
    io.write_sidecar(recording.rig, sources, tmp_path / "part.toml")
    again = io.load(tmp_path / "part.csv")
    assert {GRAVITY, *LEVERS} <= set(again.side)
    first, second = (estimate(Model.linear(), record) for record in (recording, again))
    assert second["scale_factor"].value == pytest.approx(first["scale_factor"].value, abs=1e-6)


def test_gravity_along_the_axis_is_honoured(tmp_path: Path) -> None:
    changed = world(9, still=True)
    changed = replace(changed, a=np.column_stack([changed.a[:, 0], 0.0 * changed.t, 0.0 * changed.t]))
    level = G * (changed.R @ X)[:, 2]
    rng = np.random.default_rng(4)
    output = (1.0 + K) * (changed.a[:, 0] + level) + BIAS + 0.01 * rng.standard_normal(len(changed.t))
    table = {
        "t": changed.t,
        "acc": output,
        "pos": changed.p[:, 0] + 2e-5 * rng.standard_normal(len(changed.t)),
        "g": level,
    }
    text = ONE_AXIS + BASE + ALONG
    recording = read(tmp_path, table, text + 'gravity_along_axis = { column = "g", unit = "m/s^2" }\n')
    improvement = ac.improve(recording)
    print(improvement.sentence)
    assert improvement.effects == ()
    fitted = improvement.diagnosis.fit
    assert abs(fitted["scale_factor"].value - K) < 4.0 * fitted["scale_factor"].std < 0.01
    blind = ac.improve(read(tmp_path, table, text, "blind"), most=0)
    assert blind.diagnosis.remarks[0].code == "turning_sensor"
    with pytest.raises(ac.RecordingError, match="gravity_along_axis: a fit by a live filter takes gravity"):
        ac.fit(recording, method=FilterChoice())


def test_a_gyroscope_gives_the_tilt_with_its_drift(tmp_path: Path) -> None:
    truth = world(11, degrees=3.0, still=True, seconds=40.0)
    table = columns(replace(truth, a=truth.a * X), X)
    table["acc"] = (1.0 + K) * (truth.a[:, 0] + G * (truth.R @ X)[:, 2]) + BIAS  # a car drives along its own axis
    table["acc"] = table["acc"] + 0.01 * np.random.default_rng(3).standard_normal(len(truth.t))
    recording = read(tmp_path, table, TURNING)
    assert set(recording.side) == set(TURNED)
    fit = estimate(Model.linear(), recording)
    print(fit)
    # The gyroscope's own noise adds a random walk of 0.0006 m/s² per root second, which no coefficient knows of.
    assert fit["scale_factor"].value == pytest.approx(K, abs=0.01)
    assert abs(fit["gyroscope_tilt.1"].value) == pytest.approx((1.0 + K) * G, rel=0.02)
    assert abs(fit["gyroscope_tilt.2"].value) < 4.0 * fit["gyroscope_tilt.2"].std
    assert not [*slow_residual(fit, prepare(recording, fit.origins))]
    blind = estimate(Model.linear(), read(tmp_path, table, ONE_AXIS + BASE + ALONG, "blind"))
    assert blind["scale_factor"].std > 2.0 * fit["scale_factor"].std  # tilt is slow noise to it
    assert abs(blind["scale_factor"].value - K) < 4.0 * blind["scale_factor"].std
    again = prepare(read(tmp_path, table, ONE_AXIS + BASE + ALONG, "again"), blind.origins)
    assert [*slow_residual(blind, again)]


def test_a_lever_arm_is_estimated(tmp_path: Path) -> None:
    lever = np.array([0.03, -0.05, 0.08])
    truth = world(13, degrees=12.0)
    fast = world(13, degrees=12.0)
    recording = read(tmp_path, columns(fast, X, lever), TRACKED)
    fit = estimate(Model.linear(), recording)
    for axis, true in zip("xyz", lever, strict=True):
        lever = fit[f"lever_arm.{axis}"]
        print(lever)
        assert abs(lever.value - true) < 4.5 * lever.std
    twin = estimate(Model.linear(), read(tmp_path, columns(truth, X), TRACKED, "twin"))
    assert max(abs(twin[f"lever_arm.{axis}"].value) / twin[f"lever_arm.{axis}"].std for axis in "xyz") < 4.5


def test_the_path_has_the_projected_acceleration() -> None:
    t = np.sort(np.concatenate([np.arange(0.0, 4.0, 0.004), [1.0011, 2.0013]]))
    r = np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t), np.sin(t)])
    e = np.column_stack([np.cos(0.3 * t), np.sin(0.3 * t), 0.0 * t])
    true = -9.0 * np.sin(3.0 * t) * e[:, 0] - 4.0 * np.cos(2.0 * t) * e[:, 1]
    s = path_along(t, r, e)
    v = np.cumsum(0.5 * (true[1:] + true[:-1]) * np.diff(t))
    wanted = np.concatenate([[0.0], np.cumsum(0.5 * (np.concatenate([[0.0], v[:-1]]) + v) * np.diff(t))])
    off = s - wanted
    off -= np.polyval(np.polyfit(t, off, 1), t)
    assert np.max(np.abs(off)) < 1e-4
    assert np.max(np.abs(s - np.einsum("ni,ni->n", e, r))) > 0.1  # which is another path


@pytest.mark.parametrize("drifting", [True, False])
def test_noise_that_the_output_does_not_show_is_not_the_outputs(drifting: bool) -> None:
    rng = np.random.default_rng(8)
    simulation = ac.simulate(
        "tones", seconds=20.0, rig=CXL02_RIG, parameters={"bias": 0.05, "scale_factor": 0.01}, rng=rng
    )
    recording, position = simulation.recording, simulation.recording.position
    if drifting:  # white as an acceleration, twenty times the noise of the sensor
        shaken = 20.0 * 1e-2 * rng.standard_normal(len(position))
        step = np.median(np.diff(position.t))
        error = np.cumsum(np.cumsum(shaken)) * step**2
        error -= np.polyval(np.polyfit(position.t, error, 12), position.t)
        recording = replace(recording, position=replace(position, y=position.y + error))
    fit = estimate(Model.linear(), recording)
    assert (fit.runs[0].noise.band is not None) == drifting
    assert fit["scale_factor"].value == pytest.approx(0.01, abs=0.01)


REFUSED = [
    ('input_axis = "x"\n', "", r"rig.input_axis: is missing beside \[channels.attitude\]; write input_axis"),
    ('"x"', "[1.0, 1.0, 0.0]", r"of length 1.414, expected a unit vector; the same direction is \[0.707107"),
    ('"x"', '"w"', r"rig.input_axis: found 'w', expected \"x\", \"y\", \"z\" or a unit vector"),
    (ATTITUDE, "", r"rig.input_axis: is the direction of the axis in a body .* declare \[channels.attitude\]"),
    ('"sensor to ENU"', '"body to world"', r'channels.attitude.maps: found .* expected "sensor to ENU"'),
    (', "q_z"', "", r"channels.attitude.columns: found .* expected four columns such as"),
    ('"q_z"', '"quat_z"', r'there is no column "quat_z", which run.toml names for attitude.q_z; did you mean "q_z"'),
    (PLACE, PLACE.split("\n")[0] + "\n", r"channels.position_n: is missing beside \[channels.attitude\]"),
    (PLACE, PLACE + ALONG, r"channels.position: beside \[channels.attitude\] .* leave it out"),
    (PLACE, PLACE + 'gravity_along_axis = { column = "e", unit = "m/s^2" }\n', r"keep one of the two"),
    ("[rig]\n", '[rig]\nmount = "reversed"\n', r"rig.mount: beside \[channels.attitude\] input_axis says how"),
    ("[rig]\n", '[rig]\ngravity_along_axis = "1 m/s^2"\n', r"rig.gravity_along_axis: .* keep one of the two"),
]


@pytest.mark.parametrize(("old", "new", "text"), REFUSED)
def test_a_wrong_declaration_is_refused(tmp_path: Path, old: str, new: str, text: str) -> None:
    table = {name: y[:400] for name, y in columns(world(seconds=2.0), X).items()}
    assert old in TRACKED
    with pytest.raises(ac.RecordingError, match=text):
        read(tmp_path, table, TRACKED.replace(old, new, 1))


LEVEL = ONE_AXIS + BASE + ALONG + 'gravity_along_axis = { column = "g", unit = "m/s^2" }\n'
Q = ("q_w", "q_x", "q_y", "q_z")
CELLS = [
    ("long", TRACKED, r"columns q_w, q_x, q_y, q_z: .* not of length 1 \(first at t = 0.4 s: 2"),
    ("empty", TRACKED, r'column "q_y": every cell is empty, expected numbers for the attitude'),
    ("apart", TRACKED, r"position_e, .* and the attitude share 0 instants; at least 2 are needed"),
    ("angle", LEVEL, r"gravity_along_axis: between .* expected what an ideal accelerometer"),
    (
        "",
        TURNING.replace('"wy", unit = "rad/s"', '"wy", unit = "m"'),
        r'"wy", gyr_y: its unit is m; expected an angular',
    ),
    ("", TURNING.replace(RATES.split("\n")[2] + "\n", ""), r"channels.gyr_z: is missing; a gyroscope is gyr_x, gyr_y"),
]


@pytest.mark.parametrize(("wrong", "sidecar", "text"), CELLS)
def test_wrong_cells_are_refused(tmp_path: Path, wrong: str, sidecar: str, text: str) -> None:
    table = {name: y[:400] for name, y in columns(world(seconds=2.0), X).items()}
    t = table["t"]
    changed = {
        "long": {name: np.where(t >= 0.4 - 1e-9, 2.0 * table[name], table[name]) for name in Q},
        "empty": {"q_y": np.full(400, np.nan)},
        "apart": {name: np.where(t < 0.2, table[name], np.nan) for name in Q}
        | {name: np.where(t > 1.2, table[name], np.nan) for name in ("e", "n", "u")},
        "angle": {"g": np.linspace(-90.0, 90.0, 400)},
        "": {},
    }
    with pytest.raises(ac.RecordingError, match=text):
        read(tmp_path, table | changed[wrong], sidecar)


def test_check_asks_where_columns_look_like_an_orientation(tmp_path: Path) -> None:
    table = {name: y[:400] for name, y in columns(world(seconds=2.0), X).items()}
    table |= {f"gyro_{c}": table.pop(f"w{c}") for c in "xyz"}
    recording = read(tmp_path, table, ONE_AXIS + BASE + ALONG)
    summary = summarise(recording)
    assert "orientation: not recorded; the axis is taken to keep its direction" in summary
    assert (
        'gyroscope (gyro_x, gyro_y, gyro_z): map them as gyr_x, gyr_y, gyr_z and write [rig] input_axis = "x"'
        in summary
    )
    assert 'columns = ["q_w", "q_x", "q_y", "q_z"]' in summary
    assert 'gyr_x = { column = "gyro_x"' in io.template(tmp_path / "run.csv")
    assert "orientation: recorded" in summarise(read(tmp_path, table, TRACKED))


def test_gravity_that_is_recorded_and_does_not_change_is_a_constant() -> None:
    """Also beyond its samples, where the readings of a position reach farther, and in the columns of a relation."""
    plain = ac.simulate(
        "tones", seconds=8.0, rig=replace(CXL02_RIG, axis="up"), parameters={"bias": BIAS}, rng=np.random.default_rng(6)
    ).recording
    t = plain.position.t
    inside = t[(t > t[0] + 1.0) & (t < t[-1] - 1.0)]
    gravity = Channel(GRAVITY, inside, np.full(len(inside), plain.rig.gravity), "m/s^2")
    constant, recorded = prepare(plain), prepare(replace(plain, side={GRAVITY: gravity}))
    for a, b in zip(constant.gravity_integrals, recorded.gravity_integrals, strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-15)
    for first, second in zip(RelationColumns(constant).drives, RelationColumns(recorded).drives, strict=True):
        for a, b in ((first.first, second.first), (first.second, second.second)):
            np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-12 * float(np.max(np.abs(a), initial=1e-3)))
