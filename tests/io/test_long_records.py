"""Memory of whole commands on long records, in arrays as long as the record."""

from __future__ import annotations

from pathlib import Path

import pytest

from benches.long_record import peak_of, write

ROWS = 300_000, 1_500_000


@pytest.mark.parametrize(("verb", "most"), [("check", 19.5), ("fit", 28.0)])
def test_memory_for_each_row_is_bounded(tmp_path: Path, verb: str, most: float) -> None:
    few, many = (peak_of(verb, write(tmp_path / f"r{rows}.parquet", rows)) for rows in ROWS)
    arrays = (many - few) * 2**20 / (8.0 * (ROWS[1] - ROWS[0]))
    assert arrays < most, arrays
