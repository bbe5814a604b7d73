"""A container runs no code, and its reader does what reading needs and nothing else: as root and as any other user."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accelcal import io
from accelcal.data.recording import RecordingError
from accelcal.io import containers
from accelcal.io.decoding.child import WRITTEN
from accelcal.io.decoding.known_formats import FORMATS
from accelcal.io.files import open_table
from tests.io.recorders import RECORDERS

T = np.arange(60) / 100.0
MAKES_A_FILE = "__import__('os').mkdir('made')"
SYMPY = "def symbols(text): return text\ndef lambdify(of, text, **_): return lambda values: eval(text)\n"
"""What SymPy does with a text that is no formula, without the time to parse it."""
ACTS = {
    "a program": "import subprocess; subprocess.run(['mkdir', 'made'])",
    "a shell": "import os; os.system('mkdir made')",
    "a fork": "import os; os.fork() or os._exit(0)",
    "a program in its place": "import os; os.execvp('mkdir', ['mkdir', 'made'])",
    "a connection": "import socket; socket.socket().connect(('127.0.0.1', 9))",
    "a foreign function": "import ctypes; ctypes.CDLL(None).mkdir(b'made', 0o700)",
    "a file": "open('made', 'w')",
    "a file by its descriptor": "import os; os.open('made', os.O_CREAT | os.O_RDWR)",
    "a folder": "import os; os.mkdir('made')",
    "another name": "import os; os.rename('there', 'made')",
    "a link": "import os; os.symlink('there', 'made')",
    "removal": "import os; os.remove('there')",
    "a pickle": "import pickle; pickle.loads(b'cos\\nmkdir\\n(S\\'made\\'\\ntR.')",
    "limits of its own": "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1, 1))",
}
"""What a library could be brought to do by a file."""


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of its own, which the reader is in, with a file and a folder for temporary files."""
    for name in ("work", "temporary"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    Path("there").write_text("x")
    return tmp_path


@pytest.fixture(params=["this user", "nobody"])
def user(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Readers run as the user of these tests, often root, and as one without rights who may look at every file."""
    if request.param == "nobody":
        rights = "+dac_override,+dac_read_search"
        change = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
        change += [f"--inh-caps={rights}", f"--ambient-caps={rights}"]
        if os.getuid() or not shutil.which("setpriv") or subprocess.run([*change, "true"]).returncode:
            pytest.skip("another user takes root and setpriv")
        start = subprocess.Popen

        def popen(command: list[str], **options: Any) -> Any:
            return start([*change, *command], **options)

        monkeypatch.setattr(containers.subprocess, "Popen", popen)
    return str(request.param)


def formula() -> Any:
    """A conversion by a text that is code."""
    from asammdf.blocks.v4_blocks import ChannelConversion

    return ChannelConversion(conversion_type=3, formula=MAKES_A_FILE)


def nested(*, default: bool = False) -> Any:
    """A table of values whose entry, or default, is a table with a formula."""
    from asammdf.blocks.v4_blocks import ChannelConversion

    content: Any = formula()
    for _ in range(2):
        both = {"text_0": b"a", "default_addr": content} if default else {"text_0": content, "default_addr": b"a"}
        content = ChannelConversion(conversion_type=7, ref_param_nr=2, val_0=0.0, **both)
    return content


def planted(path: Path, where: str, conversion: Any) -> None:
    """An MF4 of two channels on one master with a conversion on one of the three."""
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        columns = {"accel": (np.sin(T), "m/s^2"), "position": (np.round(10.0 * np.cos(T)), "m")}
        file.append([Signal(y, T, name=name, unit=unit) for name, (y, unit) in columns.items()])
        file.groups[0].channels[["master", "accel", "position"].index(where)].conversion = conversion
        file.save(path, overwrite=True)


def refusal_of(act: Callable[[], object]) -> str:
    """What an act is refused with."""
    with pytest.raises(RecordingError) as error:
        act()
    return str(error.value)


@pytest.mark.parametrize("sympy", ["stub", "real"])
@pytest.mark.parametrize("where", ["master", "accel"])
def test_a_formula_of_an_mf4_is_refused_wherever_it_stands(
    where: str, sympy: str, user: str, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("asammdf")
    if sympy == "stub":
        (place / "sympy.py").write_text(SYMPY)
        monkeypatch.syspath_prepend(place)
    elif importlib.util.find_spec("sympy") is None:
        pytest.skip("SymPy is not installed")
    column = "t" if where == "master" else where
    for conversion in (formula(), nested(), nested(default=True)):
        planted(Path("run.mf4"), where, conversion)
        refusal = refusal_of(lambda: io.load("run.mf4"))
        assert f'column "{column}" is converted by a formula in the file, which is not evaluated; export it' in refusal
        others = sorted({"t", "accel", "position"} - {column})
        assert [len(result.values) for result in open_table(Path("run.mf4")).read(others).values()] == [len(T)] * 2
    assert not Path("made").exists()
    eval(MAKES_A_FILE)  # the code does what is meant here
    assert Path("made").exists()


@pytest.mark.parametrize("kind", [np.uint8, np.int64, np.float64])
def test_conversions_without_a_text_are_computed_as_before(kind: type) -> None:
    pytest.importorskip("asammdf")
    from asammdf import MDF, Signal
    from asammdf.blocks.v4_blocks import ChannelConversion

    raw = np.arange(60).astype(kind)
    quotient = ChannelConversion(conversion_type=2, P1=1.0, P2=2.0, P3=3.0, P4=0.0, P5=1.0, P6=4.0)
    line = ChannelConversion(conversion_type=1, a=0.5, b=1.0)
    with MDF(version="4.10") as file:
        file.append([Signal(raw, T, name="a"), Signal(raw, T, name="b")])
        for channel, conversion in zip(file.groups[0].channels, (line, quotient, line), strict=True):
            channel.conversion = conversion
        file.save("run.mf4", overwrite=True)
    content = open_table(Path("run.mf4")).read(["t", "a", "b"])
    x = raw.astype(np.float64)
    np.testing.assert_allclose(content["t"].values, 0.5 * T + 1.0, rtol=1e-15)
    np.testing.assert_allclose(content["a"].values, (x**2 + 2.0 * x + 3.0) / (x + 4.0), rtol=1e-14)
    np.testing.assert_allclose(content["b"].values, 0.5 * x + 1.0, rtol=1e-15)


@pytest.mark.parametrize("act", ACTS)
def test_a_reader_is_refused_what_no_reading_needs(act: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The library of C3D, in whose place a module does what a file has made it do.
    (place / "c3d.py").write_text(f"def Reader(file):\n    {ACTS[act]}\n    raise SystemExit('it was done')\n")
    monkeypatch.syspath_prepend(place)
    Path("run.c3d").write_bytes(b"\x02P" + bytes(510))
    text = refusal_of(lambda: open_table(Path("run.c3d")))
    assert "was stopped when it was about to do what no reading needs" in text, text
    assert "\n" not in text
    assert sorted(os.listdir()) == ["run.c3d", "there"]


@pytest.mark.parametrize("suffix", ["parquet", "npz", "mat", "h5"])
def test_tables_of_many_rows_are_read_by_any_user(suffix: str, user: str) -> None:
    h5py, pa = pytest.importorskip("h5py"), pytest.importorskip("pyarrow")
    t = np.arange(40_000) / 1000.0
    columns, path = {"t_s": t, "accel_m_per_s2": np.sin(t)}, Path(f"run.{suffix}")
    if suffix == "parquet":
        pytest.importorskip("pyarrow.parquet").write_table(pa.table(columns), path)
    elif suffix == "npz":
        np.savez(path, **columns)
    elif suffix == "mat":
        pytest.importorskip("scipy.io").savemat(path, columns)
    else:
        with h5py.File(path, "w") as file:
            for name, values in columns.items():
                file[name] = values
    read = open_table(path).read(list(columns))
    assert [len(column.values) for column in read.values()] == [len(t)] * 2


@pytest.mark.parametrize("suffix", RECORDERS)
def test_every_library_reads_within_its_guard(suffix: str, user: str, place: Path) -> None:
    columns = {"accel": np.sin(T), "position": np.cos(T)}
    pytest.importorskip(next(item.library for item in FORMATS if f".{suffix}" in item.suffixes))
    RECORDERS[suffix](Path(f"run.{suffix}"), columns, {"accel": "m/s^2", "position": "m"}, 0.01)
    left = sorted(os.listdir(place / "temporary"))
    table = open_table(Path(f"run.{suffix}"))
    names = [name for name in table.columns if "accel" in name]
    assert all(len(column.values) for column in table.read(names).values())
    assert sorted(os.listdir(place / "temporary")) == left


def test_a_library_writes_into_its_scratch_folder_alone_and_not_much(place: Path) -> None:
    script = f"""
import os, sys, tempfile
from accelcal.io.decoding.child import confine, limit
limit(0)
confine({str(place / "temporary")!r})
with tempfile.NamedTemporaryFile() as file:
    print(os.path.dirname(file.name))
    try:
        for _ in range({WRITTEN // 1_000_000} + 1):
            file.write(bytes(1_000_000))
            file.flush()
    except OSError as error:
        print(error.strerror)
try:
    open("there", "a")
except PermissionError:
    print("refused")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:-1] == [str(place / "temporary"), os.strerror(27), "refused"]
    assert os.listdir(place / "temporary") == []


def test_what_a_killed_reader_leaves_is_removed(place: Path) -> None:
    pytest.importorskip("asammdf")
    columns = {"accel": np.sin(T), "position": np.cos(T)}
    RECORDERS["mf4"](Path("run.mf4"), columns, {"accel": "m/s^2", "position": "m"}, 0.01)
    for name in os.listdir(place / "temporary"):
        (place / "temporary" / name).unlink()
    process = containers.ReaderProcess(Path("run.mf4"), "MF4")
    assert len(os.listdir(place / "temporary")) == 2  # the folder and its lock
    process._process.kill()
    while process.waits:
        time.sleep(0.01)
    with pytest.raises(RecordingError, match="its reader ended"):
        process.columns(["accel"])
    assert os.listdir(place / "temporary") == []


def nested_types(folder: Path, fan: int, depth: int, number: str) -> Path:
    """An MCAP with one message of ROS 2 types that hold `fan` of the next each; the last holds `number`."""
    from mcap.writer import Writer

    parts = [
        "\n".join(f"pkg/T{k + 1} f{i}" if k + 1 < depth else f"{number} f{i}" for i in range(fan)) for k in range(depth)
    ]
    text = f"\n{'=' * 80}\n".join([parts[0], *(f"MSG: pkg/T{k}\n{part}" for k, part in enumerate(parts[1:], 1))])
    path = folder / "run.mcap"
    with path.open("wb") as handle:
        file = Writer(handle)
        file.start()
        channel = file.register_channel("/a", "cdr", file.register_schema("pkg/msg/T0", "ros2msg", text.encode()))
        file.add_message(channel, 0, bytes(1024), 0)
        file.finish()
    return path


@pytest.mark.parametrize("number", ["float64", "string"])
def test_definitions_that_nest_into_endless_columns_are_counted_while_they_are_made(
    tmp_path: Path, number: str
) -> None:
    pytest.importorskip("mcap")
    began = sum(os.times()[:4])
    with pytest.raises(RecordingError, match="more than 4096 columns" if number == "float64" else "."):
        io.load(nested_types(tmp_path, 10, 25, number))
    assert (
        sum(os.times()[:4]) - began < 4.0
    )  # s of processor; without counting it is the limit of a reader, 5 s, and more
    with pytest.raises(
        RecordingError, match=r"/a\.f0\.f1\.f2\.f0"
    ):  # the twin: 81 columns are listed, and none is known
        io.load(nested_types(tmp_path, 3, 4, "float64"))
