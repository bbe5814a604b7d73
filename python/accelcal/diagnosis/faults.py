"""Faults of the data: dropouts, glitches, lost samples, steps of position, changes in the middle of a record; and the
recording examined for them, once for all commands."""

from __future__ import annotations

import math
import pickle
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal import _core
from accelcal._support.values import amount_of, listing
from accelcal.data import Array, Channel, Flags, PositionStep, Recording, in_usual_unit, instant
from accelcal.data.orientation import HOLE
from accelcal.diagnosis.left_out import cut_without, left_out_remarks, without, without_wrong_readings
from accelcal.diagnosis.policy import (
    BREAK_BAND_RATIO,
    BREAK_EXPLAINED,
    BREAK_LOG_LIKELIHOOD,
    BREAK_POWER_RATIO,
    DELAY_CHANGE_SIGMA,
    DROPOUT_ALPHA,
    FAULT_ALPHA,
    IMPACT_COINCIDENCE,
    IMPACT_ENCODER_RATIO,
    IMPACT_OUTPUT_RATIO,
    IMPACT_PEAK_RATIO,
    OTHER_SCALE,
    PLAY_LEAST_REVERSALS,
    PLAY_RATIO,
    RAIL_SAMPLES,
    RELATION_EXPLAINED,
    RELATION_LEAST_BLOCKS,
    STEP_LEAST_COUNTS,
    STEP_PULSE_SHARE,
    UNRELATED_EXPLAINED,
    WHOLE_SAMPLE_TOLERANCE,
)
from accelcal.effects.building_blocks import held_sign, play
from accelcal.estimation.drive import DriveIntegrals, drive, run_filter
from accelcal.estimation.readings import spikes
from accelcal.estimation.remarks import Remark, Value, remark
from accelcal.estimation.run import PreparedRun, Source, prepare, prepared
from accelcal.estimation.values import Noise, Values
from accelcal.signals.series import LOCAL, least_change, local_spread, running_median, runs_of_true, widened
from accelcal.signals.signals import CORNER_NOISE

BANDS_PER_DECADE = 4
"""Bands between the slowest that the record resolves and a tenth of the encoder's rate."""
TOGETHER, FORGOTTEN = 1 << 16, 16.0
"""Readings whose columns are there at a time, and the waits of a filter after which its start has left no bit."""
MOST_BLOCKS = 512
"""Blocks of a scan; longer records have longer blocks."""


class RelationColumns:
    """Columns that drive a filter of any band: encoder, output, its first and second difference, a constant.

    Gravity along an axis that turns counts with the encoder and not with the output, whose scale factor is unknown.
    """

    def __init__(self, run: PreparedRun) -> None:
        self.run = run
        self._bands: dict[float, BandRelation] = {}

    @cached_property
    def drives(self) -> list[DriveIntegrals]:
        """Integrals that drive the filter, column by column."""
        run = self.run
        shift = run.accel_step
        late, plain, early = (drive(run, Values({"time_offset": d}), None) for d in (-shift, 0.0, shift))
        restart = late.restart | plain.restart | early.restart
        h: Array = np.diff(plain.t, prepend=plain.t[0])
        h[restart] = 0.0
        duration, zero = (h, h**2 / 2.0), np.zeros(len(h))
        pull = zero, zero
        if run.gravity.channel:
            once, twice = (integral * ~restart for integral in run.gravity_integrals)
            steady = float(np.sum(once)) / max(float(np.sum(h)), 1e-300)  # a constant would hide what moves
            pull = once - steady * h, twice - steady * duration[1]
        slope = early.first - late.first, early.second - late.second
        for before, middle, behind, pulled in (
            (late.first, plain.first, early.first, pull[0]),
            (late.second, plain.second, early.second, pull[1]),
        ):  # in place: the second difference stands where the early one was
            behind += before
            behind -= np.multiply(middle, 2.0, out=before)
            middle += pulled
            middle[restart] = behind[restart] = 0.0
        slope[0][restart] = slope[1][restart] = 0.0
        against = (-pull[0], -pull[1]) if run.gravity.channel else pull
        return [
            DriveIntegrals(plain.t, z, first, second, restart, plain.extra_q)
            for z, (first, second) in (
                (zero, (plain.first, plain.second)),
                (zero, slope),
                (zero, (early.first, early.second)),
                (zero, duration),
                (plain.z - plain.z[0], against),
            )
        ]

    def release(self) -> None:
        """Free them until they are used again: of an hour they are 240 MB."""
        self.__dict__.pop("drives", None)
        self._bands.clear()

    @cached_property
    def steps(self) -> tuple[PositionStep, ...]:
        """Jumps of the position that they show."""
        return tuple(position_steps(self))

    def bands(self, share: float = 0.1, parts: float = 4.0) -> list[float]:
        """Crossovers from a share of the encoder's rate down to the slowest that `parts` of the record resolve, Hz; by
        default those at which changes are sought. None of a record that is too short."""
        run = self.run
        top, lowest = share / run.reading_step, parts * RELATION_LEAST_BLOCKS / float(run.t[-1] - run.t[0])
        count = max(2, math.ceil(BANDS_PER_DECADE * math.log10(top / lowest)) + 1)
        return [float(band) for band in np.geomspace(top, lowest, count)] if lowest < top else []

    def in_band(self, band: float) -> BandRelation:
        """Innovations of each column behind a filter whose crossover is `band`, Hz."""
        if band not in self._bands:
            self._bands[band] = BandRelation(self, band)
        return self._bands[band]

    def noise(self, band: float) -> Noise:
        """Noise whose filter has this crossover."""
        r = self.run.reading_variance_guess
        return Noise((2.0 * np.pi * band) ** 4 * r * self.run.reading_step, r)

    def response(self, band: float, z: NDArray[np.bool_]) -> Array:
        """Innovations caused by readings of this shape, one unit high, from the middle of the shape on; readings are
        even."""
        run = self.run
        before = 20 * len(z)
        reading = np.concatenate([np.zeros(before), z.astype(np.float64)])
        zero, begins = np.zeros_like(reading), np.arange(len(reading)) == 0
        t: Array = np.arange(len(reading), dtype=np.float64) * run.reading_step
        return run_filter(run, DriveIntegrals(t, reading, zero, zero, begins, zero), self.noise(band)).series("e")[
            before + len(z) // 2 :
        ]


class BandRelation:
    """Encoder innovations and the columns that should explain them, in one band: output, its first and second
    difference, constant, encoder, each divided by its root mean square."""

    def __init__(self, source: RelationColumns, band: float) -> None:
        self.source, self.band = source, band
        """Hz"""
        run, noise, drives = source.run, source.noise(band), source.drives
        settled, t = self.settled, self.t
        span = float(t[-1] - t[0]) if len(t) > 1 else 0.0
        number = max(1, int(min(MOST_BLOCKS, span * band)))
        self.edges: Array = np.linspace(t[0], t[-1], number + 1) if len(t) else np.zeros(2)
        """Of blocks of at least one period of the band, (K + 1,) s."""
        driven = [column.arrays[1:4] for column in drives]
        shared, edges, prior = drives[0].arrays, self.edges[:-1], run.prior(noise.r)
        gram = _core.block_products(shared, driven, settled, edges, q=noise.q, r=noise.r, prior=prior)
        size = np.sqrt(np.diag(gram.sum(axis=0))[:5] / max(1, len(t)))
        self.size: Array = np.where(size > 0.0, size, 1.0)
        """(5,) root mean square by which each column was divided, m."""
        scale = np.append(self.size, 1.0)
        self.gram: Array = gram / np.outer(scale, scale)
        """(K, 6, 6) products of the columns over the blocks, the last row and column counting readings."""

    @property
    def settled(self) -> Flags:
        """Readings that enter, (readings,)."""
        return self.source.drives[0].settled(self.source.run.wait(self.source.noise(self.band)))

    @property
    def t(self) -> Array:
        """Times of settled readings, (n,) s."""
        settled = self.settled
        first, last = int(np.argmax(settled)), len(settled) - int(np.argmax(settled[::-1]))
        whole = settled[first:last].all()  # a view takes no memory
        return self.source.run.t[first:last] if whole and settled.any() else self.source.run.t[settled]

    def columns(self, begin: float = -math.inf, end: float = math.inf) -> Iterator[Array]:
        """The columns at settled readings from `begin` to before `end`, s, in pieces (n, 5).

        The filter starts so long before each piece that nothing of the start is left.
        """
        run, noise, settled = self.source.run, self.source.noise(self.band), self.settled
        first, last = (int(k) for k in np.searchsorted(run.t, (begin, end)))
        prior, forgotten = run.prior(noise.r), FORGOTTEN * run.wait(noise)
        for start in range(first, last, TOGETHER):
            rows = slice(start, min(start + TOGETHER, last))
            before = int(np.searchsorted(run.t, run.t[start] - forgotten))
            drives = [column.part(slice(before, rows.stop)).arrays for column in self.source.drives]
            innovations = _core.innovations(drives, q=noise.q, r=noise.r, prior=prior)[:, start - before :]
            yield (innovations[:, settled[rows]] / self.size[:, None]).T

    def residual(self) -> Array:
        """Residual of the encoder's innovations under the best relation, at settled readings, (n,) m."""
        triangle, count = np.empty((0, 5)), 0
        for columns in self.columns():
            triangle = np.asarray(np.linalg.qr(np.concatenate([triangle, columns]), mode="r"))
            count += len(columns)
        rank_at = count * float(np.finfo(np.float64).eps)
        c = np.linalg.lstsq(triangle[:, :4], triangle[:, 4], rcond=rank_at)[0]
        residual, begin = np.empty(count), 0
        for columns in self.columns():
            rows = slice(begin, begin := begin + len(columns))
            residual[rows] = (columns[:, 4] - columns[:, :4] @ c) * self.size[4]
        return residual

    def power(self, gram: Array, c: Array) -> Array:
        """Mean square residual of each block under one relation; empty blocks are skipped."""
        gram = gram[gram[:, 5, 5] > 0]
        X, y, yy = gram[:, :4, :4], gram[:, :4, 4], gram[:, 4, 4]
        total = yy - 2.0 * (y @ c) + np.einsum("kij,i,j->k", X, c, c)
        return np.asarray(np.maximum(total, 0.0) / gram[:, 5, 5])

    def departure(self, c: Array, power: float, interval: tuple[float, float]) -> float:
        """Most likely instant in `interval` from which readings depart from a relation whose residual had this power,
        s."""
        t = self.t
        rows = slice(*np.searchsorted(t, interval))
        columns = np.concatenate([*self.columns(*interval)])
        squares = (columns[:, 4] - columns[:, :4] @ c) ** 2
        behind = np.cumsum(squares[::-1])[::-1]
        count = np.arange(len(squares), 0, -1)
        mean_square = np.maximum(behind / count, power)
        gain = 0.5 * (behind / power - count * (1.0 + np.log(mean_square / power)))
        return float(t[rows][int(np.argmax(gain))])


def _solve(gram: Array) -> Array:
    """Coefficients of the four columns; a small ridge keeps a column without power from deciding."""
    A = gram[..., :4, :4]
    ridge = 1e-9 * np.trace(A, axis1=-2, axis2=-1)[..., None, None] * np.eye(4) + 1e-300 * np.eye(4)
    return np.asarray(np.linalg.solve(A + ridge, gram[..., :4, 4][..., None])[..., 0])


def _misfit(gram: Array, coefficients: Array) -> float:
    """Mean square of what the columns with these coefficients leave of the encoder."""
    weights = np.append(coefficients, -1.0)
    return float(weights @ gram[:5, :5] @ weights / gram[5, 5])


def unexplained(gram: Array) -> tuple[Array, Array]:
    """Sum of squares that the best relation leaves, and the share of the variance that it explains; (K,)."""
    c = _solve(gram)
    left = np.maximum(gram[:, 4, 4] - np.einsum("ki,ki->k", c, gram[:, :4, 4]), 1e-12 * gram[:, 4, 4] + 1e-300)
    constant = gram[:, 3, 4] ** 2 / np.maximum(gram[:, 3, 3], 1e-300)
    moved = np.maximum(gram[:, 4, 4] - constant, 1e-300)
    return left, 1.0 - left / moved


Kind = Literal["dropout", "glitch", "rail_hit", "position_step", "dropped_samples"]
LASTING: tuple[Kind, ...] = ("dropout", "rail_hit")
"""Faults whose size is a length of time."""
LISTED_SINGLY = 2
"""Faults of one kind and channel that have a sentence each; more share one."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A stretch or an instant at which a channel did not measure."""

    kind: Kind
    channel: str
    time: float
    """Its beginning, s."""
    size: float
    """dropout, rail_hit: its length, s; glitch, position_step: m; dropped_samples: whole samples."""
    sentence: str


def faults(recording: Recording, run: PreparedRun, columns: RelationColumns | None = None) -> tuple[Fault, ...]:
    """Faults that no physics of the sensor explains, in order of time.

    Parameters
    ----------
    recording : for its channels as they were read.
    run : the stretch in use; faults outside it are not reported.
    columns : of that run, if available.

    Returns
    -------
    Dropouts, glitches, saturation, position steps (missed counts) and dropped samples; not what was left out.
    """
    listed = [*dropouts(run.accel), *dropouts(recording.reference or recording.position), *glitches(recording, run)]
    left_out = [(gap.channel, begin, end) for gap in recording.left_out for begin, end in gap.stretches]
    listed = [
        fault
        for fault in listed
        if not any(
            fault.channel == name and fault.time <= begin and end <= fault.time + fault.size
            for name, begin, end in left_out
        )
    ]
    listed += rail_hits(run)
    columns = columns or RelationColumns(run)
    steps = (*recording.position_steps, *(() if recording.reference else columns.steps))
    listed += [Fault("position_step", "position", step.time, step.size, step.sentence) for step in steps]
    listed += dropped_samples(columns)
    inside = [f for f in listed if run.t[0] <= f.time <= run.t[-1]]
    return tuple(sorted(inside, key=lambda f: f.time))


def fault_remarks(listed: Sequence[Fault], length: float, name: str) -> tuple[Remark, ...]:
    """One remark for each fault, or one for all of a kind and channel where there are many.

    Parameters
    ----------
    listed : in order of time.
    length : of the record, s.
    name : of the record.
    """
    groups: dict[tuple[Kind, str], list[Fault]] = {}
    for fault in listed:
        groups.setdefault((fault.kind, fault.channel), []).append(fault)
    remarks: list[Remark] = []
    for (kind, channel), members in groups.items():
        together = len(members) > LISTED_SINGLY
        for part in [members] if together else [[fault] for fault in members]:
            longest = max(part, key=lambda fault: abs(fault.size))
            values: dict[str, Value] = {
                "recording": name,
                "channel": channel,
                "count": len(part),
                "longest": longest.size,
                "time": longest.time,
            }
            if kind in LASTING:
                values["share"] = 100.0 * sum(fault.size for fault in part) / length
            remarks.append(remark(kind, **values) if together else Remark(kind, f"{name}: {longest.sentence}", values))
    return tuple(remarks)


def dropouts(channel: Channel) -> list[Fault]:
    """Gaps that are too long for samples lost one by one."""
    intervals = np.diff(channel.t)
    if len(intervals) < 16:
        return []
    step = float(np.median(intervals))
    lost_share = max(0.0, 1.0 - step * len(intervals) / float(channel.t[-1] - channel.t[0]))
    by_chance = math.log(DROPOUT_ALPHA / len(intervals)) / math.log(min(max(lost_share, 1e-12), 0.9))
    longest = step * (1.5 + max(HOLE, by_chance))
    return [
        Fault(
            "dropout",
            channel.name,
            float(channel.t[i]),
            float(intervals[i]),
            f"{channel.name}: no readings for {intervals[i]:.3g} s from t = {instant(channel.t[i])} s on",
        )
        for i in np.flatnonzero(intervals > longest)
    ]


def glitches(recording: Recording, run: PreparedRun) -> list[Fault]:
    """Encoder readings that jump and return; the replay skips them."""
    if run.left_out == 0:
        return []
    t, z = recording.position.t, recording.position.y
    inside = (t >= run.t[0]) & (t <= run.t[-1])
    t, z = t[inside], z[inside]
    skipped = spikes(t, z, recording.accel)
    instants = []
    for a, b in runs_of_true(skipped, 1):
        jumps = z[a : b + 1] - np.interp(t[a : b + 1], run.t, run.z)
        size = float(jumps[np.argmax(np.abs(jumps))])
        how_many = amount_of(b - a + 1, "reading jumps", "readings jump")
        back = "returns" if a == b else "return"
        text = f"position: {how_many} by {in_usual_unit(size, 'm')} at t = {instant(t[a])} s and {back}"
        instants.append(Fault("glitch", "position", float(t[a]), size, text))
    return instants


def rail_hits(run: PreparedRun) -> list[Fault]:
    """Stretches in which the output repeats its extreme: it saturates below the declared range, or none is declared.

    They are told and kept: a move at constant acceleration, seen by a coarse converter, looks the same.
    """
    t, u = run.accel.t, run.accel.y
    quantum = least_change(u)
    hits = []
    for extreme in (float(u.max()), float(u.min())):
        for a, b in runs_of_true(u == extreme, RAIL_SAMPLES):
            jump = max(abs(u[a] - u[max(a - 1, 0)]), abs(u[b] - u[min(b + 1, len(u) - 1)]))
            if jump > 8.0 * quantum:
                begin, size = float(t[a]), float(t[b] - t[a])
                text = (
                    f"accel: the output saturates at {extreme:.4g} m/s² for {size:.2g} s from t = {instant(begin)} s on"
                )
                hits.append(Fault("rail_hit", "accel", begin, size, text))
    return hits


MOST_STEP_SEARCHES = 3
"""Searches for position steps: behind a large one the relation, and with it a smaller one, shows only in the next."""


def with_position_steps(run: PreparedRun) -> tuple[PreparedRun, RelationColumns | None]:
    """The run with the position steps that it shows and without the part whose scale factor is another, and the columns
    of every reading behind which nothing further was found; None where the search ended with a finding.

    The integral of a velocity or an acceleration counts nothing: its errors jump and stay by themselves.
    """
    counted = run.recording.reference is None and not run.recording.position_steps
    for _ in range(MOST_STEP_SEARCHES):
        try:
            columns = RelationColumns(run.complete)
            if (related := without_unrelated_start(columns)) is not None:
                run = run.anew(related)
                continue
            jumps = columns.steps if counted else ()
            rest = None if jumps else without_other_scale(columns)
            if jumps:
                run = run.with_steps(sorted((*run.recording.position_steps, *jumps), key=lambda step: step.time))
            elif rest is None:
                return run, columns
            else:
                run = run.anew(rest)
        except ValueError:
            break
    return run, None


def position_steps(columns: RelationColumns) -> list[PositionStep]:
    """Instants at which the encoder lost or gained counts, or was zeroed: its reading jumps and stays.

    The innovations behind a fast filter respond to a step with a pulse; the pulse is detected against the local spread.
    """
    run = columns.run
    relation = columns.in_band(0.1 / run.reading_step)
    t = relation.t
    if len(t) < 8 * LOCAL:
        return []
    residual = relation.residual()
    step = columns.response(relation.band, np.arange(2 * PULSE) >= PULSE)
    spike = columns.response(relation.band, np.arange(2 * PULSE) == PULSE)
    matched = np.correlate(residual, step, "full")[PULSE - 1 :]
    matched /= np.linalg.norm(step)
    score = local_spread(matched)
    np.divide(np.abs(matched), score, out=score)
    high = np.flatnonzero(score > SURELY_CHANCE)
    if not len(high):
        return []
    single = np.correlate(residual, spike, "full")[PULSE - 1 :] / np.linalg.norm(spike)
    chance = dict(zip(high, 2.0 * len(score) * scipy.special.stdtr(0.7 * LOCAL, -score[high]), strict=True))
    noise = float(np.median(np.abs(residual))) / 0.6745
    behind_gap = np.diff(t, prepend=t[0]) > HOLE * run.reading_step
    read, reach = run.recording.position, PULSE * run.reading_step
    bent = np.abs(np.diff(read.y, 3))  # at a jump 1.5 times its size at least
    jumps: list[PositionStep] = []
    last = -PULSE
    for k in (int(k) for k in high if chance[k] < FAULT_ALPHA and not behind_gap[k]):
        neighbours = slice(max(0, k - PULSE), k + PULSE)
        step_near, spike_near = (np.max(np.abs(y[neighbours])) for y in (matched, single))
        if k - last < PULSE or step_near > abs(matched[k]) or spike_near > 1.05 * abs(matched[k]):
            continue
        around = residual[max(0, k - PULSE) : k + 2 * PULSE]
        if matched[k] ** 2 < STEP_PULSE_SHARE * float(np.sum(around**2) - len(around) * noise**2):
            continue
        size = float(matched[k] / np.linalg.norm(step))
        if abs(size) < STEP_LEAST_COUNTS * run.least_step:
            continue
        begin, end = np.searchsorted(read.t, (t[k] - reach, t[k] + reach))
        if abs(size) > np.max(bent[begin:end], initial=0.0):
            continue
        last = k
        jumps.append(PositionStep(float(t[k]), size, float(chance[k])))
    return without_play(jumps, run, t, matched / np.linalg.norm(step)) if jumps else []


def without_play(jumps: Sequence[PositionStep], run: PreparedRun, t: Array, steps: Array) -> list[PositionStep]:
    """Jumps that are no lost motion: the reading of a head with play steps at every reversal, against the new way.

    Parameters
    ----------
    jumps : in the order of time.
    t, steps : times of the innovations (n,) s, and the step that each shows, m.
    """
    slack = 4.0 * CORNER_NOISE * math.sqrt(run.reading_variance_guess)  # noise crosses half of it either way
    way = held_sign((run.z - play(run.z, slack, float(run.z[0]))) / (0.5 * slack))
    turned = np.flatnonzero(np.diff(way)) + 1
    at = np.searchsorted(t, run.t[turned])
    inside = (at >= PULSE) & (at < len(t) - PULSE)
    at, sign = at[inside], -way[turned][inside]
    if len(at) <= PLAY_LEAST_REVERSALS:
        return [*jumps]
    around = steps[at[:, None] + np.arange(-PULSE, PULSE + 1)] * sign[:, None]
    scatter = float(local_spread(steps)[at].mean()) * math.sqrt(0.5 * math.pi / len(at))

    def is_play(jump: PositionStep) -> bool:
        others = around[np.abs(t[at] - jump.time) > 2.0 * PULSE * run.reading_step]  # both have a pulse
        if not PLAY_LEAST_REVERSALS <= len(others) < len(at):
            return False
        usual = np.median(others, axis=0)
        lag = int(np.argmax(np.abs(usual)))
        largest = float(np.quantile(np.max(np.abs(others), axis=1), 0.9))
        near = int(np.argmin(np.abs(t[at] - jump.time)))
        play_like = abs(usual[lag]) > SURELY_CHANCE * scatter and jump.size * sign[near] * usual[lag] > 0.0
        small = abs(jump.size) <= PLAY_RATIO * largest
        return play_like and small and abs(t[at[near]] - jump.time) <= PULSE * run.reading_step

    return [jump for jump in jumps if not is_play(jump)]


SURELY_CHANCE = 7.0
"""Score that chance reaches somewhere in the shortest record more often than `FAULT_ALPHA`."""
PULSE = 16
"""Readings that a fast filter needs to forget a step."""


def dropped_samples(columns: RelationColumns) -> list[Fault]:
    """An instant at which the delay between the channels jumps for good by whole samples of either clock.

    Parameter change by cumulated scores, variances from the scatter of blocks (Andrews 1993), the largest over all
    instants; two of three bands must agree, and on a whole number of samples.
    """
    run = columns.run
    changes: list[tuple[float, float, float]] = []
    for band in np.geomspace(0.1, 0.005, 3) / run.reading_step:
        relation = columns.in_band(float(band))
        if len(relation.gram) >= 4 * RELATION_LEAST_BLOCKS:
            k, jump, std = _delay_change(relation.gram, relation.size)
            shift = 2.0 * run.accel_step
            changes.append((std * shift, jump * shift, float(relation.edges[k])))
    significant = sorted(change for change in changes if abs(change[1]) > DELAY_CHANGE_SIGMA * change[0])
    if len(significant) < 2:
        return []
    std_s, jump_s, time = significant[0]
    reference = (run.recording.reference or run.recording.position).name
    for channel, step in ((run.accel.name, run.accel_step), (reference, run.reading_step)):
        samples = jump_s / step
        agreed = sum(abs(other - jump_s) < WHOLE_SAMPLE_TOLERANCE * step for _, other, _ in significant)
        if (
            abs(samples) > 0.5
            and abs(samples - round(samples)) < WHOLE_SAMPLE_TOLERANCE
            and std_s < 0.5 * WHOLE_SAMPLE_TOLERANCE * step
            and agreed > 1
        ):
            text = (
                f"{channel}: the delay jumps by {jump_s * 1e3:+.3g} ms at t = {instant(time)} s and stays: "
                f"{amount_of(abs(round(samples)), 'sample was', 'samples were')} lost or duplicated without a trace in "
                "the time stamps"
            )
            return [Fault("dropped_samples", channel, time, float(round(samples)), text)]
    return []


def _delay_change(gram: Array, size: Array) -> tuple[int, float, float]:
    """Instant of the largest change of delay: blocks before it, change in shifts of `RelationColumns`, and its std; no
    change where a delay that grows steadily, as of two clocks, explains more.

    The instant is chosen with the scatter of scores under no change; the variance at that instant is that under the
    change.
    """
    c = _solve(gram.sum(axis=0))
    A = gram[:, :4, :4]
    score = gram[:, :4, 4] - A @ c
    eye = 1e-9 * np.trace(A.sum(axis=0)) * np.eye(4)
    rows = slice(RELATION_LEAST_BLOCKS, len(A) - RELATION_LEAST_BLOCKS)
    A1, s1, V1 = (np.cumsum(x, axis=0)[rows] for x in (A, score, _outer(score)))
    A2, s2, V2 = A.sum(axis=0) - A1, score.sum(axis=0) - s1, _outer(score).sum(axis=0) - V1
    B1, B2 = np.linalg.inv(A1 + eye), np.linalg.inv(A2 + eye)
    before, behind = np.einsum("kij,kj->ki", B1, s1), np.einsum("kij,kj->ki", B2, s2)
    # tau = (c1/c0) of the columns as they were before they were scaled to unit mean square
    to_delay = np.array([-c[1] / c[0], 1.0, 0.0, 0.0]) * size[0] / (size[1] * c[0])
    jump = (behind - before) @ to_delay
    variance = np.einsum("i,kij,j->k", to_delay, B1 @ V1 @ B1 + B2 @ V2 @ B2, to_delay)
    k = int(np.argmax(jump**2 / np.maximum(variance, 1e-300)))
    x = np.arange(len(A)) - np.average(np.arange(len(A)), weights=np.trace(A, axis1=1, axis2=2))
    steady = np.linalg.solve(np.einsum("k,kij->ij", x**2, A) + eye, x @ score) @ (x @ score)
    step = s1[k] @ before[k] + s2[k] @ behind[k]
    split = RELATION_LEAST_BLOCKS + k + 1
    W1 = _outer(score[:split] - A[:split] @ before[k]).sum(axis=0)
    W2 = _outer(score[split:] - A[split:] @ behind[k]).sum(axis=0)
    std = math.sqrt(max(float(to_delay @ (B1[k] @ W1 @ B1[k] + B2[k] @ W2 @ B2[k]) @ to_delay), 1e-300))
    return split, float(jump[k]) if step > steady else 0.0, std


def _outer(x: Array) -> Array:
    """Outer product of each row with itself."""
    return x[:, :, None] * x[:, None, :]


@dataclass(frozen=True, slots=True)
class Usable:
    """The part of a record on which one model can hold."""

    start: float
    """s"""
    end: float
    """s"""
    breaks: tuple[float, ...]
    """Instants from which no relation holds, s; empty when the whole record is usable."""
    columns: RelationColumns
    """Of the whole overlap of the channels."""


def usable(source: Source, columns: RelationColumns | None = None) -> Usable:
    """The part before the first break; the whole overlap of the channels if there is none.

    Parameters
    ----------
    source : with its position steps.
    columns : of every reading of it, if available.

    Raises
    ------
    RecordingError
        If the channels do not overlap.
    """
    run = prepared(source)
    if columns is None or run is not columns.run:
        columns = RelationColumns(run)
    breaks = find_breaks(columns)
    used = run.t[run.t < breaks[0]] if breaks else run.t
    return Usable(float(run.t[0]), float(used[-1]), breaks, columns)


def find_breaks(columns: RelationColumns) -> tuple[float, ...]:
    """First instant from which no linear relation between output and encoder holds, to the end of the record.

    Parameters
    ----------
    columns : of a record; no fit is needed.

    Returns
    -------
    At most one instant, s on the position clock.

    Notes
    -----
    For every split of the record, each side is fitted separately; the log-likelihood of two variances against one
    selects the
    split. It is a break if the part before is explained, the part behind is not explained by any relation of its own,
    and its
    residual is larger by a factor that effects, vibration and a change from rest to motion do not reach. A slow
    departure shows
    in a narrow band first: the earliest instant counts, within a factor 8 of the widest band.
    """
    run = columns.run
    bands = columns.bands()
    if len(bands) == 0:
        return ()
    widest, largest = 0.0, math.inf
    for band in bands:
        if band < widest / BREAK_BAND_RATIO:
            break
        split = _split(columns.in_band(band))
        if split is not None:
            widest, largest = max(widest, band), min(largest, split)
    if widest == 0.0:
        largest = impact(run)
    return (largest,) if math.isfinite(largest) else ()


IMPACT_SAMPLES = 5
"""An impact is shorter than twice this many samples."""


def impact(run: PreparedRun) -> float:
    """Instant of an impact that shows on both channels at once, s; infinite if there is none.

    An impact lasts for several samples of the output, exceeds all other peaks in it, and shifts the encoder within the
    same tenth of a second. It is the only sign of a break where no relation ever held (a barometer as encoder).
    """
    t, u = run.accel.t, run.accel.y
    if len(u) < 4 * LOCAL:
        return math.inf
    excess = running_median(u, IMPACT_SAMPLES, "edge")
    np.abs(np.subtract(u, excess, out=excess), out=excess)
    pair = np.minimum(excess[1:], excess[:-1])
    longest = HOLE * float(np.median(np.diff(t), overwrite_input=True))
    pair[widened(np.diff(t) > longest, IMPACT_SAMPLES)] = 0.0  # over a gap the motion goes on
    hit = int(np.argmax(pair))
    if hit < 4 * LOCAL:
        return math.inf  # too little before it to know what is usual
    beside = np.searchsorted(t[:-1], t[hit] + 2.0 * IMPACT_COINCIDENCE * np.array([-1.0, 1.0]))
    elsewhere = max(np.max(part, initial=0.0) for part in (pair[: beside[0]], pair[beside[1] :]))
    before = slice(max(0, hit - 4 * LOCAL), max(1, hit - IMPACT_SAMPLES))
    spread = float(np.median(excess[before])) / 0.6745
    spread = max(spread, least_change(u))
    if pair[hit] < max(IMPACT_OUTPUT_RATIO * spread, IMPACT_PEAK_RATIO * float(elsewhere)) or pair[hit] == 0.0:
        return math.inf
    second_difference = np.abs(np.diff(run.z, 2))
    begin = int(np.searchsorted(run.t, t[hit] - IMPACT_COINCIDENCE))
    usually = float(np.median(second_difference[max(0, begin - 4 * LOCAL) : max(1, begin)])) + run.least_step
    jumps = run.t[1:-1][second_difference > IMPACT_ENCODER_RATIO * usually]
    disturbed = [*(f.time for f in glitches(run.recording, run)), *(float(time) for time in jumps)]
    near = [time for time in disturbed if abs(time - float(t[hit])) < IMPACT_COINCIDENCE]
    return min([float(t[hit]), *near]) if near else math.inf


@dataclass(frozen=True, slots=True)
class _Splits:
    """One relation before and one behind every edge between two blocks of a band, (K - 1,) each."""

    sums: tuple[Array, Array]
    """Of the products before and behind, (K - 1, 6, 6) each."""
    explained: tuple[Array, Array]
    """Share of the encoder's variance."""
    power: tuple[Array, Array]
    """Mean square residual."""
    gain: Array
    """Log-likelihood over one relation and one variance, nat."""

    @classmethod
    @np.errstate(divide="ignore", invalid="ignore")
    def of(cls, gram: Array) -> _Splits:
        """Of the products over blocks, (K, 6, 6)."""
        forward, k = np.cumsum(gram, axis=0), np.arange(1, len(gram))
        sums = forward[:-1], forward[-1] - forward[:-1]
        (before, held), (behind, then) = map(unexplained, sums)
        power = before / sums[0][:, -1, -1], behind / sums[1][:, -1, -1]
        whole = unexplained(forward[-1:])[0][0] / forward[-1, -1, -1]
        gain = 0.5 * (len(gram) * np.log(whole) - k * np.log(power[0]) - (len(gram) - k) * np.log(power[1]))
        return cls(sums, (held, then), power, gain)

    def best(self, possible: Flags) -> int | None:
        """The edge of those possible that gains most, and enough; `RELATION_LEAST_BLOCKS` lie before it."""
        gain = np.where(possible & np.isfinite(self.gain), self.gain, -np.inf)
        gain[: RELATION_LEAST_BLOCKS - 1] = -np.inf
        best = int(np.argmax(gain))
        return best if gain[best] >= BREAK_LOG_LIKELIHOOD else None


def _split(relation: BandRelation) -> float | None:
    """Instant of the break inside one band, if there is one."""
    gram, edges = relation.gram, relation.edges
    K = len(gram)
    if K < 2 * RELATION_LEAST_BLOCKS:
        return None
    splits = _Splits.of(gram)
    power = splits.power[0]
    lost = (splits.explained[1] < BREAK_EXPLAINED) & (splits.power[1] > BREAK_POWER_RATIO * power)
    best = splits.best(lost & (np.arange(1, K) <= K - 2))
    if best is None or splits.explained[0][best] < RELATION_EXPLAINED:
        return None
    held = _solve(splits.sums[0][best])
    if np.median(relation.power(gram[best + 1 :], held)) < BREAK_POWER_RATIO * power[best]:
        return None
    interval = (edges[max(0, best - 1)], edges[min(K, best + 4)])
    return relation.departure(held, float(power[best]), interval)


def without_unrelated_start(columns: RelationColumns) -> Recording | None:
    """The recording without the output with which it begins, where no relation to the position holds as behind it: the
    logger ran before the stage was homed, or the sensor was mounted; None where one does.

    Parameters
    ----------
    columns : of every reading of it.
    """
    for band in columns.bands():
        relation = columns.in_band(band)
        gram, K = relation.gram[::-1], len(relation.gram)
        if K < 2 * RELATION_LEAST_BLOCKS:
            continue
        splits = _Splits.of(gram)
        lost = (splits.explained[1] < UNRELATED_EXPLAINED) & (splits.power[1] > BREAK_POWER_RATIO * splits.power[0])
        best = splits.best(lost & (splits.explained[0] > RELATION_EXPLAINED) & (np.arange(1, K) >= K // 2))
        if best is None:
            continue
        held = _solve(splits.sums[0][best])
        if np.median(relation.power(gram[best + 1 :], held)) < BREAK_POWER_RATIO * splits.power[0][best]:
            continue
        recording, end = columns.run.recording, relation.edges[K - best - 1 + EDGE_BLOCKS]
        if end < columns.run.t[0] + columns.run.filters.unsettled:  # nor does a relation hold behind a high-pass
            continue
        return without(recording, "accel", recording.accel.t < end, "unrelated", 1.0 / band, 0.0)
    return None


def without_other_scale(columns: RelationColumns) -> Recording | None:
    """The recording without the shorter part of the output, where its scale factor differs from that of the rest by
    more than any effect of a sensor: a range, a gain or a sign was changed, for good or for a while, or one channel by
    another; None where it does not.

    Parameters
    ----------
    columns : of every reading of it.
    """
    for band in columns.bands():
        relation = columns.in_band(band)
        full = relation.gram[:, 5, 5] > 0.0  # in a long gap there is nothing to compare
        gram, begins, K = relation.gram[full], relation.edges[:-1][full], int(np.sum(full))
        if K < 2 * RELATION_LEAST_BLOCKS:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(gram, RELATION_LEAST_BLOCKS, axis=0).sum(axis=-1)
        scales, held = _solve(windows)[:, 0], unexplained(windows)[1] > RELATION_EXPLAINED
        apart = runs_of_true(held & _is_other(scales, float(np.median(scales[held]))) if held.any() else held, 1)
        begin, end, scale = max(apart, key=lambda run: run[1] - run[0], default=(0, 0))[0], 0, 0.0
        for way in (1, -1) if apart else ():  # from its beginning to its end, and back, around the end of the record
            splits = _Splits.of(np.roll(gram, -begin, axis=0)[::way])
            inside, rest = (_solve(part)[:, 0] for part in splits.sums)
            with np.errstate(divide="ignore", invalid="ignore"):
                by_output = [
                    c**2 * part[:, 0, 0] / part[:, 4, 4] for c, part in zip((inside, rest), splits.sums, strict=True)
                ]
            holds = (np.minimum(*splits.explained) > RELATION_EXPLAINED) & (np.minimum(*by_output) > BREAK_EXPLAINED)
            best = splits.best(holds & _is_other(inside, rest) & (np.arange(1, K) <= K - 4))
            if best is None:
                scale = 0.0
                break
            begin, end = begin + way * (best + 1), begin
            scale = float(rest[best] / inside[best])  # the columns make the encoder's reading of the output
        if not scale:
            continue
        if 2 * (end - begin) > K:
            begin, end, scale = end, begin + K, 1.0 / scale
        recording, within = columns.run.recording, np.arange(begin, end) % K
        inside, rest = gram[within].sum(axis=0), np.delete(gram, within, axis=0).sum(axis=0)
        if _misfit(inside, by := _solve(rest)) < MISFIT * _misfit(rest, by):
            continue  # no more than this relation leaves elsewhere: a rest, in which the filter decays
        sixths = np.stack([gram[part].sum(axis=0) for part in np.array_split(within, 6)])
        moved = sixths[sixths[:, 4, 4] > MOVED * np.max(sixths[:, 4, 4])]  # at rest there is no scale
        scales, change = _solve(moved)[:, 0], abs(scale - 1.0) / max(1.0, abs(scale))
        middle = float(np.median(scales))
        if not np.all(np.abs(scales - middle) < ONE_SCALE * change * abs(middle)):
            continue  # a disturbance that is added has no scale of its own
        blocks = widened(np.isin(np.arange(K), within), EDGE_BLOCKS)
        out = blocks[np.clip(np.searchsorted(begins, recording.accel.t, "right") - 1, 0, K - 1)]
        return without(recording, "accel", out, "other_scale", 1.0 / band, scale)
    return None


MISFIT = 3.0
"""Mean square of what the relation of the rest leaves in a part with another scale factor, over that in the rest. A
stop behind a move stays below, where the delay changes along the record."""
ONE_SCALE = 0.25
"""Most by which the scale factors of the sixths of a part differ from their middle, as a share of its difference from
the rest of the record."""
MOVED = 0.1
"""Sum of squares of the motion in a sixth, over the largest of them, from which the sixth is judged."""
EDGE_BLOCKS = 2
"""Blocks beside a part with another scale factor that are left out, too: so well is its edge known."""


@np.errstate(divide="ignore", invalid="ignore")
def _is_other(scale: Array, than: Array | float) -> Flags:
    """Whether the ratio of two scale factors is more than an effect of a sensor makes, or has the other sign."""
    ratio = scale / than
    return np.asarray(~((ratio > 1.0 / OTHER_SCALE) & (ratio < OTHER_SCALE)))


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """The part of a recording on which one model can hold, and the faults in it."""

    start: float
    """s"""
    end: float
    """s"""
    breaks: tuple[float, ...]
    """s"""
    remarks: tuple[Remark, ...]
    """Faults, several of one kind as one."""
    chosen: bool = False
    """Whether the user chose it, for all recordings; else it is that of the first."""


class Examined:
    """A recording without readings that are known to be wrong, prepared once, and what it shows before any fit.

    Parameters
    ----------
    recording : as it was read.
    start, end : s, optional; a part that the user chose, which is taken as it is.
    before : the same without a part, where that has been examined.
    """

    def __init__(
        self,
        recording: Recording,
        start: float | None = None,
        end: float | None = None,
        before: Examined | None = None,
    ) -> None:
        self.chosen, self.asked, self.before = start is not None or end is not None, (start, end), before
        whole = before.whole if before else as_prepared(recording)
        clean = recording if before else without_wrong_readings(whole)
        self.whole: Source = whole if clean is recording else as_prepared(clean)
        """Every reading; the recording where only a part of it can be used."""

    @cached_property
    def run(self) -> PreparedRun:
        """The part that is used.

        Raises
        ------
        RecordingError
            If it cannot be.
        """
        return prepared(self.whole, start=self.asked[0], end=self.asked[1])

    @cached_property
    def stepped(self) -> tuple[Source, RelationColumns | None]:
        """The whole with the jumps of its position, and the columns of every reading, if available."""
        if self.before:
            return self.before.stepped
        return with_position_steps(self.whole) if isinstance(self.whole, PreparedRun) else (self.whole, None)

    @cached_property
    def source(self) -> PreparedRun:
        """Run that a model is fitted to: the part that is used or more, with the jumps of the position."""
        stepped = self.stepped[0]
        return self.run if stepped is self.whole or not isinstance(stepped, PreparedRun) else stepped

    @cached_property
    def usable(self) -> Usable:
        """The part before the first break."""
        return usable(self.source, self.stepped[1])

    @property
    def breaks(self) -> tuple[float, ...]:
        """Instants from which no relation holds, s; none is sought in a part that the user chose."""
        return () if self.chosen else self.usable.breaks

    @property
    def span(self) -> tuple[float | None, float | None]:
        """Start and end of what is used, s: as chosen, or up to a break; None where nothing breaks."""
        return (self.usable.start, self.usable.end) if self.breaks else self.asked

    @cached_property
    def part(self) -> PreparedRun:
        """Run that is used, up to a break."""
        start, end = self.span
        if not self.breaks or start is None or end is None:
            return self.source
        recording = self.source.recording
        return prepare(replace(recording.part(start, end), digest=recording.digest))

    def _release(self) -> None:
        """Free the columns of the relation, which nothing needs once breaks and faults are known."""
        for columns in (self.stepped[1], None if self.chosen else self.usable.columns):
            if columns is not None:
                columns.release()

    @cached_property
    def judged(self) -> PreparedRun:
        """The part on which one model can hold."""
        return prepared(self.source, start=self.span[0], end=self.span[1])

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """Faults in that part."""
        columns = None if self.chosen or self.breaks else self.usable.columns
        listed = faults(self.source.recording, self.judged, columns)
        self._release()
        return listed

    def remarks(self, place: str = "") -> list[Remark]:
        """Remarks on its break, on readings left out and on other faults; `place` stands before its name."""
        run, recording = self.judged, self.source.recording
        name = f"{place}{recording.title}"
        end = float(recording.accel.t[-1])
        broken = [
            remark("break", recording=name, time=at, cut=cut_without(recording, [(at, end)])) for at in self.breaks
        ]
        left_out = left_out_remarks([recording], place, *self.span)
        return [*broken, *left_out, *fault_remarks(self.faults, float(run.t[-1] - run.t[0]), name)]

    @cached_property
    def stretch(self) -> TimeSpan:
        """Begin and end of that part, and the faults in it."""
        t = self.judged.t
        return TimeSpan(float(t[0]), float(t[-1]), self.breaks, tuple(self.remarks()), self.chosen)


MOST_SAMPLES, MOST_RECORDINGS = 1 << 20, 4
"""Samples of all channels of a recording up to which what was learnt of it stays, and number of those."""
_examined: OrderedDict[bytes, Examined] = OrderedDict()
"""By the content of the recording; the last one that was asked for is at the end."""


def examine(recording: Recording, start: float | None = None, end: float | None = None) -> Examined:
    """A recording as examined by this process before, where it is one of the last that are short enough."""
    channels = recording.accel, recording.position, *recording.side.values()
    if sum(map(len, channels)) > MOST_SAMPLES:
        return Examined(recording, start, end)
    try:
        content = pickle.dumps(recording, pickle.HIGHEST_PROTOCOL)
    except (TypeError, AttributeError, pickle.PicklingError):  # a mapping of the user's own, or a channel
        return Examined(recording, start, end)
    digest = blake2b(content).digest()
    # A copy stays: the arrays of the caller may change.
    whole = _examined[digest] = _examined.pop(digest) if digest in _examined else Examined(pickle.loads(content))
    while len(_examined) > MOST_RECORDINGS:
        _examined.popitem(last=False)
    return whole if start is None and end is None else Examined(recording, start, end, whole)


def as_prepared(recording: Recording) -> Source:
    """The recording prepared; itself where it cannot be used as a whole: the fit says why."""
    try:
        return prepare(recording)
    except ValueError:
        return recording


__dir__ = listing(globals())
