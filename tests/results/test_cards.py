"""What a notebook shows of a result: a sentence and a table, numbers of the result itself, nothing that could run."""

import dataclasses
import re
import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import accelcal as ac
from accelcal import verbs
from accelcal.data.dwells import Dwells
from accelcal.estimation.estimate import estimate
from accelcal.plots.diagnosis import added_variables
from accelcal.results import table as tables
from accelcal.results.words import concise, interval, plain
from accelcal.simulation import ADXL105_RIG, CXL02_RIG

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "cubic": 1e-3}


def record(seed):
    rng = np.random.default_rng(seed)
    return ac.simulate("interleaved", seconds=30.0, rig=CXL02_RIG, parameters=TRUTH, rng=rng).recording


def tumble():
    angle = np.arange(8) * np.pi / 4.0
    item = (np.full(8, 1e-3), np.full(8, 60.0), np.full(8, 6000.0))
    return Dwells(angle, 9.8 * np.sin(angle), *item, ("0",) * 8, CXL02_RIG, name="tumble.csv")


@pytest.fixture(scope="module")
def results():
    train, unseen = record(1), record(2)
    linear, cubic = estimate(ac.Model.linear(), train), verbs.add(estimate(ac.Model.linear(), train), train, "cubic")
    return {
        "recording": train,
        "dwells": tumble(),
        "fit": linear,
        "comparison": ac.compare(linear, unseen),
        "lacking": verbs.diagnose(linear, train),
        "complete": verbs.diagnose(cubic, train),
        "history": verbs.compare([linear, cubic], unseen),
        "improvement": verbs.improve(train, holdout=unseen, most=1),
    }


KINDS = ("recording", "dwells", "fit", "comparison", "lacking", "complete", "history", "improvement")


def shown(result):
    """The card as an element: what is not well formed does not pass."""
    return ET.fromstring(result._repr_html_())


def cells(element):
    return [["".join(cell.itertext()) for cell in row] for row in element.iter("tr")]


@pytest.mark.parametrize("kind", KINDS)
def test_a_card_is_one_sentence_and_a_small_table(results, kind):
    card = shown(results[kind])
    assert len(list(card.iter("b"))) == 1
    rows = cells(card)
    assert 2 <= len(rows) <= 9
    assert len({len(row) for row in rows}) == 1


@pytest.mark.parametrize("kind", KINDS)
def test_a_card_loads_and_runs_nothing(results, kind):
    card = shown(results[kind])
    tags = {element.tag for element in card.iter()}
    assert tags <= {"div", "p", "b", "table", "thead", "tbody", "tr", "th", "td"}
    assert {key for element in card.iter() for key in element.attrib} <= {"class", "style"}


@pytest.mark.parametrize("kind", KINDS)
def test_the_plain_text_is_one_line_without_arrays(results, kind):
    text = repr(results[kind])
    assert len(text) < 400
    assert "\n" not in text
    assert "array" not in text


def test_every_parameter_stands_with_its_uncertainties(results):
    fit = results["fit"]
    rows = {row[0]: row for row in cells(shown(fit))[1:]}
    assert list(rows) == [e.name for e in fit.estimates]
    for e in fit.estimates:
        assert concise(e.value, e.std) in " ".join(rows[e.name])
        assert plain(e.unit, e.value, e.std) in rows[e.name]
        assert interval(e.value, e.std) in rows[e.name]


def test_drifts_are_those_of_the_comparison(results):
    evaluation = results["comparison"]
    rows = cells(shown(evaluation))[1:]
    assert [row[0] for row in rows] == ["1 s", "5 s", "10 s"]
    metres = {"mm": 1e-3, "µm": 1e-6, "m": 1.0}
    for row, drift in zip(rows, evaluation[0].coast_rms.values(), strict=True):
        number, unit = row[1].split()
        assert float(number) * metres[unit] == pytest.approx(drift, rel=0.006)  # three digits are shown


def test_what_is_missing_is_named_and_what_is_not_is_bounded(results):
    lacking, complete = (shown(results[kind]) for kind in ("lacking", "complete"))
    assert cells(lacking)[1][0] == results["lacking"].effects[0] == "cubic"
    assert cells(complete)[0] == ["effect", "detection limit (95 % probability)"]
    assert "scale factor" not in [row[0] for row in cells(complete)]  # it is in the model


def test_bars_are_as_long_as_the_errors(results):
    history = results["history"]
    widths = [float(w) for w in re.findall(r"width:(\d+)px", history._repr_html_())]
    errors = history.errors
    assert history.headline.unit == "m/s²"
    assert widths[0] == tables.LONGEST_BAR
    assert widths[1] / widths[0] == pytest.approx(errors[1] / errors[0], abs=0.01)  # whole pixels
    assert errors[1] < 0.5 * errors[0]


def test_a_comparison_is_the_sequence_of_its_models(results):
    history = results["history"]
    assert len(history) == 2
    assert [evaluation.coast_rms for evaluation in history] == [history[0].coast_rms, history[1].coast_rms]
    assert history.names == ("base", "base + cubic")
    with pytest.raises(ValueError, match="at least one of each"):
        verbs.compare([], results["recording"])


def test_a_hostile_name_is_text(results):
    name = '<img src="x" onerror="alert(1)">&amp;.csv'
    card = shown(dataclasses.replace(results["recording"], name=name))
    assert "img" not in {element.tag for element in card.iter()}
    assert name in "".join(card.itertext())


def test_what_is_no_result_has_no_card():
    with pytest.raises(TypeError, match="a int has no table"):
        tables.table(3)


def test_the_face_is_loaded_when_a_result_is_shown_and_not_before():
    code = "import sys, accelcal.verbs; print(*(m in sys.modules for m in ('accelcal.results.table', 'plotly')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.split() == ["False", "False"]


@pytest.fixture(scope="module")
def full():
    """A fit with an effect on noise, a curve and a shape parameter beside its coefficients."""
    rng = np.random.default_rng(7)
    simulation = ac.simulate("interleaved", seconds=12.0, rig=ADXL105_RIG, parameters=TRUTH, rng=rng, lsb=0.02)
    fit = ac.fit(simulation.recording)
    return ac.add(fit, simulation.recording, "shape_of_velocity", "creep", "quantisation"), simulation.recording


def test_an_effect_on_noise_a_curve_and_a_shape_stand_in_every_face(full, tmp_path, capsys):
    from accelcal.app.screens.model import by_name
    from accelcal.cli.printing import show_fit
    from accelcal.report.content import gather
    from accelcal.report.view import view
    from accelcal.results.tables import curve_row

    fit, recording = full
    assert fit.noise_effects
    assert fit.shapes
    show_fit(fit)
    page = view(gather(fit, recording))
    faces = {
        "terminal": capsys.readouterr().out,
        "text": str(fit),
        "notebook": fit._repr_html_(),
        "frame": " ".join(fit.to_dataframe().index),
        "report": str(page["parameters"]["rows"]),
        "first page": str(page["page"]["parameters"]).replace(" ", "_"),
        "side by side": " ".join(by_name(fit)),
    }
    for name in ("quantisation", "shape_of_velocity", "creep", fit.shapes[0].name):
        for face, text in faces.items():
            assert name.replace(".", "_") in text.replace(".", "_"), (face, name)
    # one coefficient is not what the whole curve contributes at most, which a diagnosis says
    assert curve_row(fit, "shape_of_velocity", 9)["si"].startswith("largest ")


def test_an_effect_on_noise_is_in_the_last_model_and_has_no_panel_of_its_own():
    """The last verdict names it, and the model has it; a model without it lacks it, as one without the cubic does."""
    rng, truth = np.random.default_rng(1), {"cubic": 1e-3}
    recording = ac.simulate("interleaved", seconds=12.0, rig=CXL02_RIG, parameters=truth, rng=rng, lsb=0.02).recording
    result = ac.improve(recording)
    assert result.effects == ("cubic", "quantisation")
    assert result.table().title.startswith("Improvement: no effect is missing; ")
    assert ac.improve(recording, most=0).diagnosis.verdict != "adequate"
    without = result.best.model.drop("quantisation")
    lacking = dataclasses.replace(result, best=dataclasses.replace(result.best, model=without))
    assert lacking.table().title.startswith("Improvement: an effect is missing; ")
    drawn = added_variables(ac.compare([step.fit for step in result.steps], recording))
    assert [panel.title.split(":")[0] for panel in drawn.panels] == ["cubic"]
