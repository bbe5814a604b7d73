"""Static positions of three outputs beside their motion: against a dense problem, in simulation, and refusals."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy import linalg, optimize, stats
from typer.testing import CliRunner

import accelcal as ac
from accelcal.cli import app
from accelcal.data import LEVELS, Dwells, Positions, Recording, Rig, Sensor
from accelcal.estimation.estimate import restored_states
from accelcal.estimation.gauss_newton import Layout, outputs_of, rows_of_positions, solve
from accelcal.estimation.rows import normal_equations
from accelcal.io import load_positions
from accelcal.io.dwell_tables import load_dwell_table
from accelcal.validation.consistency import chi_square_region
from tests.estimation.triads import G, Triad
from tests.tiers import drawn

SHARED = ("bias", "scale_factor", "body_misalignment.1", "body_misalignment.2")
"""What motion and positions both determine, of each output."""
SAMPLES, COUNT = 400.0, 10
"""Samples of each position, and their number."""


def still(seed: int) -> Triad:
    """A sensor whose motion is too small to give its scale factors to 1e-4."""
    triad = Triad(seed, seconds=15.0, rate=100.0, turning=0.15)
    for number, share in ((0, 0.3), (1, 0.3), (2, 0.3), (4, 0.1)):
        frequency, size, phase = triad.waves[number]
        triad.waves[number] = frequency, share * size, phase
    return triad


def held(triad: Triad, *, count: int = COUNT, scale=(1.0, 1.0, 1.0), bias: float = 0.0, warm=None) -> Positions:
    """Positions of a sensor: each axis up and down, the others in any direction; held by hand to some degrees."""
    r = np.random.default_rng([triad.seed, 99])
    up = np.vstack([np.eye(3), -np.eye(3), r.standard_normal((max(count - 6, 0), 3))])[:count]
    up += 0.05 * r.standard_normal(up.shape)
    force = G * up / np.linalg.norm(up, axis=1)[:, None]
    std = triad.noise * np.sqrt(0.5 * triad.rate)
    mean = triad.truth["bias"] + bias + force @ (np.array(scale)[:, None] * triad.truth["matrix"]).T
    return Positions(
        mean + std / np.sqrt(SAMPLES) * r.standard_normal(mean.shape),
        np.full(mean.shape, std),
        np.full(count, SAMPLES),
        G,
        "faces.csv",
        "m/s^2",
        np.full(count, SAMPLES / triad.rate),
        temperature=warm,
        rig=Rig(sensor=Sensor(noise=triad.noise)),
        digest="faces",
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("positions")


@pytest.fixture(scope="module")
def triad_fit(folder: Path) -> tuple[Triad, tuple[Recording, ...], Positions, ac.Fit]:
    """A sensor, its motion, its positions, and the fit of both."""
    triad = still(300)
    axes, positions = ac.load_axes(triad.write(folder)), held(triad)
    return triad, axes, positions, ac.fit([*axes, positions])


def errors(fit: ac.Fit, truth: dict[tuple[str, str], float], names=SHARED) -> tuple[np.ndarray, np.ndarray]:
    """Errors of some parameters, and their covariance."""
    rows = [k for k, e in enumerate(fit.free) if e.name in names]
    wrong = np.array([fit.free[k].value - truth[fit.free[k].name, fit.free[k].axis] for k in rows])
    return wrong, fit.covariance[np.ix_(rows, rows)]


def codes(fit: ac.Fit) -> set[str]:
    return {note.code for note in fit.remarks}


def norm_slopes(positions: Positions, x: np.ndarray) -> np.ndarray:
    """Whitened derivatives of |M^-1 (y - b)| by b and the rows of M, (n, 12): what positions alone determine."""

    def norm(x: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.linalg.solve(x[3:].reshape(3, 3), (positions.mean - x[:3]).T).T, axis=1)

    steps = 1e-6 * np.eye(12)
    return np.column_stack([(norm(x + h) - norm(x - h)) / 2e-6 for h in steps]) / np.sqrt(positions.white[:, :1])


def test_motion_and_positions_are_one_dense_problem(triad_fit):
    """Estimates and covariance of one step from the fit against least squares with two angles of each position."""
    _, axes, positions, fit = triad_fit
    states = restored_states(fit, [replace(axes[0], positions=positions), *axes[1:]])
    layout = Layout.of(fit.model, outputs_of(axes))
    at, belief = layout.gather([state.values for state in states]), layout.prior_information(fit.model)
    information, score = np.diag(belief), belief * (layout.prior_mean(fit.model) - at)
    for index, state in enumerate(states):
        normal, rows = normal_equations(state, fit.model.free), layout.rows(index)
        information[np.ix_(rows, rows)] += normal.gram
        score[rows] += normal.score
    static = rows_of_positions(fit.model, layout, states)
    assert static.scatter == 0.0
    step, covariance = solve(
        information + static.columns.T @ static.columns, score + static.columns.T @ static.y, layout
    )
    # the dense problem: the motion by its information, all outputs of the positions, and their attitudes
    size = np.sqrt(np.diag(information))
    root = linalg.cholesky(information / np.outer(size, size)) * size
    names = {(term.name, layout.whose(runs)[1]): k for k, (term, runs) in enumerate(layout.slots)}
    std = np.sqrt(positions.white)
    first = positions.mean / np.linalg.norm(positions.mean, axis=1)[:, None]

    def missed(x: np.ndarray) -> np.ndarray:
        value = at + x[: len(at)] / size
        bias, matrix = np.empty(3), np.eye(3)
        for i, axis in enumerate("xyz"):
            bias[i] = value[names["bias", axis]]
            parts = [value[names[name, axis]] for name in SHARED[1:]]
            matrix[i] += np.roll(parts, i)
        angles = x[len(at) :].reshape(-1, 2)
        across = np.cross(first, np.roll(np.eye(3), 1, axis=0)[np.argmax(np.abs(first), axis=1)])
        up = first + angles[:, :1] * across + angles[:, 1:] * np.cross(first, across)
        force = G * up / np.linalg.norm(up, axis=1)[:, None]
        left = root @ (x[: len(at)] / size) - linalg.solve_triangular(root, score, trans=1)
        return np.concatenate([left, ((positions.mean - bias - force @ matrix.T) / std).ravel()])

    dense = optimize.least_squares(missed, np.zeros(len(at) + 2 * len(positions)), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    x, h = dense.x, np.repeat([1e-2, 1e-5], [len(at), 2 * len(positions)])  # standard deviations, rad
    for _ in range(3):
        J = np.column_stack([(missed(x + e) - missed(x - e)) / (2.0 * np.max(e)) for e in np.diag(h)])
        x = x - np.linalg.lstsq(J, missed(x), rcond=None)[0]
    expected = np.linalg.inv(J.T @ J)[: len(at), : len(at)] / np.outer(size, size)
    sigma = np.sqrt(np.diag(covariance))
    print(
        np.max(np.abs(step - x[: len(at)] / size) / sigma),
        np.max(np.abs(covariance - expected) / np.outer(sigma, sigma)),
    )
    assert step / sigma == pytest.approx(x[: len(at)] / size / sigma, abs=1e-6)
    assert covariance / np.outer(sigma, sigma) == pytest.approx(expected / np.outer(sigma, sigma), abs=1e-6)
    assert np.array([e.std for e in fit.free]) == pytest.approx(sigma, rel=1e-3)  # the delay is read a step before


@drawn(40)
def test_parameters_of_motion_and_positions_are_as_right_as_they_say(folder, draws):
    """NEES of bias, scale factors and matrix in its 99 % region, and disagreements of p < 0.01 beyond 1 in 1000 seeds'
    count; the twin states a third of the uncertainty of the scale factors. Each is smaller than of either alone."""
    nees, twin, disagree = [], [], 0
    for seed in range(400, 400 + draws):
        triad = still(seed)
        axes, positions = ac.load_axes(triad.write(folder)), held(triad)
        fit, truth = ac.fit([*axes, positions]), triad.true_values()
        disagree += "positions_disagree" in codes(fit)
        wrong, covariance = errors(fit, truth)
        nees.append(wrong @ np.linalg.solve(covariance, wrong))
        wrong, covariance = errors(fit, truth, ("scale_factor",))
        twin.append(9.0 * wrong @ np.linalg.solve(covariance, wrong))
        if seed < 404:
            motion = ac.fit(axes)
            J = norm_slopes(positions, np.concatenate([triad.truth["bias"], triad.truth["matrix"].ravel()]))
            alone = np.sqrt(np.diag(np.linalg.pinv(J.T @ J, rcond=1e-9)))
            by_axis = dict(zip(product(("bias", "scale_factor"), "xyz"), alone[[0, 1, 2, 3, 7, 11]], strict=True))
            for e, of_motion in zip(fit.free, motion.free, strict=True):
                assert e.std < of_motion.std * (1.0 if e.name in SHARED else 1.1)
                assert e.std < by_axis.get((e.name, e.axis), np.inf)
                if e.name == "scale_factor":
                    assert e.std < 0.3 * of_motion.std
    low, high = chi_square_region(12, draws, 0.99)
    print(f"NEES {np.mean(nees):.2f} of 12 over {draws} sensors ({low:.2f} to {high:.2f}); {disagree} disagree")
    assert low < np.mean(nees) < high
    assert np.mean(twin) > chi_square_region(3, draws, 0.99)[1]
    assert disagree <= stats.binom.ppf(0.999, draws, 0.01)


def test_positions_of_another_sensor_disagree_in_words(triad_fit):
    """One scale factor differs by 20 standard deviations of the difference of both; the twin is the fixture."""
    triad, axes, _, fit = triad_fit
    motion = next(e.std for e in ac.fit(axes).free if (e.name, e.axis) == ("scale_factor", "y"))
    other = ac.fit([*axes, held(triad, scale=(1.0, 1.0 + 20.0 * motion, 1.0))])
    remark = next(note for note in other.remarks if note.code == "positions_disagree")
    assert remark.values["p"] < 1e-9
    assert remark.values["parameter"] == "scale_factor"
    assert "chi-square" in remark.sentence
    assert "below alpha = 0.01" in remark.sentence
    assert f"y {20.0 * motion:+.2g}"[:6] in remark.sentence
    agreed = next(note for note in fit.remarks if note.code == "positions_agree")
    assert agreed.values["freedom"] == 9
    assert "not below alpha = 0.01" in agreed.sentence


def test_a_bias_that_differs_between_both_is_varied(triad_fit):
    triad, axes, _, _ = triad_fit
    later = held(triad, bias=0.02)
    shared, varied = ac.fit([*axes, later]), ac.fit([*axes, later], ac.Model.linear().vary("bias"))
    remark = next(note for note in shared.remarks if note.code == "positions_disagree")
    assert remark.values["parameter"] == "bias"
    assert "positions_agree" in codes(varied)
    wrong, covariance = errors(varied, triad.true_values())
    assert wrong @ np.linalg.solve(covariance, wrong) < stats.chi2.ppf(0.999, 12)
    with pytest.raises(ac.AccelcalError, match="differs from run to run"):
        ac.fit(axes, ac.Model.linear().vary("bias"))


@pytest.mark.parametrize("count", [2, 6])
def test_few_positions_are_rows_as_well(triad_fit, count):
    triad, axes, _, _ = triad_fit
    fit = ac.fit([*axes, held(triad, count=count)])
    wrong, covariance = errors(fit, triad.true_values())
    assert wrong @ np.linalg.solve(covariance, wrong) < stats.chi2.ppf(0.999, 12)
    assert (len(fit.dwells.residual), fit.dwells.freedom) == (count, 0)


def test_a_hand_that_shakes_widens_the_uncertainty(triad_fit):
    triad, axes, _, fit = triad_fit
    positions = held(triad, count=30)
    shaken = positions.mean + 3e-3 * np.random.default_rng(7).standard_normal(positions.mean.shape)
    wide = ac.fit([*axes, replace(positions, mean=shaken)])
    assert wide.dwells.scatter == pytest.approx(3e-3, rel=0.5)  # 21 degrees of freedom: 15 % each
    assert any("a hand that shakes" in note.sentence for note in wide.remarks)
    assert "positions_agree" in codes(wide)
    assert all(a.std > b.std for a, b in zip(wide.free, fit.free, strict=True) if a.name == "scale_factor")


def test_temperature_of_positions_counts_where_the_model_has_it(folder):
    """The bias of x grows by 1e-3 m/s²/K, and positions are 20 K warmer; without their temperature it is refused."""
    triad = Triad(302, seconds=15.0, rate=100.0, warms=True, law=lambda t, f, warm: 1e-3 * (warm - 25.0))
    axes, model = ac.load_axes(triad.write(folder)), ac.Model.linear().add("temperature_bias_on_x")
    cool = held(triad)
    warm = replace(cool, mean=cool.mean + 0.02 * np.eye(3)[0], temperature=np.full(COUNT, 45.0))
    fit = ac.fit([*axes, warm], model)
    assert "positions_agree" in codes(fit)
    assert abs(fit["temperature_bias_on_x"].value - 1e-3) < 4.0 * fit["temperature_bias_on_x"].std
    assert fit["temperature_bias_on_x"].std < 0.5 * ac.fit(axes, model)["temperature_bias_on_x"].std
    with pytest.raises(ac.RecordingError, match="needs temperature, which these dwells do not have"):
        ac.fit([*axes, cool], model)


def test_two_motions_and_positions_are_one_sensor(folder):
    first, second = still(303), Triad(303, seconds=15.0, rate=100.0, motion=1)
    second.truth = first.truth
    axes = [*ac.load_axes(first.write(folder)), *ac.load_axes(second.write(folder))]
    fit = ac.fit([*axes, held(first)])
    wrong, covariance = errors(fit, first.true_values())
    assert wrong @ np.linalg.solve(covariance, wrong) < stats.chi2.ppf(0.999, 12)
    assert "positions_agree" in codes(fit)


def test_effects_of_one_output_and_the_model_file_go_with_positions(triad_fit, tmp_path):
    _, axes, positions, fit = triad_fit
    better = ac.add(fit, [*axes, positions], "cubic_on_y")
    assert abs(better["cubic_on_y"].value) < 4.5 * better["cubic_on_y"].std
    assert better["cubic_on_y"].std < 0.1 * ac.add(ac.fit(axes), axes, "cubic_on_y")["cubic_on_y"].std
    better.save(tmp_path / "m.json")
    again = ac.load_model(tmp_path / "m.json")
    assert again.dwells == better.dwells
    assert "10 positions" in str(again)
    warm = ac.fit([*axes, positions], ac.Model.linear())
    assert warm.estimates == fit.estimates
    assert ac.diagnose(fit, [*axes, positions]).by_axis


def written(triad: Triad, folder: Path) -> Path:
    """A record of six faces held for 5 s, turned within 1 s from one to the next."""
    r, positions = np.random.default_rng(5), held(triad, count=6)
    rows = []
    for k, mean in enumerate(positions.mean):
        share = np.linspace(0.0, 1.0, 100)[:, None]
        turned = mean * share + positions.mean[k - 1] * (1.0 - share) + 2.0 * r.standard_normal((100, 3))
        rows += [turned, mean + positions.std[0, 0] * r.standard_normal((500, 3))]
    y = np.vstack(rows)
    path = folder / "faces.csv"
    np.savetxt(path, np.column_stack([0.01 * np.arange(len(y)), y]), "%.7g", ",", header="t,ax,ay,az", comments="")
    channels = "".join(f'accel_{a} = {{ column = "a{a}", unit = "m/s^2" }}\n' for a in "xyz")
    path.with_suffix(".toml").write_text(
        f'[channels]\ntime = {{ column = "t", unit = "s" }}\n{channels}[dwell]\nattitude = "unknown"\n'
    )
    return path


def test_the_command_fits_a_motion_and_a_record_of_faces(triad_fit, tmp_path):
    triad, _, _, fit = triad_fit
    board = still(300).write(tmp_path)
    faces = written(triad, tmp_path)
    shown = CliRunner().invoke(app, ["fit", str(board), str(faces)])
    assert shown.exit_code == 0, shown.output
    assert "faces.csv and the motion agree" in " ".join(shown.output.split())
    assert "position  residual (m/s²)" in shown.output
    positions = load_positions(faces)
    assert len(positions) == 6
    joint = ac.fit([*ac.load_axes(board), positions])
    assert joint["scale_factor"].std == pytest.approx(fit["scale_factor"].std, rel=0.5)
    gravity = '[dwell]\nattitude = "unknown"\n'
    sidecar = faces.with_suffix(".toml")
    sidecar.write_text(sidecar.read_text().replace(gravity, f'{gravity}gravity = "9.81744 m/s^2"\n'))
    shown = CliRunner().invoke(app, ["fit", str(board), str(faces)])
    assert shown.exit_code == 3
    assert "declare the same [dwell] gravity in both sidecars" in shown.output
    beside = board.with_suffix(".toml")
    beside.write_text(beside.read_text() + '[dwell]\ngravity = "9.81744 m/s^2"\n')
    turned, standard = ac.load_axes(board)[0], triad_fit[1][0]
    assert turned.side[LEVELS[0]].y == pytest.approx(standard.side[LEVELS[0]].y * 9.81744 / G, rel=1e-9)
    # the simulated sensor turns in standard gravity, so that all scale factors are 0.11 % smaller
    assert ac.fit([*ac.load_axes(board), load_positions(faces)])["scale_factor"].value == pytest.approx(
        joint["scale_factor"].value - 1.1e-3, abs=1e-4
    )


def test_a_unit_of_one_of_three_outputs_is_corrected_at_its_channel(tmp_path):
    path = Triad(301, seconds=15.0, rate=100.0).write(tmp_path)
    sidecar = path.with_suffix(".toml")
    sidecar.write_text(
        sidecar.read_text().replace('column = "accel_y", unit = "m/s^2"', 'column = "accel_y", unit = "g"')
    )
    remark = next(note for note in ac.fit(ac.load_axes(path)).remarks if note.code == "implausible_scale")
    assert 'Write [channels] accel_y = { column = "accel_y", unit = "m/s^2" }' in remark.sentence


def test_what_does_not_go_together_is_refused_with_the_next_step(triad_fit, tmp_path):
    _, axes, positions, _ = triad_fit
    rng = np.random.default_rng(1)
    single = ac.simulate("tones", seconds=10.0, rig=ac.simulation.ADXL105_RIG, parameters={}, rng=rng).recording
    many = np.ones(3)
    dwells = Dwells(np.array([1.5, 0.0, -1.5]), G * many, 1e-3 * many, 60.0 * many, 6e3 * many, ("0",) * 3, Rig())
    for several, sentence in (
        ([single, positions], "positions of three outputs beside .*, which is of one; expected all three"),
        ([positions], "without a motion; .* `accelcal dwells` calibrates positions"),
        ([dwells, positions], "without a motion"),
        ([*axes, dwells], "dwells of one output beside triad_300.csv, which has three; expected positions"),
        ([*axes, positions, positions], "expected one set of positions"),
        ([*axes, replace(positions, unit="count")], "outputs in count; expected means in m/s"),
        ([*axes, replace(positions, std=0.0 * positions.std, rig=Rig())], "without any scatter"),
    ):
        with pytest.raises(ac.RecordingError, match=sentence):
            ac.fit(several)
    table = tmp_path / "positions.csv"
    table.write_text("start_s,end_s,samples,accel_x,accel_y,accel_z,std_x,std_y,std_z\n0,5,500,0,0,9.8,1,1,1\n")
    assert len(load_positions(table)) == 1
    good = table.read_text()
    for old, new, sentence in (
        ("0,5,500", "5,5,500", 'row 2, column "end_s": found 5, expected a time after start_s'),
        (",500,", ",1,", 'row 2, column "samples": found 1, expected a number of samples, at least 2'),
        ("9.8,1,", "9.8,-1,", 'row 2, column "std_x": found -1, expected a standard deviation'),
        ("9.8,1,", "16384,1,", "a norm of 1.638e\\+04 m/s² in the median of 1 rows; expected about 9.807"),
    ):
        table.write_text(good.replace(old, new))
        with pytest.raises(ac.RecordingError, match=sentence):
            load_positions(table)
    table.write_text(good)
    with pytest.raises(ac.RecordingError, match="Positions of three outputs are a file of their own"):
        load_dwell_table(table)
