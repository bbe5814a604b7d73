"""Readings left out of an estimate before it is made: saturated, stuck, of a sleeping logger, denied by the reference.

A reading at the limit of the range, one that repeats a value while the other channel moves, or one far beyond the rest
of which the reference shows nothing, is no measurement with noise: it biases every estimate, so it becomes a gap, with
the reach of the declared filters on both sides.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np
import scipy

from accelcal._support.values import listing
from accelcal.data import (
    ACCELERATION,
    POSITION_ORDER,
    VELOCITY,
    Array,
    Channel,
    Flags,
    Recording,
    instant,
    integrated,
    require_reference,
    require_usable,
    running_integral,
    usual_step,
    within_spans,
)
from accelcal.data.recording import LeftOut, WrongKind
from accelcal.diagnosis.policy import (
    DENIED_RATIO,
    DENIED_SHARE,
    DENIED_SIGMA,
    DISTURBED_SHARE,
    JUNK_RATIO,
    LEFT_OUT_BESIDE,
    LOST_SIGMA,
    LOST_STEPS,
    RAIL_NOISE,
    RAIL_PILED,
    RAIL_SAMPLES,
    RAIL_TOLERANCE,
    STUCK_MOTION_SHARE,
    STUCK_SAMPLES,
    STUCK_VELOCITY_SHARE,
)
from accelcal.estimation.channel_filters import ChannelFilters
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import PreparedRun, Source, prepared, recording_of
from accelcal.signals.processing import FORGOTTEN, memory
from accelcal.signals.series import interpolation_errors, interpolation_spread, local_spread, runs_of_true, widened

FEWEST = 16
"""Samples of the output in a stretch, least, from which its noise is known."""
SLOPE = 8
"""Readings on either side of a stretch that tell the speed there."""
ALIKE = 0.9
"""Correlation of what output and reference show of one motion, least, whatever the scale of either."""
MOSTLY = 0.5
"""Share of wild readings, least, in a stretch of junk."""
SINGLE = 2
"""Damaged readings that stand alone; about more of them some may lie that are no larger than the rest."""
HIDDEN = (1.0, 0.25, 1.0 / 16.0)
"""What an output that repeats one count may hide of a reference of so many derivatives less, over the count and the
length of the stretch to that power: its departure from a polynomial of that degree stays below."""

MOST_CUT = 4
"""Stretches that a command is spelled out for."""
MILLISECOND = 1e-3
"""To which an instant is printed, s."""

Stretches = list[tuple[float, float]]
"""First and last instant of each stretch, s."""


def without_wrong_readings(source: Source) -> Recording:
    """The recording without the readings that are known to be wrong; the recording itself where there are none.

    One that cannot be used is returned as it is, too: the fit says why.
    """
    recording = recording_of(source)
    return recording if recording.left_out else _cleaned(source) or recording


def left_out_remarks(
    recordings: Sequence[Recording], place: str = "", start: float | None = None, end: float | None = None
) -> list[Remark]:
    """Remarks on readings left out of recordings, one for each kind and channel; `place` stands before the name.

    Where `start` or `end` is given, s, what lies outside is not mentioned.
    """
    first, last = -math.inf if start is None else start, math.inf if end is None else end
    return [
        remark(
            gap.kind,
            recording=f"{place}{recording.title}",
            channel=gap.channel,
            count=gap.count,
            of=gap.of,
            share=100.0 * gap.count / gap.of,
            stretches=len(gap.stretches),
            time=gap.stretches[0][0],
            end=gap.stretches[-1][1],
            reach=gap.reach,
            scale=gap.scale,
            cut=cut_without(recording, [stretch for item in recording.left_out for stretch in item.stretches]),
        )
        for recording in recordings
        for gap in recording.left_out
        if any(a <= last and b >= first for a, b in gap.stretches)
    ]


def cut_without(recording: Recording, stretches: Sequence[tuple[float, float]]) -> str:
    """The clause with the command that writes a file without these stretches, s, or with the call where the channels
    were arrays; empty where they are too many."""
    spans = list[tuple[float, float]]()
    for a, b in sorted((a - MILLISECOND, b + MILLISECOND) for a, b in stretches):
        if spans and a <= spans[-1][1]:
            spans[-1] = (spans[-1][0], max(b, spans[-1][1]))
        else:
            spans.append((a, b))
    if len(spans) > MOST_CUT:
        return ""
    if not recording.origin.arguments:
        return f"; without that: recording.without({', '.join(f'({instant(a)}, {instant(b)})' for a, b in spans)})"
    parts = " ".join(f"--without {instant(a)}:{instant(b)}" for a, b in spans)
    name = quote(f"{Path(recording.name).stem}_cut.csv")
    return f"; a file without that: accelcal cut {recording.origin.arguments} {parts} -o {name}"


def _cleaned(source: Source) -> Recording | None:
    """The recording without its wrong readings; None where it has none, or no others."""
    recording = recording_of(source)
    try:
        require_usable(recording)
        wrong: tuple[tuple[WrongKind, str, Stretches], ...] = (
            ("denied", "accel", [*junk(recording), *denied(recording)]),
            ("saturated", "accel", rail_hits(recording)),
            *stuck(source),
            *lost_signal(recording),
        )
    except ValueError:
        return None
    rig, left = recording.rig, recording
    for kind, name, stretches in wrong:
        channel: Channel = getattr(left, name)
        step, filters = usual_step(channel.t), rig.output_filters if name == "accel" else rig.position_filters
        reach = memory(filters, 1.0 / step)
        if name == "accel":
            reach += FORGOTTEN * rig.lowpass_tau
            reach += 0.0 if kind == "denied" else LEFT_OUT_BESIDE * step
        edges = np.array([[begin - reach, np.nextafter(end + reach, math.inf)] for begin, end in stretches])
        out = within_spans(np.searchsorted(channel.t, edges), len(channel))
        if not out.any():
            continue
        if len(channel) - np.count_nonzero(out) < 2:
            return None
        left = without(left, name, out, kind, reach)
    return left if left.left_out else None


def without(
    recording: Recording, name: str, out: Flags, kind: WrongKind, reach: float, scale: float = 1.0
) -> Recording:
    """The recording without some samples of a channel, (n,), with a note on them; `scale` is theirs over the rest's."""
    channel: Channel = getattr(recording, name)
    spans = tuple((float(channel.t[a]), float(channel.t[b])) for a, b in runs_of_true(out, 1))
    item = LeftOut(kind, channel.name, int(np.count_nonzero(out)), len(channel), spans, reach, scale)
    changed: dict[str, Any] = {name: replace(channel, t=channel.t[~out], y=channel.y[~out])}
    if name == "reference":
        changed["position"] = integrated(changed[name])
    return replace(recording, left_out=(*recording.left_out, item), **changed)


def denied(recording: Recording) -> Stretches:
    """Stretches of output far beyond the rest, of which the reference shows nothing: damaged packets, switching on.

    Over each stretch and half of its length, or 16 readings of the reference, on either side, the departure from a
    polynomial of what the reference reads is regressed on that of the output in the stretch, integrated as often as
    makes it the same quantity. A shock that the reference shows is kept, and so is one that hides in its noise; beside
    an acceleration nothing is judged.
    """
    accel, reference = recording.accel, recording.reference or recording.position
    order = POSITION_ORDER if recording.reference is None else require_reference(reference)[0]
    departure = np.abs(accel.y - np.median(accel.y))
    # beside an acceleration a delay hides that two short pulses are alike
    far = departure > (DENIED_RATIO * np.quantile(departure, 0.99) if order else math.inf)
    beside, stretches = FEWEST * usual_step(reference.t), []
    for a, b in runs_of_true(widened(far, LEFT_OUT_BESIDE), 1) if far.any() else []:
        at = accel.t[a : b + 1][far[a : b + 1]]
        begin, end = (float(at[0]), float(at[-1])) if len(at) <= SINGLE else (float(accel.t[a]), float(accel.t[b]))
        around = [begin - max(beside, 0.5 * (end - begin)), end + max(beside, 0.5 * (end - begin))]
        about, rows = (slice(*np.searchsorted(channel.t, around)) for channel in (accel, reference))
        t, moved = accel.t[about], accel.y[about] - np.median(accel.y)
        moved[(t < begin) | (t > end)] = 0.0
        x, read = reference.t[rows], reference.y[rows]
        if len(x) < FEWEST:
            continue
        for _ in range(order):
            moved = running_integral(moved, np.diff(t))
        powers = np.vander((x - x[0]) / (x[-1] - x[0]), order + 3)
        both = np.column_stack([np.interp(x, t, moved), read])
        claimed, shown = (both - powers @ np.linalg.lstsq(powers, both)[0]).T
        power, spare = float(claimed @ claimed) + 1e-300, len(x) - powers.shape[1] - 1
        share, left = abs(float(claimed @ shown)) / power, float(shown @ shown) / power
        alike = share > ALIKE * math.sqrt(left)  # a shock in another unit
        if share + DENIED_SIGMA * math.sqrt(left / spare) < DENIED_SHARE and not alike:
            stretches.append((begin, end))
    return stretches


def junk(recording: Recording) -> Stretches:
    """Stretches at the begin and the end of the output that jump far more than the rest: a sensor that is switched on.

    They may be no larger than the motion, and as fast as the samples they hide in the noise of a position.
    """
    accel, read = recording.accel, recording.reference
    if read is not None and read.name == ACCELERATION:  # a record of shocks may begin with one
        return []
    change = np.abs(np.diff(accel.y, 3))
    wild = change > JUNK_RATIO * (np.quantile(change, 0.99) or math.inf) if len(change) else change > 0.0
    if not (wild[:FEWEST].any() or wild[-FEWEST:].any()):
        return []
    runs = runs_of_true(widened(wild, LEFT_OUT_BESIDE), FEWEST)
    return [
        (float(accel.t[a]), float(accel.t[b + 3]))
        for a, b in runs
        if (a == 0 or b == len(wild) - 1) and np.mean(wild[a : b + 1]) > MOSTLY
    ]


def rail_hits(recording: Recording) -> Stretches:
    """Stretches in which the output is at the limit of its declared range, or the element was before the low-passes.

    An output that piles up beyond the declared range has its limit there. Readings just below a limit must be few: a
    motion that only comes near it is no saturation.
    """
    declared = recording.rig.sensor.range
    accel = recording.accel
    if declared is None or float(np.max(np.abs(accel.y))) < 0.5 * declared:
        return []
    stretches: Stretches = []
    for t, y in (accel.t, accel.y), _before_low_passes(recording):
        noise = RAIL_NOISE * interpolation_spread(t, y) if y is not accel.y else 0.0
        tolerance = max(RAIL_TOLERANCE * declared, noise)
        for upward in (y, -y):
            extreme = float(np.max(upward))
            beyond = extreme > declared + tolerance and runs_of_true(upward == extreme, RAIL_SAMPLES)
            limit = extreme if beyond else declared
            at, below = np.abs(upward - limit) <= tolerance, (limit - 3.0 * tolerance, limit - tolerance)
            others = np.count_nonzero((upward >= below[0]) & (upward < below[1]))
            higher = np.count_nonzero(upward > limit + tolerance)
            if np.count_nonzero(at) >= RAIL_PILED * max(others, higher):
                stretches += [(float(t[a]), float(t[b])) for a, b in runs_of_true(at, 2)]
    return stretches


def _before_low_passes(recording: Recording) -> tuple[Array, Array]:
    """Times and values of the output with its declared low-passes inverted; of one RC, as if the input were constant
    between two samples: it then is exact where the element is at its limit."""
    accel, lowpass = recording.accel, recording.rig.lowpass
    rates = (1.0 / usual_step(channel.t) for channel in (accel, recording.position))
    accel = ChannelFilters(recording.rig, *rates).undone(accel)
    if lowpass is None:
        return accel.t, accel.y
    weight = np.exp(-np.diff(accel.t) / lowpass.tau)
    return accel.t[1:], (accel.y[1:] - weight * accel.y[:-1]) / (1.0 - weight)


def stuck(source: Source) -> list[tuple[WrongKind, str, Stretches]]:
    """Stretches in which one channel repeats a value while the other one moves, by channel."""
    recording = recording_of(source)
    repeats = [
        runs_of_true(np.diff(channel.y) == 0.0, STUCK_SAMPLES) for channel in (recording.accel, recording.position)
    ]
    if not any(repeats):
        return []
    run = prepared(source).complete
    return [("stuck", "accel", stuck_outputs(run)), ("stuck", "position", stuck_positions(run))]


def stuck_outputs(run: PreparedRun) -> Stretches:
    """Stretches in which the output repeats a value while the reference shows more motion than one count hides."""
    (t, z), accel, degree = run.reference_readings, run.accel, run.order
    noise = math.sqrt(run.reading_variance_guess) if degree == POSITION_ORDER else interpolation_spread(t, z)
    steps = np.abs(np.diff(accel.y))
    count = float(np.quantile(steps[steps > 0.0], 0.01)) if np.any(steps) else 0.0
    stretches = []
    for a, b in runs_of_true(steps == 0.0, STUCK_SAMPLES):
        begin, end = float(accel.t[a]), float(accel.t[b + 1])
        rows = slice(*np.searchsorted(t, [begin, end]))
        hidden = HIDDEN[degree] * count * (end - begin) ** degree
        least = 10.0 * (noise + run.least_step) + hidden
        if rows.stop - rows.start >= 8 and _departure_from_polynomial(t[rows], z[rows], degree) > least:
            stretches.append((begin, end))
    return stretches


def stuck_positions(run: PreparedRun) -> Stretches:
    """Stretches in which the position repeats a value while the output shows that the stage moves.

    The output must move as it does elsewhere, and by as much as the speeds before and behind differ: a bias that drifts
    at rest, or a sensor that is touched, is no motion of the stage.
    """
    if run.order != POSITION_ORDER:
        return []
    t, z, accel = run.t, run.z, run.accel
    steps = np.abs(np.diff(z))
    count = float(np.min(steps[steps > 0.0], initial=np.ptp(z)))  # whatever resolution is declared
    noise = math.sqrt(run.reading_variance_guess) + max(run.least_step, count)
    force = run.rig.polarity * (accel.y - np.mean(accel.y))
    speed = running_integral(force, np.diff(accel.t))
    usual = float(np.std(force))
    stretches = []
    for a, b in runs_of_true(steps == 0.0, STUCK_SAMPLES):
        begin, end = float(t[a]), float(t[b + 1])
        rows = slice(*np.searchsorted(accel.t, [begin, end]))
        u, step = force[rows], run.accel_step
        if len(u) < FEWEST or np.std(u) < STUCK_MOTION_SHARE * usual:
            continue
        position = np.cumsum(np.cumsum(u - np.mean(u))) * step**2
        random_motion = interpolation_spread(accel.t[rows], u) * step**2 * len(u) ** 1.5
        if _departure_from_polynomial(accel.t[rows], position, 1) <= 20.0 * noise + 5.0 * random_motion:
            continue
        before, behind = slice(max(0, a - SLOPE), a + 1), slice(b + 2, b + 2 + SLOPE)
        if a >= SLOPE and b + 2 + SLOPE <= len(t):
            gained = float(np.polyfit(t[behind] - end, z[behind], 1)[0] - np.polyfit(t[before] - end, z[before], 1)[0])
            shown = speed[rows]
            if abs(gained - (shown[-1] - shown[0])) > STUCK_VELOCITY_SHARE * float(np.ptp(shown)):
                continue
        stretches.append((begin, end))
    return stretches


def shown_by_output(recording: Recording, order: int) -> Callable[[Array], Array]:
    """Motion that the output shows, integrated `order` times, as a function of time; its scale is the output's."""
    accel, polarity = recording.accel, recording.rig.polarity
    curve = scipy.interpolate.CubicSpline(accel.t, polarity * (accel.y - np.mean(accel.y))).antiderivative(order)
    return lambda t: np.asarray(curve(t))


def gain_of_changes(read: Array, shown: Array) -> float:
    """Ratio of what is read (n,) to what is shown (n,), from reading to reading: a slow drift of either is left out."""
    changes = np.diff(shown)
    energy = changes @ changes
    return float(np.diff(read) @ changes / energy) if energy > 0.0 else 0.0


def lost_signal(recording: Recording) -> list[tuple[WrongKind, str, Stretches]]:
    """Readings of a velocity that jump away from the integral of the output and come back, as a few of them do.

    What both show is taken off, and the rest is compared with its neighbours. A jump counts that a sudden change of the
    output about it cannot make, as an impact leaves one where the channels are not quite simultaneous.
    """
    read, accel = recording.reference, recording.accel
    if read is None or read.name != VELOCITY or len(read) < FEWEST:
        return []
    step, shown = usual_step(read.t), shown_by_output(recording, 1)(read.t)
    error, gain = interpolation_errors(read.t, read.y - shown)
    sudden = np.abs(interpolation_errors(accel.t, accel.y)[0])
    largest = np.interp(read.t, accel.t, scipy.ndimage.maximum_filter1d(sudden, 2 * LEFT_OUT_BESIDE + 1))
    likely = LOST_SIGMA * local_spread(error / gain)
    near = widened(np.abs(error / gain) > likely + LOST_STEPS * step * largest, LEFT_OUT_BESIDE // 2)
    if not near.any() or np.mean(near) > DISTURBED_SHARE:
        return []
    # of these the wrong ones: far from what lies around and the motion between
    rest = read.y - shown * gain_of_changes(read.y[~near], shown[~near])
    out = np.abs(rest - scipy.interpolate.CubicSpline(read.t[~near], rest[~near])(read.t)) > likely
    return [("lost_signal", "reference", [(float(read.t[a]), float(read.t[b])) for a, b in runs_of_true(out, 1)])]


def _departure_from_polynomial(t: Array, y: Array, degree: int) -> float:
    """Peak-to-peak departure of a stretch from a polynomial."""
    x = t - t[0]
    return float(np.ptp(y - np.polynomial.Polynomial.fit(x, y, degree)(x)))


__dir__ = listing(globals())
