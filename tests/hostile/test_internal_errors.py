"""Whatever is raised ends as one sentence; what is not for users leaves a report, which holds none of their data."""

from __future__ import annotations

import ast
import json
import math
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal import io
from accelcal._support import errors
from accelcal.app import tasks
from accelcal.app.workbench import Workbench
from accelcal.cli import app, write_recording
from accelcal.data import quality
from accelcal.data.recording import RecordingError
from accelcal.data.units import quantity
from accelcal.simulation import ADXL105_RIG

SECRET = "4.2424242"
LIBRARIES = errors._libraries()


class PanicException(BaseException):
    """As the compiled core raises it where it panics: no `Exception`."""


def deep(n: int) -> int:
    """A recursion without end."""
    return deep(n + 1)


FOREIGN: dict[str, Callable[[], object]] = {
    "ZeroDivisionError": lambda: eval("1 / 0", {}),
    "OverflowError": lambda: eval("math.exp(1e9)", {"math": math}),
    "KeyError": lambda: json.loads("{}")[SECRET],
    "IndexError": lambda: np.zeros(3)[int("7")],
    "TypeError": lambda: len(json.loads(SECRET)),
    "JSONDecodeError": lambda: json.loads(SECRET + "x"),
    "LinAlgError": lambda: np.linalg.inv(np.zeros((2, 2))),
    "AttributeError": lambda: json.loads(SECRET).absent,
    "MemoryError": lambda: np.zeros(10**17),
    "ModuleNotFoundError": lambda: __import__("absent_module"),
}


def raising(kind: str) -> Callable[..., object]:
    """A function whose innermost frame is no file of the user: as if a library had raised."""
    if kind == "RecursionError":
        source, names = "def f(*a, **k): return f()", {}
    elif kind == "PanicException":
        source, names = "def f(*a, **k): raise error('" + SECRET + "')", {"error": PanicException}
    else:
        source, names = "def f(*a, **k): return call()", {"call": FOREIGN[kind]}
    exec(compile(source, "<library>", "exec"), names)
    return names["f"]  # type: ignore[return-value]


@pytest.fixture
def here(tmp_path, monkeypatch):
    (tmp_path / "reports").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "reports"))
    simulation = ac.simulate(
        "tones", seconds=5.0, rig=ADXL105_RIG, parameters={"bias": 0.05}, rng=np.random.default_rng(1)
    )
    write_recording(simulation.recording, tmp_path / "run.csv")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(autouse=True)
def _tests_are_no_user_code(monkeypatch):
    monkeypatch.setattr(errors, "_libraries", lambda: (*LIBRARIES, str(Path(__file__).parent)))


def ended(*arguments: str) -> int:
    with pytest.raises(SystemExit) as done:
        app(list(arguments))
    return int(done.value.code or 0)


@pytest.mark.parametrize("kind", [*FOREIGN, "RecursionError", "PanicException"])
def test_an_error_of_accelcal_is_one_sentence_and_a_report(here, monkeypatch, capsys, kind):
    monkeypatch.setattr(quality, "summarise", raising(kind))
    monkeypatch.setattr("sys.argv", ["accelcal", "check", "run.csv"])
    assert ended("check", "run.csv") == 70
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert printed.err.startswith("accelcal: this is an error of accelcal: ")
    assert ("memory" in printed.err) == (kind == "MemoryError")
    (report,) = (here / "reports").iterdir()
    assert str(report) in printed.err
    text = report.read_text()
    assert "command: accelcal check run.csv" in text
    for words in ("python: 3.", "numpy: ", kind, "accelcal/cli/data.py:"):
        assert words in text, words
    assert SECRET not in text + printed.err
    assert len(text) < 30_000


def test_reports_are_never_written_over_and_find_another_place(here, monkeypatch, capsys):
    monkeypatch.setattr(quality, "summarise", raising("KeyError"))
    for _ in range(3):
        assert ended("check", "run.csv") == 70
    assert len(list((here / "reports").iterdir())) == 3
    monkeypatch.setattr("tempfile.tempdir", str(here / "absent"))
    assert ended("check", "run.csv") == 70
    assert len(list(here.glob("accelcal-error-*.txt"))) == 1
    monkeypatch.setattr(errors, "_folders", lambda: iter([str(here / "absent")]))
    assert ended("check", "run.csv") == 70
    assert "no folder accepts a report of it" in capsys.readouterr().err


@pytest.mark.parametrize("short", [MemoryError(), ImportError("_core.so: failed to map segment from shared object")])
def test_a_report_that_finds_no_memory_either_costs_no_sentence(monkeypatch, short):
    def without_memory(*_: object) -> object:
        raise MemoryError

    monkeypatch.setattr(errors, "_report", without_memory)
    monkeypatch.delitem(sys.modules, "accelcal._core")
    monkeypatch.setitem(sys.modules, "accelcal._core", None)  # importing it fails
    message = errors.sentence(short)
    assert "it asked for more memory than there is" in message
    assert message.endswith("no folder accepts a report of it")
    assert "memory" not in errors.sentence(ImportError("no module"))  # the twin


def raise_own() -> None:
    """What accelcal raises on purpose where it has no class of its own for it."""
    ac.simulate("tones", seconds=-1.0, rig=ADXL105_RIG, parameters={}, rng=np.random.default_rng(1))


@pytest.mark.parametrize(
    ("raised", "for_user"),
    [
        (raise_own, True),
        (lambda: quantity("1 nonsense", "time"), True),
        (lambda: io.load("absent.csv"), True),
        (lambda: Path("absent").read_text(), True),
        (lambda: ac.load_model("absent.json"), True),
        (lambda: math.sqrt(float("-1")), False),
        (lambda: np.zeros(3).reshape(2, 2), False),
        (lambda: "\ud800".encode(), False),
        (lambda: int("x"), False),
    ],
)
def test_what_accelcal_raises_on_purpose_is_for_users_and_nothing_else(tmp_path, monkeypatch, raised, for_user):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((ValueError, OSError)) as caught:
        raised()
    assert errors.is_for_user(caught.value) is for_user


def test_a_value_error_that_a_function_of_accelcal_lets_through_is_its_error():
    namespace: dict[str, object] = {"math": math, "Own": ac.AccelcalError}
    name = str(errors.PACKAGE / "made_up.py")
    exec(
        compile("def f(x):\n    return math.sqrt(x)\ndef g(x):\n    raise Own('x: expected 1')\n", name, "exec"),
        namespace,
    )
    for function, for_user in (("f", False), ("g", True)):
        with pytest.raises(ValueError, match=r"x: expected 1|math domain error") as caught:
            namespace[function](-1.0)  # type: ignore[operator]
        assert errors.is_for_user(caught.value) is for_user


def test_every_error_that_accelcal_words_derives_from_its_base() -> None:
    bare, classes = [], []
    for path in sorted(errors.PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
                name, codes = ast.unparse(node.exc.func), ast.unparse(node.exc.args[0]).startswith("errno.")
                if name in ("ValueError", "ImportError") or (name == "OSError" and not codes):
                    bare.append(f"{path.name}:{node.lineno}")
            if isinstance(node, ast.ClassDef) and "ValueError" in map(ast.unparse, node.bases):
                classes.append(node.name)
    # The tables of thresholds are read by developers, and their module imports nothing.
    assert {place.partition(":")[0] for place in bare} == {"policy.py"}
    assert classes == ["AccelcalError"]


def test_an_effect_of_the_user_that_fails_is_named_by_its_line(here, monkeypatch, capsys):
    monkeypatch.setattr(errors, "_libraries", lambda: LIBRARIES)
    effect = here / "own.py"
    effect.write_text("def f(*a, **k):\n    return 1 // 0\n")
    names: dict[str, object] = {}
    exec(compile(effect.read_text(), "own.py", "exec"), names)
    monkeypatch.setattr(quality, "summarise", names["f"])
    assert ended("check", "run.csv") == 3
    err = capsys.readouterr().err
    assert err == "accelcal: own.py, line 2: ZeroDivisionError: integer division or modulo by zero; change this line\n"
    assert not list((here / "reports").iterdir())


@pytest.mark.parametrize("kind", FOREIGN)
def test_nothing_ends_in_silence_in_the_workbench(here, monkeypatch, kind):
    bench = Workbench(here / "bench")
    monkeypatch.setattr(tasks, "marks", raising(kind))
    bench.load(here / "run.csv")
    assert bench.sentence.startswith("this is an error of accelcal: ")
    assert bench.job is None
    (report,) = (here / "reports").iterdir()
    assert str(report) in bench.sentence
    assert SECRET not in report.read_text()


def test_own_words_reach_the_workbench_unchanged(here, monkeypatch):
    bench = Workbench(here / "bench")
    bench.load(here / "absent.csv")
    assert re.search("absent.csv: there is no such file", bench.sentence)
    assert not list((here / "reports").iterdir())


def test_errors_of_worker_processes_keep_their_kind():
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        for call, for_user in ((raise_own, True), (raise_foreign, False), (raise_recording_error, True)):
            error = pool.submit(call).exception()
            assert error is not None
            assert errors.is_for_user(error) is for_user, call


def raise_foreign() -> None:
    """What a library raises."""
    math.sqrt(float("-1"))


def raise_recording_error() -> None:
    """A class of accelcal."""
    raise RecordingError("run.csv: expected more rows")


def test_the_report_is_for_its_owner_alone(here):
    place = errors.write_report(KeyError(SECRET), ["accelcal"])
    assert place is not None
    assert os.stat(place).st_mode & 0o077 == 0
