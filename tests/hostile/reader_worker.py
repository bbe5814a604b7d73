"""A process that reads one mutated case after the other; it dies where a reader crashes or never ends, and is replaced.

Cases come as lines "section number", answers leave as lines of JSON. Containers are opened by a fork of this process in
place of a fresh interpreter, over the same pipes, under the same limits: a hundred times as fast.

By hand: ``python -m tests.hostile.reader_worker containers 0 2000`` prints counts and every failure.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import IO, Any

import numpy as np

from accelcal import io
from accelcal.data.quality import describe, summarise
from accelcal.data.recording import Recording, RecordingError
from accelcal.io import containers
from accelcal.io.decoding import child

from .mutations import CONTAINERS, case_files

SECONDS = 10.0
"""Processor time of one case."""
MEMORY = 1_000_000_000
"""Bytes that one case may take beyond what the libraries take."""
SMALL = 10_000_000
"""Bytes of a file up to which that must do."""
FRESH = 500
"""Every so many cases of containers the fresh interpreter of the product is used, not the fork."""


class Forked:
    """A fork that serves one file: what `accelcal.io.containers.start` starts, without the time to import."""

    def __init__(self) -> None:
        asked, self._ask = os.pipe()
        self._listen, answered = os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            os.close(self._ask)
            os.close(self._listen)
            os.close(0)
            with os.fdopen(asked, "rb") as requests, os.fdopen(answered, "wb") as replies:
                try:
                    warnings.simplefilter("ignore")  # of files that the end of the process closes
                    child.main(requests, replies)
                finally:
                    os._exit(0)
        os.close(asked)
        os.close(answered)
        self.stdin: IO[bytes] = os.fdopen(self._ask, "wb")
        self.stdout: IO[bytes] = os.fdopen(self._listen, "rb")
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """The exit code, once it has ended."""
        return self._reap(os.WNOHANG)

    def wait(self) -> int:
        """The exit code, when it has ended."""
        code = self._reap(0)
        assert code is not None
        return code

    def kill(self) -> None:
        """End it."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)

    def _reap(self, options: int) -> int | None:
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, options)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode


def read(path: Path, everything: bool) -> str:
    """Read a recording as commands and the workbench do; the sentence of its refusal, or "" where it was read.

    Raises
    ------
    AssertionError
        If something that is no recording was accepted, or a refusal does not name the file.
    """
    text = ""
    try:
        if everything:
            io.template(path)
        contents = io.load_declared(path)[0]
    except RecordingError as error:
        text = str(error)
    if text:
        assert str(path.parent) in text or "/dev/zero" in text, f"a refusal without its file: {text}"
        assert len(text) < 20_000, f"a refusal of {len(text)} characters"
    elif isinstance(contents, Recording):
        require_recording(contents)
        summarise(contents)
        json.dumps(describe(contents), allow_nan=False)
    else:
        assert all(np.isfinite(y).all() for y in (contents.angle, contents.mean, contents.std, contents.duration)), (
            "dwells"
        )
    return text


def require_recording(recording: Recording) -> None:
    """Fail where stamps or readings are not what every later step relies on."""
    for channel in (recording.accel, recording.position, *recording.side.values()):
        assert np.isfinite(channel.t).all(), f"stamps of {channel.name}"
        assert np.isfinite(channel.y).all(), f"readings of {channel.name}"
        assert (np.diff(channel.t) > 0).all(), f"stamps of {channel.name} do not rise"


def misbehave(section: str) -> None:
    """What the caller must notice, on request."""
    if section == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if section == "hang":
        signal.setitimer(signal.ITIMER_PROF, 0.1)
        while True:
            pass
    if section == "memory":
        bytes(3 * MEMORY)


def case_file(section: str, number: int, folder: Path) -> Path | None:
    """The file of a case; None where a mutation has made it larger than memory."""
    try:
        return case_files(section, number, folder)
    except MemoryError:
        return None


def answer(section: str, number: int) -> dict[str, Any]:
    """Run one case."""
    signal.setitimer(signal.ITIMER_PROF, SECONDS)  # SIGPROF ends the process: no library can miss it
    before = time.process_time()
    start = containers.start
    if number % FRESH or section != "containers":
        containers.start = Forked  # type: ignore[assignment]
    with tempfile.TemporaryDirectory(prefix="hostile-") as folder:
        path: Path | None = None
        try:
            misbehave(section)
            path = case_file(section, number, Path(folder))
            text = "" if path is None else read(path, number % 5 == 0)
            outcome = "large" if path is None else "refused" if text else "read"
        except MemoryError as error:
            large = path is not None and path.stat().st_size > SMALL
            outcome, text = "large" if large else "failed", f"MemoryError: {error}"
        except BaseException as error:
            outcome, text = "failed", f"{type(error).__name__}: {error}"[:500]
        finally:
            containers.start = start
            signal.setitimer(signal.ITIMER_PROF, 0.0)
    return {"number": number, "outcome": outcome, "text": text[:500], "seconds": time.process_time() - before}


def main() -> None:
    """Answer until the input ends."""
    for section in ("text", "sidecars", "containers"):  # libraries are loaded before memory is limited
        for number in range(len(CONTAINERS)):
            answer(section, number)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (pages * os.sysconf("SC_PAGE_SIZE") + MEMORY, hard))
    print("ready", flush=True)
    for line in sys.stdin:
        section, number = line.split()
        print(json.dumps(answer(section, int(number))), flush=True)


class Worker:
    """The worker as its caller sees it."""

    def __init__(self) -> None:
        self.deaths = 0
        self._process = self._start()

    def _start(self) -> subprocess.Popen[str]:
        command = [sys.executable, "-W", "error", "-m", "tests.hostile.reader_worker"]
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2]
        )
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        return process

    def run(self, section: str, number: int) -> dict[str, Any]:
        """One case; a worker that dies of it is replaced."""
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write(f"{section} {number}\n")
        stdin.flush()
        line = stdout.readline()
        if line:
            result: dict[str, Any] = json.loads(line)
            return result
        code = self._process.wait()
        self.deaths += 1
        self._process = self._start()
        return {"number": number, "outcome": "died", "text": f"code {code}", "seconds": float("nan")}

    def close(self) -> None:
        """End it."""
        self._process.communicate()


def campaign(worker: Worker, section: str, numbers: range) -> tuple[Counter[str], list[dict[str, Any]]]:
    """Counts of outcomes and every failure of a range of cases; progress and hours are printed."""
    counts, failures, begin = Counter[str](), [], time.monotonic()
    slowest = 0.0
    for done, number in enumerate(numbers, start=1):
        outcome = worker.run(section, number)
        counts[outcome["outcome"]] += 1
        slowest = max(slowest, outcome["seconds"])
        if outcome["outcome"] in ("failed", "died"):
            failures.append(outcome)
            print(f"{section} {number}: {outcome['outcome']}: {outcome['text']}", flush=True)
        if done % 1000 == 0 or done == len(numbers):
            hours = (time.monotonic() - begin) / 3600.0
            print(f"{section} to {number}: {dict(counts)}, slowest {slowest:.2f} s, {hours:.3f} h", flush=True)
    return counts, failures


if __name__ == "__main__":
    warnings.simplefilter("error")
    if len(sys.argv) == 4:
        campaign(Worker(), sys.argv[1], range(int(sys.argv[2]), int(sys.argv[3])))
    else:
        main()
