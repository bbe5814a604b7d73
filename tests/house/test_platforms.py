"""Windows and macOS: what only POSIX has stands in few files, each with a fallback, and the main commands run without.

A child process runs them on a Python from which the modules, functions, signals and flags of POSIX have been removed,
and on which, as on Windows, an open file can be neither renamed nor removed.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest

import accelcal
from accelcal.io.decoding import child

ROOT = Path(__file__).parents[2]
PACKAGE = Path(accelcal.__file__).parent
MODULES = {"fcntl", "termios", "resource", "pwd", "grp", "pty", "tty", "syslog", "posix"}
"""Modules of the standard library that Windows lacks."""
ATTRIBUTES = {
    "os": """O_NOCTTY O_NOFOLLOW O_NONBLOCK WNOHANG chown ctermid fchmod fchown fork forkpty getegid geteuid getgid
        getloadavg getpgid getpriority getresuid getsid getuid killpg lchown mkfifo mknod nice openpty posix_fadvise
        posix_spawn posix_spawnp pread preadv pwrite register_at_fork sched_getaffinity sched_setaffinity sendfile
        set_blocking setpgid setpriority setsid statvfs sync sysconf tcsetpgrp ttyname uname wait wait3 wait4 waitid
        writev""",
    "signal": """ITIMER_REAL SIGALRM SIGCHLD SIGCONT SIGHUP SIGKILL SIGPIPE SIGQUIT SIGSTOP SIGTSTP SIGUSR1 SIGUSR2
        SIGWINCH SIGXCPU SIG_BLOCK SIG_SETMASK alarm pause pthread_kill pthread_sigmask setitimer sigpending
        sigtimedwait sigwait""",
    "select": "epoll poll",
    "time": "tzset",
}
"""Names that Windows lacks; `os.set_blocking` came to it with Python 3.12."""
TEXTS = ("/proc/", "/dev/", "/sys/", "/tmp", "prctl", "malloc_trim")
"""What strings outside of help and docstrings do not name elsewhere."""
ALLOWED = {
    "_support/locks.py": {"fcntl", "os.O_NOFOLLOW", "os.O_NONBLOCK", "os.getuid", "os.uname"},
    "_support/process.py": {
        *("os.WNOHANG", "os.fork", "os.killpg", "prctl", "malloc_trim", "process_group"),
        *("signal.SIGKILL", "signal.SIG_BLOCK", "signal.SIG_SETMASK", "signal.pthread_sigmask"),
    },
    "_support/stopping.py": {"signal.SIGPIPE", "signal.pthread_kill"},
    "app/live_page.py": {"/dev/"},  # an example of a port
    "app/server.py": {"os.getuid", "signal.SIGHUP"},
    "app/workers.py": {"/proc/", "os.nice", "os.sysconf", "resource"},
    "cli/live.py": {"/dev/"},  # the same example
    "io/atomic.py": {"/dev/", "os.O_NONBLOCK", "os.set_blocking"},
    "io/containers.py": {"signal.SIGXCPU"},
    "io/decoding/child.py": {"/proc/", "os.sysconf", "resource"},
    "io/files.py": {"os.O_NONBLOCK"},
}
"""What each file of the package names of POSIX; the tests below run it without, macOS lacks a part."""
STARTS = {"process_group", "preexec_fn", "start_new_session"}
"""Settings of a new process."""
POSIX = {f"{module}.{name}" for module, names in ATTRIBUTES.items() for name in names.split()}


WORDS = re.compile(
    rf"\b(?:{'|'.join(ATTRIBUTES)})\W+(?:{'|'.join(name.partition('.')[2] for name in sorted(POSIX))})\b"
    rf"|from (?:{'|'.join(ATTRIBUTES)}) import|\b(?:{'|'.join(sorted(MODULES | STARTS))})\b|{'|'.join(TEXTS)}"
)
"""What a file has that is worth parsing."""
OPENS = re.compile(r"\b(open|read_text|write_text|fdopen|TextIOWrapper|Popen|subprocess\.\w+)\(")


def named(source: str) -> set[str]:
    """Modules, attributes, settings of processes and places of POSIX that a source names, by `hasattr` as well."""
    return set(_named(ast.parse(source))) if WORDS.search(source) else set()


def _named(tree: ast.Module) -> Iterator[str]:
    texts = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from MODULES & {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from (MODULES & {node.module}) | (POSIX & {f"{node.module}.{alias.name}" for alias in node.names})
        elif isinstance(node, ast.Attribute):
            owner = node.value.id if isinstance(node.value, ast.Name) else ""
            yield from POSIX & {f"{owner}.{node.attr}"}
            yield from {"prctl", "malloc_trim"} & {node.attr}
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("getattr", "hasattr"):
            yield from POSIX & {f"{ast.unparse(node.args[0])}.{getattr(node.args[1], 'value', '')}"}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in texts:
            yield from (text for text in TEXTS if text in node.value)
            yield from STARTS & {node.value}
        elif isinstance(node, ast.keyword) and node.arg in STARTS:
            yield node.arg


def without_encoding(source: str) -> Iterator[int]:
    """Lines that open a text and leave its encoding to the system."""
    for node in ast.walk(ast.parse(source)) if OPENS.search(source) else ():
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            words = {keyword.arg for keyword in node.keywords}
            modes = [
                value for value in map(ast.unparse, node.args) if value[:1] == "'" and set(value) <= set("'rwabtx+")
            ]
            opens = name == "open" and isinstance(node.func, ast.Name) and not any("b" in mode for mode in modes)
            binary = name == "fdopen" and any("b" in mode for mode in modes)
            reads = name in ("read_text", "write_text", "fdopen", "TextIOWrapper") and not binary
            runs = name in ("Popen", "run", "check_output") and words & {"text", "universal_newlines"}
            if (opens or reads or runs) and "encoding" not in words:
                yield node.lineno


def test_posix_is_named_where_it_is_allowed_and_nowhere_else() -> None:
    texts = {path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    assert {path: names for path, text in texts.items() if (names := named(text))} == ALLOWED


def test_texts_are_opened_with_their_encoding() -> None:
    places = {path: [*without_encoding(path.read_text(encoding="utf-8"))] for path in PACKAGE.rglob("*.py")}
    assert not {path: lines for path, lines in places.items() if lines}


def test_names_of_posix_and_missing_encodings_are_noticed() -> None:
    assert named("import fcntl\nfrom os import fork\nimport os\nos.killpg\nhasattr(os, 'nice')\n") == {
        *("fcntl", "os.fork", "os.killpg", "os.nice"),
    }
    assert named("'''/proc/self'''\nx = '/proc/self'\n") == {"/proc/"}
    assert named("Popen(a, preexec_fn=b)\nf(signal.SIGHUP)\n") == {"preexec_fn", "signal.SIGHUP"}
    assert [
        *without_encoding(
            "open(a)\nopen(a, 'rb')\na.read_text()\nsubprocess.run(a, text=True)\nopen(a, encoding='x')\n"
        )
    ] == [
        1,
        3,
        4,
    ]


WINDOWS = f"""
import asyncio, os, runpy, select, shutil, signal, subprocess, sys, time, types, warnings
if COMMANDS:
    import numpy, pyarrow.parquet, scipy.linalg  # which ask for the system while they start
subprocess.signal = types.SimpleNamespace(**vars(signal))  # the module is another one there
posix = sys.modules["posix"]
def is_open(path, folder=None):
    path = os.path.join(os.readlink("/proc/self/fd/%d" % folder), path) if folder is not None else path
    for number in os.listdir("/proc/self/fd"):
        try:
            if os.path.samestat(posix.stat(path, follow_symlinks=False), posix.fstat(int(number))):
                raise PermissionError(13, "the process cannot access the file, which is in use", path)
        except FileNotFoundError:
            return
        except OSError as error:
            if error.errno == 13:
                raise
def refusing(act):
    def refuse(*paths, **where):
        for path in paths:
            is_open(path, where.get("dir_fd"))
        return act(*paths, **where)
    return refuse
for name in ("rename", "replace", "unlink", "remove"):
    setattr(os, name, refusing(getattr(os, name)))
sys.modules.update(dict.fromkeys({sorted(MODULES - {"posix"})}))
for module, names in {ATTRIBUTES}.items():
    for name in names.split():
        vars(sys.modules[module]).pop(name, None)
warnings.filterwarnings("error", category=EncodingWarning, module="accelcal")
for words in COMMANDS:
    sys.argv[1:] = words.split()
    try:
        runpy.run_module("accelcal", run_name="__main__", alter_sys=True)
    except SystemExit as end:
        if end.code:
            sys.exit("%s ended with %s" % (words, end.code))
"""
SIDECAR = """[channels]
time = { column = "t", unit = "s" }
accel = { column = "accel", unit = "m/s^2" }
position = { column = "position", unit = "m" }
"""
COMMANDS = (
    "--help",
    "simulate -o run.csv --seconds 8 --seed 1",
    "simulate -o run.csv --seconds 8 --seed 2",  # over the first one
    "simulate -o other.parquet --seconds 8 --seed 3",
    "check readings.npz",  # which a process of its own opens
    "fit run.csv -o model.json",
    "diagnose model.json run.csv",
    "compare model.json other.parquet -o compare.json",
    "report model.json run.csv -o report.html",
    "export model.json --c sensor.h",
    "doctor",
)


def on_windows(folder: Path, *commands: str, then: str = "") -> subprocess.CompletedProcess[str]:
    """Run commands in one process on a Python without POSIX, then some code."""
    code = f"COMMANDS = {commands}\n{WINDOWS}\n{then}"
    command = [sys.executable, "-X", "warn_default_encoding", "-c", code]
    return subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8", timeout=300)


def test_the_main_commands_run_without_posix(tmp_path: Path) -> None:
    t = np.arange(0.0, 8.0, 0.01)
    np.savez(tmp_path / "readings.npz", t=t, accel=-np.sin(t), position=np.sin(t))
    (tmp_path / "readings.toml").write_text(SIDECAR, encoding="utf-8")
    done = on_windows(tmp_path, *COMMANDS)
    assert done.returncode == 0, done.stderr
    written = {path.name for path in tmp_path.iterdir()}
    assert {"run.csv", "run.toml", "other.parquet", "model.json", "compare.json", "report.html", "sensor.h"} <= written
    assert not [name for name in written if name.startswith(".accelcal")]  # no part was left


@pytest.mark.parametrize(
    ("then", "expected"),
    [
        ("import fcntl", "ModuleNotFoundError"),
        ("os.fork()", "no attribute 'fork'"),
        ("signal.SIGKILL", "no attribute 'SIGKILL'"),
        ("held = open('a', 'wb'); os.replace('a', 'b')", "which is in use"),
        ("held = open('a', 'wb'); os.rename('b', 'a')", "which is in use"),
        ("exec(compile('open(\"b\")', 'x', 'exec'), {'__name__': 'accelcal'})", "EncodingWarning"),
    ],
    ids=["module", "function", "signal", "rename", "replace", "encoding"],
)
def test_what_windows_lacks_fails_there(tmp_path: Path, then: str, expected: str) -> None:
    # The twin that must fail: each restriction is in force.
    (tmp_path / "b").write_bytes(b"")
    done = on_windows(tmp_path, then=then)
    assert done.returncode == 1
    assert expected in done.stderr


def test_a_broken_pipe_has_its_exit_code_without_the_signal(tmp_path: Path) -> None:
    then = "from accelcal._support.stopping import run\ndef broken(): raise BrokenPipeError\nsys.exit(run(broken))"
    assert on_windows(tmp_path, then=then).returncode == 141


def test_workers_start_by_spawning() -> None:
    texts = [path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")]
    pools = [line for text in texts for line in text.splitlines() if re.search(r"= (ProcessPoolExecutor|Pool)\(", line)]
    assert pools
    assert all('mp_context=get_context("spawn")' in line for line in pools)


def test_a_limit_that_a_system_does_not_have_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    import resource

    asked = []

    def of_macos(which: int, limits: tuple[int, int]) -> None:
        asked.append(which)
        if which == resource.RLIMIT_AS:
            raise ValueError("current limit exceeds maximum limit")

    monkeypatch.setattr(resource, "setrlimit", of_macos)
    monkeypatch.setattr(child.signal, "signal", lambda *_: None)
    child.limit(1000)
    assert {resource.RLIMIT_AS, resource.RLIMIT_CPU, resource.RLIMIT_FSIZE} <= set(asked)


def test_wheels_are_built_for_each_system_once_and_tried() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheels = project["tool"]["cibuildwheel"]
    assert wheels["build"] == f"cp{project['project']['requires-python'].removeprefix('>=').replace('.', '')}-*"
    assert fnmatch("cp311-manylinux_x86_64", wheels["build"])
    archs = {system: wheels[system]["archs"] for system in ("linux", "macos", "windows")}
    assert archs == {"linux": ["x86_64", "aarch64"], "macos": ["x86_64", "arm64"], "windows": ["AMD64"]}
    assert "tools/licences.py" in wheels["before-build"]
    assert {"simulate", "fit"} <= set(wheels["test-command"].split())
    bindings = tomllib.loads((ROOT / "crates/accelcal-py/Cargo.toml").read_text(encoding="utf-8"))
    assert "abi3-py311" in bindings["dependencies"]["pyo3"]["features"]  # so one Python is enough
