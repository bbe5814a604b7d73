"""Recordings and rigs to files, each whole or not at all, also while a recording grows; a mark tells who wrote them."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from operator import attrgetter
from pathlib import Path
from types import MappingProxyType, SimpleNamespace, TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from accelcal._support.errors import AccessError
from accelcal.data import (
    GRAVITY,
    NO_LABELS,
    UNITS,
    Array,
    Channel,
    ChannelFilter,
    DwellSetup,
    Finding,
    Flags,
    Recording,
    RecordingError,
    Rig,
    RunLabels,
    high_passes,
    low_passes,
    reference_among,
    units,
)
from accelcal.io import naming
from accelcal.io.atomic import Part, atomic, atomic_write, free_name, named
from accelcal.io.files import content_of, digest_of
from accelcal.io.loading import Body
from accelcal.io.sidecar import KEYS, Clock, Key, Source, sidecar_of, toml_key, toml_of, toml_text
from accelcal.io.table import SIDECAR_BYTES, cells_of, on_stamps

if TYPE_CHECKING:
    import pyarrow as pa


def write_csv(recording: Recording, path: str | Path) -> dict[str, Clock | Source]:
    """Write a recording as CSV, units in the column names; a channel not sampled at an instant leaves its cell empty.

    Parameters
    ----------
    recording : channels of shape (n,) each on its own clock; the rows are the union of their stamps.
    path : the file to write; replaced if it exists.

    Returns
    -------
    By channel, the column it was written to: what `write_sidecar` wants to know.

    Raises
    ------
    RecordingError
        If a channel has a name that would be read back as something else.
    """
    columns = {channel.name: naming.column_name(channel.name, channel.unit) for channel in _channels(recording)}
    return _write(recording, path, "t_s", columns, csv=True)


def write_parquet(recording: Recording, path: str | Path) -> dict[str, Clock | Source]:
    """Write a recording as Parquet, units in the metadata of the columns; null where a channel was not sampled.

    Parameters, return value and errors are those of `write_csv`.
    """
    return _write(recording, path, "t", {channel.name: channel.name for channel in _channels(recording)}, csv=False)


def _write(
    recording: Recording, path: str | Path, time: str, columns: Mapping[str, str], *, csv: bool
) -> dict[str, Clock | Source]:
    """Write one column for each channel, by its name, beside the time; return where each of them is."""
    import pyarrow as pa

    _require_readable(recording, columns)
    fields = [pa.field(time, pa.float64(), metadata={"unit": "s"})]
    t = common_stamps(recording)
    cells = {time: cells_of(t, np.zeros(len(t), np.bool_))}
    sources: dict[str, Clock | Source] = {"time": Clock(column=time, unit="s")}
    for channel, values, missing in common_rows(recording):
        name = columns[channel.name]
        fields.append(pa.field(name, pa.float64(), metadata={"unit": channel.unit}))
        cells[name] = cells_of(values, missing)
        sources[channel.name] = Source(name, channel.unit)
    _write_table(pa.table(cells, schema=pa.schema(fields)), path, csv=csv)
    return sources


def write_body(body: Body, path: str | Path, mark: Callable[[str], str] = str) -> None:
    """Write what two loggers recorded of one body as one file, CSV or Parquet by its name, and the sidecar beside it.

    Parameters
    ----------
    path, mark : as of `write_csv` and `write_sidecar`.
    """
    import pyarrow as pa

    columns = body.table.read(body.table.columns)
    cells = {
        name: cells_of(y.values, np.zeros(len(y.values), bool) if y.present is None else ~y.present)
        for name, y in columns.items()
    }
    run = body.declared["run"]
    noticed = [asdict(finding) for finding in (body.alignment, *body.table.notes) if finding.lasts]
    tables = {**body.declared, "run": {**run, "noticed": [*noticed, *run.get("noticed", ())]}}
    texts = {name: {key: toml_of(value) for key, value in entries.items()} for name, entries in tables.items()}
    _write_table(pa.table(cells), path, csv=Path(path).suffix == ".csv")
    atomic_write(sidecar_of(Path(path)), mark(_toml(texts)))


def write_sidecar(
    rig: Rig,
    channels: Mapping[str, Clock | Source],
    path: str | Path,
    dwell: DwellSetup | None = None,
    labels: RunLabels = NO_LABELS,
    noticed: tuple[Finding, ...] = (),
    prior_sizes: Mapping[str, str] = MappingProxyType({}),
    mark: Callable[[str], str] = str,
) -> None:
    """Write what is declared of a rig and of the columns of its file; reading it gives the same rig.

    Parameters
    ----------
    rig : what it merely assumes is not written.
    channels : by channel name, time included, its column.
    path : the sidecar to write; replaced if it exists.
    dwell : what it says of a table of dwells.
    labels : when, how mounted and by whom the run was made.
    noticed : in the recording that the file is a part of.
    prior_sizes : typical sizes of effects by name.
    mark : gives the text that is written from that which declares all this.
    """
    reference = reference_among(channels) or "position"
    holder = SimpleNamespace(rig=rig, dwell=dwell or DwellSetup(), run=labels, noticed=noticed)
    tables = {name: {key: _written(entry, holder) for key, entry in keys.items()} for name, keys in KEYS.items()}
    if GRAVITY in channels:  # gravity along the axis is not declared twice
        tables["rig"][GRAVITY] = None
    tables["prior"] = {name: toml_text(size) for name, size in prior_sizes.items()}
    tables["channels"] = {name: _channel(rig, name, source, reference) for name, source in channels.items()}
    atomic_write(path, mark(_toml(tables)))


def _write_table(table: pa.Table, path: str | Path, *, csv: bool) -> None:
    with atomic(path) as part:
        if csv:
            from pyarrow import csv as text

            text.write_csv(table, part, text.WriteOptions(quoting_style="needed"))
        else:
            from pyarrow import parquet

            parquet.write_table(table, part, compression="zstd", write_page_checksum=True)


def _toml(tables: Mapping[str, Mapping[str, str | None]]) -> str:
    """Tables of values in TOML; what has none, a table of nothing else, is left out."""
    return "\n".join(
        f"[{name}]\n" + "".join(f"{toml_key(key)} = {value}\n" for key, value in entries.items() if value)
        for name, entries in tables.items()
        if any(entries.values())
    )


def _written(key: Key, holder: object) -> str | None:
    """A value as a sidecar has it; None where it is not declared, or written elsewhere."""
    value = attrgetter(key.at)(holder) if key.at else None
    rig = attrgetter("rig")(holder)
    if value is None or value in ("", ()) or key.assumed in rig.assumptions:
        return None
    if isinstance(value, tuple):
        entries = (", ".join(f"{name} = {toml_text(y)}" for name, y in asdict(item).items()) for item in value)
        return "[\n" + "".join(f"  {{ {entry} }},\n" for entry in entries) + "]"
    if key.unit == "date":
        return datetime.fromtimestamp(value * 86400.0, UTC).isoformat()
    if key.unit == "1":
        return repr(float(value))
    return _amount(value, key.unit.format(rig.sensor.scale_unit), key.usual) if key.unit else toml_text(value)


def _channels(recording: Recording) -> list[Channel]:
    position = recording.position if recording.reference is None else recording.reference
    return [*(channel for channel in (recording.accel, position) if len(channel)), *recording.side.values()]


def _require_readable(recording: Recording, columns: Mapping[str, str]) -> None:
    """Check that each column name is read back as the channel and unit that it stands for."""
    for channel in _channels(recording):
        named = naming.take_apart(columns[channel.name])
        name = naming.role(named.base) or named.base
        differing = [unit for unit in (named.suffix, named.brackets) if unit not in (None, channel.unit)]
        if name != channel.name or differing:
            read = f"{name} in {differing[0]}" if differing else name
            raise RecordingError(
                f'channel "{channel.name}" in {channel.unit} would be read back as {read}; rename it before writing.'
            )


def common_stamps(recording: Recording) -> Array:
    """Return all instants at which anything was sampled, shape (n,), s."""
    clocks = [channel.t for channel in _channels(recording)]
    if all(np.array_equal(clock, clocks[0]) for clock in clocks[1:]):
        return clocks[0]
    return np.unique(np.concatenate(clocks))


def common_rows(recording: Recording) -> Iterator[tuple[Channel, Array, Flags]]:
    """Each channel on the common stamps: the channel, its values, and where it was not sampled, (n,) each."""
    t = common_stamps(recording)
    for channel in _channels(recording):
        values, present = on_stamps(channel, t)
        yield channel, values, ~present


def _amount(value: float | None, unit: str, usual: str = "") -> str | None:
    """A quantity in its usual unit where it is round there and reads back as the same number, else in SI in full."""
    if value is None:
        return None
    if usual:
        factor = units.conversion(usual).factor
        number = f"{value / factor:.6g}"
        if float(number) * factor == value:
            return f'"{number} {usual}"'
    return f'"{value / units.conversion(unit).factor!r} {unit}"'


def _channel(rig: Rig, name: str, source: Clock | Source, reference: str) -> str:
    """Return the entries of one channel; low-pass and resolution are declared beside the channel they belong to."""
    entries = {
        "column": toml_text(source.column) if source.column is not None else None,
        "unit": toml_text(source.unit) if source.unit is not None else None,
    }
    if isinstance(source, Clock):
        return _inline(entries | {"rate": _amount(source.rate, "Hz")})
    if source.time is not None:
        entries["time"] = _channel(rig, "time", source.time, reference)
    entries |= filter_entries(rig, name, reference)
    if name == "position":
        entries["resolution"] = _amount(rig.resolution, "m", "um")
    if name == reference:
        usual = {"position": "um", "velocity": "mm/s"}.get(name, "m/s^2")
        entries["noise"] = _amount(rig.reading_noise, UNITS[name], usual)
    return _inline(entries)


def filter_entries(rig: Rig, name: str, reference: str = "position") -> dict[str, str | None]:
    """Keys lowpass and highpass of one channel as a sidecar has them; None where nothing is declared."""
    filters = {"accel": rig.output_filters, reference: rig.position_filters}.get(name, ())
    low, high = (
        [_filter(channel_filter) for channel_filter in kind] for kind in (low_passes(filters), high_passes(filters))
    )
    if name == "accel" and rig.lowpass is not None:
        filter_keys = {
            "kind": '"RC"',
            "fc": _amount(rig.lowpass.cutoff, "Hz"),
            "tolerance": None if (share := rig.lowpass.tolerance) is None else repr(float(share)),
        }
        low = [_inline(filter_keys)]
    listed = {"lowpass": low, "highpass": high}
    return {
        key: texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]" if texts else None
        for key, texts in listed.items()
    }


def _filter(declared: ChannelFilter) -> str:
    """Return one filter as an inline table."""
    numbers = {"taps" if declared.kind == "fir" else "b": declared.b, "a": declared.a}
    entries = {
        "kind": f'"{declared.kind}"',
        "fc" if declared.quality is None else "f0": _amount(declared.cutoff, "Hz"),
        "Q": None if declared.quality is None else repr(declared.quality),
        "tolerance": None if declared.tolerance is None else repr(float(declared.tolerance)),
        "length": str(declared.length) if declared.length else None,
        "order": str(declared.order) if declared.kind in ("butterworth", "bessel", "sinc") else None,
        **{key: f"[{', '.join(map(repr, values))}]" if values else None for key, values in numbers.items()},
        "rate": _amount(declared.rate, "Hz"),
    }
    return _inline(entries)


def _inline(entries: Mapping[str, str | None]) -> str:
    """An inline table of what is declared; None is not."""
    return "{ " + ", ".join(f"{key} = {value}" for key, value in entries.items() if value is not None) + " }"


_MARK = re.compile(r"# accelcal (\S+) wrote this file and its recording: ([0-9a-f]{64})\n")


def marked(declared: str, command: str, recording: str) -> str:
    """Text of a sidecar with the mark of the command that wrote it.

    Parameters
    ----------
    declared : text of the sidecar.
    recording : SHA-256 of the recording beside it, hex.
    """
    return f"# accelcal {command} wrote this file and its recording: {_digest(declared, recording)}\n{declared}"


def writer_of(recording: Path) -> str:
    """The command that wrote a recording and its sidecar, both as they are now; "" for all others."""
    try:
        text = content_of(sidecar_of(recording), "a sidecar", SIDECAR_BYTES).decode()
        mark = _MARK.match(text)
        if mark is not None and mark[2] == _digest(text[mark.end() :], digest_of(recording)):
            return mark[1]
    except (OSError, RecordingError, UnicodeDecodeError):
        pass  # not there, or nothing that accelcal writes
    return ""


def _digest(declared: str, recording: str) -> str:
    return hashlib.sha256(f"{recording}\n{declared}".encode()).hexdigest()


_MAGIC = b"PAR1"
_END = 8
"""Bytes after the table: its length and the magic number."""
_SKIPPED = np.zeros(1 << 26, np.uint8)
"""Never read and never written: places in the file that are there already."""


class GrowingParquet:
    """Row groups appended to a file that any reader of Parquet may open at any time.

    Parameters
    ----------
    path : the file; what is there keeps its content until the first row group.
    units : unit by name of the column, in order. Columns are float64; NaN is written as null.

    Raises
    ------
    OSError
        If nothing can be written there, it is a pipe or a device, or the file system has no hard links. The text names
        it and says why.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "run.parquet")
    >>> with GrowingParquet(path, {"t": "s"}) as file:
    ...     file.append({"t": np.array([0.0, 1.0])})
    ...     file.append({"t": np.array([2.0])})
    >>> file.rows, path.stat().st_size == file.size
    (3, True)
    """

    def __init__(self, path: Path, units: Mapping[str, str]) -> None:
        self.path = path
        self.units = dict(units)
        """More may be named until the first row group."""
        self.rows, self.groups = 0, 0
        self.size = 0
        """Bytes of the file under its name."""
        self.broken = False
        """Whether an append failed or was cut short: copies and table may not match, and none can follow."""
        self._table: Any = None
        self._copies: list[_Copy] = []
        self._new = len(_MAGIC)
        """Where the next row group begins."""
        self._late = b""
        """What the copy that nobody sees lacks of the other."""

    def __enter__(self) -> Self:
        """Make both copies, unseen."""
        with named(self.path):
            try:
                for _ in range(2):
                    part = Part(self.path)
                    if part.straight:
                        raise OSError(errno.EINVAL, "it is a pipe or a device, and a recording grows in a file")
                    part.create()
                    self._copies.append(_Copy(part))
            except BaseException:
                self.close()
                raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def append(self, columns: Mapping[str, Array]) -> None:
        """Write a row group, after which the file under its name holds it; (n,) each, NaN where not sampled.

        Raises
        ------
        OSError
            If it cannot be written, another program has begun to write it, or an earlier group could not be written;
            the file under its name is then as it was.
        """
        import pyarrow as pa

        if self.broken:
            raise OSError(errno.EIO, f"{self.path}: an earlier row group could not be written, so none can follow")
        self.broken = True  # until all of it is done
        values = {name: pa.array(y, mask=np.isnan(y)) for name, y in columns.items()}
        fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in self.units.items()]
        group, table = _encoded(pa.table(values, schema=pa.schema(fields)), self._new)
        if self._table is None:
            self._table = table
        else:
            self._table.append_row_groups(table)
        hidden, latest = self._copies
        with named(self.path):
            if not self.groups and hidden.part.is_new and self.path.exists():
                raise AccessError(f"{self.path}: another program has begun to write it; give one of them another name")
            hidden.grow(self._late + group, _footer(self._table))
            hidden.take(self.path)
        self._copies = [latest, hidden]
        self._late = group
        self._new += len(group)
        self.rows, self.groups = self.rows + len(next(iter(columns.values()))), self.groups + 1
        self.size = hidden.size
        self.broken = False

    def close(self) -> None:
        """Remove the copy that nobody sees; the file stays under its name."""
        for copy in self._copies:
            copy.part.discard()
        self._copies = []


class _Copy:
    """One of the two files."""

    def __init__(self, part: Part) -> None:
        self.part = part
        self.size = 0
        self._end = 0
        """Where the row groups end."""

    def grow(self, groups: bytes, footer: bytes) -> None:
        """Put row groups in the place of the table at the end, and a new table behind them."""
        with self.part.path.open("r+b") as file:
            content = groups + footer if self._end else _MAGIC + groups + footer
            file.seek(self._end)
            file.write(content)
            file.truncate()
            self.size = file.tell()
        self._end = self.size - len(footer)
        self.part.settle()

    def take(self, path: Path) -> None:
        """Become the file under this name, at once."""
        name = free_name(self.part.path.parent)
        os.link(self.part.path, name)
        try:
            os.replace(name, os.path.realpath(path))
        except BaseException:
            name.unlink(missing_ok=True)
            raise


class _Sink(io.RawIOBase):
    """Keeps what is written beyond a place."""

    def __init__(self, start: int) -> None:
        self.content = bytearray()
        self._skip = start

    def writable(self) -> bool:
        """A sink for `pyarrow`."""
        return True

    def write(self, content: Any) -> int:
        """Keep what lies beyond the start."""
        size = len(content)
        skipped = min(size, self._skip)
        self._skip -= skipped
        if skipped < size:
            self.content += memoryview(content)[skipped:]
        return size


def _encoded(rows: pa.Table, start: int) -> tuple[bytes, Any]:
    """A row group as it lies in a file from the byte `start`, and the table of a file that held it alone.

    `pyarrow` counts places from where its writer began, so it is led over the bytes before; they are never touched.
    """
    import pyarrow as pa
    from pyarrow import parquet

    sink = _Sink(start)
    tables: list[Any] = []
    stream = pa.PythonFile(sink, mode="w")
    writer = parquet.ParquetWriter(
        stream,
        rows.schema,
        compression="zstd",
        use_dictionary=False,
        write_page_checksum=True,
        metadata_collector=tables,
    )
    while (ahead := start - stream.tell()) > 0:
        stream.write(_SKIPPED.data[: min(ahead, len(_SKIPPED))])
    writer.write_table(rows, row_group_size=max(1, rows.num_rows))
    writer.close()
    table = int.from_bytes(sink.content[-_END : -_END // 2], "little")
    return bytes(sink.content[: -_END - table]), tables[0]


def _footer(table: Any) -> bytes:
    """The end of a file with these row groups."""
    import pyarrow as pa

    whole = pa.BufferOutputStream()
    table.write_metadata_file(whole)
    return bytes(memoryview(whole.getvalue())[len(_MAGIC) :])
