"""miniSEED 2 and 3 of seismic loggers: rates and counts of the records first, then the samples of one source."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pymseed import MS3TraceList

from accelcal._support.errors import AccelcalError
from accelcal.io.decoding.source import Clock, RefusedError, Sampled, Source, opened_channels, seconds_since


def opened(path: str) -> Source:
    """Open a file: each source is a column, called by its identifier without ``FDSN:``; the format holds no units.

    Stamps are those of the records, so that a gap remains one; they count from the earliest sample of the file.
    """
    traces = MS3TraceList.from_file(path, record_list=True)
    listed = [(trace.sourceid, list(trace)) for trace in traces]
    if not listed:
        raise AccelcalError("it holds no whole record")
    parts = [part for _, segments in listed for segment in segments for part in segment.recordlist or ()]
    left = Path(path).stat().st_size - sum(int(part.record.reclen) for part in parts)
    if left:
        raise AccelcalError(f"{left} bytes are no whole record")
    return opened_channels(_sampled(traces, listed))


def _sampled(traces: Any, listed: list[tuple[str, list[Any]]]) -> Iterator[Sampled]:
    zero = min(segment.starttime for _, segments in listed for segment in segments)
    for name, segments in listed:
        counts = [int(segment.samplecnt) for segment in segments]
        key = tuple(
            (segment.starttime, segment.samprate, count) for segment, count in zip(segments, counts, strict=True)
        )
        if any(not rate > 0.0 or count < 0 for _, rate, count in key):
            continue  # a log, or an instant without samples

        def read(parts: list[Any] = segments, held: Any = traces) -> Any:
            return np.concatenate([_values(part) for part in parts])

        def stamps(parts: Any = key) -> Any:
            return np.concatenate(
                [seconds_since(begin, zero) + np.arange(count) / rate for begin, rate, count in parts]
            )

        yield Sampled(name.removeprefix("FDSN:"), sum(counts), None, read, Clock(key, stamps))


def _values(segment: Any) -> Any:
    values = segment.create_numpy_array_from_recordlist()
    if segment.sampletype not in (None, "i", "f", "d"):  # 32-bit integer, float, double; the rest is text
        raise RefusedError("holds text, expected numbers; choose another source")
    return np.asarray(values, dtype=np.float64)
