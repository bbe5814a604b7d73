"""Several recordings and dwells in the workbench: roles, the joint fit, the error on all that is held out, guests."""

import json
import shlex
import shutil
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import accelcal as ac
from accelcal.app import mapping, script, tasks, widgets
from accelcal.app.screens import files, improvement, model
from accelcal.app.screens.model import own_error
from accelcal.app.workbench import Workbench
from accelcal.cli import app as command_line
from accelcal.estimation.noise import NoiseScore
from accelcal.results import model_file
from accelcal.simulation import CXL02_RIG
from accelcal.validation.differences import pooled
from tests.commands import python

NAMES = ("run0.csv", "run1.csv", "run2.csv", "dwells.csv")


def loaded(folder, place):
    place.mkdir()
    bench = Workbench(place)
    bench.load_several([folder / name for name in NAMES])
    assert bench.sentence == ""
    return bench


def roles(bench):
    return [(run.role, run.held_out is not None) for run in bench.state.runs]


@pytest.fixture(scope="module")
def grown(several, tmp_path_factory):
    """Return a workbench with two recordings held out, base and + cubic; tests must leave it as it is."""
    bench = loaded(several, tmp_path_factory.mktemp("runs") / "home")
    bench.assign(1, "hold out")
    bench.fit()
    bench.add("cubic")
    assert bench.sentence == ""
    return bench


def test_roles_are_proposed_changed_and_undone(several, tmp_path):
    bench = loaded(several, tmp_path / "home")
    assert roles(bench) == [("fit", False), ("fit", False), ("hold out", False), ("fit", False)]
    assert [run.dwells is not None for run in bench.state.runs] == [False, False, False, True]
    assert [run.lender for run in bench.state.runs] == ["", "run0.csv", "", ""]
    proposed = bench.state
    bench.assign(2, "leave out")  # something is held out, always
    assert roles(bench) == [("fit", True), ("fit", False), ("leave out", False), ("fit", False)]
    bench.assign(1, "hold out")  # a recording takes the place of a part
    assert roles(bench) == [("fit", False), ("hold out", False), ("leave out", False), ("fit", False)]
    changed = bench.state
    bench.undo()
    bench.undo()
    assert bench.state is proposed
    bench.redo()
    bench.redo()
    assert bench.state is changed
    refused = {(3, "hold out"): "show no motion", (0, "leave out"): "no recording would be left to fit"}
    for (number, role), message in refused.items():
        bench.assign(number, role)
        assert message in bench.sentence
        assert bench.state is changed
    bench.show(2)
    bench.hold_out(1.0, 2.0)
    assert "is not fitted" in bench.sentence
    bench.show(0)
    bench.hold_out(10.0, 16.0)  # beside the recording
    assert [part.name for part in bench.state.unseen] == ["run0.csv", "run1.csv"]
    bench.fit_whole()
    bench.remove(1)
    assert roles(bench) == [("fit", True), ("leave out", False), ("fit", False)]
    bench.fit_whole()
    assert "nothing would be held out" in bench.sentence


def test_models_stay_where_what_they_were_fitted_to_does(grown, tmp_path):
    bench = Workbench(tmp_path)
    bench.state = grown.state
    bench.assign(2, "leave out")
    assert [step.fit for step in bench.state.steps] == [step.fit for step in grown.state.steps]
    assert [len(step.heldouts) for step in bench.state.steps] == [1, 1]
    assert bench.state.step.heldout.coast_rms == grown.state.step.heldouts[0].coast_rms
    bench.assign(3, "leave out")
    assert bench.state.steps == ()


class Recorder:
    """Stands for the workers of a workbench: keeps what it is asked for, and gives an answer to each task."""

    def __init__(self, answers):
        self.answers, self.asked = answers, []

    def __call__(self, task, *args, progress, memory):
        self.asked.append((task, args))
        answer = self.answers[task]
        if isinstance(answer, Exception):
            raise answer
        return answer


def with_answers(state, folder, answers):
    recorder = Recorder(answers)
    bench = Workbench(folder, recorder)
    bench.state = state
    return bench, recorder


def test_a_diagnosis_outlives_values_that_cannot_be_had_and_is_not_that_of_the_first(grown, tmp_path):
    result = object()
    answers = {tasks.diagnosed: result, tasks.values_of_runs: ValueError("too short alone"), tasks.reported: "<html>"}
    state = replace(
        grown.state, runs=(grown.state.runs[0], replace(grown.state.runs[1], role="fit"), *grown.state.runs[2:])
    )
    bench, recorder = with_answers(state, tmp_path, answers)
    bench.diagnose()
    assert [task for task, _ in recorder.asked] == [tasks.diagnosed, tasks.values_of_runs]
    assert bench.diagnosis is result
    assert bench.run_values is None
    assert bench.sentence == ""
    assert bench.report() is not None
    *_, effects = recorder.asked[-1][1]
    assert effects is None


def test_curves_are_those_of_the_data_in_use(grown, tmp_path):
    bench, recorder = with_answers(replace(grown.state, shown=1), tmp_path, {tasks.compared: [object()]})
    bench.whole()
    bench.whole()
    assert len(recorder.asked) == 1
    first, held, *others = grown.state.runs
    bench.state = replace(bench.state, runs=(first, replace(held, excluded=((1.0, 2.0),)), *others))
    bench.whole()
    assert len(recorder.asked) == 2
    bench.state = replace(grown.state, runs=(first, *others), shown=1)  # the next one is on the time line
    bench.whole()
    assert len(recorder.asked) == 3


def test_sentences_say_what_is_held_out(grown):
    state = grown.state
    assert improvement.held_out(state) == "2 held-out recordings together"
    parts = tuple(replace(run, role="fit", held_out=(8.0, 12.0)) for run in state.runs[:2])
    assert improvement.held_out(replace(state, runs=parts)) == "2 held-out parts together"
    assert improvement.held_out(replace(state, runs=parts[:1])) == "the held-out part of this run"
    score = NoiseScore("vibration", "accel", 3.0, 1.0, 100, 1.0, 1.5)
    heldouts = tuple(replace(heldout, noise_scores=(score,)) for heldout in state.step.heldouts)
    scored = replace(state, steps=(*state.steps[:-1], replace(state.step, heldouts=heldouts)))
    assert [text.partition(",")[0] for text in improvement.noise_scores(scored)] == [
        "Held out (run1.csv)",
        "Held out (run2.csv)",
    ]
    pool = state.step.heldout
    assert own_error(pool).startswith(f"systematic error of the output below {pool.band:.3g} Hz: ")


def test_the_report_command_is_of_a_recording_though_dwells_come_first(grown):
    *recordings, dwells = grown.state.runs
    lines = script.command_line(replace(grown.state, runs=(dwells, *recordings))).splitlines()
    (line,) = [line for line in lines if " report " in line]
    assert line.startswith("accelcal report m1.json run0.csv ")


def test_the_pool_is_the_error_over_all_start_points(grown):
    for step in grown.state.path:
        for horizon, value in step.heldout.coast_rms.items():
            errors = np.concatenate([heldout.drifts[horizon][1] for heldout in step.heldouts])
            expected = float(np.sqrt(np.mean(errors**2))) if len(errors) else None
            assert value == (None if expected is None else pytest.approx(expected, rel=1e-12))
        assert step.heldout.coast_rms[5.0] is not None
        floors = [heldout.noise_floor.simulated for heldout in step.heldouts]
        floor = step.heldout.noise_floor.simulated
        assert min(other.value for other in floors) <= floor.value <= max(other.value for other in floors)
        assert floor.high - floor.low < max(other.high - other.low for other in floors)  # more data, surer
    nested = widgets.path_of(grown.state)
    assert nested.errors[1] < 0.1 * nested.errors[0]
    assert pooled([grown.state.step.heldouts[0]]) is grown.state.step.heldouts[0]


def test_the_script_and_the_commands_of_several_give_the_same_numbers(grown, several, tmp_path):
    for path in several.iterdir():
        shutil.copy(path, tmp_path)
    done = python("-c", script.python(grown.state), cwd=tmp_path, check=True)
    for step in grown.state.path:
        for heldout in step.heldouts:
            assert str(heldout.coast_rms) in done.stdout
    assert "nothing else is missing" in done.stdout
    assert model_file.to_dict(model_file.load(tmp_path / "model.json")) == model_file.to_dict(grown.state.step.fit)
    lines = script.command_line(grown.state).splitlines()
    assert sum(" compare " in line for line in lines) == 1
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        for line in lines:
            words = shlex.split(line)
            if words[1] in ("fit", "add"):
                ran = CliRunner().invoke(command_line, words[1:])
                assert ran.exit_code == 0, (line, ran.output)
    recording = model_file.load(tmp_path / "m1.json")
    assert recording["cubic"].value == pytest.approx(grown.state.step.fit["cubic"].value, rel=1e-9)


def test_a_session_of_several_comes_back(grown, tmp_path):
    path = tmp_path / "work.accelcal"
    path.write_bytes(grown.session())
    (tmp_path / "fresh").mkdir()
    bench = Workbench(tmp_path / "fresh")
    bench.open(path)
    assert bench.sentence == ""
    assert roles(bench) == roles(grown)
    assert bench.state.title == "run0.csv and 3 more"
    assert [step.heldout.coast_rms for step in bench.state.path] == [s.heldout.coast_rms for s in grown.state.path]


def test_models_of_elsewhere_stand_beside(grown, several, tmp_path):
    bench = Workbench(tmp_path)
    bench.state = grown.state
    (tmp_path / "work.accelcal").write_bytes(grown.session())
    bench.invite(tmp_path / "work.accelcal")
    assert bench.sentence == ""
    assert [guest.name for guest in bench.state.guests] == ["work: base", "work: base + cubic"]
    assert bench.state.guests[1].own.coast_rms == grown.state.step.heldout.coast_rms
    (tmp_path / "sensor.json").write_text(bench.model_text())
    bench.invite(tmp_path / "sensor.json")
    (tmp_path / "with guests.accelcal").write_bytes(bench.session())
    (tmp_path / "fresh").mkdir()
    again = Workbench(tmp_path / "fresh")
    again.open(tmp_path / "with guests.accelcal")
    assert again.sentence == ""
    assert list(again.state.models) == list(bench.state.models)
    assert again.state.models["sensor.json"]["cubic"].value == bench.state.step.fit["cubic"].value
    base, cubic, *_ = bench.state.models
    fits = bench.state.models
    alike = model.differences(fits[cubic], fits["sensor.json"])
    assert {difference.sigma for difference in alike} == {0.0}
    assert [difference.name for difference in alike] == ["bias", "scale_factor", "time_offset", "tilt", "cubic"]
    (lacking,) = [difference for difference in model.differences(fits[base], fits[cubic]) if difference.value is None]
    assert (lacking.name, lacking.first) == ("cubic", None)
    assert bench.pair((base, cubic)) is None
    bench.compare_pair((base, cubic))
    before, after = bench.pair((base, cubic))
    assert after.simulated_rms < 0.1 * before.simulated_rms
    other = replace(bench.state.step.fit, rig=replace(bench.state.step.fit.rig, sensor=ac.Sensor(model="ADXL105")))
    assert model.same_sensor([bench.state.step.fit], bench.state)
    assert not model.same_sensor([other], bench.state)
    bench.invite(several / "run0.csv")
    assert bench.sentence != ""
    bench.undo()
    bench.undo()
    assert bench.state is grown.state


def test_dwells_alone_and_a_file_twice_are_refused(several, tmp_path):
    bench = Workbench(tmp_path)
    bench.load_several([several / "dwells.csv"])
    assert "dwells alone show no motion" in bench.sentence
    bench.load(several / "run0.csv")
    bench.include([several / "run0.csv"])
    assert "once more" in bench.sentence
    assert len(bench.state.runs) == 1


def test_columns_that_are_alike_are_mapped_once(files, tmp_path):
    for name in ("one.csv", "two.csv"):
        text = (files / "odd.csv").read_text()
        (tmp_path / name).write_text(text if name == "one.csv" else text.rstrip().rpartition("\n")[0] + "\n")
    (tmp_path / "home").mkdir()
    bench = Workbench(tmp_path / "home")
    bench.load_several([tmp_path / "one.csv", tmp_path / "two.csv"])
    run = bench.state.run
    assert run.problem
    chosen = [
        mapping.Choice("stamp", "time", "s"),
        mapping.Choice("sensor", "accel", "m/s^2"),
        mapping.Choice("scale", "position", "mm"),
    ]
    bench.declare(mapping.sidecar_from(mapping.text_of(run.file, run.sidecar, run.template), chosen))
    assert bench.sentence == ""
    assert [entry.problem for entry in bench.state.runs] == ["", ""]
    assert roles(bench) == [("fit", True), ("fit", False)]
    mapped = bench.state
    third = tmp_path / "three.csv"
    third.write_text((files / "odd.csv").read_text().rsplit("\n", 3)[0] + "\n")
    bench.include([third])  # read as the others, and held out in the place of a part
    assert bench.sentence == ""
    assert [entry.problem for entry in bench.state.runs] == ["", "", ""]
    assert bench.state.runs[2].lender in ("one.csv", "two.csv")
    assert roles(bench) == [("fit", False), ("fit", False), ("hold out", False)]
    bench.undo()
    bench.declare("[channels]\naccel = { column = 'nowhere', unit = 'm/s^2' }\n")
    assert "no column for position" in bench.sentence
    assert bench.state is mapped


def test_sidecars_find_their_files(tmp_path):
    def dropped(*names):
        paths = [tmp_path / name for name in names]
        for path in paths:
            path.write_text(path.name)
        sidecars = [path for path in paths if path.suffix == ".toml"]
        return [p.name for p in files.beside([p for p in paths if p not in sidecars], sidecars)]

    assert dropped("a.csv", "b.csv", "rig.toml", "a.toml") == []
    assert [(tmp_path / name).read_text() for name in ("a.toml", "b.toml")] == ["a.toml", "rig.toml"]
    assert dropped("c.csv", "x.toml", "y.toml") == ["x.toml", "y.toml"]


def test_recordings_that_disagree_are_seen_and_those_that_agree_are_not():
    # p is multiplied by the number of parameters; the alarm rate at 1e-3 is that of one pair of recordings.
    def record(seed, scale):
        rng = np.random.default_rng(seed)
        truth = {"bias": 0.05, "scale_factor": scale}
        return ac.simulate("interleaved", seconds=12.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording

    from accelcal.verbs import run_values

    for scale, agree in ((0.01, True), (0.012, False)):
        pair = [record(1, 0.01), record(2, scale)]
        result = run_values(ac.fit(pair), pair)
        at = result.parameters.index("scale_factor")
        assert (result.p_values[at] > 1e-3) == agree
        assert np.abs(result.value[1, at] - scale) < 5.0 * result.std[1, at]
    with pytest.raises(ValueError, match="two recordings or more"):
        run_values(ac.fit(pair[:1]), pair[:1])


def test_the_schema_names_every_role():
    from accelcal.app.state import ROLES, StoredRun

    assert json.loads(json.dumps(StoredRun.model_json_schema()))["properties"]["role"]["enum"] == list(ROLES)
