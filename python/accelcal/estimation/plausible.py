"""Plausible before named: what was mistaken where a scale factor or a constant is none of a working sensor.

A wrong column, unit, range or sign makes every effect significant, so each is told with the line that mends it before
any effect is named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from accelcal.data import ACCELERATION, GRAVITY, OUTPUTS, STANDARD_GRAVITY, VELOCITY, Recording, Rig, units, usual_step
from accelcal.data.clocks import THE_OUTPUT, relation
from accelcal.data.recording import ORDERS
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import PreparedRun
from accelcal.io.loading import other_outputs

PLAUSIBLE_SCALE = (0.7, 1.4)
"""1 + k that a working sensor can have, over the declared ratio of the rig; what is beyond is a mistake."""
REVERSED_SCALE = (-2.0, -0.5)
"""1 + k over the same that a sensor shows which is mounted the other way round."""
GRAVITY_SHARE = 0.2
"""Distance of a constant from gravity, over gravity, within which it is gravity."""
MOST_DOUBLINGS = 5
"""Doublings between the ranges of a sensor, at most: ±2 g to ±64 g."""
MOST_TENS = 2
"""Steps of ten of the gain of an amplifier, at most."""
CLEARLY_BETTER = 0.1
"""Logarithm by which a mistake must fit better than the next for that one not to be listed."""
EXACTLY = 0.05
"""Logarithm of 1 + k within which a unit is what was mistaken of a body that turns, and not its orientation."""
ORIENTED = "the orientation? Check unit, order, sense and clock of the columns of attitude or angle, and the input axis"
ACCELERATIONS = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY, "mm/s^2": 1e-3, "cm/s^2": 1e-2}
KNOWN: Mapping[str, Mapping[str, float]] = {
    "accel": ACCELERATIONS,
    "position": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "in": 0.0254, "ft": 0.3048, "nm": 1e-9},
    VELOCITY: {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "cm/s": 1e-2},
    ACCELERATION: ACCELERATIONS,
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
}
"""Units that are mistaken for one another, by channel, in SI."""
OTHER_MOUNT = {"normal": "reversed", "rolled": "reversed", "reversed": "normal"}
ORDINARY = ((1e-6, 100.0), (2.0, 1e5), (5.0, 1e5), (1e-3, 1e4))
"""Travel (m), duration (s), rate (Hz) and output (m/s²) of ordinary rigs: they tell mistakes of one factor apart."""


def plausible(share: float) -> bool:
    """Whether 1 + k, over the ratio of the rig, is that of a working sensor."""
    return PLAUSIBLE_SCALE[0] <= share <= PLAUSIBLE_SCALE[1]


def implausible_scale(run: PreparedRun, scale: float) -> list[Remark]:
    """The remark on a value of 1 + k that no working sensor has, with what was mistaken; none on an ordinary one."""
    if plausible(scale / (run.rig.ratio or 1.0)):
        return []
    cause = run.once(("mistaken", f"{scale:.2g}"), lambda: mistaken(run.recording, scale))
    return [remark("implausible_scale", scale=scale, cause=cause)]


def suspicion(recording: Recording) -> str:
    """The sentence on a scale factor or a constant that no working sensor has, before any fit; empty where both may be
    ordinary.

    The relation of both channels in the band in which they are most alike stands for 1 + k: noise of the position makes
    it too small, by no more than the square of their correlation.
    """
    if not (len(recording.accel) and len(recording.position)):
        return ""
    rig, (slope, alike) = recording.rig, relation(recording.accel, recording.position)
    scale = rig.polarity * slope
    share = scale / (rig.ratio or 1.0)
    if abs(alike) < THE_OUTPUT:
        return other_column(recording) or exchanged(recording)
    if REVERSED_SCALE[0] < share < REVERSED_SCALE[1]:
        return turned(recording, scale)
    if plausible(share) or plausible(share / alike**2):
        constant = float(np.mean(recording.accel.y)) - scale * rig.gravity * rig.polarity
        return gravity_mistaken(recording, scale, constant) if rig.coupled else ""
    return remark("implausible_scale", scale=scale, cause=mistaken(recording, scale)).sentence


def turned(recording: Recording, scale: float) -> str:
    """The sentence on an output that runs against the encoder, with the line that mends it."""
    return f"{recording.title}: the output runs against the encoder (1 + k = {scale:.3f}). " + (
        f"Is a sign of the output or of input_axis swapped, or {other_sense(recording)}" * bool(other_sense(recording))
        or "The sensor is mounted the other way round or a sign is swapped; write in the sidecar\n[rig]\n"
        f'mount = "{OTHER_MOUNT[recording.rig.mount]}"'
    )


def other_sense(recording: Recording) -> str:
    """The sentence on an attitude that maps the other way round; empty where no attitude is mapped."""
    if not any(name.startswith("attitude.") for name in recording.origin.columns):
        return ""
    return (
        "does the attitude map the other way round? Write in the sidecar under [channels.attitude] the other of "
        'maps = "sensor to ENU" and maps = "ENU to sensor", and check the order and clock of its columns'
    )


def mistaken(recording: Recording, scale: float) -> str:
    """What was mistaken where 1 + k is no sensor's: another column, or a unit, range or clock; and what accepts it."""
    ratio = np.format_float_positional(float(f"{scale:.4g}"), trim="-")
    line = f"write [rig] ratio = {ratio}" if recording.origin.arguments else f"give rig=Rig(ratio={ratio})"
    accept = f"If the rig itself makes this ratio, a lever or two masses, {line}"
    texts = [other_column(recording)]
    if not texts[0]:
        ranked = sorted(causes(recording, abs(scale / (recording.rig.ratio or 1.0))))
        texts = [t for unusual, off, t in ranked[:2] if unusual + off < sum(ranked[0][:2]) + CLEARLY_BETTER]
        if GRAVITY in recording.side and not (ranked and ranked[0][1] < EXACTLY):
            return f"{ORIENTED}. {accept}"
    line = f"no unit, range or column explains it. {sensitivity_line(recording.rig, scale)}".rstrip(". ")
    return f"{'; or '.join(texts) or exchanged(recording) or line}. {accept}"


def declaration(channel: str, column: str, unit: str) -> str:
    """The line of a sidecar that declares a column and its unit."""
    return f'{channel} = {{ column = "{column}", unit = "{unit}" }}'


def declaring(recording: Recording, channel: str, column: str, unit: str) -> str:
    """What declares a column and its unit: a line of the sidecar, or the argument behind which arrays are read."""
    if recording.origin.arguments:
        return f"Write [channels] {declaration(channel, column, unit)}"
    return f'Give units={{"{column}": "{unit}"}}'


def exchanged(recording: Recording) -> str:
    """The sentence on output and position that are in the column of each other; empty where they are not.

    Numbers of either column, in the unit of the other channel, are then an output and its position.
    """
    (output, unit), (position, length) = (
        recording.origin.columns.get(name, ("", "")) for name in ("accel", "position")
    )
    kinds = [units.conversion(text).si if units.is_unit(text) else "" for text in (unit, length)]
    if recording.reference is not None or recording.axis or kinds != ["m/s^2", "m"]:
        return ""
    size = units.conversion(unit).factor / units.conversion(length).factor
    read, moved = recording.position, recording.accel
    slope, alike = relation(replace(read, y=read.y * size), replace(moved, y=moved.y / size))
    if abs(alike) < THE_OUTPUT or not plausible(abs(slope)):
        return ""
    line = "exchange them where the recording is made"
    if recording.origin.arguments:
        lines = declaration("accel", position, unit), declaration("position", output, length)
        line = f"write [channels] {' and '.join(lines)}"
    return f"output and position are each in the column of the other: {line}"


def other_column(recording: Recording) -> str:
    """The column in which the motion is, where that is not the declared output; empty where there is none."""
    slope, alike = relation(recording.accel, recording.position)
    best, least = ("", "", 0.0), THE_OUTPUT
    for column, unit, channel in other_outputs(recording):
        tried, correlation = relation(channel, recording.position)
        if plausible(abs(tried)) and abs(correlation) > least:
            best, least = (column, unit, correlation), abs(correlation)
    column, unit, correlation = best
    if not column or any(plausible(abs(slope) / max(biased, 1e-9)) for biased in (1.0, alike**2)):
        return ""
    other = correlation * recording.rig.polarity < 0.0
    mount = f' and [rig] mount = "{OTHER_MOUNT[recording.rig.mount]}"' if other else ""
    return (
        f"the motion is in {column}{', with the other sign' * other} (correlation {correlation:.2f}), not in "
        f"{recording.origin.columns.get('accel', ('accel',))[0]} ({alike:.2f}): write [channels] "
        f"{declaration(OUTPUTS.get(recording.axis, 'accel'), column, unit)}{mount}"
    )


def causes(recording: Recording, share: float) -> Iterator[tuple[float, float, str]]:
    """Mistakes of unit, clock, scale and range that leave a plausible 1 + k.

    Parameters
    ----------
    recording : its columns and units are those that the lines name.
    share : 1 + k that was estimated, over the ratio of the rig, without its sign.

    Yields
    ------
    Decades by which the record is beyond `ORDINARY` without it, logarithm of the 1 + k that is left, and what was
    mistaken with the line to write.
    """
    reference = "position" if recording.reference is None else recording.reference.name
    order = ORDERS[reference][0] if recording.reference else 2
    # 1 + k goes with the true unit over the declared one to a power, once it is put right
    for name, power in (("accel", 1), (reference, -1), ("time", order)):
        column, unit = recording.origin.columns.get(name, (name, ""))
        electrical = unit in units.ELECTRICAL
        declared = [size for text, size in KNOWN[name].items() if unit and units.same_unit(text, unit)]
        for true, size in KNOWN[name].items():
            for factor in (size, 1.0 / size) if electrical else [size / stated for stated in declared]:
                left = share * factor**power
                if factor == 1.0 or not power or not plausible(left):
                    continue
                channel = OUTPUTS.get(recording.axis, name) if name == "accel" else name
                text = f"the unit of column {column}: {true}, not {unit}? {declaring(recording, channel, column, true)}"
                if electrical:
                    line = sensitivity_line(recording.rig, 1.0 / factor) if name == "accel" else ""
                    text = f"the scale of {column}? It is {1.0 / factor:.6g} times the declared one. {line}".rstrip(
                        ". "
                    )
                yield unusual(recording, {name: factor}, order), abs(math.log(left)), text
    for base, most, cause in ((2.0, MOST_DOUBLINGS, "a range register"), (10.0, MOST_TENS, "a gain of an amplifier")):
        n = round(math.log(share, base)) if share > 0.0 else 0
        if 0 < abs(n) <= most and plausible(share / base**n):
            text = f"the range setting? The output is {base**n:g} times what it should be, as where {cause} is off. "
            line = sensitivity_line(recording.rig, base**n)
            yield 0.0, abs(math.log(share / base**n)), f"{text}{line}".rstrip(". ")


def sensitivity_line(rig: Rig, factor: float) -> str:
    """The line that declares the sensitivity times a factor; empty where none is declared."""
    scale, unit = rig.sensor.scale, rig.sensor.scale_unit
    return "" if scale is None else f'Write [sensor] scale = "{scale * factor * STANDARD_GRAVITY:.6g} {unit}/g"'


def unusual(recording: Recording, factor: Mapping[str, float], order: int) -> float:
    """Decades by which a record is beyond what rigs do, its channels times a factor; `order` is of the reference."""
    t, time, output = recording.accel.t, factor.get("time", 1.0), factor.get("accel", 1.0)
    read = math.prod(size for name, size in factor.items() if name not in ("time", "accel"))
    values = (
        float(np.ptp(recording.position.y)) * read * time ** (2 - order),
        float(t[-1] - t[0]) * time,
        1.0 / (usual_step(t) * time),
        float(np.std(recording.accel.y)) * output,
    )
    return sum(
        max(0.0, math.log10(low / max(value, 1e-99)), math.log10(max(value, 1e-99) / high))
        for value, (low, high) in zip(values, ORDINARY, strict=True)
    )


def reversed_or_unrelated(recording: Recording, scale: float, std: float) -> str:
    """What is refused where the output runs against the encoder: a mount, or channels that are no one axis."""
    coherent = abs(relation(recording.accel, recording.position)[1]) > THE_OUTPUT
    if coherent and REVERSED_SCALE[0] < scale / (recording.rig.ratio or 1.0) < REVERSED_SCALE[1]:
        return turned(recording, scale)
    unrelated = other_column(recording) or other_sense(recording) or ORIENTED * (GRAVITY in recording.side)
    cause = mistaken(recording, scale) if coherent else unrelated
    return (
        f"{recording.title}: output and position are not one axis of one body: 1 + k = {scale:.3g} ± "
        f"{std:.2g}, where a sensor shows 1, or -1 if it is mounted the other way round. No scale factor, mount or "
        "effect is read from them; check that both channels are of the same run, axis and unit"
        f"{': ' * bool(cause)}{cause}"
    )


def gravity_mistaken(recording: Recording, scale: float, constant: float) -> str:
    """The sentence on a constant of the output that is gravity where the rig declares another; empty where it is none.

    Parameters
    ----------
    recording : with its rig.
    scale, constant : 1 + k, and K0 in m/s².
    """
    rig, near = recording.rig, GRAVITY_SHARE * STANDARD_GRAVITY
    constant *= rig.polarity / scale
    levels = (0.0, STANDARD_GRAVITY, -STANDARD_GRAVITY)
    shown = next((level for level in levels if abs(rig.gravity + constant - level) < near), None)
    ordinary = any(abs(rig.gravity - level) < near for level in levels)
    if shown is None or not ordinary or abs(constant) < STANDARD_GRAVITY - near:
        return ""
    line, along = f'axis = "{"up" if shown > 0.0 else "down"}"', f"on an axis declared {rig.axis}"
    why = f"{along}: the record reads the other way; write in the sidecar"
    if shown == 0.0:
        line = 'gravity_along_axis = "0 m/s^2"'
        why = f'{along}. A level axis has axis = "level"; else gravity seems to be removed; write in the sidecar'
    elif abs(rig.gravity) < near:
        why = f"close to gravity, {along}. If the axis is vertical, write in the sidecar"
    return f"{recording.title}: the output has a constant of {constant:.3f} m/s² {why}\n[rig]\n{line}"
