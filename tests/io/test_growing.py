"""A Parquet file that grows: whole at any time, also when its writer is killed while it writes."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from accelcal.io import atomic_write, write as writing
from accelcal.io.write import GrowingParquet

ROWS, GROUPS = 50, 6
UNITS = {"t": "s", "accel": "m/s^2", "position": "m"}
WRITER = """
import os, signal, sys
import numpy as np, pyarrow.parquet
from pathlib import Path
from tests.io.test_growing import ROWS, GROUPS, UNITS, group
from accelcal.io.write import GrowingParquet
at, folder, seen = int(sys.argv[1]), sys.argv[2], 0
def moment(event, arguments):
    global seen
    if event.partition(".")[0] in ("open", "os") and any(str(a).startswith(folder) for a in arguments):
        seen += 1
        if seen == at:
            os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(moment)
with GrowingParquet(Path(folder, "run.parquet"), UNITS) as file:
    for i in range(GROUPS):
        file.append(group(i))
print(seen)
"""


def group(number: int) -> dict[str, np.ndarray]:
    t = np.arange(ROWS) + float(ROWS * number)
    return {"t": t, "accel": np.sin(t), "position": np.where(t % 3 == 0, np.cos(t), np.nan)}


def rows_of(path: Path) -> int:
    """Rows of a file that must be whole and the beginning of what was written."""
    table = parquet.ParquetFile(path, page_checksum_verification=True).read()
    n = table.num_rows
    columns = {name: np.concatenate([group(i)[name] for i in range(GROUPS)])[:n] for name in UNITS}
    for name, y in columns.items():
        assert np.array_equal(table[name].to_numpy(zero_copy_only=False), y, equal_nan=True), name
        assert table.schema.field(name).metadata == {b"unit": UNITS[name].encode()}
    assert n % ROWS == 0
    return n


def write(folder: Path, at: int) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", WRITER, str(at), str(folder)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        timeout=120,
    )


def test_every_row_group_can_be_read_at_once(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    with GrowingParquet(path, UNITS) as file:
        assert not path.exists()
        for i in range(GROUPS):
            file.append(group(i))
            assert rows_of(path) == ROWS * (i + 1) == file.rows
            assert parquet.ParquetFile(path).num_row_groups == file.groups
    assert [item.name for item in tmp_path.iterdir()] == ["run.parquet"]
    assert rows_of(path) == ROWS * GROUPS


def test_nothing_is_written_where_nothing_came(tmp_path: Path) -> None:
    with GrowingParquet(tmp_path / "run.parquet", UNITS):
        pass
    assert not list(tmp_path.iterdir())


def test_an_older_file_keeps_its_content_until_the_first_group(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    path.write_bytes(b"old")
    path.chmod(0o640)
    with GrowingParquet(path, UNITS) as file:
        assert path.read_bytes() == b"old"
        file.append(group(0))
    assert rows_of(path) == ROWS
    assert path.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("share", np.linspace(0.1, 0.98, 8).tolist())
def test_a_kill_leaves_a_whole_file_and_the_next_writer_tidies_up(tmp_path: Path, share: float) -> None:
    (tmp_path / "all").mkdir()
    done = write(tmp_path / "all", 0)
    assert done.returncode == 0, done.stderr
    moments = int(done.stdout)
    folder = tmp_path / "killed"
    folder.mkdir()
    at = max(1, round(share * moments))
    done = write(folder, at)
    assert done.returncode == -signal.SIGKILL, done.stderr
    path = folder / "run.parquet"
    rows = rows_of(path) if path.exists() else 0
    print(f"killed at moment {at} of {moments}: {rows} of {ROWS * GROUPS} rows")
    assert rows >= ROWS * int(share * GROUPS - 1)
    atomic_write(folder / "next.json", "{}")
    assert {item.name for item in folder.iterdir()} <= {"run.parquet", "next.json"}
    if path.exists():
        assert rows_of(path) == rows


def test_a_writer_that_is_cut_off_in_the_middle_harms_only_the_copy_that_nobody_sees(tmp_path: Path) -> None:
    # A kill inside one write: the copy that is not under the name holds half a row group, and no table.
    path = tmp_path / "run.parquet"
    with GrowingParquet(path, UNITS) as file:
        for i in range(3):
            file.append(group(i))
        hidden = file._copies[0].part.path
        with hidden.open("r+b") as half:
            half.truncate(hidden.stat().st_size // 2)
        assert rows_of(path) == 3 * ROWS
        with pytest.raises(pa.ArrowInvalid, match="magic bytes"):  # the sister: this is what a kill would leave
            parquet.ParquetFile(hidden).read()


@pytest.mark.parametrize("step", ["grow", "take"])
def test_after_a_group_that_could_not_be_written_none_follows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    path = tmp_path / "run.parquet"

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with GrowingParquet(path, UNITS) as file:
        file.append(group(0))
        with monkeypatch.context() as full:
            full.setattr(writing._Copy, step, refuse)
            with pytest.raises(OSError, match="No space left"):
                file.append(group(1))
        with pytest.raises(OSError, match="an earlier row group could not be written"):
            file.append(group(1))
        assert rows_of(path) == ROWS == file.rows
    assert rows_of(path) == ROWS
    assert [item.name for item in tmp_path.iterdir()] == ["run.parquet"]


def test_a_folder_a_pipe_and_a_missing_folder_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.parquet")
    for name in ("pipe.parquet", "absent/run.parquet", "."):
        with pytest.raises(OSError, match="cannot be written"), GrowingParquet(tmp_path / name, UNITS):
            pass
