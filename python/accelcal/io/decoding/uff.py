"""Universal files of modal analysis (UFF): time responses of data sets 58 and 58b, their headers first."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pyuff import UFF

from accelcal._support.errors import AccelcalError
from accelcal.io.decoding.source import Clock, RefusedError, Sampled, Source, opened_channels, uniform

_TIME_RESPONSE, _EVEN, _COMPLEX = 1, 1, (5, 6)


def opened(path: str) -> Source:
    """Open a file: each real time response is a column, called by its first ID line, or by node and direction."""
    _require_end(path)
    file = UFF(path)
    sets = [k for k, kind in enumerate(file.get_set_types()) if int(kind) == 58]
    headers = {k: file.read_sets(k, header_only=True) for k in sets}
    vectors = {
        k: header
        for k, header in headers.items()
        if int(header["func_type"]) == _TIME_RESPONSE and int(header["ord_data_type"]) not in _COMPLEX
    }
    if not vectors:
        raise RefusedError(f"none of its {len(sets)} data sets 58 is a time response; export the time histories")
    return opened_channels(_sampled(file, vectors))


def _require_end(path: str) -> None:
    """Refuse a file whose last data set is cut off: the library passes over it in silence."""
    with Path(path).open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - 1000))  # the mark of an end is short
        lines = file.read().split()
    if not lines or lines[-1] != b"-1":
        raise AccelcalError("its last data set does not end")


def _sampled(file: Any, headers: dict[int, dict[str, Any]]) -> Iterator[Sampled]:
    texts = Counter(_text(header.get("id1")) for header in headers.values())
    for k, header in headers.items():
        count, text = int(header["num_pts"]), _text(header.get("id1"))
        place = f"{int(header['rsp_node'])}:{int(header['rsp_dir']):+d}"
        name = text if text and texts[text] == 1 else f"{text} {place}".strip()
        clock = Clock(k, lambda k=k: np.asarray(file.read_sets(k)["x"]))  # type: ignore[misc]
        if int(header["abscissa_spacing"]) == _EVEN:
            clock = uniform(float(header["abscissa_min"]), float(header["abscissa_inc"]), count)
        unit = _text(header.get("ordinate_axis_units_lab"))
        yield Sampled(name, count, unit or None, lambda k=k: np.asarray(file.read_sets(k)["data"]), clock)  # type: ignore[misc]


def _text(header: Any) -> str:
    text = str(header or "").strip()
    return "" if text.upper() == "NONE" else text
