"""The workbench without a browser: its numbers are the library's, and no action leaves a half-done state."""

import asyncio
import shlex
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import accelcal as ac
from accelcal import io, verbs
from accelcal.app import mapping, script, tasks, widgets, workbench
from accelcal.app.screens import data as data_screen, files as files_screen, improvement
from accelcal.app.state import Refused, State
from accelcal.app.workbench import Busy, Workbench
from accelcal.calibration.export import Laboratory, calibrate, draft, header, module
from accelcal.cli import app as command_line
from accelcal.diagnosis.search.confounding import Weights
from accelcal.estimation.estimate import estimate
from accelcal.plots.residuals import before_after
from accelcal.results import json as results_json, model_file
from tests.commands import accelcal, python

from .conftest import sagging, with_delay


@pytest.fixture
def bench(tmp_path):
    (tmp_path / "home").mkdir()
    return Workbench(tmp_path / "home")


@pytest.fixture(scope="module")
def grown(files, tmp_path_factory):
    """Return a workbench on the hidden cubic, with base and + cubic; tests must leave it as it is."""
    bench = Workbench(tmp_path_factory.mktemp("grown"))
    bench.load(files / "cubic.csv")
    bench.fit()
    bench.diagnose()
    bench.add("cubic")
    bench.diagnose()
    assert bench.sentence == ""
    return bench


def test_numbers_are_those_of_the_library(grown, files):
    data = ac.load(files / "cubic.csv")
    a, b = grown.state.run.held_out
    train, unseen = data.without((a, b)), data.part(a, b)
    base = estimate(ac.Model.linear(), train)
    cubic = verbs.add(base, train, "cubic")
    compared = ac.compare([base, cubic], unseen)
    for step, fit, evaluation in zip(grown.state.path, (base, cubic), compared, strict=True):
        assert model_file.to_dict(step.fit) == model_file.to_dict(fit)
        assert step.heldout.to_json() == evaluation.to_json()
    assert b - a == pytest.approx(verbs.HELD_OUT * 20.0, abs=0.01)  # rounded to a millisecond, ends of the channels


def test_the_held_out_error_falls_to_the_noise(grown):
    before, after = (s.heldout for s in grown.state.path)
    # Windows of 1 s: the held-out 12 s hold a dozen that do not overlap, so their rms is known to a fifth.
    assert after.coast_rms[1.0] < 0.3 * before.coast_rms[1.0]
    assert after.coast_rms[1.0] < 1.6 * after.coast_floor[1.0]


def test_the_cubic_is_offered_first_and_nothing_after_it(grown):
    first, last = (grown.diagnoses[(s.key, 0)] for s in grown.state.path)
    near, _, _ = improvement.offered(first)
    assert near[0].effect == "cubic"
    assert near[0].significant
    assert last.verdict == "adequate"
    assert improvement.offered(last)[:2] == ([], [])
    assert improvement.found_in_noise(grown.state, last) == []
    assert last.table("limits").cells[1][0][0] == "quadratic"


def test_a_step_is_drawn_before_and_after_on_one_scale(grown):
    after = grown.state.step.heldout
    drawn = before_after(grown.before(), after, grown.state.step.change.label)
    sizes = [float(panel.title.partition(": ")[2].removesuffix(" σ")) for panel in drawn.panels]
    assert sizes[0] > 20.0
    assert sizes[1] < 4.5  # twelve bins of noise reach that once in 10 000 records
    worst = next(bins for bins in grown.before().bins if bins.variable == "acceleration")  # a cubic is a function of it
    assert sizes[0] == pytest.approx(np.abs(worst.score).max(), abs=0.05)
    assert drawn.headline == f"+ cubic: the residual against acceleration goes from {sizes[0]} σ to {sizes[1]} σ"
    assert drawn.panels[0].y.range == drawn.panels[1].y.range
    back = before_after(after, grown.before(), "− cubic")  # the twin: an effect that is taken away
    assert float(back.panels[1].title.split()[1]) > float(back.panels[0].title.split()[1])


def test_a_reversed_sensor_is_said_on_loading_and_declared_in_the_form(bench, files):
    recording = ac.load(files / "cubic.csv")
    path = bench.upload_folder() / "back.csv"
    path.write_bytes((files / "cubic.csv").read_bytes())
    sidecar = (files / "cubic.toml").read_text(encoding="utf-8")
    other = "normal" if recording.rig.mount == "reversed" else "reversed"
    wrong, right = (
        mapping.sidecar_from(
            sidecar, mapping.choices(mapping.columns_of(path), sidecar, ""), changes={data_screen.MOUNT: mount}
        )
        for mount in (other, recording.rig.mount)
    )
    io.sidecar_of(path).write_text(wrong, encoding="utf-8")
    bench.load(path)
    (message,) = bench.state.run.summary["suspect"]
    assert f'mount = "{recording.rig.mount}"' in message
    bench.declare(right)
    assert bench.state.run.summary["suspect"] == []


def test_names_under_the_bars_stay_apart_and_have_room(grown, monkeypatch):
    def under(letters):
        monkeypatch.setattr(widgets, "AXIS_LETTERS", letters)
        layout = widgets.falling(grown.state, "light").figure["layout"]
        lines = [name.split("<br>") for name in layout["xaxis"]["ticktext"]]
        return max(map(len, lines)), max(len(line) for several in lines for line in several), layout["margin"]["b"]

    (few, long, low), (many, short, deep) = under(200), under(30)
    assert few < many
    assert short <= 15 < long
    assert deep - low == 16 * (many - few)


def test_what_a_sidecar_is_for_depends_on_what_has_been_loaded_meanwhile(tmp_path):
    sidecar = tmp_path / "run.toml"
    sidecar.write_text("[columns]\n", encoding="utf-8")
    actions = []
    bench = SimpleNamespace(state=SimpleNamespace(file=None, opened=None), declare="declare", refuse=actions.append)

    async def idle():
        bench.state.file = tmp_path / "run.csv"  # it was being read

    async def act(action, *args, waits):
        actions.append(action)

    asyncio.run(files_screen.used(SimpleNamespace(bench=bench, idle=idle, act=act), [sidecar], more=False))
    assert actions == ["declare"]


def test_a_name_has_a_nearest_rival_and_confounded_effects_have_each_other(grown):
    result = grown.diagnoses[(grown.state.path[0].key, 0)]
    best, other = result.scan.candidates[:2]

    def judged(verdict, *members):
        pair = [
            replace(c, gain=gain, log_evidence=0.5 * gain, weights=dict.fromkeys(members or (c.effect,), Weights()))
            for c, gain in ((best, 900.0), (other, 700.0))
        ]
        scan = replace(result.scan, candidates=tuple(pair), detected=result.scan.detected[-1:])
        return replace(result, verdict=verdict, scan=scan)

    named, tied = judged("named"), judged("tied", best.effect, other.effect)
    assert improvement.badge(named) == ("An effect is missing", "found")
    first, rival = improvement.cards(named)
    nearest = f"Its nearest rival is {rival.title}, worse by 100 in log-evidence."
    assert (first.rivals, first.nearest, rival.nearest) == ((), nearest, "")
    assert improvement.badge(tied) == ("Confounded effects", "found")
    first, rival = improvement.cards(tied)
    assert (first.rivals, first.nearest) == ((rival.title,), "")
    last = grown.diagnosis
    assert improvement.badge(last) == ("No effect is missing", "good")
    assert improvement.badge(replace(last, verdict="unexplained"))[1] == "bad"


def test_nothing_is_offered_where_nothing_is_missing(bench, files):
    # False-alarm rate of a record: alpha = 0.005; its sister is the test above.
    bench.load(files / "null.csv")
    bench.fit()
    bench.diagnose()
    assert bench.diagnosis.verdict == "adequate"
    assert not any(card.significant for card in improvement.cards(bench.diagnosis))
    assert improvement.found_in_noise(bench.state, bench.diagnosis) == []


def test_undo_redo_remove_and_branch(bench, files):
    bench.load(files / "cubic.csv")
    bench.fit("cubic")
    both = bench.state
    bench.drop("quadratic")
    assert bench.state.step.fit.model.added == ("cubic",)
    assert bench.state.step.change.label == "− quadratic"
    bench.undo()
    assert bench.state is both
    bench.redo()
    assert bench.state.step.fit.model.added == ("cubic",)
    bench.look_at(both.current)
    bench.drop("cubic")
    base, *branches = bench.state.steps
    assert {s.parent for s in branches} == {base.key}
    assert [s.change.label for s in bench.state.path] == ["base", "− cubic"]
    before = bench.state
    bench.drop("nothing")
    assert "not an added effect" in bench.sentence
    assert bench.state is before


def test_a_parameter_is_held_and_released(grown, files, tmp_path):
    bench = Workbench(tmp_path)
    bench.state = grown.state
    bench._keys = iter(range(100, 200))
    bench.freeze("bias", 0.04)
    held = bench.state.step.fit
    assert (held["bias"].value, held["bias"].std) == (0.04, 0.0)
    bench.release("bias")
    assert bench.state.step.fit["bias"].value == pytest.approx(grown.state.step.fit["bias"].value, abs=1e-7)
    bench.freeze("nonsense", 1.0)
    assert bench.sentence == "'nonsense' is not a parameter of this model"


def test_another_division_begins_models_anew_and_undo_brings_them_back(grown, tmp_path):
    bench = Workbench(tmp_path)
    bench.state = grown.state
    bench.exclude(10.0, 5.0)
    assert bench.state.run.excluded == ((5.0, 10.0),)
    assert bench.state.steps == ()
    t = bench.state.train[0].position.t
    assert not np.any((t >= 5.0) & (t <= 10.0))
    bench.hold_out(0.0, 12.0)
    assert bench.state.train[0].position.t[0] > 12.0
    t = bench.state.unseen[0].position.t
    assert not np.any((t >= 5.0) & (t <= 10.0))  # the excluded stretch is not used for validation either
    bench.use_again(0)
    t = bench.state.unseen[0].position.t
    assert np.any((t >= 5.0) & (t <= 10.0))
    assert t[-1] == pytest.approx(12.0, abs=0.01)
    for _ in range(3):
        bench.undo()
    assert bench.state is grown.state
    bench.hold_out(-5.0, 100.0)
    assert bench.state is grown.state
    assert "nothing is left" in bench.sentence
    bench.hold_out(50.0, 60.0)
    assert "outside the used range" in bench.sentence


def test_a_hole_in_the_middle_makes_no_effect(grown, tmp_path):
    # False-alarm rate of a record: alpha = 0.005; the sister is the cubic, which is seen around the hole.
    bench = Workbench(tmp_path)
    bench.state = grown.state
    bench.exclude(8.4, 18.5)
    bench.fit()
    bench.diagnose()
    assert bench.diagnosis.effects[0] == "cubic"
    bench.add("cubic")
    bench.diagnose()
    assert bench.diagnosis.verdict == "adequate"


def test_a_whole_recording_can_be_held_out(grown, files, tmp_path):
    bench = Workbench(tmp_path)
    bench.state = grown.state
    bench.include([files / "other.csv"])
    assert [step.fit for step in bench.state.steps] == [step.fit for step in grown.state.steps]
    assert [heldout.recording for heldout in bench.state.step.heldouts] == ["cubic.csv", "other.csv"]
    bench.fit_whole()
    bench.fit()
    assert bench.state.step.heldout.recording == "other.csv"
    expected = ac.compare(estimate(ac.Model.linear(), ac.load(files / "cubic.csv")), ac.load(files / "other.csv"))[0]
    assert bench.state.step.heldout.coast_rms == expected.coast_rms


def test_a_mechanism_takes_the_place_of_a_process_whose_path_is_shown(bench, tmp_path):
    bench.load(sagging(tmp_path / "sag.csv", seconds=40))
    bench.fit()
    assert bench.state.step.moving == ()  # nothing of the base moves
    bench.add("scale_gauss_markov")
    (path,) = bench.state.step.moving
    assert path.followers[0].mechanism in ("scale_factor_follows_abs_a", "scale_factor_follows_a2")
    bench.add("scale_factor_follows_abs_a")
    (mechanism,) = bench.state.step.moving
    assert mechanism.followers == ()
    assert bench.state.step.fit.model.added == ("scale_factor_follows_abs_a",)
    base, random = (step.heldout.systematic.rms for step in (bench.state.steps[0], bench.state.steps[1]))
    last = bench.state.step.heldout.systematic.rms
    assert last < 0.3 * min(base, random)
    assert widgets.labelled(bench.state.step) == "+ scale factor follows |a|"
    (tmp_path / "s.accelcal").write_bytes(bench.session())
    bench.open(tmp_path / "s.accelcal")
    if bench.state.opened is not None:
        bench.give([tmp_path / "sag.csv", tmp_path / "sag.toml"])
    assert bench.sentence == ""
    assert [len(step.moving) for step in bench.state.path] == [0, 1, 1]
    assert bench.state.step.moving[0].mean == pytest.approx(mechanism.mean, rel=1e-6)


def test_an_own_formula_becomes_a_candidate(bench, files):
    bench.load(files / "cubic.csv")
    bench.fit()
    bench.own_effect("my_cubic_law", "a**3", "(m/s²)⁻²", "output")
    bench.diagnose()
    assert "my_cubic_law" in {c.effect for c in bench.diagnosis.scan.candidates}
    bench.add("my_cubic_law")
    assert bench.state.step.fit["my_cubic_law"].value == pytest.approx(4e-3, rel=0.01)  # truth; 1 sigma is 0.1 %
    before = bench.state
    bench.own_effect("evil", "__import__('os').system('true')", "1", "output")
    assert "allowed are numbers" in bench.sentence
    assert bench.state is before


@pytest.mark.parametrize("name", ["bad.csv", "binary.csv"])
def test_a_bad_file_gets_the_sentence_of_the_command_line(bench, files, name):
    upload_folder = bench.upload_folder()
    path = bench.upload_path(name, upload_folder)
    path.write_bytes((files / name).read_bytes())
    done = accelcal("check", name, cwd=upload_folder)
    assert done.returncode == 3
    bench.load(path)
    message = bench.state.run.problem if bench.state.run else bench.sentence
    assert message == done.stderr.strip().removeprefix("accelcal: ")
    assert bench.state.recording is None


def test_columns_are_mapped_by_hand(bench, files):
    bench.load(files / "odd.csv")
    assert "no column for accel" in bench.state.run.problem
    text = mapping.text_of(bench.state.file, bench.state.run.sidecar, bench.state.run.template)
    chosen = [
        mapping.Choice("stamp", "time", "s"),
        mapping.Choice("sensor", "accel", "m/s^2"),
        mapping.Choice("scale", "position", "mm"),
    ]
    bench.declare(mapping.sidecar_from(text, chosen))
    assert bench.sentence == bench.state.run.problem == ""
    original = io.load(files / "other.csv")
    np.testing.assert_allclose(bench.state.recording.position.y, original.position.y, atol=1e-11)  # nine digits of mm
    assert not io.sidecar_of(files / "odd.csv").exists()  # what the user chose stays in the folder of the workbench
    twice = [mapping.Choice("stamp", "time", "s"), mapping.Choice("sensor", "time", "s")]
    with pytest.raises(ac.RecordingError, match=r'"stamp" and "sensor" are both time'):
        mapping.sidecar_from(text, twice)


def test_an_uploaded_name_cannot_leave_its_drawer(bench):
    upload_folder = bench.upload_folder()
    for name in (
        "../../etc/cron.csv",
        "..\\..\\x.csv",
        "/abs/y.csv",
        "....//z.csv",
        ".hidden.csv",
        "a\0b.csv",
        "~/q.csv",
    ):
        path = bench.upload_path(name, upload_folder)
        assert path.parent == upload_folder
        assert path.resolve().parent == upload_folder.resolve()
    for name in ("x.py", "x.pkl", "x", "../..", ""):
        with pytest.raises(Refused, match="drop a recording"):
            bench.upload_path(name, upload_folder)
    assert bench.upload_folder() != upload_folder  # an older sidecar never lies beside a newer recording


def test_sizes_are_limited_with_a_sentence(bench, files, monkeypatch):
    monkeypatch.setattr(tasks, "MOST_BYTES", 1000)
    bench.load(files / "cubic.csv")
    assert "the limit of the workbench is 0 MB" in bench.sentence
    monkeypatch.setattr(tasks, "MOST_BYTES", 10**9)
    monkeypatch.setattr(tasks, "MOST_SAMPLES", 100)
    bench.load(files / "cubic.csv")
    assert "samples; the limit of the workbench is 100" in (bench.sentence or bench.state.run.problem)


def test_cancelled_work_leaves_no_trace_and_others_wait(bench, files):
    bench.load(files / "cubic.csv")
    before = bench.state
    begun, go_on = threading.Event(), threading.Event()

    def work(state, progress):
        progress(0.5)
        begun.set()
        go_on.wait(10.0)
        return State()

    thread = threading.Thread(target=bench._perform, args=("long work", work))
    thread.start()
    begun.wait(10.0)
    assert bench.job.title == "long work"
    assert bench.job.share == 0.5
    with pytest.raises(Busy, match="Please wait: long work"):
        bench.fit()
    bench.undo()
    assert bench.state is before  # not while something is under way
    bench.cancel()
    assert bench.job is None
    go_on.set()
    thread.join(10.0)
    assert bench.state is before
    assert bench.sentence == "Cancelled; nothing was changed."


def test_work_ends_when_it_is_cancelled(bench, files):
    bench.load(files / "cubic.csv")
    shares = []

    def work(state, progress):
        fit = estimate(ac.Model.linear(), state.train[0])

        def reported(share):
            shares.append(share)
            if share > 0.3:
                bench.cancel()
            progress(share)

        return verbs.diagnose(fit, state.train, progress=reported)

    bench._perform("diagnosing", work)
    assert max(shares) < 0.6  # it ended at the next report, long before the end


def test_workbenches_do_not_touch_each_other(files, tmp_path):
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    first, two = Workbench(tmp_path / "one"), Workbench(tmp_path / "two")
    first.load(files / "cubic.csv")
    two.load(files / "null.csv")
    first.fit()
    assert two.state.steps == ()
    two.fit()
    two.undo()
    assert first.state.step is not None
    assert first.state.recording.name == "cubic.csv"


def test_the_script_and_the_commands_give_the_same_numbers(grown, files, tmp_path):
    for name in ("cubic.csv", "cubic.toml"):
        (tmp_path / name).write_bytes((files / name).read_bytes())
    text = script.python(grown.state)
    done = python("-c", text, cwd=tmp_path, check=True)
    assert str(grown.state.step.heldout.coast_rms) in done.stdout
    assert "cubic was found" in done.stdout
    assert "nothing else is missing" in done.stdout
    assert model_file.to_dict(model_file.load(tmp_path / "model.json")) == model_file.to_dict(grown.state.step.fit)

    runner = CliRunner()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        for line in script.command_line(grown.state).splitlines():
            words_ = shlex.split(line)
            if words_[1] == "report":
                continue
            ran = runner.invoke(command_line, words_[1:])
            assert ran.exit_code == 0, (line, ran.output)
    # Written and read again as text: a CSV keeps all digits, so only the digests differ.
    reread = model_file.load(tmp_path / "m1.json")
    assert reread["cubic"].value == pytest.approx(grown.state.step.fit["cubic"].value, rel=1e-9)


def test_the_commands_bring_every_formula_of_the_users_own(bench, files, tmp_path):
    bench.load(files / "cubic.csv")
    bench.own_effect("lift_of_the_cable", "p * abs(p)", "1/s²/m", "output")
    bench.own_effect("law_of_the_cube", "a**3", "(m/s²)⁻²", "output")
    bench.fit()
    bench.add("law_of_the_cube")
    bench.add("lift_of_the_cable")
    assert bench.sentence == ""
    for name in ("cubic.csv", "cubic.toml"):
        (tmp_path / name).write_bytes((files / name).read_bytes())
    for entry in bench.state.own:
        (tmp_path / f"{entry.effect.name}.py").write_text(entry.file, encoding="utf-8")
    commands = script.command_line(bench.state).splitlines()
    assert [line.count("--effects-file") for line in commands] == [0, 0, 0, 0, 2, 2, 2, 2, 2]
    for line in commands:
        ran = accelcal(*shlex.split(line)[1:], cwd=tmp_path)
        assert ran.returncode == 0, (line, ran.stderr)
    with bench.catalogue():
        reread = model_file.load(tmp_path / "m2.json")
    for name in ("law_of_the_cube", "lift_of_the_cable"):
        assert reread[name].value == pytest.approx(bench.state.step.fit[name].value, rel=1e-9)  # through text and back


def test_model_and_report_are_downloaded(grown, tmp_path):
    path = tmp_path / "m.json"
    path.write_text(grown.model_text())
    assert model_file.load(path)["cubic"].value == grown.state.step.fit["cubic"].value
    page = grown.report()
    text = page.read_text()
    assert "cubic" in text
    assert "on a held-out part of the fitted recording" in text
    assert "another recording" not in text
    assert "cubic.csv (part)" in text
    assert grown.state.run.digest in text  # what sha256sum prints of the file
    assert "src=http" not in text.replace('"', "")


def test_exports_are_those_of_the_library(grown):
    calibration = calibrate(grown.state.step.fit)
    assert grown.export("C").read_text() == header(calibration, "sensor.h")
    assert grown.export("Rust").read_text() == module(calibration)
    assert grown.export("JSON").read_text() == model_file.dumps(results_json.content(calibration))
    assert grown.export("DCC").read_text() == draft(calibration, Laboratory()).text


def test_what_cannot_become_code_is_said(bench, grown, monkeypatch):
    fit = grown.state.step.fit
    fast = replace(fit, estimates=tuple(replace(e, value=-1.0) if e.name == "cubic" else e for e in fit.estimates))
    monkeypatch.setattr(workbench, "fitted", lambda state: replace(grown.state.step, fit=fast))
    assert bench.export("C") is None
    assert "not safely monotone" in bench.sentence


def test_the_example_has_something_to_find(bench):
    bench.example("stage")
    assert bench.state.recording.name == "example_stage.csv"
    assert bench.sentence == ""


def test_what_is_declared_reaches_every_file_that_shares_it_the_script_and_the_commands(bench, files, tmp_path):
    _, *rows = (files / "odd.csv").read_text().rstrip().split("\n")
    for name, part in (("one.csv", rows[:6000]), ("two.csv", rows[6000:])):
        (tmp_path / name).write_text("\n".join(["stamp,sensor,scale", *part]) + "\n")
    bench.load(tmp_path / "one.csv")
    chosen = [
        mapping.Choice("stamp", "time", "s"),
        mapping.Choice("sensor", "accel", "m/s^2"),
        mapping.Choice("scale", "position", "mm"),
    ]
    text = mapping.sidecar_from(bench.state.run.template, chosen)
    bench.declare(text)
    bench.include([tmp_path / "two.csv"])
    assert bench.state.runs[1].lender == "one.csv"
    bench.show(1)  # declared on either file, it is for both
    low_pass = mapping.LowPassEntry("RC", "500 Hz").changed(text)
    bench.declare(
        mapping.sidecar_from(text, chosen, changes={**low_pass, "rig.axis": "down", mapping.RESOLUTION: "2 um"})
    )
    assert bench.sentence == ""
    rigs = [run.recording.rig for run in bench.state.runs]
    assert {(rig.lowpass, rig.axis, rig.resolution) for rig in rigs} == {(ac.LowPass(500.0), "down", 2e-6)}
    (tmp_path / "one.toml").write_text(bench.state.runs[0].sidecar)  # what Export has as Sidecar (.toml)
    done = python(
        "-c", script.python(bench.state) + "print(*(run.rig for run in (run1, run2)))", cwd=tmp_path, check=True
    )
    assert done.stdout.count("cutoff=500") == 2
    assert [line.partition(" --rig ")[2].split()[0] for line in script.command_line(bench.state).splitlines()[:2]] == [
        "one.toml",
        "one.toml",
    ]
    bench.assign(1, "fit")
    bench.remove(0)  # the file that is left has what the other one lent
    assert (bench.sentence, bench.state.runs[0].lender) == ("", "")
    bench.declare_low_pass(200.0)
    assert bench.state.runs[0].recording.rig.lowpass == ac.LowPass(200.0)
    assert "run1" not in script.python(bench.state)
    for _ in range(3):
        bench.undo()
    fresh = Workbench(tmp_path / "fresh")
    fresh.folder.mkdir()
    (tmp_path / "one.toml").unlink()
    (tmp_path / "work.accelcal").write_bytes(bench.session())
    fresh.open(tmp_path / "work.accelcal")
    assert fresh.sentence == ""
    assert [run.recording.rig.lowpass for run in fresh.state.runs] == [ac.LowPass(500.0)] * 2


def test_a_lag_of_the_size_of_a_low_pass_is_declared_with_one_click(bench, tmp_path):
    bench.load(with_delay(tmp_path / "run.csv", cutoff=200.0))
    bench.exclude(2.0, 3.0)
    bench.fit()
    bench.add("cubic")
    assert improvement.undeclared_low_pass(bench.state) == 200.0
    before = bench.state
    bench.declare_low_pass(200.0)
    assert bench.sentence == ""
    assert bench.state.run.recording.rig.lowpass == ac.LowPass(200.0)
    assert [step.change.label for step in bench.state.path] == ["base", "+ cubic"]
    assert (bench.state.run.excluded, bench.state.run.held_out) == (((2.0, 3.0),), before.run.held_out)
    lag = bench.state.step.fit["time_offset"]
    assert before.step.fit["time_offset"].value == pytest.approx(1.0 / (2.0 * np.pi * 200.0), rel=0.02)
    assert abs(lag.value) < 0.02 * before.step.fit["time_offset"].value
    assert improvement.undeclared_low_pass(bench.state) is None
    bench.undo()
    assert bench.state is before


@pytest.mark.parametrize("shift", [0.0, 4e-4, -1e-4])
def test_no_low_pass_is_offered_where_the_output_leads_or_lags_less_than_the_sampling_shows(bench, tmp_path, shift):
    bench.load(with_delay(tmp_path / "run.csv", shift=shift))
    bench.fit()
    assert bench.state.step.fit["time_offset"].value == pytest.approx(-shift, abs=1e-5)
    assert improvement.undeclared_low_pass(bench.state) is None


def with_junk(path, jump, shaken):
    """A stage that is homed after a second, from a simulator of its own: before it the readings are absurd."""
    rng, t = np.random.default_rng(71), np.arange(24_000) / 1000.0
    p, a = np.zeros_like(t), np.zeros_like(t)
    for f, g in ((0.4, 0.6), (1.7, 2.1), (4.3, 4.0)):
        w, phase = 2.0 * np.pi * f, rng.uniform(0.0, 6.28)
        p, a = p + g / w**2 * np.sin(w * t + phase), a - g * np.sin(w * t + phase)
    u, z = 0.05 + 1.01 * a + 0.02 * rng.standard_normal(t.size), p + 1e-7 * rng.standard_normal(t.size)
    early = t < 1.0
    u[early], z[early] = np.where(shaken, 50.0 * rng.uniform(-1.0, 1.0, early.sum()), u[early]), z[early] + jump
    rows = "\n".join(f"{row[0]:.3f};{row[1]:.6f};{1e3 * row[2]:.6f}" for row in zip(t, u, z, strict=True))
    path.write_text(f"t;a;p\n{rows}\n")
    return path


@pytest.mark.parametrize(("jump", "shaken"), [(0.0, True), (0.0123, True), (0.0123, False)])
def test_junk_at_the_start_is_one_fault_with_one_click(bench, tmp_path, jump, shaken):
    bench.load(with_junk(tmp_path / "run.csv", jump, shaken))
    chosen = [
        mapping.Choice("t", "time", "s"),
        mapping.Choice("a", "accel", "m/s^2"),
        mapping.Choice("p", "position", "mm"),
    ]
    text = mapping.sidecar_from(bench.state.run.template, chosen, changes={"sensor.range": "49.99 m/s^2"})
    bench.declare(text)
    run = bench.state.run
    ((begin, end),) = {data_screen.spoilt(fault, run) for fault in run.marks.remarks} - {None}
    assert (begin, end) == (0.0, pytest.approx(1.0, abs=0.2))
    for fault in run.marks.remarks:
        assert "accelcal cut" not in widgets.remark_text(fault)
        assert "accelcal cut" not in fault.sentence or "accelcal cut run.csv --without" in fault.sentence
    messages = [finding["text"] for finding in run.summary["findings"]]
    assert any("probably saturated" in text for text in messages) == shaken
    bench.exclude(begin, end)
    assert bench.sentence == ""
    assert bench.state.run.marks.remarks == ()
    assert not any("probably saturated" in finding["text"] for finding in bench.state.run.summary["findings"])
    bench.use_again(0)
    assert [fault.code for fault in bench.state.run.marks.remarks] == [fault.code for fault in run.marks.remarks]
    # The twin: what the form says wrongly is said of the form, and no file is named that nobody made.
    bench.declare(text.replace("49.99 m/s^2", "fast"))
    assert "the form: sensor.range" in bench.state.run.problem
    assert ".toml" not in bench.state.run.problem
