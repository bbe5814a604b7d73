"""C3D of motion capture: labels, rates and counts first; then all frames at once, since they hold all channels."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from c3d import Reader

from accelcal.io.decoding.source import Sampled, Source, opened_channels, uniform


def opened(path: str) -> Source:
    """Open a file: points are columns ``label.X``, ``label.Y``, ``label.Z``, analog channels are called by their label.

    A point that was not seen in a frame is not sampled there.
    """
    return opened_channels(_sampled(Reader(Path(path).open("rb"))))


def _sampled(file: Any) -> Iterator[Sampled]:
    frames, per_frame = int(file.frame_count), int(file.analog_per_frame)

    @cache
    def read() -> tuple[Any, Any]:
        """Points (frames, points, 3) and analog values (channels, samples)."""
        points, analog = [], []
        for _, frame_points, sampled in file.read_frames():
            points.append(np.where(frame_points[:, 3:4] < 0.0, np.nan, frame_points[:, :3]))
            analog.append(sampled)
        return np.array(points), np.concatenate(analog, axis=1) if analog else np.empty((0, 0))

    labels = _names(file.point_labels)
    units = _texts(file, "POINT:UNITS")
    for k in range(int(file.point_used)):
        label = labels[k] if k < len(labels) and labels[k] else f"point {k + 1}"
        for axis in range(3):
            yield Sampled(
                f"{label}.{'XYZ'[axis]}",
                frames,
                units[0] if units else None,
                lambda k=k, axis=axis: read()[0][:, k, axis],  # type: ignore[misc]
                uniform(0.0, 1.0 / float(file.point_rate), frames),
            )
    labels, units = _names(file.analog_labels), _texts(file, "ANALOG:UNITS")
    for k in range(int(file.analog_used)):
        yield Sampled(
            labels[k] if k < len(labels) and labels[k] else f"analog {k + 1}",
            frames * per_frame,
            (units[k] or None) if k < len(units) else None,
            lambda k=k: read()[1][k],  # type: ignore[misc]
            uniform(0.0, 1.0 / float(file.analog_rate), frames * per_frame),
        )


def _names(strings: Any) -> list[str]:
    return [] if strings is None else [str(string).strip() for string in strings]


def _texts(file: Any, key: str) -> list[str]:
    """A parameter of one text or several."""
    item = file.get(key)
    if item is None:
        return []
    if len(item.dimensions) < 2:
        return [str(item.string_value).strip()]
    return _names(item.string_array)
