"""Valid recordings of every format, and what becomes of them: bytes, numbers, fields, headers and structure changed.

A case is a function of its section ("text", "sidecars" or "containers") and its number: `case_files` makes its files.
"""

from __future__ import annotations

import io
import re
import struct
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from accelcal.io import naming
from tests.io.recorders import IN_MESSAGES, NO_UNITS, RECORDERS, named

from .case import case_rng

SECTIONS = ("text", "sidecars", "containers")
Rng = np.random.Generator
Vectors = dict[str, np.ndarray]

NUMBERS = (
    "nan", "inf", "-inf", "1e400", "-1e400", "1e308", "-1e308", "5e-324", "-0", "1e12", "1e30", "9" * 39, "9" * 400,
    "1" * 5000, "0x10", "1_000", "1,5", "1.5.2", "--1", "+", "", " ", '"', "''", "½", "1", "١", "1e", "e5", "NULL",
    "true", "2026-11-03T00:00:00", "9999-12-31T23:59:59Z", "0001-01-01", "1" * 60000 + "x", "=1+1", "\x00", "\x1b[31m",
)  # fmt: skip
UNITS = (
    "m**9**9**9", "m^9^9^9", "m^(9^9^9)", "m*10**10**10", "m**(-9**9**9)", "m" + "^2" * 25, "m" * 70, "delta_degC", "",
    "degC*degC", "degC/s", "m/m/m/m", "h^12*h^12*h^12", "1/m^12", "g^-12", "(m", "m)", "()", "m.__class__",
    "__import__", "m lambda", "1e5 m", "km^12*km^12", "sqrt(" * 12, "√√√", "m²²²²²", "%", "?", "m\x00", "ms", "mm/s²",
    "furlong", "T",
)  # fmt: skip
SIDECAR_VALUES = (
    "1" + "0" * 400, "1" + "0" * 5000, "0x" + "f" * 400, "0x" + "f" * 5000, "-1", "nan", "inf", "1e308", "true", "[]",
    "[[[[[[[[]]]]]]]]", "[" * 3000 + "]" * 3000, "{}", "{a={a={a=1}}}", '""', '"?"', '"nan g"', '"1e999 g"', '"1 Hz"',
    '"1 Hz**9**9**9"', '"1e300 km"', '"1e-320 s"', '"-5 mg"', '"5 delta_degC"', '"' + "x" * 3000 + '"', "2026-11-03",
    "0001-01-01", "9999-12-31T23:59:59-23:59", "00:00:00", '"\\u0000"', '"../../../etc/passwd"', '"/dev/zero"', "'''",
    "[1e308, 1e308, 1e308]", "[1, 2]", '["a", "b", "c", "d"]', "[nan]", "0b1", "1__0", "a.b.c", '"1 g" "2 g"',
)  # fmt: skip
SIDECAR = """\
[sensor]
model = "ADXL105"
serial = "12"
noise = "225 ug/sqrt(Hz)"
bias_instability = "100 ug"
range = "5 g"
scale = "0.25 V/g"
zero = "2.5 V"
[rig]
axis = "level"
mount = "normal"
[clock]
offset_tolerance = "5 us"
[channels]
time = { column = "t_s", unit = "s" }
accel = { column = "accel_V", unit = "V", lowpass = { kind = "RC", fc = "159 Hz", tolerance = 0.01 } }
position = { column = "position_mm", unit = "mm", resolution = "1 um" }
temperature = { column = "temp_degC", unit = "degC" }
other = { column = "x [mT]", unit = "mT" }
[uncertainty]
encoder_scale = 1e-5
level = "0.05 deg"
misalignment = "0.1 deg"
[run]
date = 2026-11-03T14:30:00Z
mounting = "A"
operator = "N"
[judge]
tolerance = "1 mg"
"""


def case_files(section: str, number: int, folder: Path) -> Path:
    """Write the files of one case into an empty folder, and return the recording."""
    rng = case_rng(section, number)
    if section == "text":
        path = folder / "run.csv"
        path.write_bytes(_mutated_text(rng, _table(rng)))
    elif section == "sidecars":
        path = folder / "run.csv"
        path.write_bytes(_table_for_sidecar(rng))
        (folder / "run.toml").write_bytes(_mutated_sidecar(rng))
    else:
        names = list(CONTAINERS)
        name = names[number % len(names)]
        path = folder / f"run.{name.partition('-')[2] or name}"
        vectors = _hostile_vectors(rng) if rng.uniform() < 0.4 else _vectors(rng)
        CONTAINERS[name](path, vectors, rng)
        if rng.uniform() < 0.8:
            path.write_bytes(_mutated_bytes(rng, path.read_bytes()))
    return path


def _vectors(rng: Rng) -> Vectors:
    n = int(rng.integers(30, 300))
    t = np.arange(n) / 100.0
    return {"t_s": t, "accel_g": np.sin(t), "position_mm": np.cos(t), "temp_degC": 20.0 + t}


def _choice(rng: Rng, options: Any) -> Any:
    return options[int(rng.integers(len(options)))]


# Text.


def _table(rng: Rng) -> str:
    """A table in one of the dialects."""
    vectors = _vectors(rng)
    rows = [[f"{x:.6g}" for x in row] for row in zip(*vectors.values(), strict=True)]
    for row in rows[1::2]:
        row[2] = ""  # the encoder is slower
    kind = int(rng.integers(7))
    if kind == 0:  # semicolons, decimal commas, a unit row
        lines = ["time;accel;position;temp", "s;g;mm;degC"]
        return "\n".join(lines + [";".join(row).replace(".", ",") for row in rows])
    if kind == 1:  # preamble, comments, tabs
        lines = ["Logger 3.1", "# serial 12", "", "\t".join(vectors)]
        return "\r\n".join(lines + ["\t".join(row) for row in rows])
    if kind == 2:  # stamps
        stamps = [f"2026-11-03T14:30:{float(row[0]):09.6f}Z" for row in rows]
        return "\n".join(
            ["time,accel_g,position [mm]"] + [f"{s},{row[1]},{row[2]}" for s, row in zip(stamps, rows, strict=True)]
        )
    if kind == 3:  # dwells
        angles = [f"{10 * k},{np.sin(k):.5f},0.001,5,23.1,500,{k % 2}" for k in range(12)]
        names = ["attitude_deg,mean,std,duration_s,temperature_degC,samples,group", "deg,g,g,s,degC,1,1"]
        return "\n".join(names + angles)
    if kind == 4:  # quoted cells, clocks of their own
        names = "time [s],accel (m/s²),accel_t_ms,position [µm],position_t_ms"
        return "\n".join([names] + [f'"{r[0]}","{r[1]}",{r[0]},"{r[2]}",{r[0]}' for r in rows])
    return "\n".join([",".join(vectors)] + [",".join(row) for row in rows])


def _mutated_text(rng: Rng, text: str) -> bytes:
    for _ in range(int(_choice(rng, (1, 1, 1, 2, 3)))):
        text = _choice(rng, _TEXT_MUTATIONS)(rng, text)
    data = text.encode(_choice(rng, ("utf-8",) * 10 + ("utf-16", "utf-8-sig")), errors="replace")
    return _mutated_bytes(rng, data) if rng.uniform() < 0.3 else data


def _cell(rng: Rng, text: str, new: Callable[[str], str], first: int = 0) -> str:
    lines = text.split("\n")
    at = int(rng.integers(min(first, len(lines) - 1), len(lines)))
    mark = max(",;\t", key=lines[at].count)
    cells = lines[at].split(mark)
    k = int(rng.integers(len(cells)))
    cells[k] = new(cells[k])
    lines[at] = mark.join(cells)
    return "\n".join(lines)


def _number(rng: Rng, text: str) -> str:
    return _cell(rng, text, lambda _: _choice(rng, NUMBERS), 1)


def _column(rng: Rng, text: str) -> str:
    """Every number of a column becomes another."""
    lines = text.split("\n")
    mark = max(",;\t", key=lines[-1].count)
    k = int(rng.integers(max(1, lines[-1].count(mark) + 1)))
    new = str(_choice(rng, NUMBERS))
    scale = float(_choice(rng, (0.0, -1.0, 1e-15, 1e9, 1e300, 1e-320)))
    for i in range(1, len(lines)):
        cells = lines[i].split(mark)
        if k < len(cells):
            try:
                cells[k] = repr(float(cells[k]) * scale)
            except ValueError:
                cells[k] = new if rng.uniform() < 0.5 else cells[k]
        lines[i] = mark.join(cells)
    return "\n".join(lines)


def _header(rng: Rng, text: str) -> str:
    lines = text.split("\n")
    at = int(rng.integers(min(4, len(lines))))
    new = (
        lambda old: f"{old} [{_choice(rng, UNITS)}]",
        lambda old: f"{old}_{_choice(rng, UNITS)}",
        lambda old: f"{old} ({_choice(rng, UNITS)})",
        lambda old: _choice(
            rng, ("t_s", "time", "accel_g", "pos_m", "position_t", "", "_" * 900, " " * 5000, "(" * 3000)
        ),
        lambda old: str(_choice(rng, UNITS)),
    )
    lines[at : at + 1] = _cell(rng, lines[at], _choice(rng, new)).split("\n")
    return "\n".join(lines)


def _lines_moved(rng: Rng, text: str) -> str:
    lines = text.split("\n")
    a, b = sorted(rng.integers(0, len(lines), 2).tolist())
    part = lines[a : b + 1]
    how = int(rng.integers(4))
    if how == 0:
        return "\n".join(lines[:a] + lines[b + 1 :])
    if how == 1:
        return "\n".join(lines[: b + 1] + part * int(rng.integers(1, 4)) + lines[b + 1 :])
    if how == 2:
        rng.shuffle(part)
        return "\n".join(lines[:a] + part + lines[b + 1 :])
    return "\n".join(lines[:a] + part[::-1] + lines[b + 1 :])


def _fields_swapped(rng: Rng, text: str) -> str:
    held: list[str] = []

    def take(cell: str) -> str:
        held.append(cell)
        return held[0]

    return _cell(rng, _cell(rng, text, take), take)


def _separators(rng: Rng, text: str) -> str:
    old, new = _choice(
        rng, ((",", ";"), (",", "\t"), (".", ","), ("\n", "\r"), ("\n", "\n\n"), (",", ",,"), ("\n", ""))
    )
    return text.replace(old, new, int(_choice(rng, (1, 20, -1))))


def _inserted(rng: Rng, text: str) -> str:
    at = int(rng.integers(len(text) + 1))
    piece = str(_choice(rng, ('"', "#", "\x00", "\ufeff", "%", "//", ",", "\n", " " * 400, "\t", "é", *NUMBERS)))
    return text[:at] + piece * int(_choice(rng, (1, 1, 2, 50))) + text[at:]


def _long(rng: Rng, text: str) -> str:
    return text + str(_choice(rng, ("\n", ",", "1", "1,", " ", '"', "#", "\n,,,", "é"))) * int(rng.integers(1, 200_000))


_TEXT_MUTATIONS = (
    _number, _number, _number, _column, _column, _header, _header, _lines_moved, _fields_swapped, _separators,
    _inserted, _long,
)  # fmt: skip


# Sidecars.


def _table_for_sidecar(rng: Rng) -> bytes:
    vectors = _vectors(rng)
    rows = [f"{t:.6g},{2.5 + 0.25 * a:.6g},{p:.6g},{c:.6g},1" for t, a, p, c in zip(*vectors.values(), strict=True)]
    return "\n".join(["t_s,accel_V,position_mm,temp_degC,x [mT]", *rows]).encode()


def _mutated_sidecar(rng: Rng) -> bytes:
    text = SIDECAR
    for _ in range(int(_choice(rng, (1, 1, 1, 2, 3)))):
        text = _choice(rng, _SIDECAR_MUTATIONS)(rng, text)
    data = text.encode(_choice(rng, ("utf-8",) * 30 + ("utf-16",)), errors="replace")
    return _mutated_bytes(rng, data) if rng.uniform() < 0.15 else data


def _replaced(rng: Rng, text: str, pattern: str, new: Callable[[str], str]) -> str:
    listed = list(re.finditer(pattern, text))
    if not listed:
        return text
    match = _choice(rng, listed)
    return text[: match.start()] + new(match[0]) + text[match.end() :]


def _value(rng: Rng, text: str) -> str:
    return _replaced(rng, text, r"(?<== )[^\n,{}]+", lambda _: _choice(rng, SIDECAR_VALUES))


def _line_value(rng: Rng, text: str) -> str:
    return _replaced(rng, text, r"(?<== )[^\n]+", lambda _: _choice(rng, SIDECAR_VALUES))


def _sidecar_unit(rng: Rng, text: str) -> str:
    unit = _choice(rng, UNITS).replace("\\", "").replace('"', "").replace("\x00", "\\u0000")
    return _replaced(rng, text, r'(?<=unit = )"[^"]*"', lambda _: f'"{unit}"')


def _quantity(rng: Rng, text: str) -> str:
    number = _choice(rng, [n for n in NUMBERS if len(n) < 100 and n.isprintable() and '"' not in n])
    return _replaced(rng, text, r'(?<=")[0-9.]+ ', lambda _: f"{number} ")


def _key(rng: Rng, text: str) -> str:
    names = ("axis", "scal", "channels", "a.b.c", '""', "gyr_x", "attitude", "input_axis", "lowpass", "b." * 90 + "c")
    return _replaced(rng, text, r"(?m)^\w+(?= =)", lambda _: _choice(rng, names))


def _table_name(rng: Rng, text: str) -> str:
    names = ("[sensor]", "[rig]", "[dwell]", "[channels.attitude]", "[[channels]]", "[]", "[a.b]", "[channels.accel]")
    return _replaced(rng, text, r"(?m)^\[\w+\]", lambda _: _choice(rng, names))


def _added(rng: Rng, text: str) -> str:
    lines = (
        '[dwell]\nattitude = "up"', '[dwell]\nangle = "1e300 deg"', '[dwell]\ntable = "/dev/zero"',
        "[dwell]\ntable = 1",
        '[channels.attitude]\ncolumns = ["a", "b", "c", "d"]\nmaps = "sensor to ENU"', "x = " + "[" * 2000,
        'position = { column = "position_mm", lowpass = { kind = "fir", taps = [1e308, 1e308] } }', "[run]\ndate = 1",
    )  # fmt: skip
    parts = text.split("\n")
    parts.insert(int(rng.integers(len(parts) + 1)), _choice(rng, lines))
    return "\n".join(parts)


_SIDECAR_MUTATIONS = (
    _value, _value, _value, _line_value, _line_value, _sidecar_unit, _quantity, _quantity, _key, _table_name, _added,
    _lines_moved,
)  # fmt: skip


# Containers.


def _hostile_vectors(rng: Rng) -> Vectors:
    """Vectors whose numbers, types, lengths or shapes are not those of a recording."""
    vectors = _vectors(rng)
    for _ in range(int(rng.integers(1, 3))):
        name = str(_choice(rng, list(vectors)))
        y = vectors[name]
        k = int(rng.integers(max(1, len(y)))) if y.ndim else 0
        with np.errstate(all="ignore"):
            vectors[name] = _choice(rng, _VECTOR_MUTATIONS)(rng, y.real.copy().ravel(), k)
    return vectors


def _put(value: float) -> Callable[[Rng, np.ndarray, int], np.ndarray]:
    def put(rng: Rng, y: np.ndarray, k: int) -> np.ndarray:
        y = y.astype(np.float64)
        y[k : k + int(rng.integers(1, 4))] = value
        return y

    return put


_VECTOR_MUTATIONS: tuple[Callable[[Rng, np.ndarray, int], np.ndarray], ...] = (
    *(_put(x) for x in (np.nan, np.inf, -np.inf, 1e308, 5e-324, 1e12, -1e12, 0.0)),
    lambda rng, y, k: y[::-1],
    lambda rng, y, k: y[:k],
    lambda rng, y, k: y[:0],
    lambda rng, y, k: np.concatenate([y, y]),
    lambda rng, y, k: y[:, None] * np.ones(2),
    lambda rng, y, k: (y * 1e300).astype(np.float64),
    lambda rng, y, k: (y * 1e-318).astype(np.float64),
    lambda rng, y, k: y.astype(_choice(rng, (np.int8, np.uint64, np.float16, np.float32, np.bool_))),
    lambda rng, y, k: y.astype(np.complex128),
    lambda rng, y, k: np.full(len(y), y[0] if len(y) else 0.0),
    lambda rng, y, k: rng.permutation(y),
)


def _unit_attributes(rng: Rng, names: Any) -> dict[str, str]:
    if rng.uniform() < 0.6:
        return {}
    return {name: _choice(rng, UNITS) for name in names if rng.uniform() < 0.5}


def _npz(path: Path, vectors: Vectors, rng: Rng) -> None:
    (np.savez_compressed if rng.uniform() < 0.5 else np.savez)(path, **vectors)
    if rng.uniform() < 0.2:
        header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({int(rng.integers(1, 2**62))},), }}\n".encode()
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("huge.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)


def _parquet(path: Path, vectors: Vectors, rng: Rng) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    units = _unit_attributes(rng, vectors)
    remaining = {name: y for name, y in vectors.items() if y.ndim == 1 and y.dtype.kind != "c"}
    n = min(map(len, remaining.values()), default=0)
    arrays = {
        name: pa.array(y[:n], mask=rng.uniform(size=n) < _choice(rng, (0.0, 0.3))) for name, y in remaining.items()
    }
    if rng.uniform() < 0.2:
        arrays["t_s"] = pa.array((np.arange(n) * 1000).astype("int64")).cast(
            pa.timestamp(_choice(rng, ("s", "us", "ns")))
        )
    fields = [pa.field(k, v.type, metadata={"unit": units[k]} if k in units else None) for k, v in arrays.items()]
    table = pa.table(arrays, schema=pa.schema(fields))
    parquet.write_table(
        table, path, compression=_choice(rng, ("zstd", "snappy", "none", "gzip")), row_group_size=64,
        use_dictionary=bool(rng.uniform() < 0.5), write_page_checksum=bool(rng.uniform() < 0.3),
    )  # fmt: skip


def _mat(version: str) -> Callable[[Path, Vectors, Rng], None]:
    def write(path: Path, vectors: Vectors, rng: Rng) -> None:
        from scipy.io import savemat

        if version == "4":
            savemat(path, {k: v for k, v in vectors.items() if v.dtype.kind not in "bu"}, format="4")
            return
        content: Mapping[str, Any] = vectors
        if rng.uniform() < 0.4:
            cells = np.empty(2, dtype=object)
            cells[:] = [vectors, "text"]
            content = {"run": {"x": vectors}, "cells": cells, **vectors}
        savemat(path, dict(content), do_compression=bool(rng.uniform() < 0.5))

    return write


def _hdf5(userblock: int) -> Callable[[Path, Vectors, Rng], None]:
    def write(path: Path, vectors: Vectors, rng: Rng) -> None:
        import h5py

        units = _unit_attributes(rng, vectors)
        with h5py.File(path, "w", userblock_size=userblock) as file:
            group = file.create_group("run") if rng.uniform() < 0.3 else file
            for name, y in vectors.items():
                options = {"compression": "gzip", "shuffle": True} if len(y) and rng.uniform() < 0.5 else {}
                item = group.create_dataset(name, data=y, **options)
                if name in units:
                    item.attrs["unit"] = units[name].replace("\x00", "")
            how = int(rng.integers(12))
            if how == 0:
                group.create_dataset("unwritten", shape=(int(rng.integers(1, 2**40)),), dtype="f8", chunks=(1 << 20,))
            elif how == 1:
                group["soft"] = h5py.SoftLink("/run")
                group["outside"] = h5py.ExternalLink("/etc/passwd", "/")
            elif how == 2:
                group["ring"] = group
            elif how == 3:
                group.create_dataset("raw", shape=(8,), dtype="u1", external=[("/etc/passwd", 0, 8)])
        if userblock:
            with path.open("r+b") as raw:
                raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")

    return write


def _recorded(write: Callable[..., None]) -> Callable[[Path, Vectors, Rng], None]:
    """By the writer of another logger: what its library accepts of the vectors, called as a reader finds it."""

    def write_file(path: Path, vectors: Vectors, rng: Rng) -> None:
        remaining = {
            naming.take_apart(name).base: y.astype(np.float64)
            for name, y in vectors.items()
            if name != "t_s" and y.ndim == 1 and y.dtype.kind in "fiu" and len(y) > 3
        }
        units = {"accel": "g", "position": "mm", "temp": "degC"} if rng.uniform() < 0.7 else {}
        units |= {name: _choice(rng, UNITS).replace("\x00", "")[:20] for name in remaining if rng.uniform() < 0.1}
        with np.errstate(all="ignore"):
            write(
                path,
                remaining if len(remaining) > 1 else {"accel": np.arange(9.0), "x": np.arange(9.0)},
                units,
                float(_choice(rng, (0.01, 0.01, 1e-9, 1e3))),
            )
        if rng.uniform() < 0.7:
            suffix = path.suffix.removeprefix(".")
            declared = ("accel", "position") if suffix in IN_MESSAGES or suffix in NO_UNITS else ()
            lines = [f'{name} = {{ column = "{named(suffix, name)}" }}' for name in declared]
            path.with_suffix(".toml").write_text("\n".join(["[channels]", *lines]))

    return write_file


CONTAINERS: dict[str, Callable[[Path, Vectors, Rng], None]] = {
    "npz": _npz,
    "parquet": _parquet,
    "v5-mat": _mat("5"),
    "h5": _hdf5(0),
    "v4-mat": _mat("4"),
    "v73-mat": _hdf5(512),
    **{suffix: _recorded(write) for suffix, write in RECORDERS.items()},
}
"""Writers by name; what follows the dash is the suffix."""


# Bytes.


def _mutated_bytes(rng: Rng, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        if not changed:
            break
        _choice(rng, _BYTE_MUTATIONS)(rng, changed)
    return bytes(changed)


def _place(rng: Rng, data: bytearray) -> int:
    """Anywhere, but most often near the begin or the end, where headers are."""
    n = len(data)
    reach = _choice(rng, (n, 64, 512, 2048, n))
    at = int(rng.integers(min(n, reach)))
    return at if rng.uniform() < 0.6 else n - 1 - at


def _flip(rng: Rng, data: bytearray) -> None:
    for _ in range(int(_choice(rng, (1, 1, 2, 5, 30)))):
        data[_place(rng, data)] = int(rng.integers(256))


def _bit(rng: Rng, data: bytearray) -> None:
    data[_place(rng, data)] ^= 1 << int(rng.integers(8))


def _cut(rng: Rng, data: bytearray) -> None:
    at = _place(rng, data)
    del data[at : at + int(_choice(rng, (1, 4, 16, 200, len(data))))]


def _repeat(rng: Rng, data: bytearray) -> None:
    at, length = _place(rng, data), int(_choice(rng, (1, 8, 64, 1000)))
    data[at:at] = data[at : at + length] * int(_choice(rng, (1, 1, 3)))


def _exchange(rng: Rng, data: bytearray) -> None:
    a, b, length = _place(rng, data), _place(rng, data), int(_choice(rng, (1, 4, 8, 64)))
    first, second = bytes(data[a : a + length]), bytes(data[b : b + length])
    data[a : a + len(second)] = second
    data[b : b + len(first)] = first


def _integer(rng: Rng, data: bytearray) -> None:
    """An integer of a header becomes an extreme one."""
    value = int(
        _choice(rng, (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1, 255, 65535, 1 << 28))
    )
    size = int(_choice(rng, (2, 4, 8)))
    at = _place(rng, data) // 4 * 4
    part = (value % (1 << 8 * size)).to_bytes(size, str(_choice(rng, ("little", "big"))))  # type: ignore[arg-type]
    data[at : at + size] = part[: max(0, len(data) - at)]


_BYTE_MUTATIONS = (_flip, _flip, _bit, _bit, _cut, _repeat, _exchange, _integer, _integer)


def zip_of(members: Mapping[str, bytes]) -> bytes:
    """A compressed zip archive."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()
