"""What looks like a number and is none: refused in any column by row and column, and never read as another number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from accelcal import io
from accelcal.data.recording import RecordingError

COLUMNS = {"t_s": "time of accel", "accel_g": "accel", "position_mm": "position"}
"""Columns of the table, and what each holds."""
T = np.arange(60) / 100.0
ROWS = [[f"{t:.2f}", f"{np.sin(t):.5f}", f"{np.cos(t):.5f}"] for t in T]
AT = 30
"""Row of numbers that is changed; two lines stand before the first."""
NO_NUMBERS = (
    *("0;5", "1.2.3", "1..2", "--1", "+-1", "1e", "1d3", "1f", "1j", "1.5%", "0x10", "0b1", "0o7", "1_000", "1 000"),
    *("1'000", "1\u202f000", "1\u00a0000", "true", "null", "None", "x", "１２", "1２", "٣", "३", "½", "²", "①", "−1"),
    *("1\u200b", "\u202e1", "1.5 g", "$1", "=1+1", "2024-13-45", "(1)", "[1]", "1e5e5", "0x1p-2", "1L", "∞", "e5", "."),
)
NOT_FINITE = ("nan", "NaN", "-nan", "inf", "-inf", "+Inf", "Infinity", "-INFINITY", "1e999", "-1e400")


def table(cells: list[list[str]], delimiter: str = ",") -> str:
    """A table of numbers under its header."""
    return "\n".join(delimiter.join(row) for row in [list(COLUMNS), *cells]) + "\n"


def changed(column: int, cell: str) -> list[list[str]]:
    """The rows with one cell in the place of another."""
    rows = [list(row) for row in ROWS]
    rows[AT][column] = cell
    return rows


def sentence(path: Path, text: str) -> str:
    """What a table is refused with."""
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RecordingError) as caught:
        io.load(path)
    return str(caught.value)


@pytest.mark.parametrize("column", range(3), ids=COLUMNS)
def test_what_is_no_number_is_refused_by_row_and_column(tmp_path: Path, column: int) -> None:
    path, name = tmp_path / "run.csv", list(COLUMNS)[column]
    messages = {cell: sentence(path, table(changed(column, cell))) for cell in NO_NUMBERS}
    wrong = {
        cell: text
        for cell, text in messages.items()
        if not text.startswith(f'{path}: row {AT + 2}, column "{name}": found "{cell}", expected a number; ')
    }
    print(f"{len(messages)} cells in {name}: {len(wrong)} without row and column (threshold 0)")
    assert not wrong


@pytest.mark.parametrize("column", range(3), ids=COLUMNS)
def test_what_is_not_finite_is_refused_by_row_and_channel(tmp_path: Path, column: int) -> None:
    path, channel = tmp_path / "run.csv", list(COLUMNS.values())[column]
    for cell in NOT_FINITE:
        message = sentence(path, table(changed(column, cell)))
        assert message.startswith(f"{path}: {channel}: 1 sample is not finite (first at "), cell
        assert f"row {AT + 2})" in message, cell


@pytest.mark.parametrize("column", range(3), ids=COLUMNS)
def test_a_decimal_comma_among_points_is_refused_by_its_row(tmp_path: Path, column: int) -> None:
    path = tmp_path / "run.csv"
    assert f"row {AT + 2} has 4 cells where the rows before have 3" in sentence(path, table(changed(column, "1,5")))
    name = list(COLUMNS)[column]
    message = sentence(path, table(changed(column, "1,5"), ";"))
    assert f'row {AT + 2}, column "{name}": found "1,5", expected a number' in message


@pytest.mark.parametrize("cell", ["1.5", "1.234,5", "1 234,5"])
def test_a_point_among_decimal_commas_is_refused_by_row_and_column(tmp_path: Path, cell: str) -> None:
    rows = [[part.replace(".", ",") for part in row] for row in ROWS]
    rows[AT][1] = cell
    message = sentence(tmp_path / "run.csv", table(rows, ";"))
    assert f'row {AT + 2}, column "accel_g": found "{cell}", expected a number' in message


def test_a_table_of_decimal_commas_has_the_numbers_of_points(tmp_path: Path) -> None:
    points, commas = tmp_path / "points.csv", tmp_path / "commas.csv"
    points.write_text(table(ROWS))
    commas.write_text(table([[part.replace(".", ",") for part in row] for row in ROWS], ";"))
    np.testing.assert_array_equal(io.load(points).accel.y, io.load(commas).accel.y)


def test_stamps_in_other_digits_are_refused_by_row_and_column(tmp_path: Path) -> None:
    stamps = [f"2024-05-01T00:00:{k / 10:04.1f}" for k in range(60)]
    rows = [[stamp, *row[1:]] for stamp, row in zip(stamps, ROWS, strict=True)]
    rows[AT][0] = rows[AT][0].replace("2024", "２０２４")
    message = sentence(tmp_path / "run.csv", table(rows))
    assert f'row {AT + 2}, column "t_s": found "２０２４-' in message
    assert "expected an ISO 8601 date and time" in message


def test_a_whole_table_in_other_digits_has_no_rows_of_numbers(tmp_path: Path) -> None:
    full_width = str.maketrans("0123456789", "０１２３４５６７８９")
    rows = [[cell.translate(full_width) for cell in row] for row in ROWS]
    assert "no row of numbers" in sentence(tmp_path / "run.csv", table(rows))
