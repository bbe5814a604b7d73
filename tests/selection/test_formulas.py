"""From a curve to formulas: planted functions, nulls, curves without a formula; against a fit, and by command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from typer.testing import CliRunner

import accelcal as ac
from accelcal.cli import app, write_recording
from accelcal.data.rig import Rig
from accelcal.diagnosis.select.curve_formulas import GRAMMAR, Trial, nodes_over, per
from accelcal.effects import from_expression
from accelcal.model import Model
from accelcal.results import model_file
from accelcal.signals.signals import Signals
from accelcal.simulation import CXL02_RIG
from benches import mechanisms
from benches.formulas import NONE, WORLDS, answer, normalised, record, records, size_at
from benches.outcomes import Trial as Planted
from tests.commands import accelcal

CURVE = "shape_of_velocity"


@pytest.fixture(scope="module")
def breakaway():
    law = WORLDS["v tanh"]
    run = record(np.random.default_rng(7), law, 0.004)
    return run, ac.fit(run)


def planted(kind, number, folder):
    """A record of another simulator and its fit; a mechanism is at 20 standard deviations."""
    trial = Planted(kind, number, 515)
    rng = np.random.default_rng([trial.seed, number])
    scene = mechanisms.scene(rng)
    run = ac.load(mechanisms.write(scene, mechanisms.added(scene, trial, rng), rng, folder / "record.csv"))
    return run, ac.fit(run)


@pytest.fixture(scope="module")
def sagging(tmp_path_factory):
    return planted("mechanism", 0, tmp_path_factory.mktemp("sagging"))


def test_a_gain_that_sags_is_a_mechanism_with_its_driver(sagging):
    run, fit = sagging
    formulas = ac.formulas(fit, run, CURVE)
    first = formulas.formulas[0]
    assert formulas.sentence.startswith("scale factor follows |a| with a memory of 0.")
    assert (first.mechanism, first.units, first.inner_unit) == ("scale_factor_follows_abs_a", ("(m/s²)⁻¹",), "s")
    low, high = first.inner_interval
    assert first.inner == pytest.approx(0.4, abs=2.0 * (high - low))  # 4 standard deviations
    assert first.effect("sag").effect.name == first.mechanism
    grown = ac.add(fit, run, first.mechanism)
    assert first.coefficients[0] == pytest.approx(grown[first.mechanism].value, abs=0.3 * first.std[0])
    assert first.inner == pytest.approx(grown.shapes[0].value, abs=0.3 * (high - low))
    assert first.std[0] == pytest.approx(grown[first.mechanism].std, rel=0.2)


@pytest.mark.parametrize(("kind", "number"), [("process", 0), ("null", 0)])
def test_a_gauss_markov_scale_factor_follows_no_driver(tmp_path, kind, number):
    """The sister: a Gauss-Markov scale factor, and nothing."""
    run, fit = planted(kind, number, tmp_path)
    formulas = ac.formulas(fit, run, "shape_of_acceleration")
    assert not [formula.mechanism for formula in formulas.formulas if formula.mechanism], formulas.sentence


@pytest.mark.parametrize("name", ["v signed root", "v resonance", "p peak", "a tanh"])
def test_a_function_outside_the_catalogue_is_in_the_set(name):
    law = WORLDS[name]
    result = answer(law, records((3,), law, size_at(30.0, 1, law)))
    assert law.elements in [frozenset(formula.elements) for formula in result.formulas], result.sentence
    assert len(result.formulas) <= 8
    assert all(formula.held_out > 0.5 * formula.gain for formula in result.formulas)
    assert result.chance < 1e-6


def test_nothing_hidden_has_nothing_to_describe():
    """3 records at 1 % each: two false answers have probability 0.0003."""
    false = 0
    for seed in range(3):
        run = record(np.random.default_rng([11, seed]), WORLDS["v tanh"], 0.0)
        formulas = ac.formulas(ac.fit(run), run, CURVE)
        assert "shows no function of velocity" in formulas.sentence or formulas.formulas
        false += bool(formulas.formulas)
    assert false <= 1


@pytest.mark.parametrize(("size", "tau"), [(3e-3, 0.0), (5e-3, 0.5)])
def test_slow_noise_is_no_function_of_the_motion(size, tau):
    """A bias that is a random walk, or Gauss-Markov: a record of each with 2 curves, none described."""
    rng = np.random.default_rng([21, 0])
    run = record(rng, WORLDS["v tanh"], 0.0)
    step, n = float(np.median(np.diff(run.accel.t))), len(run.accel.t)
    if tau:
        keep = np.exp(-step / tau)
        drift = lfilter([1.0], [1.0, -keep], size * np.sqrt(1.0 - keep**2) * rng.standard_normal(n))
    else:
        drift = np.cumsum(size * np.sqrt(step) * rng.standard_normal(n))
    run = replace(run, accel=replace(run.accel, y=run.accel.y + drift), digest=f"drifting {tau}")
    fit = ac.fit(run)
    for curve in (CURVE, "shape_of_position"):
        assert not ac.formulas(fit, run, curve).formulas


def test_a_holdout_of_another_range_is_scored_by_the_formula_itself():
    """Trained on slow motion, held out on fast: v|v| explains far more there."""
    gains = []
    for speed in (0.3, 3.0):
        rng = np.random.default_rng(31)
        simulation = ac.simulate("tones", seconds=40.0, rig=CXL02_RIG, parameters={}, rng=rng, a_rms=speed)
        accel = simulation.recording.accel
        v = simulation.truth.motion.velocity(accel.t)
        gains.append(
            replace(simulation.recording, accel=replace(accel, y=accel.y + 20.0 * v * np.abs(v)), digest=f"{speed}")
        )
    formulas = ac.formulas(ac.fit(gains[0]), gains[0], CURVE, holdout=gains[1])
    true = [formula for formula in formulas.formulas if formula.elements == ("signed square",)]
    assert true, formulas.sentence
    assert true[0].held_out > true[0].gain


def test_a_curve_of_several_bumps_has_no_short_formula():
    law = NONE["v four bumps"]
    result = answer(law, records((5,), law, size_at(60.0, 1, law)))
    assert not result.formulas
    assert result.rejected
    assert "no short formula" in result.sentence


def test_the_hats_give_what_a_fit_of_the_same_function_gives(breakaway):
    """Two paths: a mixture of hats of one Gram matrix, and the fit of an own effect through the replay."""
    run, fit = breakaway
    formulas = ac.formulas(fit, run, CURVE)
    first = formulas.formulas[0]
    effect = first.effect("own_breakaway", owner="rig")
    grown = ac.fit(run, Model.linear().add(effect.effect.name))
    estimated = grown["own_breakaway"]
    assert estimated.value == pytest.approx(first.coefficients[0], abs=0.2 * first.std[0])
    assert (estimated.value / estimated.std) ** 2 == pytest.approx(first.gain, rel=0.05)
    assert estimated.std < first.std[0]  # the length is held in the effect, and free in the formula


def test_nodes_cover_the_range_and_hold_zero():
    for low, high in ((-0.1, 0.3), (0.02, 0.3), (-0.3, -0.1)):
        nodes = nodes_over(np.linspace(low, high, 999))
        assert nodes[0] <= low + 1e-12
        assert nodes[-1] >= high - 1e-12
        assert np.all(np.diff(nodes) > 0.0)
        assert (0.0 in nodes) == (low < 0.0 < high)


def test_a_formula_can_be_written_read_and_added(breakaway, tmp_path):
    run, fit = breakaway
    write_recording(run, tmp_path / "run.csv")
    model_file.save(fit, tmp_path / "m.json")
    source = tmp_path / "drag.py"
    command = ["formula", str(tmp_path / "m.json"), str(tmp_path / "run.csv"), "--curve", CURVE, "--name", "own_drag"]
    done = CliRunner().invoke(app, [*command, "-o", str(source), "--json"])
    assert done.exit_code == 0, done.output
    content = json.loads(done.stdout)
    assert content["schema"] == "accelcal/formulas/5"
    assert content["formulas"][0]["units"] == ["m/s²"]
    options = ["--effects-file", str(source), "--effect", "own_drag", "-o", str(tmp_path / "m2.json")]
    added = accelcal("add", *command[1:3], *options)  # another process, as for a user: here the name is known already
    assert added.returncode == 0, added.stderr
    assert "own_drag" in added.stdout
    text = CliRunner().invoke(app, command).stdout
    assert "its length" in text
    assert "lack of fit" in text


def test_a_mechanism_is_added_by_name_and_not_written(sagging, tmp_path):
    run, fit = sagging
    write_recording(run, tmp_path / "run.csv")
    model_file.save(fit, tmp_path / "m.json")
    command = ["formula", str(tmp_path / "m.json"), str(tmp_path / "run.csv"), "--curve", CURVE]
    done = CliRunner().invoke(app, [*command, "-o", str(tmp_path / "sag.py")])
    assert done.exit_code == 0, done.output
    assert not (tmp_path / "sag.py").exists()
    assert "its time constant, 68 % interval" in done.stdout
    assert "is not written: the effect has a name" in done.stderr
    assert "--effect scale_factor_follows_abs_a" in done.stderr


def test_a_formula_that_held_out_data_contradict_says_so(sagging, tmp_path):
    run, fit = sagging
    honest, _ = planted("null", 0, tmp_path)
    contradicted = ac.formulas(fit, run, CURVE, holdout=honest)
    assert contradicted.formulas[0].contradicted
    assert contradicted.sentence.endswith("The held-out record contradicts it")
    assert "contradicts" not in ac.formulas(fit, run, CURVE).sentence


@pytest.mark.parametrize(
    ("curve", "says"),
    [
        ("quadratic", "no curve of one variable"),
        ("shape_of_nothing", "did you mean"),
        ("shape_since_reversal", "no curve"),
    ],
)
def test_what_is_no_curve_of_one_variable_is_refused(breakaway, tmp_path, curve, says):
    run, fit = breakaway
    write_recording(run, tmp_path / "run.csv")
    model_file.save(fit, tmp_path / "m.json")
    done = CliRunner().invoke(app, ["formula", str(tmp_path / "m.json"), str(tmp_path / "run.csv"), "--curve", curve])
    assert done.exit_code == 2, done.output
    assert says in " ".join(done.output.replace("│", " ").split())


def test_every_element_is_its_text():
    """The algebra that is written is the function that was fitted."""
    x = np.linspace(-0.3, 0.4, 57)
    for number, element in enumerate(GRAMMAR):
        for part, (text, function) in enumerate(zip(element.texts, element.functions, strict=True)):
            effect = from_expression(f"own_element_{number}_{part}", text.format(x="v", d="0.07"))

            nothing = np.zeros_like(x)
            moving = Signals(t=nothing, p=nothing, v=x, a=nothing, jerk=nothing, scale=1.0, rig=Rig())
            np.testing.assert_allclose(effect.effect.function(moving), function(x, 0.07), rtol=1e-9, atol=1e-12)


def test_units_of_coefficients():
    assert per("m/s²", "m/s", 0.0) == "m/s²"
    assert per("m/s²", "m/s", 1.0) == "m/s²/(m/s)"
    assert per("m/s²", "m", 0.5) == "m/s²/(m)^0.5"


def test_the_interval_of_a_length_ends_where_the_gain_is_one_less():
    """A likelihood of known shape: g = -((log d - log 3)/0.2)² has its interval at 3 exp(±0.2), off its middle."""

    class Hats:
        """What `Trial.at` asks of a Gram matrix."""

        nodes, blocks = np.linspace(0.0, 10.0, 11), 100.0

        def gain(self, columns):
            d = -10.0 / np.log(columns[-1, 0])
            return 50.0 - (np.log(d / 3.0) / 0.2) ** 2, 1, np.ones(1), np.eye(1)

    decay = next(element for element in GRAMMAR if element.name == "decay")
    best = Trial.at((decay,), 3.0, Hats())
    low, high = best.inner_interval(Hats())
    assert (low, high) == pytest.approx((3.0 * np.exp(-0.2), 3.0 * np.exp(0.2)), rel=1e-3)
    assert normalised(3.0, (low, high), low) == pytest.approx(1.0, rel=1e-3)
    assert normalised(3.0, (low, high), 2.0 * high) < -1.0
