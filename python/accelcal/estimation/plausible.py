"""Plausible before named: what was mistaken where a scale factor or a constant is none of a working sensor.

A wrong column, unit, range or sign makes every effect significant, so each is told with the line that mends it before
any effect is named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from accelcal.data import (
    ACCELERATION,
    STANDARD_GRAVITY,
    UNITS,
    VELOCITY,
    Recording,
    RecordingError,
    Rig,
    units,
    usual_step,
)
from accelcal.data.recording import ORDERS
from accelcal.data.relation import ALIKE, relation
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import PreparedRun
from accelcal.io.loading import other_outputs

PLAUSIBLE_SCALE = (0.7, 1.4)
"""1 + k that a working sensor can have, over the declared ratio of the rig; what is beyond is a mistake."""
REVERSED_SCALE = (-2.0, -0.5)
"""1 + k over the same that a sensor shows which is mounted the other way round."""
REVERSED_COHERENCE = 0.5
"""Squared coherence of output and motion below which a relation with the other sign is none of a mount."""
UNLIKE = 0.1
"""Correlation by which it must exceed that of the declared column, if its scale is no better."""
GRAVITY_SHARE = 0.2
"""Distance of a constant from gravity, over gravity, within which it is gravity."""
MOST_CAUSES = 2
"""Mistakes that are listed for one factor."""
MOST_DOUBLINGS = 5
"""Doublings between the ranges of a sensor, at most: ±2 g to ±64 g."""
CLEARLY_BETTER = 0.1
"""Logarithm by which one mistake must fit better than the next for that one not to be listed."""

ACCELERATIONS = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY, "mm/s^2": 1e-3, "cm/s^2": 1e-2}
KNOWN: Mapping[str, Mapping[str, float]] = {
    "accel": ACCELERATIONS,
    "position": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "in": 0.0254, "ft": 0.3048, "nm": 1e-9},
    VELOCITY: {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "cm/s": 1e-2},
    ACCELERATION: ACCELERATIONS,
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
}
"""Units that are mistaken for one another, by channel, in SI."""
SI = {"accel": "m/s^2", **UNITS}
ORDINARY = {"travel": (1e-6, 100.0), "duration": (2.0, 1e5), "rate": (5.0, 1e5), "output": (1e-3, 1e4)}
"""Ranges in which rigs lie: m, s, Hz, m/s². They tell two mistakes apart that make the same factor."""


@dataclass(frozen=True, slots=True)
class Cause:
    """One mistake that explains a scale factor."""

    text: str
    """What was mistaken, and the line to write."""
    left: float
    """1 + k that is left without it."""
    unusual: float = 0.0
    """Decades by which the record is beyond `ORDINARY` without it."""


def implausible_scale(run: PreparedRun, scale: float) -> list[Remark]:
    """The remark on a value of 1 + k that no working sensor has, with what was mistaken; none on an ordinary one."""
    if plausible(scale / (run.rig.ratio or 1.0)):
        return []
    told = run.once(("mistaken", f"{scale:.2g}"), lambda: mistaken(run.recording, scale))
    return [remark("implausible_scale", scale=scale, factor=1.0 / scale if scale else math.inf, cause=told)]


def suspicion(recording: Recording) -> str:
    """The sentence on a scale factor that no working sensor has, before any fit; empty where it may be ordinary.

    The relation of both channels in the band in which they are most alike stands for 1 + k: noise of the position makes
    it too small, by no more than the square of their correlation.
    """
    if not (len(recording.accel) and len(recording.position)):
        return ""
    alike, rig = relation(recording.accel, recording.position), recording.rig
    scale, least = rig.polarity * alike.slope, alike.correlation**2
    if abs(alike.correlation) < ALIKE:
        return other_column(recording)
    if REVERSED_SCALE[0] < scale / (rig.ratio or 1.0) < REVERSED_SCALE[1]:
        return turned(recording, scale)
    if any(plausible(scale / (rig.ratio or 1.0) / biased) for biased in (1.0, least)):
        return ""
    return remark("implausible_scale", scale=scale, factor=1.0 / scale, cause=mistaken(recording, scale)).sentence


def turned(recording: Recording, scale: float) -> str:
    """The sentence on an output that runs against the encoder, with the line that mends it."""
    return (
        f"{recording.name or 'recording'}: the output runs against the encoder (1 + k = {scale:.3f}). The sensor is "
        "mounted the other way round or a sign is swapped; write in the sidecar\n[rig]\n"
        f'mount = "{turned_mount(recording.rig)}"'
    )


def mistaken(recording: Recording, scale: float) -> str:
    """What was mistaken where 1 + k is no sensor's: another column, or a unit, range or clock; and what accepts it."""
    share = scale / (recording.rig.ratio or 1.0)
    ratio = np.format_float_positional(float(f"{scale:.4g}"), trim="-")
    accept = f"If the rig itself makes this ratio, a lever or two masses, write [rig] ratio = {ratio}"
    column = other_column(recording)
    if column:
        return f"{column}. {accept}"
    listed = sorted(
        causes(recording, abs(share)), key=lambda cause: (round(cause.unusual, 1), abs(math.log(cause.left)))
    )
    best = [
        cause
        for cause in listed[:MOST_CAUSES]
        if cause.unusual <= listed[0].unusual + 1.0
        and abs(math.log(cause.left)) < abs(math.log(listed[0].left)) + CLEARLY_BETTER
    ]
    if best:
        return f"{'; or '.join(cause.text for cause in best)}. {accept}"
    return f"No unit, range or column explains it. {sensitivity_line(recording.rig, scale) or accept}"


def other_column(recording: Recording) -> str:
    """The column in which the motion is, where that is not the declared output; empty where there is none."""
    declared = relation(recording.accel, recording.position)
    best = ("", "", declared)
    for column, unit, channel in other_outputs(recording):
        tried = relation(channel, recording.position)
        fits = plausible(abs(tried.slope)) and not plausible(
            abs(declared.slope) if abs(declared.correlation) > ALIKE else 0.0
        )
        least = max(ALIKE, abs(best[2].correlation) if best[0] else 0.0)
        if abs(tried.correlation) > least and (fits or abs(tried.correlation) > abs(declared.correlation) + UNLIKE):
            best = (column, unit, tried)
    column, unit, found = best
    if not column:
        return ""
    rig, name = recording.rig, recording.origin.columns.get("accel", ("accel", ""))[0]
    other = found.correlation * rig.polarity < 0.0
    sign = ", with the other sign" if other else ""
    turned = f' and [rig] mount = "{turned_mount(rig)}"' if other else ""
    return (
        f"the motion is in {column}{sign} (correlation {found.correlation:.2f}), not in {name} "
        f'({declared.correlation:.2f}): write [channels] accel = {{ column = "{column}", unit = "{unit}" }}{turned}'
    )


def plausible(share: float) -> bool:
    """Whether 1 + k, over the ratio of the rig, is that of a working sensor."""
    return PLAUSIBLE_SCALE[0] <= share <= PLAUSIBLE_SCALE[1]


def turned_mount(rig: Rig) -> str:
    """The mount of the other sign."""
    return "normal" if rig.mount == "reversed" else "reversed"


def causes(recording: Recording, share: float) -> Iterator[Cause]:
    """Mistakes of unit, clock and range that leave a plausible 1 + k.

    Parameters
    ----------
    recording : its columns and units are those that the lines name.
    share : 1 + k that was estimated, over the ratio of the rig, without its sign.
    """
    columns, rig = recording.origin.columns, recording.rig
    reference = "position" if recording.reference is None else recording.reference.name
    order = 2 if recording.reference is None else ORDERS[reference][0]
    # 1 + k goes with the true unit over the declared one to a power, once it is put right
    for name, power in (("accel", 1), (reference, -1), ("time", order)):
        column, unit = columns.get(name, (name, ""))
        known = KNOWN[name]
        declared = next((size for text, size in known.items() if unit and units.same_unit(text, unit)), None)
        for true, size in known.items() if declared else ():
            factor = size / (declared or 1.0)
            left = share * factor**power
            if factor != 1.0 and power and plausible(left):
                text = (
                    f"the unit of column {column}: {true}, not {unit}? Write [channels] {name} = "
                    f'{{ column = "{column}", unit = "{true}" }}'
                )
                yield Cause(text, left, unusual(recording, {name: factor}, order))
    for name, power in (("accel", 1), (reference, -1)):
        if columns.get(name, ("", ""))[1] in units.ELECTRICAL:
            yield from of_sensitivity(recording, name, share, power)
    n = round(math.log2(share))
    if 0 < abs(n) <= MOST_DOUBLINGS and plausible(share / 2.0**n):
        off = "half of" if n < 0 else "twice" if n == 1 else f"{2.0**n:g} times"
        off = f"1/{2**-n} of" if n < -1 else off
        line = sensitivity_line(rig, 2.0**n)
        text = f"the range setting? The output is {off} what it should be, as where its logger took another range"
        yield Cause(f"{text}{'. ' if line else ''}{line}", share / 2.0**n, 0.02 * abs(n))


def of_sensitivity(recording: Recording, name: str, share: float, power: int) -> Iterator[Cause]:
    """Units of a declared electrical scale that leave a plausible 1 + k: those of what it is per."""
    for true, factor in KNOWN[name].items():
        for off in (factor, 1.0 / factor):
            left = share * off**power
            if factor != 1.0 and plausible(left):
                line = sensitivity_line(recording.rig, 1.0 / off) if name == "accel" else ""
                text = f"the scale of {name}? It is {1.0 / off:.6g} times the declared one, as {true} is to {SI[name]}"
                yield Cause(f"{text}{'. ' if line else ''}{line}", left, unusual(recording, {name: off}, 2))


def sensitivity_line(rig: Rig, factor: float) -> str:
    """The line that declares the sensitivity times a factor; empty where none is declared."""
    sensor = rig.sensor
    if sensor.scale is None:
        return ""
    return f'Write [sensor] scale = "{sensor.scale * factor * STANDARD_GRAVITY:.6g} {sensor.scale_unit}/g"'


def unusual(recording: Recording, factor: Mapping[str, float], order: int) -> float:
    """Decades by which a record is beyond what rigs do, its channels times a factor; `order` is of the reference."""
    t, time = recording.accel.t, factor.get("time", 1.0)
    read = next((size for name, size in factor.items() if name not in ("time", "accel")), 1.0)
    values = {
        "travel": float(np.ptp(recording.position.y)) * read * time ** (2 - order),
        "duration": float(t[-1] - t[0]) * time,
        "rate": 1.0 / (usual_step(t) * time),
        "output": float(np.std(recording.accel.y)) * factor.get("accel", 1.0),
    }
    logarithms = {key: math.log10(max(value, 1e-300)) for key, value in values.items()}
    return sum(
        max(0.0, math.log10(ORDINARY[key][0]) - size, size - math.log10(ORDINARY[key][1]))
        for key, size in logarithms.items()
    )


def reversed_or_unrelated(recording: Recording, scale: float, std: float, coherence: float) -> str:
    """What is refused where the output runs against the encoder: a mount, or channels that are no one axis."""
    coherent = coherence > REVERSED_COHERENCE
    if coherent and REVERSED_SCALE[0] < scale / (recording.rig.ratio or 1.0) < REVERSED_SCALE[1]:
        return turned(recording, scale)
    cause = mistaken(recording, scale) if coherent else other_column(recording)
    return (
        f"{recording.name or 'recording'}: output and position are not one axis of one body: 1 + k = {scale:.3g} ± "
        f"{std:.2g}, where a sensor shows 1, or -1 if it is mounted the other way round. No scale factor, mount or "
        "effect is read from them; check that both channels are of the same run, axis and unit"
        f"{': ' * bool(cause)}{cause}"
    )


def require_gravity(name: str, rig: Rig, constant: float) -> None:
    """Refuse a constant of the output that is gravity where the rig declares another.

    Parameters
    ----------
    name : of the recording.
    rig : what it declares.
    constant : K0 over 1 + k along the stage axis, m/s².

    Raises
    ------
    RecordingError
        With the line to write.
    """
    g, declared = STANDARD_GRAVITY, rig.gravity
    near = GRAVITY_SHARE * g
    if min(abs(declared), abs(abs(declared) - g)) > near or abs(constant) < g - near:
        return
    there = next((there for there in (0.0, g, -g) if abs(declared + constant - there) < near), None)
    where = f"{name}: the output has a constant of {constant:.3f} m/s²"
    if there is None:
        return
    if there == 0.0:
        raise RecordingError(
            f"{where} on an axis declared {rig.axis}: gravity seems to be removed; write in the sidecar\n[rig]\n"
            'gravity_along_axis = "0 m/s^2"'
        )
    line = f'write in the sidecar\n[rig]\naxis = "{"up" if there > 0.0 else "down"}"'
    if abs(declared) > near:
        raise RecordingError(f"{where} on an axis declared {rig.axis}: the record reads the other way; {line}")
    raise RecordingError(f"{where}, close to gravity, on an axis declared level. If the axis is vertical, {line}")
