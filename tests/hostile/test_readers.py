"""Files that attack their reader end in a recording or in one sentence, soon, in little memory, and execute nothing.

`make test-hostile` runs 100 000 mutated files; ``ACCELCAL_HOSTILE_FIRST`` is the case to resume from.
"""

from __future__ import annotations

import io as text_io
import os
import resource
import socket
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

import accelcal
from accelcal import io
from accelcal.data import units
from accelcal.data.quality import summarise
from accelcal.data.recording import Channel, Recording, RecordingError
from accelcal.data.rig import Rig
from accelcal.io import containers, files, table
from accelcal.io.sidecar import read_sidecar

from .case import LONG, cases
from .mutations import NUMBERS, SECTIONS, SIDECAR_VALUES, UNITS, zip_of
from .reader_worker import SECONDS, Worker, campaign

MANY = {"text": 40_000, "sidecars": 20_000, "containers": 40_000}
FEW = {"text": 150, "sidecars": 100, "containers": 100}
T = np.arange(60) / 100.0
ROWS = "".join(f"{t:.2f},{np.sin(t):.5f},{np.cos(t):.5f}\n" for t in T)
TABLE = "t_s,accel_g,position_mm\n" + ROWS


def seconds_of(act: Callable[[], object]) -> float:
    """Processor time of an act, in this process and in those that it started and waited for."""

    def used() -> float:
        spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return sum(item.ru_utime + item.ru_stime for item in spent)

    before = used()
    act()
    return used() - before


def sentence_of(act: Callable[[], object]) -> str:
    """What an act is refused with; "" where it is not."""
    try:
        act()
    except (RecordingError, units.UnitError) as error:
        return str(error)
    return ""


def refused(path: Path, match: str = ".", **options: object) -> str:
    """The sentence that refuses a file, within `SECONDS` of processor time."""
    messages: list[str] = []

    def act() -> None:
        with pytest.raises(RecordingError, match=match) as error:
            summarise(io.load(path, **options))  # type: ignore[arg-type]
        messages.append(str(error.value))

    assert seconds_of(act) < SECONDS
    return messages[0]


# Mutated files.


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    """One process that reads mutated files."""
    running = Worker()
    yield running
    running.close()


@pytest.mark.parametrize("section", SECTIONS)
def test_mutated_files_end_in_a_recording_or_a_sentence(worker: Worker, section: str) -> None:
    numbers = cases(FEW[section], MANY[section])
    counts, failures = campaign(worker, section, numbers)
    print(f"{section}: {dict(counts)}; failures {len(failures)} (at most 0)")
    assert not failures
    assert counts["read"] >= 0.02 * len(numbers)
    assert counts["refused"] > 0.1 * sum(counts.values())


def test_a_worker_that_dies_is_replaced_and_counted(worker: Worker) -> None:
    # The sister that must fail: a case that ends its process as a crash would.
    before = worker.deaths
    assert worker.run("crash", 1)["outcome"] == "died"
    assert worker.run("hang", 1)["outcome"] == "died"
    assert worker.run("memory", 1)["outcome"] == "failed"
    assert worker.run("text", 1)["outcome"] in ("read", "refused")
    assert worker.deaths == before + 2


# Units.


@pytest.mark.parametrize("unit", UNITS)
def test_no_unit_is_long_to_compute(tmp_path: Path, unit: str) -> None:
    def act() -> None:
        for text in (unit, f"1 {unit}", f"({unit})", unit * 3):
            assert isinstance(units.is_unit(text), bool)
            for kind in ("length", "frequency", "ratio"):
                assert len(sentence_of(lambda t=text, k=kind: units.quantity(f"1 {t}", k))) < 400  # type: ignore[misc]

    assert seconds_of(act) < SECONDS / 2.0
    column = f'"position [{unit}]"' if '"' not in unit else "position"
    path = tmp_path / "run.csv"
    path.write_text(f"t_s,accel_m_per_s2,{column}\n{ROWS}")
    assert str(path.with_suffix("")) in (sentence_of(lambda: io.load(path)) or str(path))


@pytest.mark.parametrize("unit", ["m**9**9**9", "m^9^9^9", "m^(9^9^9)", "m*10**10**10", "m**(-9**9**9)", "delta_degC"])
def test_a_unit_bomb_is_unknown_wherever_it_stands(tmp_path: Path, unit: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(f"t,accel,position\ns,g,{unit}\n{ROWS}")
    refused(path)
    path.write_text(f"t_s,accel_g,position [{unit}]\n{ROWS}")
    refused(path, "unknown unit")
    path.write_text(f"t_s,accel_g,pos\n{ROWS}")
    path.with_suffix(".toml").write_text(f'[channels]\nposition = {{ column = "pos", unit = "{unit}" }}\n')
    refused(path, "unknown unit")
    path.with_suffix(".toml").write_text(f'[channels]\nrate = "1 {unit}"\n')
    refused(path, "unknown unit")
    path.with_suffix(".toml").unlink()
    columns = {"t": T, "accel": T, "position": T}
    fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name in columns]
    parquet.write_table(pa.table(columns, schema=pa.schema(fields)), tmp_path / "run.parquet")
    refused(tmp_path / "run.parquet", "unknown unit")
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for name, y in columns.items():
            file.create_dataset(name, data=y).attrs["unit"] = unit
    refused(tmp_path / "run.h5", "unknown unit")


@pytest.mark.parametrize(
    "unit",
    ["m/s^2", "m/s²", "m·s⁻²", "m_per_s2", "V/(m/s^2)", "ug/sqrt(Hz)", "µg/√Hz", "mm/s**2", "1/s", "kg/A/s^2", "g0"],
)
def test_units_of_the_field_are_known(unit: str) -> None:
    assert units.is_unit(unit)


def test_a_wide_header_of_prose_is_judged_soon(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    words = ",".join(f"word{k}" for k in range(4000))
    path.write_text(f"{words}\n{words}\n" + (",".join(["1"] * 4000) + "\n") * 6)
    refused(path, "no column for accel")


# Files that are no files.


def test_what_is_no_regular_file_is_refused_at_once(tmp_path: Path) -> None:
    pipe, link, bound = tmp_path / "pipe.csv", tmp_path / "zero.csv", tmp_path / "socket.csv"
    os.mkfifo(pipe)
    link.symlink_to("/dev/zero")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(bound))
        for path, what in ((pipe, "a pipe"), (link, "a device"), (bound, "a socket"), (tmp_path, "a directory")):
            assert f"this is {what}" in refused(path)
            with pytest.raises(RecordingError, match=f"this is {what}"):
                read_sidecar(path)
            with pytest.raises(RecordingError, match=f"this is {what}"):
                io.load_declared(path)
    path = tmp_path / "run.csv"
    path.write_text(TABLE)
    for target in (pipe, link):
        path.with_suffix(".toml").symlink_to(target)
        refused(path, "this is a")
        refused(path, "this is a", rig=target)
        path.with_suffix(".toml").unlink()
    path.with_suffix(".toml").write_text(f'[dwell]\ntable = "{pipe}"\n')
    refused(path, "this is a pipe")


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="needs a file that cannot be read")
def test_a_file_that_fails_while_it_is_read_is_named() -> None:
    path = Path("/proc/self/mem")  # a regular file whose first byte is an error, as of a disk that fails
    for read in (io.load, read_sidecar, io.load_dwells):
        assert sentence_of(lambda r=read: r(path)).startswith(f"{path}: cannot be read (Input/output error); give ")  # type: ignore[misc]
    with pytest.raises(OSError, match="Errno 5"), path.open("rb") as file:  # the twin: the system names no file
        file.read(1)


def test_a_link_to_a_file_is_that_file(tmp_path: Path) -> None:
    (tmp_path / "kept.csv").write_text(TABLE)
    (tmp_path / "run.csv").symlink_to(tmp_path / "kept.csv")
    assert len(io.load(tmp_path / "run.csv").accel) == len(T)


@pytest.mark.parametrize("name", ["a\0b.csv", "n" * 5000 + ".csv", "名" * 120 + ".csv", "x/" * 3000, "\ud800.csv"])
def test_a_name_that_no_file_can_have_is_a_sentence(tmp_path: Path, name: str) -> None:
    path = Path(f"{tmp_path}/{name}")
    for read in (io.load, io.load_dwells, io.load_declared, io.template, read_sidecar):
        assert 0 < len(sentence_of(lambda r=read: r(path))) < 800  # type: ignore[misc]


def test_a_name_whose_sidecar_would_be_too_long_is_read(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 251 + ".csv")
    path.write_text(TABLE)
    assert len(io.load(path).accel) == len(T)


def test_what_is_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(TABLE)
    with path.with_suffix(".toml").open("wb") as file:
        file.truncate(table.SIDECAR_BYTES + 1)
    refused(path, f"expected at most {table.SIDECAR_BYTES}")
    model = tmp_path / "model.json"
    with model.open("wb") as file:
        file.truncate(table.MODEL_BYTES + 1)
    with pytest.raises(RecordingError, match="expected at most"):
        files.content_of(model, "a model file", table.MODEL_BYTES)


# Sidecars.


@pytest.mark.parametrize("value", SIDECAR_VALUES)
@pytest.mark.parametrize(
    "place",
    [
        "[uncertainty]\nencoder_scale = {}", "[sensor]\nrange = {}", "[rig]\ninput_axis = {}", "[run]\ndate = {}",
        "[channels]\nrate = {}", "[dwell]\nangle = {}", "x = {}", "[sensor]\nserial = {}",
        '[channels]\naccel = {{ column = "accel_g", lowpass = {} }}',
        '[channels]\naccel = {{ column = "accel_g", lowpass = {{ kind = "fir", taps = [1, {}] }} }}',
        '[channels]\naccel = {{ column = "accel_g", lowpass = {{ kind = "biquad", b = [1], a = [1, {}] }} }}',
        '[channels]\naccel = {{ column = "accel_g", lowpass = {{ kind = "sinc", length = {} }} }}',
    ],
)  # fmt: skip
def test_a_hostile_value_is_refused_by_its_key(tmp_path: Path, place: str, value: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(TABLE)
    path.with_suffix(".toml").write_text(place.format(value))
    messages: list[str] = []
    assert seconds_of(lambda: messages.append(sentence_of(lambda: io.load(path)))) < SECONDS
    assert not messages[0] or str(path.with_suffix("")) in messages[0]
    assert "integer string conversion" not in messages[0]
    assert len(messages[0]) < 1000


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"x = " + b"[" * 100_000, "too deep"),
        (b"x = " + b"{a=" * 5000 + b"1" + b"}" * 5000, "too deep"),
        (b"a." * 400_000 + b"b = 1", "dots in line 1"),
        (b"[" + b"a." * 400_000 + b"b]", "dots in line 1"),
        (b"x = { " + b"1." * 400_000 + b"b = 1 }", "dots in line 1"),
        (b"[uncertainty]\nencoder_scale = 1" + b"0" * 400, "not finite"),
        (b"[uncertainty]\nencoder_scale = 0x" + b"f" * 900_000, "not finite"),
        (b"[uncertainty]\nencoder_scale = 1" + b"0" * 5000, "not valid TOML"),
        (b"\xff\xfe[\x00", "not UTF-8 at byte 0"),
        (b"[sensor]\nmodel = '\xe9'", "not UTF-8 at byte"),
        (b"\x00" * 1000, "not valid TOML"),
        (b'x = "' + b'\\"' * 400_000, "not valid TOML"),
        (b"[a]\n" * 200_000, "not valid TOML"),
        (b"# " + b"." * 900_000, ""),
    ],
)
def test_a_hostile_sidecar_is_refused_soon(tmp_path: Path, text: bytes, message: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(TABLE)
    path.with_suffix(".toml").write_bytes(text)
    if message:
        assert len(refused(path, message)) < 1000
    else:
        io.load(path)


def test_a_filter_of_many_taps_is_no_long_key(tmp_path: Path) -> None:
    taps = ", ".join(["0.0005"] * 2000)
    (tmp_path / "run.csv").write_text(TABLE)
    (tmp_path / "run.toml").write_text(
        f'[channels]\naccel = {{ column = "accel_g", lowpass = {{ kind = "fir", taps = [{taps}] }} }}'
    )
    assert len(io.load(tmp_path / "run.csv").rig.output_filters[0].b) == 2000


# Text tables.


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("number", NUMBERS)
def test_a_hostile_cell_is_refused_with_its_row(tmp_path: Path, number: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(TABLE.replace("0.30,", f"{number},", 1))
    message = sentence_of(lambda: io.load(path))
    assert len(message) < 2000
    assert str(path) in message or np.isfinite(io.load(path).accel.t).all()


TEXTS = {
    "a letter behind digits": "t_s,accel_g,position_m\n" + f"0,{'1' * 60000}x,1\n" * 300,
    "digits": "t_s,accel_g,position_m\n" + f"0,{'1' * 60000},1\n" * 300,
    "spaces": "t_s,accel_g,position_m\n" + f"0,{' ' * 60000}1,1\n" * 300,
    "underscores in a name": f"{'_' * 60000},b\n" + "1,2\n" * 9,
    "spaces in a name": f"{' ' * 60000}[m],b\n" + "1,2\n" * 9,
    "brackets in a name": f"{'a(' * 20000},b\n" + "1,2\n" * 9,
    "roots in a name": f"{'sqrt(' * 9000},{'√(' * 900}\n" + "1,2\n" * 9,
    "quotes": '"' * 200_000,
    "quotes in rows": "a,b\n" + ('"' * 60_000 + ",1\n") * 20,
    "empty lines": "\n" * 2_000_000 + "1,2\n",
    "comments between rows": TABLE + "#,,,\n" * 300_000 + "9,x,9\n",
    "a wrong row at the end": TABLE + "9,9,9\n" * 100_000 + "0,0\n" + "9,9,9\n" * 100,
    "many columns": ",".join(["1"] * 5000) + "\n",
    "columns with units": ",".join(["t_s", "accel_g", "position_m", *(f"x{k}_V" for k in range(4000))]) + "\n"
    + (",".join(["1"] * 4003) + "\n") * 3,
    "returns": "\r" * 3_000_000,
    "one stamp": "t_s,accel_g,position_m\n" + "0,0,0\n" * 400_000,
    "stamps of 1e-320 s": "t_s,accel_g,position_m\n0,0,0\n1e-320,1,1\n2e-320,0,0\n",
    "stamps of 1e308 s": "t_s,accel_g,position_m\n-1e308,0,0\n0,1,1\n1e308,0,0\n",
    "readings of 1e308 m": "t_s,accel_g,position_m\n0,0,-1e308\n1,1,1e308\n2,0,0\n",
    "binary": "\x00\x01\x02" * 10_000,
}  # fmt: skip


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_a_hostile_table_is_refused_soon(tmp_path: Path, text: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text, newline="")
    assert len(refused(path)) < 20_000


def test_a_jump_of_the_clock_is_read_soon(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(TABLE + "1e12,0,0\n")
    assert seconds_of(lambda: summarise(io.load(path))) < SECONDS
    assert io.load(path).accel.t[-1] == 1e12


# Containers.


def npy(values: np.ndarray | None, header: str = "") -> bytes:
    """A member of an archive; without values a header alone."""
    buffer = text_io.BytesIO()
    if values is not None:
        np.lib.format.write_array(buffer, values)
    else:
        text = header.encode() + b"\n"
        buffer.write(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text)
    return buffer.getvalue()


def test_an_unused_array_of_4_gb_is_not_inflated(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, t_s=T, accel_g=np.sin(T), position_mm=np.cos(T))
    head = npy(None, "{'descr': '<f8', 'fortran_order': False, 'shape': (500000000,), }")
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive, archive.open("big.npy", "w") as member:
        member.write(head)
        for _ in range(500 if LONG else 20):
            member.write(bytes(8_000_000))
    if not LONG:
        refused(path, "truncated or damaged")  # a header that promises more than there is
        return
    assert seconds_of(lambda: summarise(io.load(path))) < SECONDS


def test_numbers_beyond_the_size_of_a_file_are_refused_before_they_are_read(tmp_path: Path) -> None:
    n = table.FREE_NUMBERS
    constant = pa.array(np.zeros(n))
    path = tmp_path / "run.parquet"
    parquet.write_table(pa.table({"t_s": constant, "accel_g": constant, "position_m": constant}), path)
    refused(path, f"hold {3 * n} numbers in {path.stat().st_size} bytes")
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        for name in ("t_s", "accel_g", "position_m"):
            file.create_dataset(name, shape=(500_000_000,), dtype="f8", chunks=(1 << 20,))
    refused(path, "holds 500000000 samples, expected at most")


def test_an_unwritten_vector_beside_a_recording_is_not_read(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        for name, y in (("t_s", T), ("accel_g", np.sin(T)), ("position_m", np.cos(T))):
            file[name] = y
        file.create_dataset("unwritten", shape=(500_000_000,), dtype="f8", chunks=(1 << 20,))
    assert len(io.load(path).accel) == len(T)


def test_numbers_that_stand_in_another_file_are_not_read(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    other, pipe = tmp_path / "other.bin", tmp_path / "pipe"
    other.write_bytes(bytes(8 * len(T)))
    os.mkfifo(pipe)
    with h5py.File(tmp_path / "source.h5", "w") as file:
        file["accel_g"] = np.sin(T)

    def external(file: object, name: str, target: Path) -> None:
        places = [(str(target), 0, 8 * len(T))]
        file.create_dataset(name, shape=T.shape, dtype="f8", external=places)  # type: ignore[attr-defined]

    def virtual(file: object, name: str, target: Path) -> None:
        layout = h5py.VirtualLayout(shape=T.shape, dtype="f8")
        layout[:] = h5py.VirtualSource(str(target), name, shape=T.shape)
        file.create_virtual_dataset(name, layout)  # type: ignore[attr-defined]

    for make, target in (
        (external, other),
        (external, pipe),
        (external, Path("/etc/passwd")),
        (virtual, tmp_path / "source.h5"),
    ):
        path = tmp_path / "run.h5"
        with h5py.File(path, "w") as file:
            file["t_s"], file["position_m"] = T, np.cos(T)
            make(file, "accel_g", target)
        refused(path, 'column "accel_g" keeps its numbers in another file')
    with h5py.File(path, "w") as file:
        file["t_s"], file["position_m"] = T, np.cos(T)
        file["accel_g"] = h5py.ExternalLink("source.h5", "/accel_g")
        file["soft"] = h5py.SoftLink("/accel_g")
    refused(path, "no column for accel")


def test_deep_and_circular_groups_end(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        group = file
        for _ in range(300):
            group = group.create_group("g")
        group["t_s"] = T
    refused(path, "groups lie more than 32 deep")
    with h5py.File(path, "w") as file:
        group = file
        for _ in range(25):  # 2^25 ways to the end
            below = group.create_group("a")
            group["b"], group["ring"] = below, file["/"]
            group = below
        file["t_s"], file["accel_g"], file["position_m"] = T, np.sin(T), np.cos(T)
    assert len(io.load(path).accel) == len(T)


def test_many_columns_are_refused_or_read_soon(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    member = npy(T)
    path.write_bytes(zip_of({f"x{k}.npy": member for k in range(table.MOST_COLUMNS + 1)}))
    refused(path, "expected at most 4096")
    vectors = {"t_s": T, "accel_g": np.sin(T), "position_m": np.cos(T)}
    path.write_bytes(
        zip_of({f"{k}.npy": npy(y) for k, y in vectors.items()} | {f"x{k}.npy": member for k in range(3000)})
    )
    assert seconds_of(lambda: summarise(io.load(path))) < SECONDS


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (4611686018427387904,), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
        "{'descr': '|O', 'fortran_order': False, 'shape': (3,), }",
        "{'descr': __import__('os').abort(), 'fortran_order': False, 'shape': (3,), }",
        "[" * 9000,
        "(" * 60 + ")" * 60,
    ],
)
def test_headers_of_arrays_are_not_believed(tmp_path: Path, header: str) -> None:
    path = tmp_path / "run.npz"
    path.write_bytes(zip_of({"t_s.npy": npy(None, header), "accel_g.npy": npy(T)}))
    refused(path)


def test_pickles_are_passed_over(tmp_path: Path) -> None:
    folder = tmp_path / "made"

    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(folder),)

    path = tmp_path / "run.npz"
    np.savez(path, t_s=T, accel_g=np.sin(T), position_m=np.cos(T), note=np.array([Bomb()], dtype=object))
    io.load(path)
    path.write_bytes(zip_of({"t_s": b"", "accel_g.npy": b"\x80\x04."}))
    refused(path)
    assert not folder.exists()


# The process that opens them.


def in_child(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    """Let the process run some code in place of its reader."""
    served = containers._START.replace("main(sys.stdin", f"{code}\nmain(sys.stdin")
    monkeypatch.setattr(containers, "_START", served)


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("import os; os.kill(os.getpid(), 11)", "truncated or damaged \\(its reader ended with SIGSEGV\\)"),
        ("sys.exit(3)", "its reader ended with code 3"),
        (
            "from accelcal.io.decoding import child; child.SECONDS = 0.0\n"
            "import accelcal.io.decoding.npz as m\ndef f(path):\n    while True: pass\nm.opened = f",
            "takes longer than its size explains",
        ),
        (
            "import accelcal.io.decoding.npz as m\nm.opened = lambda path: bytes(10**10)",
            "takes more than 512 MB, far beyond its size",
        ),
        ("import accelcal.io.decoding.npz as m\nm.opened = lambda path: [].x", "truncated or damaged"),
        ("sys.stdout.buffer.write(b'[' * 10**5 + b'\\n'); sys.stdout.flush()", "does not answer as it should"),
        ("sys.stdout.buffer.write(b'{}\\n'); sys.stdout.flush()", "does not answer as it should"),
        ("sys.stdout.buffer.write(b'[1, 2'); sys.stdout.flush(); sys.exit()", "its reader ended with code 0"),
    ],
)
def test_whatever_becomes_of_the_process_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, text: str
) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, t_s=T, accel_g=np.sin(T), position_m=np.cos(T))
    in_child(monkeypatch, code)
    assert "\n" not in refused(path, text)


def test_a_process_that_sleeps_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, t_s=T, accel_g=np.sin(T), position_m=np.cos(T))
    in_child(monkeypatch, "import time; time.sleep(3600)")
    monkeypatch.setattr(containers, "PATIENCE", 0.2)
    refused(path, "takes longer than its size explains")


def container(path: Path) -> Path:
    """A small archive."""
    np.savez(path, t_s=T, accel_g=np.sin(T), position_m=np.cos(T))
    return path


def test_no_process_is_left(tmp_path: Path) -> None:
    path = container(tmp_path / "run.npz")
    table = containers.open_container(path, "npz")
    assert table.read(["t_s"])["t_s"].values.tolist() == T.tolist()
    assert table.read(["accel_g"])["accel_g"].values.tolist() == np.sin(T).tolist()  # by another process
    process = containers.ReaderProcess(path, "npz")
    served = process._process
    del process
    assert served.poll() is not None


def test_a_file_that_is_looked_at_twice_is_opened_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, started, start = container(tmp_path / "run.npz"), [], containers.start
    monkeypatch.setattr(containers, "start", lambda: started.append(1) or start())
    files.open_table(path)
    io.load(path)
    assert len(started) == 1
    np.savez(path, t_s=T + 1.0, accel_g=np.sin(T), position_m=np.cos(T))
    files.open_table(path)
    np.savez(path, t_s=T + 20.0, accel_g=np.sin(T), position_m=np.cos(T))
    assert io.load(path).accel.t[0] == 20.0  # changed in between


def test_an_idle_process_ends_and_another_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = container(tmp_path / "run.npz")
    in_child(monkeypatch, "from accelcal.io.decoding import child; child.IDLE = 0.05")
    table = containers.open_container(path, "npz")
    _kept = containers._WAITING._kept
    assert _kept is not None
    _kept[1]._process.wait()
    monkeypatch.undo()
    assert len(table.read(["t_s"])["t_s"].values) == len(T)


SCRIPTS = {
    "a script without a guard": "print(len(accelcal.load(sys.argv[1]).accel))",
    "a thread": "import threading\nt = threading.Thread(target=lambda: print(len(accelcal.load(sys.argv[1]).accel)))\n"
    "t.start(); t.join()",
    "a daemon": "import multiprocessing as m\np = m.get_context('fork').Process(target=lambda: "
    "print(len(accelcal.load(sys.argv[1]).accel), flush=True), daemon=True)\np.start(); p.join()",
    "without standard streams": "a = sys.argv[1]; import os\nos.close(0); print(len(accelcal.load(a).accel))",
    "after a fork": "import os, pathlib\naccelcal.io.files.open_table(pathlib.Path(sys.argv[1]))\n"
    "if os.fork() == 0:\n    sys.exit(0)\nos.wait(); print(len(accelcal.load(sys.argv[1]).accel))",
}


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS)
def test_containers_are_read_wherever_python_runs(tmp_path: Path, script: str) -> None:
    path = container(tmp_path / "run.npz")
    program = tmp_path / "program.py"
    program.write_text(f"import sys, accelcal, accelcal.io\n{script}\n")
    done = subprocess.run([sys.executable, program, path], capture_output=True, text=True, check=True, timeout=300)
    assert done.stdout.strip() == str(len(T))
    assert done.stderr == ""


def test_threads_read_at_once(tmp_path: Path) -> None:
    paths = [container(tmp_path / f"run{k % 3}.npz") for k in range(3)] * 2
    results: list[int] = []
    threads = [threading.Thread(target=lambda p: results.append(len(io.load(p).accel)), args=(path,)) for path in paths]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [len(T)] * len(paths)


@pytest.mark.parametrize("suffix", ["npz", "parquet", "mat", "h5"])
def test_opening_a_small_container_is_cheap(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run.{suffix}"
    vectors = {"t_s": T, "accel_g": np.sin(T), "position_m": np.cos(T)}
    if suffix == "npz":
        np.savez(path, **vectors)
    elif suffix == "parquet":
        parquet.write_table(pa.table(vectors), path)
    elif suffix == "mat":
        from scipy.io import savemat

        savemat(path, vectors)
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            for name, y in vectors.items():
                file[name] = y
    least = min(seconds_of(lambda: io.load(path)) for _ in range(2))
    print(f"{suffix}: {least:.2f} s of processor time (at most 1.5)")
    assert least < 1.5


# Recordings that Python code makes.


def recording_of(t: object, y: object, tp: object, p: object) -> Recording:
    """A recording of anything."""
    return Recording(Channel("accel", t, y, "m/s^2"), Channel("position", tp, p, "m"), Rig())  # type: ignore[arg-type]


U = np.arange(400) / 100.0
STAMPS = {
    "none": U[:0], "one": U[:1], "equal": 0.0 * U, "falling": -U, "not finite": np.where(U == 1.0, np.nan, U),
    "of 1e-320 s": U * 1e-320, "of 1e-12 s": U * 1e-12, "of 1e12 s": U * 1e14, "in two dimensions": U[:, None],
    "half of 1e-300 s": np.concatenate([np.arange(200) * 1e-300, 1.0 + U[:200]]), "text": U.astype(str),
}  # fmt: skip


@pytest.mark.parametrize("t", STAMPS.values(), ids=STAMPS)
def test_unusable_recordings_are_refused_at_once_or_by_a_fit(t: np.ndarray) -> None:
    y = np.zeros(t.shape) if t.dtype.kind == "U" else np.sin(t)
    for series in ((t, y, t, y), (t, y, U, np.sin(U)), (U, np.sin(U), t, y)):
        with pytest.raises(ValueError, match=r"recording|expected real numbers in one dimension"):
            accelcal.fit(recording_of(*series))


def test_readings_and_stamps_must_pair() -> None:
    with pytest.raises(RecordingError, match="expected as many"):
        accelcal.fit(recording_of(U, U[:-1], U, U))
    with pytest.raises(RecordingError, match="share no stretch"):
        accelcal.fit(recording_of(U, U, U + 100.0, U))


@pytest.mark.parametrize("jump", [1e7, 1e12])
def test_a_jump_of_the_clock_is_refused_by_a_fit(jump: float) -> None:
    t = np.where(U > 1.0, U + jump, U)
    with pytest.raises(RecordingError, match="the clock jumps"):
        accelcal.fit(recording_of(t, np.sin(U), t, np.cos(U)))
