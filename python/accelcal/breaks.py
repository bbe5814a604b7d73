"""When a record stops obeying any model: faults of the channels, and the instant after which no relation holds.

Everything here runs before a fit and asks little: inside a band B, what the encoder says of the acceleration is a
linear combination of output, its first two derivatives and a constant, p'' = c1 u + c2 u' + c3 u'' + c0. Gain, bias,
delay and low-pass are all inside; an effect worth naming leaves a few percent outside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal import _core
from accelcal.recording import Array, Channel, Recording
from accelcal.replay import HOLE, Drive, Noise, Run, Values

Kind = Literal["dropout", "glitch", "rail_hit", "stuck", "position_step", "dropped_samples"]


@dataclass(frozen=True, slots=True)
class Fault:
    """A stretch or an instant at which a channel did not measure."""

    kind: Kind
    channel: str
    time: float
    """Where it begins, s."""
    size: float
    """dropout, rail_hit, stuck: its length, s; glitch, position_step: m; dropped_samples: whole samples."""
    sentence: str


@dataclass(frozen=True, slots=True)
class Usable:
    """The stretch of a record on which one model can hold."""

    start: float
    """s"""
    end: float
    """s"""
    breaks: tuple[float, ...]
    """Instants from which on no relation holds, s; empty when the whole record is good."""
    columns: Columns
    """Of the whole overlap of the channels."""


def usable(recording: Recording) -> Usable:
    """The stretch before the first break; the whole overlap of the channels when there is none.

    Raises
    ------
    RecordingError
        If the channels do not overlap.
    """
    run = Run(recording)
    columns = Columns(run)
    breaks = find_breaks(columns)
    start, end = float(run.t[0]), float(run.t[-1])
    if breaks:
        before = run.t[run.t < breaks[0]]
        end = float(before[-1])
    return Usable(start, end, breaks, columns)


# ---- breaks ------------------------------------------------------------------------------------------------------

BANDS_BELOW = 8.0
"""How far below the widest band that shows a break its beginning is sought."""
BANDS_PER_DECADE = 4
"""Bands tried between the slowest that the record can show and a tenth of the encoder's rate."""
MOST_BLOCKS = 512
"""Blocks of a scan; longer records take longer blocks."""
LEAST_BLOCKS = 12
"""Fewer blocks before a break than this do not establish a relation."""
EXPLAINED = 0.95
"""Share of the encoder's own power that a relation must explain where it is said to hold ..."""
UNEXPLAINED = 0.80
"""... and that the best relation of its own may explain at most after a break."""
LOUDER = 9.0
"""Residual power after a break over the one before: under its own relation, and in the median block under the old."""
EVIDENCE = 30.0
"""Log-likelihood that a break must gain, search included."""


def find_breaks(columns: Columns) -> tuple[float, ...]:
    """First instant from which on no linear relation between output and encoder holds, to the end of the record.

    Parameters
    ----------
    columns : of a record; nothing need be fitted.

    Returns
    -------
    At most one instant, s on the position clock.

    Notes
    -----
    For every split of the record, each side is fitted on its own; log-likelihood of two variances against one picks
    the split. It is a break when the side before is explained, the side behind is not explained by any relation of its
    own, and its residual is louder by a factor that effects, vibration and a change from rest to motion do not reach.
    A slow departure shows in a narrow band first: the earliest instant counts, within a factor 8 of the widest band.
    """
    run = columns.run
    top = 0.1 / run.reading_step
    lowest = 4.0 * LEAST_BLOCKS / float(run.t[-1] - run.t[0])
    if lowest >= top:
        return ()
    count = max(2, math.ceil(BANDS_PER_DECADE * math.log10(top / lowest)) + 1)
    widest, found = 0.0, math.inf
    for band in np.geomspace(top, lowest, count):
        if band < widest / BANDS_BELOW:
            break
        split = _split(columns.inside(float(band)))
        if split is not None:
            widest, found = max(widest, float(band)), min(found, split)
    if widest == 0.0:
        found = shock(run)
    return (found,) if math.isfinite(found) else ()


TOGETHER = 0.1
"""Time within which both channels must be hit by a shock, s."""
SHOCK = 50.0
"""A shock stands above the local spread of the output by this factor ..."""
THROWN = 20.0
"""The encoder is thrown off when its second difference surpasses the usual one by this factor."""
SHOCK_SAMPLES = 5
"""It is shorter than twice this many samples."""
UNHEARD = 3.0
"""... and above anything else in the record by this one; vibration has many peaks of one height."""


def shock(run: Run) -> float:
    """Instant of a blow that hits both channels at once, s; infinite when there is none.

    A blow lasts for several samples of the output, surpasses all else in it, and throws the encoder off in the same
    tenth of a second. This is what is left to see where no relation ever held (a barometer as encoder).
    """
    t, u = run.accel.t, run.accel.y
    if len(u) < 4 * LOCAL:
        return math.inf
    usual = scipy.ndimage.median_filter(u, 2 * SHOCK_SAMPLES + 1, mode="nearest")
    excess = np.abs(u - usual)
    pair = np.minimum(excess[1:], excess[:-1])
    hit = int(np.argmax(pair))
    if hit < 4 * LOCAL:
        return math.inf  # too little before it to know what is usual
    elsewhere = pair[np.abs(t[:-1] - t[hit]) > 2.0 * TOGETHER]
    before = slice(max(0, hit - 4 * LOCAL), max(1, hit - SHOCK_SAMPLES))
    spread = float(np.median(excess[before])) / 0.6745
    steps = np.abs(np.diff(u))
    spread = max(spread, float(np.min(steps[steps > 0.0], initial=math.inf)))
    if pair[hit] < max(SHOCK * spread, UNHEARD * float(np.max(elsewhere, initial=0.0))) or pair[hit] == 0.0:
        return math.inf
    bent = np.abs(np.diff(run.z, 2))
    begin = int(np.searchsorted(run.t, t[hit] - TOGETHER))
    usually = float(np.median(bent[max(0, begin - 4 * LOCAL) : max(1, begin)])) + run.least_step
    jumps = run.t[1:-1][bent > THROWN * usually]
    thrown = [*(f.time for f in glitches(run.recording, run)), *(float(time) for time in jumps)]
    near = [time for time in thrown if abs(time - float(t[hit])) < TOGETHER]
    return min([float(t[hit]), *near]) if near else math.inf


def _split(relation: Relation) -> float | None:
    """Time of the break inside one band, if there is one."""
    gram, edges = relation.blocks(MOST_BLOCKS)
    K = len(gram)
    if K < 2 * LEAST_BLOCKS:
        return None
    forward = np.cumsum(gram, axis=0)
    backward = forward[-1] - forward
    before, behind = _unexplained(forward[:-1]), _unexplained(backward[:-1])
    n1, n2 = forward[:-1, -1, -1], backward[:-1, -1, -1]
    k = np.arange(1, K)
    with np.errstate(divide="ignore", invalid="ignore"):
        power1, power2 = before[0] / n1, behind[0] / n2
        whole = _unexplained(forward[-1:])[0][0] / forward[-1, -1, -1]
        gain = 0.5 * (K * np.log(whole) - k * np.log(power1) - (K - k) * np.log(power2))
        lost = (behind[1] < UNEXPLAINED) & (power2 > LOUDER * power1)
    possible = lost & (k >= LEAST_BLOCKS) & (K - k >= 2) & np.isfinite(gain)
    if not possible.any():
        return None
    best = int(np.argmax(np.where(possible, gain, -np.inf)))
    if gain[best] < EVIDENCE or before[1][best] < EXPLAINED:
        return None
    held = _solve(forward[best])
    if np.median(relation.power(gram[best + 1 :], held)) < LOUDER * power1[best]:
        return None
    near = (edges[max(0, best - 1)], edges[min(K, best + 4)])
    return relation.departure(held, float(power1[best]), near)


class Columns:
    """What a filter of any band is driven with: encoder, output, the output a little late and early, a constant."""

    def __init__(self, run: Run) -> None:
        self.run = run
        shift = run.accel_step
        late, plain, early = (run.drive(Values({"time_offset": d}), None) for d in (-shift, 0.0, shift))
        gone = late.restart | plain.restart | early.restart
        h: Array = np.where(gone, 0.0, np.diff(plain.t, prepend=plain.t[0]))
        zero = np.zeros_like(h)
        integrals = [
            (plain.first, plain.second),
            (early.first - late.first, early.second - late.second),
            (early.first + late.first - 2.0 * plain.first, early.second + late.second - 2.0 * plain.second),
            (h, h**2 / 2.0),
        ]
        moving = ~gone
        self.drives = [Drive(plain.t, zero, first * moving, second * moving, gone) for first, second in integrals]
        self.drives.append(Drive(plain.t, np.ascontiguousarray(plain.z - plain.z[0]), zero, zero, gone))

    def inside(self, band: float) -> Relation:
        """Innovations of each column behind a filter whose crossover is `band`, Hz."""
        run = self.run
        r = run.reading_variance_guess
        noise = Noise((2.0 * np.pi * band) ** 4 * r * run.reading_step, r)
        settled = self.drives[0].settled(run.wait(noise))
        drives = [drive.arrays for drive in self.drives]
        innovations = _core.innovations(drives, q=noise.q, r=noise.r, prior=run.prior(noise.r))
        rows = innovations[:, settled]
        size = np.sqrt(np.einsum("ik,ik->i", rows, rows) / rows.shape[1])
        size = np.where(size > 0.0, size, 1.0)
        rows /= size[:, None]
        return Relation(run.t[settled], rows.T, size, band)

    def response(self, band: float, z: NDArray[np.bool_]) -> Array:
        """Innovations that a reading of this shape, one unit high, causes from its middle on; readings are even."""
        run = self.run
        r = run.reading_variance_guess
        noise = Noise((2.0 * np.pi * band) ** 4 * r * run.reading_step, r)
        before = 20 * len(z)
        reading = np.concatenate([np.zeros(before), z.astype(np.float64)])
        zero = np.zeros_like(reading)
        begins = zero > 0.0
        begins[0] = True
        t: Array = np.arange(len(reading), dtype=np.float64) * run.reading_step
        drive = Drive(t, reading, zero, zero, begins)
        return run.track(drive, noise).series("e")[before + len(z) // 2 :]


@dataclass(frozen=True, slots=True)
class Relation:
    """Encoder innovations and the columns that should explain them, in one band."""

    t: Array
    """Times of settled readings, (n,) s."""
    columns: Array
    """(n, 5): output, its first and second difference, constant, encoder; each of unit mean square, in one piece."""
    size: Array
    """(5,) what each column was divided by, m."""
    band: float
    """Hz"""

    def blocks(self, most: int) -> tuple[Array, Array]:
        """Sums of products over blocks of at least one period of the band, and their edges.

        Returns
        -------
        (K, 6, 6) products of the columns, the last row and column counting readings; (K + 1,) s.
        """
        span = float(self.t[-1] - self.t[0]) if len(self.t) > 1 else 0.0
        K = int(min(most, span * self.band))
        if K < 1:
            return np.zeros((0, 6, 6)), np.zeros(1)
        edges = np.linspace(self.t[0], self.t[-1], K + 1)
        begin = np.searchsorted(self.t, edges[:-1])
        X = self.columns
        gram = np.zeros((K, 6, 6))
        filled = np.diff(begin, append=len(self.t)) > 0
        for i in range(5):
            for j in range(i + 1):
                sums = np.add.reduceat(X[:, i] * X[:, j], begin[filled])
                gram[filled, i, j] = gram[filled, j, i] = sums
        gram[:, 5, 5] = np.diff(begin, append=len(self.t))
        return gram, edges

    def power(self, gram: Array, c: Array) -> Array:
        """Mean square residual of each block under one relation; empty blocks are left out."""
        gram = gram[gram[:, 5, 5] > 0]
        X, y, yy = gram[:, :4, :4], gram[:, :4, 4], gram[:, 4, 4]
        total = yy - 2.0 * (y @ c) + np.einsum("kij,i,j->k", X, c, c)
        return np.asarray(np.maximum(total, 0.0) / gram[:, 5, 5])

    def departure(self, c: Array, power: float, near: tuple[float, float]) -> float:
        """Most likely instant in `near` from which readings leave a relation whose residual had this power, s."""
        rows = slice(*np.searchsorted(self.t, near))
        squares = (self.columns[rows, 4] - self.columns[rows, :4] @ c) ** 2
        behind = np.cumsum(squares[::-1])[::-1]
        count = np.arange(len(squares), 0, -1)
        loud = np.maximum(behind / count, power)
        gain = 0.5 * (behind / power - count * (1.0 + np.log(loud / power)))
        return float(self.t[rows][int(np.argmax(gain))])


def _solve(gram: Array) -> Array:
    """Coefficients of the four columns; a whisper of ridge keeps a silent column from deciding."""
    A = gram[..., :4, :4]
    ridge = 1e-9 * np.trace(A, axis1=-2, axis2=-1)[..., None, None] * np.eye(4) + 1e-300 * np.eye(4)
    return np.asarray(np.linalg.solve(A + ridge, gram[..., :4, 4][..., None])[..., 0])


def _unexplained(gram: Array) -> tuple[Array, Array]:
    """Sum of squares that the best relation leaves, and the share it explains of what a constant leaves; (K,)."""
    c = _solve(gram)
    left = np.maximum(gram[:, 4, 4] - np.einsum("ki,ki->k", c, gram[:, :4, 4]), 1e-12 * gram[:, 4, 4] + 1e-300)
    constant = gram[:, 3, 4] ** 2 / np.maximum(gram[:, 3, 3], 1e-300)
    moved = np.maximum(gram[:, 4, 4] - constant, 1e-300)
    return left, 1.0 - left / moved


# ---- faults ------------------------------------------------------------------------------------------------------

LONG_GAP = 1e-6
"""A gap is a fault when losing so many samples in a row by chance is less likely than this in the whole record."""
RAIL_RUN = 4
"""So many equal readings in a row at the extreme of the record, after a jump to it, are a rail."""
AT_LIMIT = 1e-3
"""Share of the declared range within which a reading lies at its limit; readings beyond say the range is another."""
STUCK_RUN = 32
"""Fewer equal readings in a row than this are quantisation."""
SURE = 1e-6
"""Family-wise false-alarm rate of steps and dropped samples."""
CHANGE = 6.5
"""Standard deviations by which the delay must change at some instant, the search over instants included."""
WHOLE = 0.15
"""Share of a sample by which a jump may miss a whole number, and two bands each other."""
LOCAL = 64
"""Readings over which a local spread is taken."""


def faults(recording: Recording, run: Run, columns: Columns | None = None) -> tuple[Fault, ...]:
    """What a channel did that no physics of the sensor explains, in order of time.

    Parameters
    ----------
    recording : for its channels as they were read.
    run : the stretch in use; faults outside of it are not reported.
    columns : of that run, where they are at hand.

    Returns
    -------
    Dropouts, glitches, rail hits, stuck stretches, position steps (missed counts) and dropped samples.
    """
    found = [*dropouts(run.accel), *dropouts(recording.position), *glitches(recording, run)]
    found += [*rail_hits(run), *stuck(run)]
    columns = columns or Columns(run)
    found += [*position_steps(columns), *dropped_samples(columns)]
    inside = [f for f in found if run.t[0] <= f.time <= run.t[-1]]
    return tuple(sorted(inside, key=lambda f: f.time))


def dropouts(channel: Channel) -> list[Fault]:
    """Gaps that are too long for samples lost one by one."""
    intervals = np.diff(channel.t)
    if len(intervals) < 16:
        return []
    step = float(np.median(intervals))
    lost = max(0.0, 1.0 - step * len(intervals) / float(channel.t[-1] - channel.t[0]))
    by_chance = math.log(LONG_GAP / len(intervals)) / math.log(min(max(lost, 1e-12), 0.9))
    longest = step * (1.5 + max(HOLE, by_chance))
    return [
        Fault(
            "dropout",
            channel.name,
            float(channel.t[i]),
            float(intervals[i]),
            f"{channel.name}: nothing was read for {intervals[i]:.3g} s from t = {channel.t[i]:.6g} s on",
        )
        for i in np.flatnonzero(intervals > longest)
    ]


def glitches(recording: Recording, run: Run) -> list[Fault]:
    """Encoder readings that jump away and come back; the replay leaves them out."""
    if run.left_out == 0:
        return []
    t, z = recording.position.t, recording.position.y
    inside = (t >= run.t[0]) & (t <= run.t[-1])
    t, z = t[inside], z[inside]
    gone = ~np.isin(t, run.t)
    begins = np.flatnonzero(gone & ~np.concatenate([[False], gone[:-1]]))
    ends = np.flatnonzero(gone & ~np.concatenate([gone[1:], [False]]))
    found = []
    for a, b in zip(begins, ends, strict=True):
        jumps = z[a : b + 1] - np.interp(t[a : b + 1], run.t, run.z)
        size = float(jumps[np.argmax(np.abs(jumps))])
        text = f"position: {b - a + 1} readings jump away by {size:.3g} m at t = {t[a]:.6g} s and come back"
        found.append(Fault("glitch", "position", float(t[a]), size, text))
    return found


def rail_hits(run: Run) -> list[Fault]:
    """Stretches in which the output lies at the limit of its range."""
    t, u = run.accel.t, run.accel.y
    declared = run.rig.sensor.range
    steps = np.abs(np.diff(u))
    quantum = float(np.min(steps[steps > 0.0], initial=math.inf))
    found = []
    for extreme in (float(u.max()), float(u.min())):
        limit = declared is not None and abs(abs(extreme) / declared - 1.0) < AT_LIMIT
        at = np.abs(u - extreme) <= AT_LIMIT * abs(extreme) if limit else u == extreme
        for a, b in _runs(at, 2 if limit else RAIL_RUN):
            jump = max(abs(u[a] - u[max(a - 1, 0)]), abs(u[b] - u[min(b + 1, len(u) - 1)]))
            if limit or jump > 8.0 * quantum:
                begin, size = float(t[a]), float(t[b] - t[a])
                text = (
                    f"accel: the output lies at its limit, {extreme:.4g} m/s², for {size:.2g} s from {begin:.6g} s on"
                )
                found.append(Fault("rail_hit", "accel", begin, size, text))
    return found


def stuck(run: Run) -> list[Fault]:
    """Stretches in which one channel repeats a value while the other shows that it should move."""
    found = []
    wobble = math.sqrt(run.reading_variance_guess) + run.least_step
    for a, b in _runs(np.diff(run.accel.y) == 0.0, STUCK_RUN):
        begin, end = run.accel.t[a], run.accel.t[b + 1]
        rows = slice(*np.searchsorted(run.t, [begin, end]))
        if rows.stop - rows.start >= 8 and _bent(run.t[rows], run.z[rows], 2) > 10.0 * wobble:
            text = (
                f"accel: the output repeats {run.accel.y[a]:.6g} m/s² while the stage moves, from t = {begin:.6g} s on"
            )
            found.append(Fault("stuck", "accel", float(begin), float(end - begin), text))
    for a, b in _runs(np.diff(run.z) == 0.0, STUCK_RUN):
        begin, end = run.t[a], run.t[b + 1]
        rows = slice(*np.searchsorted(run.accel.t, [begin, end]))
        u, step = run.accel.y[rows], run.accel_step
        if len(u) < 8:
            continue
        path = np.cumsum(np.cumsum(u - np.mean(u))) * step**2
        walk = float(np.median(np.abs(np.diff(u)))) * step**2 * len(u) ** 1.5
        if _bent(run.accel.t[rows], path, 1) > 20.0 * wobble + 5.0 * walk:
            text = f"position: the reading stays {run.z[a]:.6g} m while the output changes, from t = {begin:.6g} s on"
            found.append(Fault("stuck", "position", float(begin), float(end - begin), text))
    return found


def _bent(t: Array, y: Array, degree: int) -> float:
    """How far a stretch departs from a straight line (1) or from constant acceleration (2), peak to peak."""
    x = t - t[0]
    return float(np.ptp(y - np.polynomial.Polynomial.fit(x, y, degree)(x)))


def _runs(flags: NDArray[np.bool_], least: int) -> list[tuple[int, int]]:
    """First and last index of each run of true flags that is at least so long."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= least]


def position_steps(columns: Columns) -> list[Fault]:
    """Instants at which the encoder lost or gained counts: its reading jumps and stays.

    The innovations behind a fast filter answer a step by a pulse; the pulse is sought against the local spread.
    """
    run = columns.run
    relation = columns.inside(0.1 / run.reading_step)
    if len(relation.t) < 8 * LOCAL:
        return []
    X, y = relation.columns[:, :4], relation.columns[:, 4] * relation.size[4]
    residual = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
    step = columns.response(relation.band, np.arange(2 * PULSE) >= PULSE)
    spike = columns.response(relation.band, np.arange(2 * PULSE) == PULSE)
    matched = np.correlate(residual, step, "full")[PULSE - 1 :] / np.linalg.norm(step)
    single = np.correlate(residual, spike, "full")[PULSE - 1 :] / np.linalg.norm(spike)
    score = np.abs(matched) / local_spread(matched)
    limit = -float(scipy.special.stdtrit(0.7 * LOCAL, 0.5 * SURE / len(score)))
    quiet = float(np.median(np.abs(residual))) / 0.6745
    behind_gap = np.diff(relation.t, prepend=relation.t[0]) > HOLE * run.reading_step
    found, last = [], -PULSE
    for k in (int(k) for k in np.flatnonzero((score > limit) & ~behind_gap)):
        near = slice(max(0, k - PULSE), k + PULSE)
        if k - last < PULSE or np.max(np.abs(matched[near])) > abs(matched[k]):
            continue
        if np.max(np.abs(single[near])) > 1.05 * abs(matched[k]):
            continue
        around = residual[max(0, k - PULSE) : k + 2 * PULSE]
        if matched[k] ** 2 < PULSE_SHARE * float(np.sum(around**2) - len(around) * quiet**2):
            continue
        size = float(matched[k] / np.linalg.norm(step))
        if abs(size) < COUNTS * run.least_step:
            continue
        last = k
        time = float(relation.t[k])
        text = f"position: the reading jumps by {size * 1e6:+.3g} um at t = {time:.6g} s and stays: missed counts"
        found.append(Fault("position_step", "position", time, size, text))
    return found


PULSE_SHARE = 0.6
"""Share of what is loud around a step that the pulse explains; a misfit of the model is wider than a pulse."""
COUNTS = 3.0
"""A smaller jump, in steps of the encoder, is its quantisation."""
PULSE = 16
"""Readings that a fast filter needs to forget a step."""


def local_spread(y: Array) -> Array:
    """Robust standard deviation about each sample, (n,): the largest of its block and both neighbours, and no less
    than that of the whole."""
    whole = float(np.median(np.abs(y))) / 0.6745
    K = len(y) // LOCAL
    if K < 3:
        return np.full(len(y), max(whole, 1e-300))
    each = np.median(np.abs(y[: K * LOCAL].reshape(K, LOCAL)), axis=1) / 0.6745
    each = np.maximum(np.maximum(each, np.append(each[1:], 0.0)), np.append(0.0, each[:-1]))
    index = np.minimum(np.arange(len(y)) // LOCAL, K - 1)
    return np.asarray(np.maximum(each, max(whole, 1e-300))[index])


def dropped_samples(columns: Columns) -> list[Fault]:
    """An instant at which the delay between the channels jumps for good by a whole sample of either clock.

    Parameter change by cumulated scores, variances from the scatter of blocks (Andrews 1993), the largest over all
    instants; two of three bands must agree, and on a whole number of samples.
    """
    run = columns.run
    seen: list[tuple[float, float, float]] = []
    for band in np.geomspace(0.1, 0.005, 3) / run.reading_step:
        relation = columns.inside(float(band))
        gram, edges = relation.blocks(MOST_BLOCKS)
        if len(gram) >= 4 * LEAST_BLOCKS:
            k, jump, std = _delay_change(gram, relation.size)
            shift = 2.0 * run.accel_step
            seen.append((std * shift, jump * shift, float(edges[k])))
    sure = sorted(one for one in seen if abs(one[1]) > CHANGE * one[0])
    if len(sure) < 2:
        return []
    std_s, jump_s, time = sure[0]
    for channel, step in ((run.accel.name, run.accel_step), ("position", run.reading_step)):
        samples = jump_s / step
        agreed = sum(abs(other - jump_s) < WHOLE * step for _, other, _ in sure)
        if abs(samples) > 0.5 and abs(samples - round(samples)) < WHOLE and std_s < 0.5 * WHOLE * step and agreed > 1:
            text = (
                f"{channel}: the delay jumps by {jump_s * 1e3:+.3g} ms at t = {time:.6g} s and stays: "
                f"{abs(round(samples))} samples were lost or doubled without a trace in the stamps"
            )
            return [Fault("dropped_samples", channel, time, float(round(samples)), text)]
    return []


def _delay_change(gram: Array, size: Array) -> tuple[int, float, float]:
    """Where the delay changes most: blocks before, delay behind minus delay before in shifts of `Columns`, and its std.

    The instant is chosen with the scatter of scores under no change; the variance there is that under the change.
    """
    c = _solve(gram.sum(axis=0))
    A = gram[:, :4, :4]
    score = gram[:, :4, 4] - A @ c
    eye = 1e-9 * np.trace(A.sum(axis=0)) * np.eye(4)
    rows = slice(LEAST_BLOCKS, len(A) - LEAST_BLOCKS)
    A1, s1, V1 = (np.cumsum(x, axis=0)[rows] for x in (A, score, _outer(score)))
    A2, s2, V2 = A.sum(axis=0) - A1, score.sum(axis=0) - s1, _outer(score).sum(axis=0) - V1
    B1, B2 = np.linalg.inv(A1 + eye), np.linalg.inv(A2 + eye)
    before, behind = np.einsum("kij,kj->ki", B1, s1), np.einsum("kij,kj->ki", B2, s2)
    # tau = (c1/c0) of the columns as they were before they were scaled to unit mean square
    to_delay = np.array([-c[1] / c[0], 1.0, 0.0, 0.0]) * size[0] / (size[1] * c[0])
    jump = (behind - before) @ to_delay
    variance = np.einsum("i,kij,j->k", to_delay, B1 @ V1 @ B1 + B2 @ V2 @ B2, to_delay)
    k = int(np.argmax(jump**2 / np.maximum(variance, 1e-300)))
    split = LEAST_BLOCKS + k + 1
    W1 = _outer(score[:split] - A[:split] @ before[k]).sum(axis=0)
    W2 = _outer(score[split:] - A[split:] @ behind[k]).sum(axis=0)
    std = math.sqrt(max(float(to_delay @ (B1[k] @ W1 @ B1[k] + B2[k] @ W2 @ B2[k]) @ to_delay), 1e-300))
    return split, float(jump[k]), std


def _outer(x: Array) -> Array:
    """Outer product of each row with itself."""
    return x[:, :, None] * x[:, None, :]
