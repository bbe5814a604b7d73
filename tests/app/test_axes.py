"""Three outputs of one sensor in the workbench: one file, one fit, a verdict for each output, effects on one alone."""

import pytest

import accelcal as ac
from accelcal.app import script
from accelcal.app.screens import improvement
from accelcal.app.workbench import Workbench
from accelcal.diagnosis.verdict import AxesDiagnosis
from accelcal.plots.comparison import coasting_of_axes, residual_of_axes
from tests.commands import python
from tests.estimation.triads import Triad

CUBIC = 1e-4
"""(m/s²)⁻² on y, tens of standard deviations on this record."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Return a workbench with a linear model of three outputs, of which y lacks a cubic; diagnosed."""
    folder = tmp_path_factory.mktemp("axes")
    triad = Triad(71, seconds=40.0, rate=100.0, law=lambda t, f, warm: CUBIC * f**3, hidden=1)
    (folder / "home").mkdir()
    bench = Workbench(folder / "home")
    bench.load(triad.write(folder))
    bench.fit()
    bench.diagnose()
    assert bench.sentence == ""
    return bench


def test_a_file_of_three_outputs_is_one_file_and_three_series(bench):
    state = bench.state
    (run,) = state.runs
    assert run.name == "triad_71.csv"
    assert [output.name for output in run.outputs] == [f"triad_71.csv {axis}" for axis in "xyz"]
    assert [part.axis for part in state.train] == [part.axis for part in state.unseen] == list("xyz")
    assert len(state.step.fit.free) == 24
    assert state.axis == "x"
    assert len(state.step.heldouts) == 3
    assert state.data.axis == "x"


def test_each_output_has_its_verdict_and_add_names_it(bench, tmp_path):
    diagnosis = bench.diagnosis
    assert isinstance(diagnosis, AxesDiagnosis)
    judged = dict(improvement.by_output(diagnosis))
    near = improvement.offered(judged["y"])[0]
    assert near[0].effect == "cubic"
    assert diagnosis.entering("y", "cubic") == "cubic_on_y"
    assert diagnosis.entering("y", "world_tilt") == "world_tilt"  # the twin: not the sensor's
    assert [axis for axis, _ in improvement.by_output(judged["x"])] == [""]
    bench.add("cubic_on_y")
    assert bench.sentence == ""
    work = tmp_path / "work.accelcal"
    work.write_bytes(bench.session())
    grown = bench.state
    bench.undo()
    assert "cubic" in grown.step.fit.of_axis("y").model.effects
    before, after = (grown.beside(step) for step in grown.path)
    assert list(after) == list("xyz")
    cubic = grown.step.fit["cubic_on_y"]
    assert abs(cubic.value - CUBIC) < 4.5 * cubic.std < 0.5 * CUBIC  # a false alarm in 150 000 records
    assert after["x"].accel_rms == pytest.approx(before["x"].accel_rms, rel=0.1)
    assert len(residual_of_axes(after, previous=before).panels) == len(coasting_of_axes(after).panels) == 3
    (tmp_path / "again").mkdir()
    again = Workbench(tmp_path / "again")
    again.open(work)
    assert [step.change.label for step in again.state.steps] == ["base", "+ cubic_on_y"]
    assert len(again.state.train) == 3


def test_copied_steps_give_the_same_model(bench, tmp_path):
    text = script.python(bench.state)
    assert 'ac.load_axes("triad_71.csv")' in text
    first = text.partition("models =")[0]
    done = python("-c", f'{first}\nm0.save("{tmp_path}/m0.json")\n', cwd=bench.state.runs[0].file.parent)
    assert done.returncode == 0, done.stderr
    assert ac.load_model(tmp_path / "m0.json").estimates == bench.state.step.fit.estimates
    assert "accelcal fit triad_71.csv" in script.command_line(bench.state)
    assert "accelcal cut takes one output" in script.command_line(bench.state)


def test_an_export_says_which_command_writes_it(bench):
    assert bench.export("C") is None
    assert "accelcal export model.json --c sensor.h" in bench.sentence
