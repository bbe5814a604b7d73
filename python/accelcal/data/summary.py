"""What was understood of a recording: rates, spans, ranges, rest, and the findings; no judgement of its own."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelcal._support.values import listing
from accelcal.data.arrays import Array
from accelcal.data.orientation import GRAVITY, LEVERS, TURNED
from accelcal.data.recording import Channel, Recording
from accelcal.data.units import instant

STILL_SPAN = 0.1
"""s; rest is judged on stretches of this length, or of 20 samples if that is longer."""
STILL_STEPS = 4
"""A stretch is at rest when the position stays within this many quantisation steps ..."""
STILL_SHARE = 1e-3
"""... or within this share of the whole travel."""


def describe(recording: Recording) -> dict[str, Any]:
    """Return what was understood of a recording, ready for JSON.

    Returns
    -------
    ``name``, ``digest``; ``channels``: by name ``samples``, ``start_s``, ``end_s``, ``rate_hz`` (gaps left out),
    ``longest_interval_s``, ``unit``, ``min``, ``max``; ``range_used`` (share of the declared full scale, or None);
    ``orientation``: "attitude", "gravity_along_axis", "gyroscope" or None; ``rest_s``: list of [start, end];
    ``dwells``: file of those fitted together with it, or None; ``findings``; ``assumptions``.
    """
    channels = [recording.accel, *([recording.position] if len(recording.position) else []), *recording.side.values()]
    full_scale = recording.rig.sensor.range
    return {
        "name": recording.name,
        "digest": recording.digest,
        "channels": {channel.name: _channel(channel) for channel in channels},
        "range_used": float(np.max(np.abs(recording.accel.y))) / full_scale if full_scale else None,
        "orientation": orientation(recording),
        "dwells": None if recording.dwells is None else recording.dwells.name,
        "rest_s": [list(stretch) for stretch in rest(recording)],
        "findings": [asdict(finding) for finding in recording.findings],
        "assumptions": list(recording.rig.assumptions),
    }


def orientation(recording: Recording) -> str | None:
    """What says how the axis turns: "attitude", "gravity_along_axis" or "gyroscope"; None where nothing does."""
    known = {"attitude": LEVERS[0], GRAVITY: GRAVITY, "gyroscope": TURNED[0]}
    return next((name for name, channel in known.items() if channel in recording.side), None)


_ORIENTATIONS = {
    "attitude": "recorded; the acceleration along the turning axis is used, gravity included",
    GRAVITY: "gravity along the axis is recorded and used",
    "gyroscope": "angles from the gyroscope; every fit estimates gravity along the axis with their drift",
    None: "not recorded; the axis is taken to keep its direction. If the body can turn, declare gravity_along_axis, an "
    "attitude or a gyroscope",
}


def summarise(recording: Recording) -> str:
    """Return `describe` as lines for a human reader; warnings come before notes."""
    found = describe(recording)
    lines = [found["name"] or "recording"]
    for name, channel in found["channels"].items():
        rate = f"{channel['rate_hz']:.6g} Hz" if channel["rate_hz"] else "no rate"
        span = f"{instant(channel['start_s'])} s to {instant(channel['end_s'])} s"
        lines.append(
            f"  {name}: {channel['samples']} samples, {rate}, {span}, "
            f"{channel['min']:.6g} to {channel['max']:.6g} {channel['unit']}"
        )
    if found["range_used"] is not None:
        lines.append(f"  range used: {found['range_used']:.0%} of ±{recording.rig.sensor.range:.6g} m/s^2")
    total = sum(end - start for start, end in found["rest_s"])
    stretches = ", ".join(f"{instant(start)} s to {instant(end)} s" for start, end in found["rest_s"][:3])
    more = ", ..." if len(found["rest_s"]) > 3 else ""
    if recording.dwells is not None:
        lines.append(f"  dwells: {len(recording.dwells)} of {recording.dwells.name}, fitted together with the motion")
    lines.append(f"  orientation: {_ORIENTATIONS[found['orientation']]}")
    lines.append(
        f"  at rest: {instant(total)} s in {len(found['rest_s'])} stretches ({stretches}{more})"
        if total
        else "  at rest: never"
    )
    for severity in ("warning", "note"):
        lines += [f"  {severity}: {finding.text}" for finding in recording.findings if finding.severity == severity]
    return "\n".join(lines + [f"  assumed: {sentence}" for sentence in found["assumptions"]])


def rest(recording: Recording) -> list[tuple[float, float]]:
    """Find the intervals at rest, judged by the encoder.

    Returns
    -------
    (start, end) of each stretch of at least two spans (`STILL_SPAN`), in s. Empty without a position.
    """
    t, y = recording.position.t, recording.position.y
    if len(t) < 20:
        return []
    edges = _edges(t)
    reach = np.maximum.reduceat(y, edges) - np.minimum.reduceat(y, edges)
    step = np.abs(np.diff(y))
    quantum = recording.rig.resolution or float(step.min(where=step > 0, initial=np.ptp(y)))
    limit = max(STILL_STEPS * quantum, STILL_SHARE * float(np.ptp(y)))
    still = np.concatenate(([False], reach <= limit, [False]))
    starts, ends = np.flatnonzero(~still[:-1] & still[1:]), np.flatnonzero(still[:-1] & ~still[1:])
    last = np.append(edges[1:], len(t)) - 1
    return [(float(t[edges[a]]), float(t[last[b - 1]])) for a, b in zip(starts, ends, strict=True) if b - a >= 2]


def _edges(t: Array) -> NDArray[np.intp]:
    """Return the index at which each judged span begins; spans without samples do not appear."""
    span = max(STILL_SPAN, 20 * float(np.median(np.diff(t))))
    step = float(t[0] + span) - float(t[0])
    if step <= 0.0:  # stamps so large that a span is lost beside them
        return np.array([0])
    near = np.unique(np.floor((t - t[0]) / step))  # spans that hold samples: there may be far fewer than the time has
    begins = t[0] + np.unique(np.concatenate([near - 1.0, near, near + 1.0])) * step
    return np.unique(np.searchsorted(t, begins[(begins >= t[0]) & (begins < t[-1])]))


def _channel(channel: Channel) -> dict[str, Any]:
    interval = np.diff(channel.t)
    usual = interval[interval <= 2.0 * np.median(interval)] if len(interval) else interval
    return {
        "samples": len(channel),
        "start_s": float(channel.t[0]),
        "end_s": float(channel.t[-1]),
        "rate_hz": 1.0 / float(np.mean(usual)) if len(usual) else None,
        "longest_interval_s": float(interval.max()) if len(interval) else None,
        "unit": channel.unit,
        "min": float(channel.y.min()),
        "max": float(channel.y.max()),
    }


__dir__ = listing(globals())
