"""Effects of a user's file that never return: a signal ends the command with its exit code and one sentence."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from accelcal._support import process, stopping

from .workbench import descendants, has_ended

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that can be split")
HEAD = """
from pathlib import Path
from accelcal.effects import effect
@effect("own", unit="1", symbol="c", scale=1.0)
def own(s):
    x = 1
    Path(__file__).with_suffix(".note").touch()
"""
ENDLESS = {
    "loops": "    while True:\n        x += 1\n",
    "catches": """
    while True:
        try:
            while x:
                x += 1
        except BaseException:
            pass
""",
    "ignores": "    import signal\n    signal.signal(signal.SIGINT, signal.SIG_IGN)\n    while True:\n        x += 1\n",
    "holds the interpreter": "    return sum(range(10**13))\n",
}


def begun(folder: Path, body: str) -> subprocess.Popen[str]:
    """A command that is in the midst of the effect."""
    (folder / "own.py").write_text(HEAD + body)
    child = subprocess.Popen(
        [
            *(sys.executable, "-c", "from accelcal.cli import main; main()"),
            *("effects", "--effects-file", str(folder / "own.py")),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not (folder / "own.note").exists():
        assert child.poll() is None, child.stderr.read()
        time.sleep(0.02)
    return child


@pytest.mark.parametrize("body", ENDLESS.values(), ids=ENDLESS)
def test_ctrl_c_ends_an_effect_that_never_returns(tmp_path: Path, body: str) -> None:
    child = begun(tmp_path, body)
    below = descendants(child.pid)
    child.send_signal(signal.SIGINT)
    _, message = child.communicate(timeout=60)
    assert child.returncode == 130
    assert message == "accelcal: interrupted; no file was left half-written\n"
    assert all(has_ended(pid) for pid in below)


def test_an_effect_that_is_terminated_or_crashes_ends_the_command_with_a_sentence(tmp_path: Path) -> None:
    child = begun(tmp_path, ENDLESS["catches"])
    child.terminate()
    _, message = child.communicate(timeout=60)
    assert (child.returncode, message) == (143, "accelcal: terminated; no file was left half-written\n")
    (tmp_path / "own.note").unlink()
    child = begun(tmp_path, "    import os\n    os.kill(os.getpid(), 11)\n")
    _, message = child.communicate(timeout=60)
    assert child.returncode == 128 + signal.SIGSEGV
    assert message.startswith("accelcal: ended by the signal SIGSEGV while effects of your own were in use")
    assert message.count("\n") == 1


@pytest.mark.skipif(sys.platform != "linux", reason="the system ends children of a killed parent on Linux alone")
def test_nothing_goes_on_behind_a_command_that_was_killed(tmp_path: Path) -> None:
    child = begun(tmp_path, ENDLESS["holds the interpreter"])
    below = descendants(child.pid)
    assert below
    child.kill()
    child.wait(60)
    assert all(has_ended(pid) for pid in below)


@pytest.mark.parametrize("ended_before", [False, True], ids=["at once", "when its end was just seen"])
def test_a_signal_at_the_edges_of_the_wait_ends_the_child(ended_before: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    child = subprocess.Popen([sys.executable, "-c", "" if ended_before else "import time; time.sleep(600)"])

    def let_come() -> None:
        if ended_before:
            child.wait(timeout=60)
        raise stopping.Stopped(signal.SIGTERM)

    try:
        with pytest.raises(stopping.Stopped) as stopped:
            process._code_of(child.pid, let_come)
        assert stopped.value.number == signal.SIGTERM
        assert has_ended(child.pid)
    finally:
        child.kill()
        child.wait(timeout=60)
