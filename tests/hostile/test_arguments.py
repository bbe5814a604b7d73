"""Absurd arguments: a stated exit code and one sentence, soon; a pipe that nobody reads: silence and the usual code."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.cli import app, write_recording
from accelcal.estimation.estimate import estimate
from accelcal.results import model_file
from accelcal.simulation import ADXL105_RIG
from tests.hostile.case import LONG, case_rng

ABSURD = ("1e400", "1e12", "nan", "-1", "inf", "-inf", "1e-320", "0", "9" * 400, "1_000", "٣", "")
PATIENCE = 30
"""Processor time that a command has, s; a fit of the recordings here takes 2."""
PLAN = ["plan", "--seconds", "6", "--effects", "cubic", "--stroke", "0.2 m", "--vmax", "0.1 m/s", "--amax", "9 m/s^2"]
NUMBERS = {
    "simulate": ["--seconds", "--a-rms", "--bias", "--scale-factor", "--time-offset", "--cubic", "--missing", "--seed"],
    "plan": ["--seconds", "--stroke", "--vmax", "--amax"],
    "fit": ["--from", "--to", "--band", "--order", "--seed"],
    "cut": ["--only", "--without"],
    "dwells": ["--least", "--attitudes"],
    "improve": ["--max-effects"],
    "freeze": ["--at"],
    "fleet": ["--workers"],
    "live": ["--every", "--baud"],
    "app": ["--port"],
}
LASTING = {("plan", "--seconds", "1_000")}
"""A thousand seconds are no absurd length, and take a while."""
FEW = 2
"""Values of each option in the slice."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    here = tmp_path_factory.mktemp("runs")
    simulation = ac.simulate(
        "tones", seconds=6.0, rig=ADXL105_RIG, parameters={"bias": 0.05}, rng=np.random.default_rng(1)
    )
    write_recording(simulation.recording, here / "run.csv")
    model_file.save(estimate(ac.Model.linear(), simulation.recording), here / "m.json")
    return here


@pytest.fixture
def limited():
    """End a test that computes on and on."""

    def stop(number: int, frame: object) -> None:
        raise AssertionError(f"no end after {PATIENCE} s of processor time")

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, PATIENCE)
    yield
    signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    signal.signal(signal.SIGVTALRM, before)


def command(name: str, option: str, value: str) -> list[str]:
    words = {
        "simulate": ["simulate", "-o", "made.csv", "--motion", "tones", "--seconds", "2"],
        "plan": PLAN,
        "fit": ["fit", "run.csv", *(["--method", "aci"] if option == "--order" else [])],
        "cut": ["cut", "run.csv", "-o", "made.csv"],
        "dwells": ["dwells", "run.csv", "--yes"],
        "improve": ["improve", "run.csv", "--from", "1", "--to", "1.5"],
        "freeze": ["freeze", "m.json", "run.csv"],
        "fleet": ["fleet", "absent"],
        "live": [
            "live",
            "--rig",
            "run.toml",
            *(["--serial", "absent"] if option == "--baud" else ["--file", "run.csv"]),
        ],
        "app": ["app", "absent.csv"],
    }[name]
    given = {"--only": f"{value}:2", "--without": f"1:{value}", "--at": f"bias={value}"}.get(option, value)
    return [*words, f"{option}={given}"]


@pytest.mark.parametrize(
    "option", [(name, option) for name, options in NUMBERS.items() for option in options], ids=" ".join
)
@pytest.mark.usefixtures("limited")
def test_absurd_numbers_end_in_one_sentence(folder, tmp_path, monkeypatch, capsys, option):
    rng = case_rng(" ".join(option), 0)
    values = [value for value in ABSURD if (*option, value) not in LASTING]
    for value in values if LONG else rng.choice(values, FEW, replace=False).tolist():
        monkeypatch.chdir(tmp_path)
        for path in folder.iterdir():
            (tmp_path / path.name).write_bytes(path.read_bytes())
        with pytest.raises(SystemExit) as ended:
            app(command(*option, value))
        printed = capsys.readouterr()
        assert ended.value.code in (0, 2, 3, 4), (value, printed.err)
        assert "Traceback" not in printed.err
        assert "error of accelcal" not in printed.err
        written = tmp_path / "made.csv"
        if ended.value.code:
            assert printed.err.strip(), value
            assert not written.exists(), value
        elif written.exists():
            assert not any(word in written.read_text() for word in ("nan", "inf")), value
        written.unlink(missing_ok=True)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"seconds": 1e6}, "at most 20000000 are simulated"),
        ({"accel_rate": 1e9}, "at most 20000000 are simulated"),
        ({"position_rate": 1e9}, "at most 20000000 are simulated"),
        ({"accel_rate": 0.0}, "expected a finite length and rate above 0"),
        ({"accel_rate": float("nan")}, "expected a finite length and rate above 0"),
        ({"accel_phase": float("inf")}, "expected a finite length and rate above 0"),
        ({"parameters": {"cubic": float("nan")}}, "expected a finite number"),
        ({"parameters": {"cubic": 1e308}, "a_rms": 1e3}, "overflows"),
        ({"parameters": {"scale_factor": 1e308}}, "overflows"),
        ({"parameters": {"bias": 1e300}, "lsb": 1e-300}, "overflows"),
        ({"position_noise": 1e308}, "overflows"),
    ],
    ids=str,
)
def test_a_simulation_beyond_its_limits_is_refused(settings, message):
    given = {
        "seconds": 2.0,
        "rig": ADXL105_RIG,
        "parameters": {},
        "rng": np.random.default_rng(1),
    } | settings
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the sentence comes alone
        with pytest.raises(ValueError, match=message):
            ac.simulate("tones", **given)


def piped(words: list[str], folder: Path, reader: str) -> tuple[int, str]:
    """Exit code and stderr of a command whose output goes to `reader`."""
    child = subprocess.Popen(
        [sys.executable, "-m", "accelcal", *words], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert child.stdout is not None
    assert child.stderr is not None
    if reader == "head":
        child.stdout.read(1)
    child.stdout.close()
    message = child.stderr.read().decode()
    return child.wait(timeout=300), message


@pytest.mark.parametrize("reader", ["true", "head"])
@pytest.mark.parametrize("words", [["effects"], ["check", "run.csv", "--json"], ["--help"]], ids=" ".join)
def test_a_pipe_that_nobody_reads_ends_in_silence(folder, words, reader):
    code, message = piped(words, folder, reader)
    assert message == ""
    assert code in ((141,) if reader == "true" else (141, 0))  # what fits into the pipe was written before it closed


def test_a_standard_output_without_space_or_none_at_all_is_said(folder):
    with Path("/dev/full").open("wb") as full:
        words = [sys.executable, "-m", "accelcal", "check", "run.csv"]
        done = subprocess.run(words, cwd=folder, stdout=full, stderr=subprocess.PIPE, text=True, timeout=300)
    assert done.returncode == 3
    hint = "next: accelcal fit run.csv -o run.json\n"
    assert done.stderr == f"{hint}accelcal: the standard output cannot be written (No space left on device)\n"
    closed = f"{sys.executable} -m accelcal check run.csv >&-"
    done = subprocess.run(closed, shell=True, cwd=folder, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, hint)


def test_a_signal_that_is_ignored_stays_ignored(folder):
    code = "import signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
    code += "from accelcal._support import stopping\n"
    code += "import os; sys.exit(stopping.run(lambda: os.kill(os.getpid(), signal.SIGHUP)))\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, env=dict(os.environ), timeout=60)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_what_fails_because_of_a_signal_is_no_error_of_accelcal(name, tmp_path):
    # An import that a signal cuts off leaves half a module behind, on which the next line fails.
    code = f"import os, signal, sys\nsignal.signal(signal.{name}, signal.default_int_handler)\n"
    code += "from accelcal._support import stopping\nfrom accelcal.cli.common import with_exit_codes\n"
    code += "def work():\n    try:\n"
    code += f"        os.kill(os.getpid(), signal.{name})\n"
    code += "    except BaseException:\n        raise AttributeError('array') from None\n"
    code += "sys.exit(stopping.run(with_exit_codes(work)))\n"
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, timeout=60)
    assert done.returncode == 128 + getattr(signal, name)
    assert done.stderr.count("\n") == 1
    assert "error of accelcal" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_that_a_library_swallows_still_ends_the_command(name):
    code = f"import os, signal, sys\nsignal.signal(signal.{name}, signal.default_int_handler)\n"  # nohup ignores some
    code += "from accelcal._support import stopping\ndef work():\n    try:\n"
    code += f"        os.kill(os.getpid(), signal.{name})\n"
    code += "    except BaseException:\n        raise ImportError('a library could not be imported') from None\n"
    code += "sys.exit(stopping.run(work))\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 128 + getattr(signal, name)
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr


def test_a_working_folder_that_was_removed_is_said(folder, tmp_path):
    for words in (["check", "run.csv"], ["fit", str(folder / "run.csv"), "-o", "m.json"], ["simulate", "-o", "x.csv"]):
        (tmp_path / "gone").mkdir()
        code = f"import os, sys; os.rmdir(os.getcwd()); sys.argv = {['accelcal', *words]!r}\n"
        code += "from accelcal.cli import main; main()"
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path / "gone", capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 3, done.stderr
        named = "run.csv: there is no such file" if words[0] == "check" else "the folder in which the command runs was"
        assert named in done.stderr
        assert "Errno" not in done.stderr


def test_a_file_whose_name_is_not_utf8_is_fitted_and_refused_by_a_fleet(folder, tmp_path):
    place = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xfe.csv"))
    shutil.copy(folder / "run.csv", place)
    shutil.copy(folder / "run.toml", place.with_suffix(".toml"))
    environment = {**os.environ, "TMPDIR": str(tmp_path)}

    def run(*words):
        words = [sys.executable, "-m", "accelcal", *words]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, env=environment, timeout=300)
        return done.returncode, done.stdout.decode(), done.stderr.decode()

    code, _, message = run("fit", place.name, "-o", "m.json")
    assert code == 0, message
    assert json.loads((tmp_path / "m.json").read_text())["runs"][0]["name"] == "\\udcff\\udcfe.csv"
    assert run("compare", "m.json", place.name, "--json")[0] == 0
    assert run("report", "m.json", place.name, "-o", "r.html")[0] == 0
    assert "\\udcff\\udcfe.csv" in (tmp_path / "r.html").read_text(encoding="utf-8")
    code, _, message = run("fleet", ".", "--store", "f.sqlite")
    assert code == 3
    assert "this name is not UTF-8" in message
    place.rename(tmp_path / "run.csv")  # the twin
    shutil.copy(folder / "run.toml", tmp_path / "run.toml")
    assert run("fleet", ".", "--store", "g.sqlite")[0] == 0
