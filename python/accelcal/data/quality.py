"""Faults and peculiarities of the samples of a channel, and the policy for each case.

==================== ===================================================================================================
not finite           error: an infinite or undefined reading is not a measurement
not plausible        error: stamps beyond 1e13 s or closer than 1 ns, readings beyond 1e100
backward stamps      error: a clock that starts again makes two recordings (`accelcal.io.loading` names the parts)
duplicate stamps     equal values: one is kept. Different values: their mean, while fewer than 1 % of the stamps are
                     concerned; beyond that the stamps are coarser than the sampling, which is an error
held repeats         accelerations only: a logger faster than its sensor writes each reading again until the next one.
                     The first is kept, the repeats were not sampled. A quantised reading at rest is not a repeat. It is
                     stamped at the logger's next tick; where the sensor's clock is uniform, its instants are used
rounded stamps       warning: stamps on a grid of which the spacing is no multiple. Where one uniform clock explains all
                     of them, its instants are used, else the stamps are kept
late, slewed stamps  warning: stamps of a host that scatter about a uniform clock which the readings fit better, and
                     those of a clock whose rate is another for a while. The instants of the clock are used
lost rows            warning: of channels without stamps whose readings step by what they change by in whole rows. Gaps
                     are left in their place (`accelcal.data.clocks`)
position repeats     mentioned, kept: an encoder at rest repeats its count
coarse grid          warning: readings that all lie on a grid coarser than the declared resolution; the grid is taken
saturated            warning, kept here: readings at the declared range, or piled up at the extreme; the former are
                     left out before anything is estimated (`accelcal.diagnosis.left_out`)
constant             warning, kept; of the output an error where something is to be learnt from it
gaps                 mentioned, kept as gaps
implausible travel   warning: more than 100 m, or faster than 1000 m/s, looks like a wrong unit of position
==================== ===================================================================================================
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelcal._support.values import amount_of, listing
from accelcal.data import units
from accelcal.data.arrays import Array, Flags, median_step, runs_of, within_spans
from accelcal.data.clocks import FEWEST_STAMPS, rounding_std, slewed, stamp_grid, steady_clock, uniform_clock
from accelcal.data.orientation import (
    ACROSS,
    ANGLE,
    GRAVITY,
    GRAVITY_NOISE,
    LEVELS,
    LEVERS,
    OF_ARM,
    PLACE,
    TURNED,
)
from accelcal.data.recording import ORDERS, Channel, Finding, Recording, RecordingError
from accelcal.data.rig import Rig
from accelcal.data.units import instant

ROUNDED, HELD = "stamps_on_grid", "held_repeats"
"""Kinds of findings that the diagnosis reads; their size is the step of the stamps, s."""
COARSE_STAMPS = 0.01
"""Share of contradictory duplicate stamps from which on the stamps are coarser than the sampling."""
GRID_TOLERANCE = 0.05
"""Steps of a grid by which a reading may lie beside it."""
CLIP_MARGIN = 1e-3
"""A reading within this share of the declared range counts as clipped."""
LONGEST_TRAVEL = 100.0
"""m"""
HIGHEST_SPEED = 1000.0
"""m/s"""


LATEST = 1e13
"""s, of either sign; beyond 300 000 years a double does not tell samples of 1 kHz apart."""
SHORTEST = 1e-9
"""Usual interval between two stamps, s."""
EVEN_TIMES = 20_000_000
"""Even times that a stretch may have beyond four for each sample."""
CLOSEST = 1e-18
"""Smallest interval between two stamps, s: below it speeds leave the range of a double when they are squared."""


@dataclass(frozen=True, slots=True)
class Samples:
    """The readings of one channel before any check."""

    file: str
    name: str
    t: Array
    """(n,) s"""
    y: Array
    """(n,) in `unit`"""
    unit: str
    row: Callable[[int], str]
    """Names the row of the i-th sample, for messages."""


def clean(samples: Samples, rig: Rig) -> tuple[Channel, list[Finding]]:
    """Check one channel and apply the policies above.

    Parameters
    ----------
    samples : t, y of shape (n,), in s and SI.
    rig : its declared range judges clipping.

    Returns
    -------
    The channel, strictly rising in time and finite, and what was noticed.

    Raises
    ------
    RecordingError
        If samples are missing altogether, not finite, or not in order of time.
    """
    _require_finite(samples)
    _require_plausible(samples)
    _require_order(samples)
    t, y, findings = _without_duplicates(samples)
    name, unit = samples.name, samples.unit
    t, noticed = _unrounded(name, t) if name in ("accel", "position", ANGLE, *PLACE) else (t, [])
    findings += noticed
    if len(t) < 2 and name in ("accel", "position"):
        raise RecordingError(_too_few(samples.file, name, len(t)))
    require_pace(samples.file, name, t)
    if name in ("accel", "position", ANGLE, *ORDERS):
        for better in (_unscattered, _counted_through):
            t, noticed = better(name, t, y)
            findings += noticed
    if unit == "m/s^2":
        t, y, noticed = _without_held(name, t, y)
        findings += noticed
        findings += _clipping(name, t, y, rig.sensor.range if name == "accel" else None)
    if name == "position":
        findings += _position_repeats(t, y) + _coarse_grid(t, y, rig.resolution) + _travel(t, y)
    findings += _constant(name, t, y) + _gaps(name, t)
    return Channel(name, np.ascontiguousarray(t), np.ascontiguousarray(y), unit), findings


def require_usable(recording: Recording) -> None:
    """Check what `clean` promises of the two channels: a recording that Python code made may hold anything.

    Raises
    ------
    RecordingError
        If a channel has fewer than 2 samples, stamps and readings that do not pair, numbers that are not finite or not
        plausible, stamps that do not rise, or a rate that no sensor has; if the channels share no stretch of time, or
        the output never changes.
    """
    file = recording.title
    for channel in (recording.accel, recording.position, *recording.side.values()):
        t, y = np.asarray(channel.t), np.asarray(channel.y)
        if t.ndim != 1 or t.shape != y.shape or t.dtype.kind not in "fiu" or y.dtype.kind not in "fiu":
            raise RecordingError(
                f"{file}: {channel.name}: {t.shape} stamps and {y.shape} readings, expected as many real numbers of "
                "each, in one dimension."
            )
        if len(t) < 2 and channel.name in ("accel", "position"):
            raise RecordingError(_too_few(file, channel.name, len(t)))
        samples = Samples(file, channel.name, t, y, channel.unit, lambda i: f"sample {i + 1}")
        _require_finite(samples)
        _require_plausible(samples)
        if np.any(t[1:] <= t[:-1]):
            i = int(np.argmax(t[1:] <= t[:-1])) + 1
            raise RecordingError(
                f"{file}: time of {channel.name} does not rise at {samples.row(i)}: {t[i]:.9g} s after "
                f"{t[i - 1]:.9g} s; expected each stamp after the one before. Keep one of the samples at one time; "
                "where the clock starts again, another recording begins."
            )
        require_pace(file, channel.name, t)
    require_overlap(file, recording.accel, recording.position)
    require_varying(recording)


def require_few_holes(recording: Recording, seconds: float, step: float) -> None:
    """Check that a stretch of so many seconds can be put on even times, a step (s) apart: most of it may be a hole.

    Raises
    ------
    RecordingError
        If there would be far more even times than samples, as where a clock jumps.
    """
    count = len(recording.accel) + len(recording.position)
    if seconds > step * (EVEN_TIMES + 4 * count):
        raise RecordingError(
            f"{recording.title}: {count} samples and readings, usually {step:.3g} s apart, are spread "
            f"over {seconds:.3g} s: the clock jumps, or the recording is mostly gaps. Correct the time column, or use "
            "a part without the jump (--from, --to)."
        )


def _too_few(file: str, name: str, count: int) -> str:
    count_text = "1 sample" if count else "no sample"
    return f"{file}: {name}: {count_text}; at least 2 are needed to have a rate; record longer, or give its column."


def require_overlap(file: str, accel: Channel, position: Channel) -> None:
    """Check that the two channels share a stretch of time.

    Raises
    ------
    RecordingError
        If one ends before the other begins.
    """
    if accel.t[0] >= position.t[-1] or position.t[0] >= accel.t[-1]:
        raise RecordingError(
            f"{file}: accel ({_span(accel.t)}) and position ({_span(position.t)}) share no stretch of time; "
            "check the two time columns and their units."
        )


def _span(t: Array) -> str:
    return f"{t[0]:g} s to {t[-1]:g} s"


def _require_finite(samples: Samples) -> None:
    for what, values in (("time of ", samples.t), ("", samples.y)):
        bad = ~np.isfinite(values)
        if bad.any():
            i, count = int(np.argmax(bad)), int(np.count_nonzero(bad))
            place = samples.row(i) if what else f"t = {instant(samples.t[i])} s, {samples.row(i)}"
            raise RecordingError(
                f"{samples.file}: {what}{samples.name}: {amount_of(count, 'sample is', 'samples are')} not finite "
                f"(first at {place}). Drop them or mark them missing with an empty cell."
            )


def _require_plausible(samples: Samples) -> None:
    """Refuse numbers that no clock and no sensor gives: products of them would leave the range of a double."""
    for what, values, most in (("time of ", samples.t, LATEST), ("", samples.y, units.LARGEST)):
        bad = np.abs(values) > most
        if bad.any():
            i = int(np.argmax(bad))
            unit = " s" if what else f" {samples.unit}".removesuffix(" 1")
            raise RecordingError(
                f"{samples.file}: {what}{samples.name}: {values[i]:.6g}{unit} at {samples.row(i)}, expected at most "
                f"{most:g}{unit}. Check the unit of the column, or leave the cell empty."
            )


def require_pace(file: str, name: str, t: Array) -> None:
    """Check that stamps, strictly rising, come at a rate that a sensor can have.

    Raises
    ------
    RecordingError
        If half of their spacings are shorter than `SHORTEST`, or one is shorter than `CLOSEST`.
    """
    if len(t) > 1 and (closest := float(np.min(np.diff(t)))) < CLOSEST:
        i = int(np.argmin(np.diff(t)))
        raise RecordingError(
            f"{file}: {name}: two stamps at t = {instant(t[i])} s are {closest:.3g} s apart, expected at least "
            f"{CLOSEST:g} s. Delete one of the two samples."
        )
    if len(t) > 1 and (usual := median_step(t)) < SHORTEST:
        raise RecordingError(
            f"{file}: {name}: the usual interval between two stamps is {usual:.3g} s, expected at least "
            f"{SHORTEST:g} s. Check the unit of the time column."
        )


def _require_order(samples: Samples) -> None:
    t = samples.t
    back = t[1:] < t[:-1]
    if back.any():
        i = int(np.argmax(back)) + 1
        count = int(np.count_nonzero(back))
        more = f", and {count - 1} times more" if count > 1 else ""
        raise RecordingError(
            f"{samples.file}: time of {samples.name} runs backward at {samples.row(i)}: "
            f"{t[i]:.9g} s after {t[i - 1]:.9g} s{more}; expected each stamp after the one before. "
            "Sort the rows by time."
        )


def _without_duplicates(samples: Samples) -> tuple[Array, Array, list[Finding]]:
    t, y = samples.t, samples.y
    if not np.any(t[1:] == t[:-1]):
        return t, y, []
    first = np.concatenate(([True], t[1:] != t[:-1]))
    starts = np.flatnonzero(first)
    lengths = np.diff(starts, append=len(t))
    differs = np.maximum.reduceat(y, starts) != np.minimum.reduceat(y, starts)
    share = np.count_nonzero(differs) / len(starts)
    doubled = float(t[starts[np.argmax(lengths > 1)]])
    if share > COARSE_STAMPS:
        i = int(starts[np.argmax(differs)])
        raise RecordingError(
            f"{samples.file}: {samples.name}: {np.count_nonzero(differs)} time stamps ({share:.0%}) carry several "
            f"different values (first at t = {instant(t[i])} s, {samples.row(i)}). The stamps are coarser than the "
            'sampling: export them with more digits, or declare rate = "... Hz" in [channels] in their place.'
        )
    mean = np.where(differs, np.add.reduceat(y, starts) / lengths, y[starts])
    count = len(t) - len(starts)
    repeated = amount_of(count, "sample repeats", "samples repeat")
    text = f"{samples.name}: {repeated} the time stamp before (first at t = {instant(doubled)} s): "
    averaged = int(np.count_nonzero(differs))
    text += (
        f"where the values differ ({averaged} stamps) their mean is used, else one is kept"
        if averaged
        else "one of each is kept"
    )
    finding = Finding("duplicate_stamps", samples.name, count, doubled, text, "warning" if averaged else "note")
    return t[starts], mean, [finding]


def _unrounded(name: str, t: Array) -> tuple[Array, list[Finding]]:
    """Find stamps that were rounded, and put the instants of a uniform clock in their place where one explains them."""
    step = stamp_grid(t)
    if step == 0.0:
        return t, []
    clock = uniform_clock(t)
    moved = clock.explains(step)
    if not moved and (clock.spread < step or step > 0.5 * clock.period):  # spacings are multiples of the step, or gaps
        return t, []
    used = (
        f"one clock of {1.0 / clock.period:.6g} Hz explains all of them and its instants are used; "
        "where stamps are cut off instead of rounded, every one is early by half a step"
        if moved
        else "no uniform clock explains them, so the stamps are kept; record them with more digits"
    )
    text = (
        f"{name}: the time stamps are rounded to {1e3 * step:.6g} ms, which alone errs by "
        f"{1e3 * rounding_std(step):.2g} ms rms: {used}"
    )
    if not moved:
        return t, [Finding(ROUNDED, name, len(t), float(t[0]), text, "warning", step, 0.0, rounding_std(step))]
    return clock.instants, [Finding(ROUNDED, name, len(t), float(t[0]), text, "warning", step, clock.common_std(step))]


def _without_held(name: str, t: Array, y: Array) -> tuple[Array, Array, list[Finding]]:
    """Drop readings that a logger wrote again because the sensor had no new one yet.

    Chance makes a quantised reading equal to the one before, most often at rest. So the question is asked only
    right after a clear change, of more than three quantisation steps. There chance makes the next reading equal as
    often as it makes it one or two codes higher or lower, about (`equal_by_chance`); clearly more often (five standard
    deviations, and 2 %) means held.
    """
    step = np.abs(np.diff(y))
    quantum = _quantum(step)
    clear = (step[:-1] > 3 * quantum) & (y[1:-1] != y.max()) & (y[1:-1] != y.min())
    clear_changes = int(np.count_nonzero(clear))
    if clear_changes < _FEWEST_CHANGES:
        return t, y, []
    repeated = int(np.count_nonzero(clear & (step[1:] == 0)))
    codes = np.rint(np.diff(y)[1:][clear] / quantum)
    by_chance = equal_by_chance([int(np.count_nonzero(codes == code)) for code in (-2, -1, 1, 2)])
    if repeated - by_chance < max(0.02 * clear_changes, 5.0 * np.sqrt(repeated + by_chance)):
        return t, y, []

    starts = np.flatnonzero(np.concatenate(([True], step > 0)))
    lengths = np.diff(starts, append=len(y))
    after_clear = np.concatenate(([False], step > 3 * quantum))[starts]
    hold = max(int(np.quantile(lengths[after_clear], 0.9)), 2)
    usual = float(np.mean(lengths[after_clear & (lengths <= 1.5 * hold)]))
    pace = usual if usual >= 1.5 else float(hold)  # below, one repeat and two equal readings have the same length
    sampled = np.maximum(np.rint(lengths / pace), 1.0)  # at rest the sensor itself repeats a code: one sample per hold
    if len(np.unique(y[starts])) > _DISTINCT * len(starts):
        sampled[:] = 1.0
    number = np.floor((np.arange(len(y)) - np.repeat(starts, lengths)) / pace + 1e-9)
    changed = (np.diff(number, prepend=-1.0) != 0.0) & (number < np.repeat(sampled, lengths))
    changed[starts] = True
    tick = median_step(t)
    changed &= np.diff(t, prepend=-np.inf) < 1.5 * tick  # behind a gap nobody knows since when the value is held
    dropped = int(np.count_nonzero(~changed))
    first = float(t[np.argmin(changed)])
    instants, common, jitter = t[changed], rounding_std(tick), rounding_std(tick)
    after = "the repeats are taken as not sampled"
    if len(instants) >= FEWEST_STAMPS and (clock := uniform_clock(instants)).explains(tick):
        instants, common, jitter = clock.instants, clock.common_std(tick), 0.0
        after += (
            f"; the sensor renews its value at {1.0 / clock.period:.6g} Hz, and the instants of this clock are used"
        )
    text = (
        f"{name}: {dropped} of {len(y)} samples ({dropped / len(y):.0%}) repeat the one before, far more than "
        f"quantisation explains (first at t = {instant(first)} s): the logger is faster than the sensor. "
        f"The first of each run is kept, {after}"
    )
    # A value is written at the first tick after the sensor's own instant: late by half a tick on average.
    return (
        instants - 0.5 * tick,
        y[changed],
        [Finding(HELD, name, dropped, first, text, "warning", tick, common, jitter)],
    )


def equal_by_chance(counts: Sequence[int]) -> float:
    """How often a reading equals the one before where it is so often two lower, one lower, one higher and two higher.

    Noise of about a code piles up about its middle. Of a normal distribution, wherever its middle is, the logarithms of
    these numbers lie on a parabola, which gives the one in between; no less than the mean of both neighbours.
    """
    far_below, below, above, far_above = (count + 0.5 for count in counts)
    near, far = math.sqrt(below * above), math.sqrt(far_below * far_above)
    return max((counts[1] + counts[2]) / 2.0, near * math.cbrt(near / far) - 0.5)


_DISTINCT = 0.9  # share of values that never recur, above which none repeats by chance
_FEWEST_CHANGES = 50  # below that the share of repeats is not significant


def _quantum(step: Array) -> float:
    """Estimate the quantisation from the sizes of the steps: the smallest, but for a hundredth of them; inf if none."""
    moved = step[step > 0]
    return float(np.quantile(moved, 0.01, overwrite_input=True)) if len(moved) else np.inf


def _position_repeats(t: Array, y: Array) -> list[Finding]:
    same = y[1:] == y[:-1]
    count = int(np.count_nonzero(same))
    if count < 0.2 * len(y) or count == len(y) - 1:
        return []
    text = (
        f"position: {count} of {len(y)} readings ({count / len(y):.0%}) equal the one before, as a quantised encoder "
        "does at rest; all are kept"
    )
    return [Finding("position_repeats", "position", count, float(t[1 + np.argmax(same)]), text)]


def reading_step(y: Array, declared: float | None) -> float:
    """Step of a quantised encoder: that of the grid on which all readings lie, or the declared one if that is no finer.

    Parameters
    ----------
    y : readings, (n,) m.
    declared : m.

    Returns
    -------
    m; 0 where neither is known.
    """
    counts = np.diff(y)
    np.abs(counts, out=counts)
    many = np.count_nonzero(counts) >= _FEWEST_CHANGES
    grid = float(np.min(counts, where=counts > 0.0, initial=np.inf))
    counts /= grid
    counts -= np.rint(counts)
    if not math.isfinite(grid) or float(np.max(np.abs(counts, out=counts))) > GRID_TOLERANCE:
        return declared or 0.0
    if declared is None:
        return grid
    # Of few, all may be multiples of a larger step by chance.
    return grid if many and grid > (1.0 + GRID_TOLERANCE) * declared else declared


def _coarse_grid(t: Array, y: Array, declared: float | None) -> list[Finding]:
    step = reading_step(y, declared)
    if declared is None or step == declared:
        return []
    text = (
        f"position: all readings lie on a grid of {units.in_usual_unit(step, 'm', 4)}, coarser than the declared "
        f"resolution of {units.in_usual_unit(declared, 'm', 4)}: the grid is taken as the resolution; declare it, or "
        "export the readings with more digits"
    )
    return [Finding("coarse_grid", "position", len(y), float(t[0]), text, "warning")]


def _clipping(name: str, t: Array, y: Array, full_scale: float | None) -> list[Finding]:
    if full_scale is not None:
        clipped = np.abs(y) >= full_scale * (1.0 - CLIP_MARGIN)
        reason = f"within {CLIP_MARGIN:.1%} of the declared range ±{full_scale:.6g} m/s^2 or beyond"
        if clipped.any():
            return [_clipped(name, t, clipped, reason)]
    findings = []
    for extreme, others in ((y.max(), y[y < y.max()]), (y.min(), y[y > y.min()])):
        at = y == extreme
        count = int(np.count_nonzero(at))
        if count < _FEWEST_PILED or not len(others):
            continue
        neighbour = others.max() if extreme > others[0] else others.min()
        codes = float(np.ptp(y)) / _quantum(np.abs(np.diff(y)))
        if count >= _PILED * np.count_nonzero(others == neighbour) and codes > _FEWEST_CODES:
            findings.append(_clipped(name, t, at, f"piled up at the extreme {extreme:.6g} m/s^2"))
    return findings


_FEWEST_PILED = 5
_MOST_CLIPPED = 0.5
"""Share of the samples beyond which not the motion but a declaration puts them at the limit."""
_PILED = 5  # a sine has at most 2.4 times as many readings at its extreme code as at the next
_FEWEST_CODES = 16  # a record at rest has only a few codes, and its extreme one may well be the commonest


def _clipped(name: str, t: Array, clipped: NDArray[np.bool_], reason: str) -> Finding:
    count, first = int(np.count_nonzero(clipped)), float(t[np.argmax(clipped)])
    end = (
        "the sensor was probably saturated. Every fit, diagnosis and comparison leaves out those at the declared "
        "range; without one, all are kept"
    )
    if count > _MOST_CLIPPED * len(t):
        end = "no sensor works there: correct the declared range, scale or zero, or declare the zero"
    text = f"{name}: {count} of {len(t)} samples are {reason} (first at t = {instant(first)} s): {end}"
    return Finding("saturated", name, count, first, text, "warning")


def _travel(t: Array, y: Array) -> list[Finding]:
    findings = []
    travel = float(np.ptp(y))
    if travel > LONGEST_TRAVEL:
        text = f"position spans {travel:.4g} m, more than {LONGEST_TRAVEL:g} m: check its unit (mm read as m?)"
        findings.append(Finding("implausible_travel", "position", 1, float(t[0]), text, "warning"))
    with np.errstate(over="ignore"):  # two stamps may lie as close as they can
        speed = np.abs(np.diff(y) / np.diff(t))
    fast = speed > HIGHEST_SPEED
    if fast.any():
        i = int(np.argmax(fast))
        text = (
            f"position moves faster than {HIGHEST_SPEED:g} m/s between {np.count_nonzero(fast)} pairs of samples "
            f"(first at t = {instant(t[i])} s): check its unit (mm read as m?) and for jumps"
        )
        findings.append(
            Finding("implausible_speed", "position", int(np.count_nonzero(fast)), float(t[i]), text, "warning")
        )
    return findings


LEAST_WAY = 1e-6
"""Share of the stroke below which what an output could have moved is nothing."""


def require_varying(recording: Recording) -> None:
    """Refuse a recording whose output never changes while its position does: its accelerometer was not read.

    An output within a spread A over a time T stands for a way of A T²/2 at most, beside a constant one.

    Raises
    ------
    RecordingError
        With the reading and what to check.
    """
    accel, position = recording.accel, recording.position
    stroke = float(np.ptp(position.y)) if len(position) else None
    if not len(accel) or stroke == 0.0:
        return
    spread = float(np.ptp(accel.y))
    way = 0.5 * spread * float(accel.t[-1] - accel.t[0]) ** 2
    if spread == 0.0 or (stroke is not None and way < LEAST_WAY * stroke):
        within = f" within {spread:.2g} m/s²" if spread else ""
        raise RecordingError(
            f"{recording.title}: all {len(accel)} samples of {accel.name} read {accel.y[0] + 0.0:.6g} "
            f"m/s²{within}; expected an output that varies with the motion. Check the sensor's supply and wiring, and "
            "which column is accel"
        )


def _constant(name: str, t: Array, y: Array) -> list[Finding]:
    if np.ptp(y) > 0:
        return []
    text = f"{name}: all {len(y)} samples read {y[0]:.6g}; the channel carries no information"
    return [Finding("constant", name, len(y), float(t[0]), text, "warning")]


def _gaps(name: str, t: Array) -> list[Finding]:
    """Find intervals clearly longer than the usual one, allowing for the jitter of the clock."""
    if len(t) < 3:
        return []
    low, usual, high = np.quantile(np.diff(t), (0.25, 0.5, 0.75), overwrite_input=True)
    interval = np.diff(t)
    long = interval > 1.5 * usual + 3.0 * (high - low)
    if not long.any():
        return []
    edges = runs_of(long)
    slow = [
        (a, b)
        for a, b in edges[np.ptp(edges, axis=1) >= STEADY]
        if np.ptp(np.quantile(interval[a:b], (0.05, 0.95))) < usual
    ]
    findings = [
        Finding(
            "other_rate",
            name,
            int(b - a),
            float(t[a]),
            f"{name}: sampled at {1.0 / np.median(interval[a:b]):.4g} Hz from t = {instant(t[a])} s to "
            f"{instant(t[b])} s and at {1.0 / usual:.4g} Hz elsewhere; that part is used as it is",
        )
        for a, b in slow
    ]
    long &= ~within_spans(slow, len(long))
    if not long.any():
        return findings
    interval = np.where(long, interval, 0.0)
    count, i, worst = int(np.count_nonzero(long)), int(np.argmax(long)), int(np.argmax(interval))
    text = (
        f"{name}: {count} gaps longer than {1.5 * usual + 3.0 * (high - low):.3g} s (usual interval {usual:.3g} s), "
        f"the longest {interval[worst]:.4g} s at t = {instant(t[worst])} s; they stay gaps"
    )
    return [*findings, Finding("gap", name, count, float(t[i]), text)]


SCATTERED = 0.02
"""Standard deviation of the intervals over the usual one from which a uniform clock is tried."""
CLEARLY = 1.5
"""By how much the mean square interpolation error must fall on the uniform clock."""


def _unscattered(name: str, t: Array, y: Array) -> tuple[Array, list[Finding]]:
    """Instants of one uniform clock in place of stamps that scatter about it, where the readings fit the clock better:
    a host stamps samples when it comes to them."""
    n = len(t)
    if n < FEWEST_STAMPS or np.std(np.diff(t)) < SCATTERED * (t[-1] - t[0]) / (n - 1):
        return t, []
    clock = steady_clock(t)
    step = float(clock[-1] - clock[0]) / (n - 1)
    if np.max(np.abs(t - clock)) > 3.0 * step:
        return t, []

    def error(at: Array) -> float:
        between = (at[1:-1] - at[:-2]) / np.maximum(at[2:] - at[:-2], CLOSEST)
        return float(np.mean((y[1:-1] - y[:-2] - between * (y[2:] - y[:-2])) ** 2))

    if error(t) < CLEARLY * error(clock):
        return t, []
    text = (
        f"{name}: the stamps scatter by {1e3 * np.std(t - clock):.2g} ms about a clock of {1.0 / step:.6g} Hz, and the "
        "readings fit the clock better: its instants are used; how late the stamps are is part of time_offset"
    )
    return clock, [Finding("scattered_stamps", name, n, float(t[0]), text, "warning")]


def _counted_through(name: str, t: Array, _: Array) -> tuple[Array, list[Finding]]:
    """Instants of the count of samples in place of stamps of a clock that was slewed."""
    stretches, clock, skew = slewed(t)
    if not stretches:
        return t, []
    a, b = stretches[0][0], stretches[-1][1]
    text = (
        f"{name}: the clock of the stamps runs {1e6 * abs(skew):.0f} ppm {'fast' if skew > 0.0 else 'slow'} between "
        f"t = {instant(t[a])} s and {instant(t[b])} s and keeps its rate elsewhere, as one does that a network sets "
        f"right; the samples are counted at {(len(t) - 1) / float(clock[-1] - clock[0]):.7g} Hz in its place"
    )
    return clock, [Finding("slewed_stamps", name, b - a, float(t[a]), text, "warning")]


STEADY = 64
"""Long intervals of one length in a row, least, that are another rate and no gaps."""


def repeated_rows(columns: Sequence[Array]) -> list[tuple[int, int]]:
    """First row and row behind the last of blocks in which a table repeats the rows just before them, in order.

    Parameters
    ----------
    columns : m of (n,) each. A motion that repeats itself exactly, more than once, is no block.
    """
    mark = sum(
        (y * weight for y, weight in zip(columns, np.sqrt(np.arange(2.0, len(columns) + 2.0)), strict=True)), 0.0
    )
    order = np.argsort(mark, kind="stable")
    again = np.diff(np.asarray(mark)[order], append=np.inf) == 0.0
    lags = order[1:][again[:-1]] - order[:-1][again[:-1]]
    blocks = []
    counts = np.bincount(lags, minlength=1)
    for lag in np.flatnonzero(counts >= np.maximum(STEADY // 4, np.arange(len(counts)) // 2)):
        equal = np.all([y[lag:] == y[:-lag] for y in columns], axis=0)
        for a, b in runs_of(equal):
            if STEADY // 4 <= lag <= b - a < 2 * lag and len(np.unique(columns[0][a:b])) > lag // 2:
                blocks.append((int(a + lag), int(a + 2 * lag)))
    return sorted(blocks)


STILL_SPAN = 0.1
"""s; rest is judged on stretches of this length, or of 20 samples if that is longer."""
STILL_STEPS = 4
"""A stretch is at rest when the position stays within this many quantisation steps ..."""
STILL_SHARE = 1e-3
"""... or within this share of the whole travel."""


LEAST_SHARE, LEAST_FACTOR = 0.05, 3.0
"""Share of the spans that is taken to be quiet whatever it is, and how much more than there the output may scatter."""
LEAST_SCATTER = 8
"""Samples of the output in a span below which its scatter tells nothing."""

OF_EXTREMES = (("saturated", "accel"), ("implausible_travel", "position"), ("implausible_speed", "position"))
"""Findings that a few readings make, and their channels."""


def with_extremes_of_rest(recording: Recording) -> Recording:
    """A recording of which stretches were cut, with what is noticed of the extremes of the rest.

    Parameters
    ----------
    recording : with the findings of the whole.
    """
    accel, position = recording.accel, recording.position
    findings = [f for f in recording.findings if (f.kind, f.channel) not in OF_EXTREMES]
    findings += _clipping("accel", accel.t, accel.y, recording.rig.sensor.range)
    findings += _travel(position.t, position.y) if recording.reference is None and len(position) else []
    return replace(recording, findings=tuple(findings))


def describe(recording: Recording) -> dict[str, Any]:
    """Return what was understood of a recording, ready for JSON.

    Returns
    -------
    ``name``, ``digest``; ``channels``: by name ``samples``, ``start_s``, ``end_s``, ``rate_hz`` (gaps left out),
    ``longest_interval_s``, ``unit``, ``min``, ``max``; ``range_used`` (share of the declared full scale, or None);
    ``orientation``: "angle", "attitude", "gravity_along_axis", "gyroscope" or None; ``rest_s``: list of [start, end];
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
    """Record of how the axis turns: "angle", "attitude", "gravity_along_axis" or "gyroscope"; None if none."""
    if recording.rig.arm is not None:
        return "angle"
    words = {"attitude": LEVERS[0], GRAVITY: GRAVITY, "gyroscope": TURNED[0]}
    return next((name for name, channel in words.items() if channel in recording.side), None)


_ORIENTATIONS = {
    "attitude": "recorded; the acceleration along the turning axis is used, gravity included",
    "angle": "by the angle of the arm; the acceleration along the turning axis is used, gravity included",
    GRAVITY: "gravity along the axis is recorded and used",
    "gyroscope": "angles from the gyroscope; every fit estimates gravity along the axis with their drift",
    None: "not recorded; the axis is taken to keep its direction. If the body can turn, declare gravity_along_axis, an "
    "attitude or a gyroscope",
}


UNLISTED = {GRAVITY_NOISE, *LEVELS, *ACROSS, *OF_ARM}
"""Side channels of a body that turns which `describe` alone has: columns of errors of mount and reference."""


def summarise(recording: Recording) -> str:
    """Return `describe` as lines for a human reader; warnings come before notes."""
    summary = describe(recording)
    lines = [summary["name"] or "recording"]
    for name, channel in summary["channels"].items():
        if name in UNLISTED:
            continue
        rate = f"{channel['rate_hz']:.6g} Hz" if channel["rate_hz"] else "no rate"
        span = f"{instant(channel['start_s'])} s to {instant(channel['end_s'])} s"
        lines.append(
            f"  {name}: {channel['samples']} samples, {rate}, {span}, "
            f"{channel['min']:.6g} to {channel['max']:.6g} {channel['unit']}"
        )
    if summary["range_used"] is not None:
        lines.append(f"  range used: {summary['range_used']:.0%} of ±{recording.rig.sensor.range:.6g} m/s^2")
    total = sum(end - start for start, end in summary["rest_s"])
    stretches = ", ".join(f"{instant(start)} s to {instant(end)} s" for start, end in summary["rest_s"][:3])
    more = ", ..." if len(summary["rest_s"]) > 3 else ""
    if recording.dwells is not None:
        lines.append(f"  dwells: {len(recording.dwells)} of {recording.dwells.name}, fitted together with the motion")
    at_rest = f"{instant(total)} s in {len(summary['rest_s'])} stretches ({stretches}{more})" if total else "never"
    lines += [f"  orientation: {_ORIENTATIONS[summary['orientation']]}", f"  at rest: {at_rest}"]
    for severity in ("warning", "note"):
        lines += [f"  {severity}: {finding.text}" for finding in recording.findings if finding.severity == severity]
    return "\n".join(lines + [f"  assumed: {sentence}" for sentence in summary["assumptions"]])


def rest(recording: Recording, *, by_output: bool = True) -> list[tuple[float, float]]:
    """Find the intervals at rest, judged by the encoder, and by the output: what shakes fast hardly moves.

    Parameters
    ----------
    recording : with a position.
    by_output : False where the noise of the output is the question, which a choice by it would answer.

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
    small = reach <= limit
    if recording.rig.arm is not None and LEVERS[0] in recording.side:
        turning = np.hypot(*(recording.side[name].y for name in LEVERS[:2]))
        small &= np.maximum.reduceat(turning, edges) <= STILL_SHARE * float(np.max(turning))
    if by_output:
        small &= _still_output(recording.accel, t[edges])
    last = np.append(edges[1:], len(t)) - 1
    return [(float(t[edges[a]]), float(t[last[b - 1]])) for a, b in runs_of(small) if b - a >= 2]


def _still_output(output: Channel, begins: Array) -> Flags:
    """Whether the output scatters in each span as in the quietest, or hardly at all; so where it was not sampled."""
    first = np.append(np.searchsorted(output.t, begins), len(output))
    counts, y = np.diff(first), output.y - float(np.mean(output.y))
    sums, squares = (np.concatenate([[0.0], np.cumsum(power)]) for power in (y, y**2))
    mean, square = (np.diff(total[first]) / np.maximum(counts, 1) for total in (sums, squares))
    spread = np.sqrt(np.maximum(square - mean**2, 0.0))
    judged = counts >= LEAST_SCATTER
    if not np.any(judged):
        return ~judged
    floor = LEAST_FACTOR * float(np.quantile(spread[judged], LEAST_SHARE))
    floor = max(floor, _quantum(np.abs(np.diff(output.y))), STILL_SHARE * float(np.ptp(output.y)))
    few = 1.0 + np.sqrt(2.0 / np.maximum(counts, 1))  # of few samples the quietest is quiet by chance
    quiet: Flags = ~judged | (spread <= few * floor)
    return quiet


def _edges(t: Array) -> NDArray[np.intp]:
    """Return the index at which each judged span begins; spans without samples do not appear."""
    span = max(STILL_SPAN, 20 * median_step(t))
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
