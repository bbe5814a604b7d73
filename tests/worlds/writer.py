"""A record as CSV and sidecar TOML: one pair of columns per channel, because every channel has its own clock."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path

import numpy as np

from .numerics import Array

Channels = Mapping[str, tuple[Array, Array, str]]


def write(
    directory: Path,
    name: str,
    channels: Channels,
    extra: Mapping[str, str],
    tables: Mapping[str, Mapping[str, str]],
    digits: int = 9,
) -> Path:
    """Write NAME.csv and NAME.toml into a directory; return the path of the CSV.

    A reading that is nan becomes an empty cell; a channel that ends early leaves both of its cells empty. Stamps have
    as many decimals, and readings as many digits, as `digits` says.
    """
    directory.mkdir(parents=True, exist_ok=True)
    columns: list[list[str]] = []
    heads: list[str] = []
    for channel, (t, y, _) in channels.items():
        heads += [f"t_{channel}", channel]
        columns += [[f"{x:.{digits}f}" for x in t.tolist()], _cells(y, digits)]
    path = directory / f"{name}.csv"
    rows = map(",".join, zip_longest(*columns, fillvalue=""))
    path.write_text("\n".join([",".join(heads), *rows]) + "\n", encoding="utf-8")
    path.with_suffix(".toml").write_text(_sidecar(channels, extra, tables), encoding="utf-8")
    return path


def _cells(y: Array, digits: int) -> list[str]:
    missing = np.isnan(y)
    return [
        "" if missing_here else f"{x:.{digits}g}"
        for x, missing_here in zip((y + 0.0).tolist(), missing.tolist(), strict=True)
    ]


def _sidecar(channels: Channels, extra: Mapping[str, str], tables: Mapping[str, Mapping[str, str]]) -> str:
    lines = []
    for table, entries in tables.items():
        lines += [f"[{table}]", *(f'{key} = "{value}"' for key, value in entries.items()), ""]
    lines.append("[channels]")
    for channel, (_, _, unit) in channels.items():
        clock = f'time = {{ column = "t_{channel}", unit = "s" }}'
        more = f", {extra[channel]}" if channel in extra else ""
        lines.append(f'{channel} = {{ column = "{channel}", unit = "{unit}", {clock}{more} }}')
    return "\n".join(lines) + "\n"
