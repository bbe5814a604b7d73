"""Killed, interrupted and terminated commands: no output half-written, nothing left after the next run."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pyarrow as pa
import pytest
import typer
from pyarrow import parquet

from accelcal import io
from accelcal._support.locks import scratch_folder
from accelcal.cli import app
from tests.hostile.case import LONG, case_rng, cases
from tests.hostile.writers import WRITERS, is_whole, make_inputs

DRIVER = str(Path(__file__).with_name("interrupted.py"))
SIGNALS = (signal.SIGKILL, signal.SIGINT, signal.SIGTERM)
OLD = b"old\n"
LIGHT = [name for name, writer in WRITERS.items() if not writer.heavy]
OFTEN = "fit", "improve", "live", "fleet"
EVERY = [name for k in range(200) for name in WRITERS if k < (200 if name in OFTEN else 40)]
"""Commands of the long run in turn, so that a part of it holds all of them."""
WRITING_OPTIONS = {"output", "c", "rust", "dcc", "plots", "figure", "store", "motion"}
MOST_IMPORTS = 1400
"""Modules that are looked for during a fit, about."""
counted: Counter[str] = Counter()


def run(folder: Path, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command line under `interrupted.py` to its end."""
    return subprocess.run(
        [sys.executable, DRIVER, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=600,
        env={**os.environ, **environment},
    )


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    make_inputs(folder)
    return folder


@pytest.fixture(scope="module")
def references(inputs, tmp_path_factory):
    """By command: moments at which it touches files, the time it takes, and its outputs; each is run when asked for."""
    results: dict[str, tuple[int, float, dict[str, bytes]]] = {}

    def find(name: str) -> tuple[int, float, dict[str, bytes]]:
        if name not in results:
            folder = tmp_path_factory.mktemp(name) / "w"
            shutil.copytree(inputs, folder)
            began = time.monotonic()
            done = run(folder, "file", "0", "0", str(folder), *absolute(name, folder))
            assert done.returncode == 0, done.stderr
            lasted = time.monotonic() - began
            outputs = {output: (folder / output).read_bytes() for output in WRITERS[name].outputs}
            results[name] = int(done.stderr.split()[-1]), lasted, outputs
        return results[name]

    return find


def absolute(name: str, folder: Path) -> list[str]:
    """Arguments of a command with whole paths of what it makes, by which the driver knows it."""
    outputs = {*WRITERS[name].outputs, "plots", "demo", "figures", "bare.csv"}
    return [str(folder / word) if word in outputs and word != name else word for word in WRITERS[name].arguments]


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_every_command_that_writes_is_among_them() -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    writing = {name for name, item in commands.items() if WRITING_OPTIONS & {option.name for option in item.params}}
    assert writing | {"init"} == set(WRITERS)


@pytest.mark.parametrize("number", cases(9, len(EVERY)))
def test_a_kill_leaves_old_or_new_and_nothing_else(number, inputs, references, tmp_path):
    rng = case_rng("kills", number)
    name = EVERY[number] if LONG else LIGHT[number % len(LIGHT)]
    sent = SIGNALS[int(rng.integers(3))]
    moments, lasted, outputs = references(name)
    folder, temporary = tmp_path / "w", tmp_path / "temporary"
    shutil.copytree(inputs, folder)
    temporary.mkdir()
    before, force = files(folder), list[str]()
    if rng.random() < 0.5 and name not in ("init", "dwells", "live"):  # these refuse to replace
        for output in outputs:
            (folder / output).parent.mkdir(exist_ok=True)
            (folder / output).write_bytes(OLD)
        force = ["--force"]  # which replaces what is there
    environment = {**os.environ, "TMPDIR": str(temporary)}
    exactly = rng.random() < 0.7  # else at a random time
    at = (str(int(rng.integers(1, moments + 1))), str(int(sent))) if exactly else ("0", "0")
    words = [sys.executable, DRIVER, "file", *at, str(folder), *absolute(name, folder), *force]
    child = subprocess.Popen(
        words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    if not exactly:
        time.sleep(rng.uniform(0.1, lasted))
        child.send_signal(sent)
    _, message = child.communicate(timeout=600)
    where = f"case {number}: {name}, {sent.name}, {at}, exit code {child.returncode}\n{message}"
    assert child.returncode in ((-sent, 128 + sent) if exactly else (0, -sent, 128 + sent)), where
    began = "interrupted;" in message or "terminated;" in message or child.returncode == 0 or sent == signal.SIGKILL
    if began:  # a signal before the first line of the package is Python's own
        assert "Traceback" not in message, where
    states = {}
    for output, reference in outputs.items():
        path = folder / output
        content = path.read_bytes() if path.exists() else None
        states[output] = "old" if content in (None, OLD) else "new"
        assert states[output] == "old" or is_whole(path, reference, grows=WRITERS[name].grows), where
    if WRITERS[name].together and (sent != signal.SIGKILL or child.returncode == 0):
        assert len(set(states.values())) == 1, f"{where}{states}"
    allowed = before | set(outputs) | {"fleet.sqlite", "fleet.sqlite-journal"}
    if sent != signal.SIGKILL:
        assert files(folder) <= allowed, where
        assert not files(temporary), where
    leftovers = len(files(folder) - allowed)
    # what the next run does before it writes
    for output in outputs:
        if (folder / output).parent.is_dir():
            io.atomic_write(folder / output, OLD)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tempfile.tempdir", str(temporary))
        with scratch_folder():
            pass
    assert files(folder) <= allowed, where
    assert not {path for path in files(temporary) if path.startswith("accelcal-")}, where
    counted[f"{sent.name} {'stopped' if child.returncode else 'came too late'}"] += 1
    counted["outputs new"] += "new" in states.values()
    counted["parts swept by the next run"] += leftovers
    print(f"{sum(counted[k] for k in counted if k.startswith('SIG'))} kills: {dict(counted)}; 0 half-written")


@pytest.mark.parametrize("number", cases(4, 60))
def test_an_interrupt_while_modules_are_imported_is_one_sentence(number, inputs, tmp_path):
    rng = case_rng("imports", number)
    at = 1 if number == 0 else int(rng.integers(1, MOST_IMPORTS))
    sent = signal.SIGTERM if number % 4 == 3 else signal.SIGINT
    if at == 1:
        sent = signal.SIGINT
    done = run(inputs, "import", str(at), str(int(sent)), "-", "fit", "run.csv")
    assert done.returncode in (128 + sent, 0), (at, done.stderr)
    assert "Traceback" not in done.stderr, (at, done.stderr)
    assert len(done.stderr.splitlines()) <= 1, (at, done.stderr)
    print(f"signal at import {at}: exit code {done.returncode}")


@pytest.mark.parametrize("number", cases(2, 60))
def test_an_interrupt_at_a_random_time_is_one_sentence(number, inputs):
    rng = case_rng("times", number)
    child = subprocess.Popen(
        [sys.executable, DRIVER, "import", "0", "0", "-", "fit", "run.csv"],
        cwd=inputs,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(rng.uniform(0.0, 3.0))
    child.send_signal(signal.SIGINT)
    _, message = child.communicate(timeout=600)
    assert child.returncode in (0, 130, -signal.SIGINT), message
    # Before the first line of the package an interrupt is Python's own, which may print a traceback of its start.
    assert "python/accelcal/" not in message, message
    print(f"{'Python itself was interrupted' if 'Traceback' in message else 'silent or one sentence'}")


def test_the_judge_sees_a_half_written_file(tmp_path):
    for name in ("a.json", "a.html", "a.svg", "a.png", "a.csv", "a.toml"):
        (tmp_path / name).write_bytes(b'{"schema": [1,')
        assert not is_whole(tmp_path / name, b'{"schema": [1, 2]}')


def test_the_judge_sees_a_recording_that_is_cut_off_or_not_the_beginning(tmp_path):
    path = tmp_path / "got.parquet"
    for rows in ([1.0, 2.0], [1.0], [2.0]):
        parquet.write_table(pa.table({"t": rows}), path)
        if len(rows) == 2:
            whole = path.read_bytes()
        assert is_whole(path, whole, grows=True) == (rows[0] == 1.0)
    path.write_bytes(whole[:-20])
    assert not is_whole(path, whole, grows=True)


IN_A_CALLBACK = """
import signal, sys, threading, time, weakref
from accelcal._support import stopping
start = threading.Thread.start
threading.Thread.start = lambda thread: (start(thread), time.sleep({busy}))
class Name: pass
def lost(_):
    signal.raise_signal(signal.SIGINT)
    for _ in range(10): pass
def command():
    name = Name()
    reference = weakref.ref(name, lost)
    del name
    time.sleep(20.0)
    print("went on")
sys.exit(stopping.run(command))
"""


@pytest.mark.parametrize("busy", [0.0, 0.2])
def test_an_interrupt_in_a_callback_whose_exceptions_python_drops_ends_the_command(busy: float) -> None:
    """Also where the interrupt comes again while a busy machine still runs what notices that it was dropped."""
    program = IN_A_CALLBACK.replace("{busy}", str(busy))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=15.0)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "accelcal: interrupted; no file was left half-written\n"
