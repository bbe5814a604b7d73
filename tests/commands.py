"""Commands in tests: `accelcal("fit", "run.csv", cwd=folder)` does what `python -m accelcal fit run.csv` does.

The process of a command is a fork of a parent that has imported what commands import, half of the time of a short one.
It has its own folder, environment, files, signals and exit functions; the modules are not taken down, which takes as
long as the work of a short command. What the parent cannot give it, an environment that the interpreter reads when it
starts, gets an interpreter of its own.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import json
import os
import pkgutil
import runpy
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

AT_START = ("PYTHON", "LC_", "LANG", "OPENBLAS", "OMP_", "MKL_", "LD_", "MALLOC_", "MPL")
"""How the names of variables begin that are read while an interpreter or a library starts."""
USED = [
    "scipy.signal",
    "scipy.stats",
    "scipy.optimize",
    "scipy.interpolate",
    "scipy.ndimage",
    "pyarrow.parquet",
    "pint",
]


def at_start(environment: Mapping[str, str]) -> dict[str, str]:
    """Return what an interpreter reads when it starts; a command run in this process left the warnings that it sets."""
    left = {"PYTHONWARNINGS": "ignore::RuntimeWarning"}.items()
    return {name: value for name, value in environment.items() - left if name.startswith(AT_START)}


class Parent:
    """Parent of forked commands, started on first use; `spent` is the processor time of its children in seconds."""

    def __init__(self) -> None:
        self.socket: socket.socket | None = None
        self.pid: int | None = None
        self.spent = 0.0
        self.environment: dict[str, str] = {}

    def start(self) -> socket.socket:
        if self.socket is None:
            self.socket, other = socket.socketpair()
            command = [sys.executable, "-m", __name__, str(other.fileno())]
            silent = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
            root = Path(__file__).parents[1]
            child = subprocess.Popen(command, cwd=root, pass_fds=[other.fileno()], **silent)
            other.close()
            self.pid = child.pid
            self.environment = at_start(os.environ)
            atexit.register(lambda: (self.socket and self.socket.close(), child.wait()))
        return self.socket

    def run(self, words: list[str], cwd: str, environment: dict[str, str], timeout: float) -> tuple[int, bytes, bytes]:
        """Return the exit code, stdout and stderr of a command."""
        link = self.start()
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err, open(os.devnull) as nothing:
            with tempfile.TemporaryFile() as request:
                request.write(json.dumps([words, cwd, environment]).encode())
                request.seek(0)
                socket.send_fds(link, [b"r"], [stream.fileno() for stream in (nothing, out, err, request)])
            number, _, answer = link.recv(100).partition(b"\n")  # a short command has ended before it is read
            link.settimeout(timeout)
            try:
                answer = answer or link.recv(100)
            except TimeoutError:
                os.kill(int(number), signal.SIGKILL)
                link.settimeout(None)
                link.recv(100)
                raise subprocess.TimeoutExpired(words, timeout) from None
            finally:
                link.settimeout(None)
            code, seconds = json.loads(answer)
            self.spent += seconds
            out.seek(0)
            err.seek(0)
            return code, out.read(), err.read()


PARENT = Parent()
CODE: list[int] = []
"""Exit code of a forked process that has come to its end without an error."""


def python(
    *words: object,
    cwd: str | os.PathLike[str] | None = None,
    env: Mapping[str, str] | None = None,
    text: bool = True,
    check: bool = False,
    timeout: float = 300.0,
) -> subprocess.CompletedProcess[Any]:
    """Run `python -m MODULE ...` or `python -c TEXT ...` to its end, with nothing to read; its output is captured."""
    command = [sys.executable, *map(str, words)]
    environment = dict(os.environ if env is None else env)
    PARENT.start()
    if at_start(environment) != PARENT.environment:
        return subprocess.run(
            command, cwd=cwd, env=environment, capture_output=True, text=text, check=check, timeout=timeout
        )
    code, out, err = PARENT.run(command[1:], str(cwd or Path.cwd()), environment, timeout)
    done = subprocess.CompletedProcess[Any](command, code, out, err)
    if text:
        done.stdout, done.stderr = (output.decode().replace("\r\n", "\n") for output in (out, err))
    if check:
        done.check_returncode()
    return done


def accelcal(*words: object, **settings: Any) -> subprocess.CompletedProcess[Any]:
    """Run a command of accelcal to its end, as `python` does."""
    return python("-m", "accelcal", *words, **settings)


def serve(link: socket.socket) -> None:
    """Fork a process for each request and say how it ended; in the forked process, return."""
    while True:
        message, files, *_ = socket.recv_fds(link, 1, 4)
        if not message:
            os._exit(0)
        child = os.fork()
        if child == 0:
            link.close()
            for number, file in enumerate(files[:3]):
                os.dup2(file, number)
            with open(files[3]) as request:
                words, cwd, environment = json.load(request)
            for file in files[:3]:
                os.close(file)
            os.chdir(cwd)
            os.environ.clear()
            os.environ.update(environment)
            sys.path[0] = cwd if words[0] == "-m" else ""
            sys.argv[:] = words
            return
        for file in files:
            os.close(file)
        link.send(f"{child}\n".encode())
        _, status, usage = os.wait4(child, 0)
        link.send(json.dumps([os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime]).encode())


def leave() -> None:
    """End a process whose exit code is stored, all other exit functions have run: modules are not taken down."""
    if CODE:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(CODE[0])


if __name__ == "__main__":
    atexit.register(leave)  # first, so it runs last
    package = importlib.import_module("accelcal")
    _ = importlib.import_module("accelcal.cli").app
    for name in USED:
        importlib.import_module(name)
    for module in pkgutil.walk_packages(package.__path__, "accelcal."):
        if not module.name.startswith(("accelcal.app", "accelcal.live", "accelcal.__main__")):
            with suppress(ModuleNotFoundError):  # of a part that is not installed, which its command says
                importlib.import_module(module.name)
    gc.collect()
    gc.freeze()
    serve(socket.socket(fileno=int(sys.argv[1])))
    option, what = sys.argv[:2]
    try:
        if option == "-m":
            del sys.argv[:1]
            runpy.run_module(what, run_name="__main__", alter_sys=True)
        else:
            del sys.argv[1]
            sys.modules["__main__"] = ModuleType("__main__")
            exec(compile(what, "<string>", "exec"), vars(sys.modules["__main__"]))
    except SystemExit as end:
        CODE += [end.code or 0] if isinstance(end.code, int | None) else []
        raise
    CODE += [0]
