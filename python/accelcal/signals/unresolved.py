"""Motion that sampling does not resolve: steps and kinks of the acceleration, told apart from wrong samples.

A set-point whose acceleration or jerk jumps holds content above any sampling rate. At each sample that its neighbours
do not predict, a likelihood ratio on the raw output decides between one or two wrong samples and such a jump behind the
low-pass of the sensor (derivations 7.5).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from accelcal.data import Array, Flags, Places, batches
from accelcal.signals.processing import recursive_filter
from accelcal.signals.series import grid_step, interpolation_errors, local_spread


@dataclass(frozen=True, slots=True)
class Jumps:
    """Instants that sampling does not resolve, on the clock of the samples."""

    t: Array
    """Instants, (n,) s."""
    size: Array
    """Jump of the acceleration, m/s², or of the jerk, m/s³, (n,)."""
    of_jerk: Flags
    """Whether it is the jerk that jumps, (n,)."""
    tau: Array
    """Time constant of the pole through which it was seen, (n,) s."""
    certain: Flags
    """Whether a wrong sample is excluded, (n,); of the others a jump is the better explanation."""
    before: Array
    """Time before each instant from which on samples are moved by it, (n,) s."""
    after: Array
    """Time after which the poles have forgotten it, (n,) s."""


NONE, NO_FLAGS = np.empty(0), np.empty(0, dtype=np.bool_)
NO_JUMPS = Jumps(NONE, NONE, NO_FLAGS, NONE, NO_FLAGS, NONE, NONE)


def jump_responses(after: Array, pole: float) -> tuple[Array, Array]:
    """Response of a pole to a unit step and to a unit ramp at times `after` their beginning, all in samples."""
    begun = (after > 0.0).astype(np.float64)
    if pole <= 0.0:
        return begun, after
    decay = np.exp(-after / pole)
    return begun * (1.0 - decay), after - pole * (1.0 - decay)


def output_of(jumps: Jumps, begin: float, step: float, n: int) -> Array:
    """Output that some jumps cause at `n` uniform times from `begin` on, s, each from its instant on, (n,) m/s².

    Jumps before `begin` count as motion that was there. Every pole forgets by the same factor from sample to sample,
    so that all of its jumps are one recursion.
    """
    output = np.zeros(n)
    for tau, of_jerk, t, size in groups(jumps):
        first = np.ceil((t - begin) / step - 1e-9).astype(np.intp)
        inside = (first >= 0) & (first < n)
        first, size, late = first[inside], size[inside], begin + step * first[inside] - t[inside]
        sizes: Array = np.bincount(first, size, n).astype(np.float64)
        level = np.cumsum(sizes)
        held = np.zeros(n)
        if tau > 0.0:
            held = np.bincount(first, size * np.exp(-late / tau), n).astype(np.float64)
            held = recursive_filter([1.0], [1.0, -float(np.exp(-step / tau))], held)
        if of_jerk:
            risen = np.bincount(first, size * late, n) + step * np.append(0.0, level[:-1])
            output = output + np.cumsum(risen) - tau * (level - held)
        else:
            output = output + level - held
    return output


def groups(jumps: Jumps) -> Iterator[tuple[float, bool, Array, Array]]:
    """Time constant, whether of the jerk, instants and sizes of the jumps of one kind."""
    for tau in np.unique(jumps.tau):
        for of_jerk in (False, True):
            same = (jumps.tau == tau) & (jumps.of_jerk == of_jerk)
            if same.any():
                yield float(tau), of_jerk, jumps.t[same], jumps.size[same]


def lost_velocity(jumps: Jumps, step: float) -> Array:
    """Standard deviation of the velocity that samples `step` s apart miss at each jump, (n,) m/s (derivations 7.5)."""
    if len(jumps.t) == 0:
        return np.empty(0)
    phase = (np.arange(64) + 0.5) / 64.0
    x = np.maximum(jumps.tau, 0.02 * step)[:, None] / step  # time constants in samples
    of_step = (0.5 - phase) - (np.exp(-phase / x) / -np.expm1(-1.0 / x) - x)
    of_ramp = 0.5 * (phase - phase**2) - x * of_step
    missed = np.where(jumps.of_jerk, of_ramp.std(axis=1) * step**2, of_step.std(axis=1) * step)
    return np.asarray(np.abs(jumps.size) * missed)


EVENT_SIGMA = 5.0
"""Standard deviations of its interpolation error beyond which a sample is looked at; noise exceeds them once in 2
million samples."""
ISOLATED = 4
"""Samples to either side whose interpolation errors one event moves."""
USUAL = 0.9
"""Quantile of the spacings that samples without a gap between them keep: packets come at uneven times."""
HALF_WINDOW = 8
"""Samples to either side that a likelihood ratio uses."""
BASELINE = 8
"""Coefficients of the polynomial that resolved motion is over the window."""
CERTAIN = (1.2, 6.0)
"""A jump is certain when twice its log-likelihood exceeds that of a wrong sample by this factor, and by this much
more: it has more choices of its form, and the resolved motion is no exact polynomial."""
PAIR_CERTAIN = 1.05
"""The same factor for two jumps against three wrong samples in a row, which explain nearly as much."""
UNEXPLAINED = (27.0, 0.25)
"""Sum of squares that a jump may leave unexplained, in variances of the noise, or as a share of what it explains; nine
degrees of freedom are left. Vibration leaves more."""
PLACES = np.arange(-1.6, 1.65, 0.1)
"""Instants of a single jump that are tried, in samples from the one that stands out the most."""
FINER = np.arange(-0.1, 0.11, 0.02)
"""Instants about the best of those that are tried after them: a strong jump misfits by more than noise between two."""
PAIR_PLACES = np.arange(-7.8, 7.85, 0.2)
"""Instants of either of two jumps that are tried: the window holds them."""
POLES = (0.0, 1.0, 3.0)
"""Time constants that are tried beside the declared one, in samples: a sensor's own poles are seldom declared."""
PAIR_MARGIN = 20.0
"""Margin by which a pair is certain where it leaves nothing but noise: three wrong samples would leave six degrees of
freedom, which exceed it 3 times in 1000."""
PAIR_BETTER = 0.25
"""The same where it leaves so little of what three wrong samples leave: a strong jump whose pole is not quite the
declared one leaves more than noise."""
ALIKE = 0.4
"""Share of the larger of two jumps below which the smaller may be a misfit of its pole."""
STEPS_FIRST = 10.0
"""What two jumps of the jerk must gain beyond two of the acceleration: a ramp of one sample and two steps explain the
same samples, and the steps leave more of the velocity unknown."""
APART = 0.9
"""Samples by which two jumps lie apart; closer ones are counted as one."""
PAIR_LEAVES = 0.1
"""Share of what a single jump leaves unexplained that two may leave, to be taken for two."""
DISTINCT = 1e-3
"""Share of their energy by which two forms must differ to be fitted together."""
CHUNK = 256
"""Events whose windows are held at a time."""
ROW = np.dtype([("t", "f8"), ("size", "f8"), ("of_jerk", "?"), ("tau", "f8"), ("certain", "?"), ("ratio", "f8")])
"""A jump as in `Jumps`, and its size in deviations of the noise."""


def jumps(t: Array, u: Array, step: float, tau: float, scores: tuple[Array, Array] | None = None) -> Jumps:
    """Find the jumps of acceleration and jerk in an output.

    Parameters
    ----------
    t, u : (n,) times, s, and output, m/s².
    step : usual spacing of the samples, s.
    tau : time constant of the declared low-pass, s; 0 where there is none.
    scores : `prediction_scores` of the output, where they are there already.
    """
    if len(u) < 4 * HALF_WINDOW:
        return NO_JUMPS
    score, spread = scores or prediction_scores(t, u)
    return jumps_at(t, u, spread, local_maxima(score, ISOLATED, EVENT_SIGMA), step, tau)


def jumps_at(t: Array, u: Array, spread: Array, places: Places, step: float, tau: float) -> Jumps:
    """Those of some samples that a jump explains; `spread` (n,) is the noise of each sample, of `prediction_scores`,
    the other parameters are as of `jumps`."""
    peaks = places[(places >= HALF_WINDOW) & (places < len(u) - HALF_WINDOW) & (len(u) >= 4 * HALF_WINDOW)]
    parts = [classified(t, u, spread, peaks[rows], step, tau) for rows in batches(len(peaks), CHUNK)]
    if not parts:
        return NO_JUMPS
    row = np.concatenate(parts)
    row = row[np.argsort(row["t"], kind="stable")]
    row = row[np.diff(row["t"], prepend=-np.inf) > APART * step]  # two windows may hold the same jump
    after = ISOLATED * step + np.maximum(row["tau"], tau) * np.log1p(row["ratio"])
    before = np.full_like(after, 0.5 * ISOLATED * step)
    return Jumps(row["t"], row["size"], row["of_jerk"], row["tau"], row["certain"], before, after)


def prediction_scores(t: Array, u: Array) -> tuple[Array, Array]:
    """Interpolation error of each sample over its standard deviation, and the noise of a sample, m/s², (n,) each; the
    error of one whose neighbours lie beyond a gap is no sign of anything, and 0."""
    error, gain = interpolation_errors(t, u)
    spread = local_spread(error / gain)
    np.hypot(spread, grid_step(u) / np.sqrt(12.0), out=spread)
    gain *= spread
    score = np.divide(np.abs(error, out=error), gain, out=error)
    reach = 2 * ISOLATED
    apart = t[reach:] - t[:-reach]
    score[ISOLATED:-ISOLATED][apart > 2.0 * reach * np.quantile(np.diff(t), USUAL, overwrite_input=True)] = 0.0
    return score, spread


def local_maxima(score: Array, reach: int, least: float) -> Places:
    """Places whose score is above `least` and the largest within `reach` samples."""
    above = np.flatnonzero(score > least)
    if len(above) == 0:
        return above
    padded = np.pad(score, reach)
    around = padded[above[:, None] + np.arange(2 * reach + 1)]
    return np.asarray(above[np.argmax(around, axis=1) == reach])


def classified(t: Array, u: Array, spread: Array, peaks: Places, step: float, tau: float) -> NDArray[np.void]:
    """Of some samples that stand out those that one or two jumps explain, a `ROW` for each jump."""
    windows = Windows.about(t, u, spread, peaks, step)
    poles = np.array(list(dict.fromkeys((tau / step, *POLES))))
    single, gain = windows.best_single(poles)
    spoiled = windows.spoiled(2)
    accepted = (gain > spoiled) & explained(windows.energy, gain)
    certain = gain > CERTAIN[0] * spoiled + CERTAIN[1]
    remaining = np.where(accepted, windows.energy - gain, np.inf)
    poor, undeclared = remaining > UNEXPLAINED[0], single.kind > 1
    parts = []
    for tried, of in ((poor, poles), (~poor & undeclared, poles[:1])):
        left = np.flatnonzero(tried)
        if len(left):
            pair, sure, two = windows.of(left).two_jumps(of, remaining[left], undeclared[left])
            certain[left] |= sure
            accepted[left] = (accepted[left] | sure) & ~two
            parts.append(replace(pair, window=left[pair.window]))
    parts.append(single.of(accepted))
    return np.concatenate([some.rows(t[peaks], spread[peaks], certain, poles, step) for some in parts])


@dataclass(frozen=True, slots=True)
class Windows:
    """Samples about those that stand out, in deviations of their noise, less the motion that is resolved."""

    x: Array
    """Instants from the middle, (n, k) samples."""
    baseline: Array
    """Orthonormal polynomials, (n, k, b)."""
    y: Array
    """(n, k)"""
    energy: Array
    """Sum of squares of each, (n,)."""

    @classmethod
    def about(cls, t: Array, u: Array, spread: Array, peaks: Places, step: float) -> Windows:
        """Windows in the middle of which `peaks` lie; the others as in `jumps_at`."""
        rows = peaks[:, None] + np.arange(-HALF_WINDOW, HALF_WINDOW + 1)
        x = (t[rows] - t[peaks][:, None]) / step
        baseline, _ = np.linalg.qr(x[:, :, None] ** np.arange(BASELINE))
        y = without(baseline, (u[rows] / spread[peaks][:, None])[:, :, None])[:, :, 0]
        return cls(x, baseline, y, np.einsum("nk,nk->n", y, y))

    def of(self, some: Places) -> Windows:
        """Some of them."""
        return Windows(self.x[some], self.baseline[some], self.y[some], self.energy[some])

    def forms(self, poles: Array, places: Array) -> Array:
        """Responses (n, k, kinds, places) of each pole to a step and to a ramp at each place, less the baseline.

        Places are (m,), or (n, m), in samples from the middle.
        """
        after = np.maximum(self.x[:, :, None] - np.atleast_2d(places)[:, None, :], 0.0)
        responses = [response for pole in poles for response in jump_responses(after, pole)]
        forms = without(self.baseline, np.concatenate(responses, axis=2))
        return forms.reshape(*self.x.shape, len(responses), places.shape[-1])

    def spoiled(self, several: int) -> Array:
        """Twice the log-likelihood that so many wrong samples in a row gain, (n,)."""
        wrong = np.eye(2 * HALF_WINDOW + 1)[None, :, HALF_WINDOW - ISOLATED : HALF_WINDOW + ISOLATED + 1]
        forms = without(self.baseline, np.broadcast_to(wrong, (len(self.x), *wrong.shape[1:])))
        return self.energy - least_remaining(forms, self.y, several)

    def best_single(self, poles: Array) -> tuple[Found, Array]:
        """The jump that explains each window best, and twice the log-likelihood that it gains, (n,)."""
        gain, kind, place, size = best_form(self.forms(poles, PLACES), self.y)
        near = PLACES[place]
        for code in np.unique(kind):
            same = np.flatnonzero(kind == code)
            some, pole = self.of(same), poles[code // 2 : code // 2 + 1]
            finer = some.forms(pole, near[same, None] + FINER)[:, :, code % 2 : code % 2 + 1]
            gain[same], _, place, size[same] = best_form(finer, some.y)
            near[same] += FINER[place]
        return Found(np.arange(len(near)), kind, near, size), gain

    def two_jumps(self, poles: Array, remaining: Array, undeclared: Flags) -> tuple[Found, Flags, Flags]:
        """Two jumps so close that one window holds both, against wrong samples in a row and against a single jump.

        Parameters
        ----------
        poles : time constants that are tried, in samples.
        remaining : (n,) energy that a single jump leaves; infinite where it explains nothing.
        undeclared : (n,) whether that jump needs a pole that was not declared.

        Returns
        -------
        The jumps; whether each window certainly holds motion, and whether it is taken for two jumps, (n,) each.
        """
        pair, gain = best_pair(self.forms(poles, PAIR_PLACES), self.y)
        spoiled, unexplained = self.spoiled(3), self.energy - gain
        noise = np.maximum(UNEXPLAINED[0], PAIR_BETTER * (self.energy - spoiled))
        sure = (gain > PAIR_CERTAIN * spoiled + CERTAIN[1]) | ((gain > spoiled + PAIR_MARGIN) & (unexplained < noise))
        sure &= explained(self.energy, gain)
        two = sure & (pair.place[1::2] - pair.place[::2] > APART)
        two &= (unexplained < PAIR_LEAVES * remaining) | ((unexplained < UNEXPLAINED[0]) & undeclared)
        size = np.abs(pair.size).reshape(-1, 2)
        alike = size > ALIKE * size.max(axis=1, keepdims=True)
        two &= np.isinf(remaining) | alike.all(axis=1)
        return pair.of((two[:, None] & alike & (size > EVENT_SIGMA)).ravel()), sure, two


@dataclass(frozen=True, slots=True)
class Found:
    """Jumps in windows about samples that stand out."""

    window: Places
    """Which window each lies in, (m,)."""
    kind: Places
    """Twice the index of its pole, one more where it is of the jerk, (m,)."""
    place: Array
    """Instant from the middle of its window, (m,) samples."""
    size: Array
    """In deviations of the noise, per sample where it is of the jerk, (m,)."""

    def of(self, rows: Flags) -> Found:
        """Those in some of the windows."""
        return Found(self.window[rows], self.kind[rows], self.place[rows], self.size[rows])

    def rows(self, middle: Array, spread: Array, certain: Flags, poles: Array, step: float) -> NDArray[np.void]:
        """Each as a `ROW`, by the middle, s, the noise, m/s², and the certainty of each window."""
        row = np.zeros(len(self.window), dtype=ROW)
        row["t"] = middle[self.window] + self.place * step
        row["of_jerk"] = self.kind % 2 == 1
        row["size"] = self.size * spread[self.window] / np.where(row["of_jerk"], step, 1.0)
        row["tau"] = poles[self.kind // 2] * step
        row["certain"] = certain[self.window]
        row["ratio"] = np.abs(self.size)
        return row


def explained(energy: Array, gain: Array) -> Flags:
    """Whether a form that gains so much leaves no more than noise, or a small share, of the samples' energy."""
    return np.asarray(energy - gain < np.maximum(UNEXPLAINED[0], UNEXPLAINED[1] * gain))


def without(baseline: Array, forms: Array) -> Array:
    """Forms (n, k, m) less their parts in an orthonormal baseline (n, k, b)."""
    return np.asarray(forms - baseline @ (baseline.transpose(0, 2, 1) @ forms))


def best_pair(forms: Array, y: Array) -> tuple[Found, Array]:
    """Two forms of one kind, of some (n, k, kinds, places) at `PAIR_PLACES`, that explain samples (n, k) best.

    Returns
    -------
    The two of each window after each other, in order of place; and twice the log-likelihood that they gain, (n,).
    """
    n, _, kinds, places = forms.shape
    best, which = np.zeros(n), np.zeros(n, dtype=np.intp)
    at, sizes = np.zeros((n, 2), dtype=np.intp), np.zeros((n, 2))
    every = np.arange(n)
    first, last = np.triu_indices(places, 1)
    for kind in sorted(range(kinds), key=lambda kind: kind % 2):  # steps first
        these = forms[:, :, kind]
        gram = np.matmul(these.transpose(0, 2, 1), these)
        dot = np.einsum("nkm,nk->nm", these, y)
        power = np.einsum("nmm->nm", gram)
        shared, dots, powers = gram[:, first, last], (dot[:, first], dot[:, last]), (power[:, first], power[:, last])
        together = powers[0] * powers[1]
        volume = together - shared**2
        distinct = volume > DISTINCT * together
        volume = np.where(distinct, volume, 1.0)
        determinants = dots[0] * powers[1] - dots[1] * shared, dots[1] * powers[0] - dots[0] * shared
        gain = np.where(distinct, (dots[0] * determinants[0] + dots[1] * determinants[1]) / volume, 0.0)
        most = np.argmax(gain, axis=1)
        better = gain[every, most] > best + (STEPS_FIRST if kind % 2 else 0.0)
        chosen = every[better], most[better]
        best[better], which[better] = gain[chosen], kind
        at[better] = np.column_stack([first, last])[most[better]]
        sizes[better] = np.column_stack([numerator[chosen] / volume[chosen] for numerator in determinants])
    return Found(np.repeat(every, 2), np.repeat(which, 2), PAIR_PLACES[at].ravel(), sizes.ravel()), best


def least_remaining(forms: Array, y: Array, several: int) -> Array:
    """Energy of samples that the best `several` neighbouring forms of some do not explain, (n,)."""
    begins = range(forms.shape[2] - several + 1)
    return np.asarray(np.min([remaining(forms[:, :, k : k + several], y) for k in begins], axis=0))


def remaining(forms: Array, y: Array) -> Array:
    """Energy of samples (n, k) that no sum of some forms (n, k, m) explains, (n,)."""
    spanned, _ = np.linalg.qr(forms)
    left = y - np.einsum("nkm,nm->nk", spanned, np.einsum("nkm,nk->nm", spanned, y))
    return np.asarray(np.einsum("nk,nk->n", left, left))


def best_form(forms: Array, y: Array) -> tuple[Array, Places, Places, Array]:
    """The form, of some (n, k, kinds, places), that explains samples (n, k) best: twice the log-likelihood that it
    gains, its kind, its place, and its size, (n,) each."""
    n, k, kinds, places = forms.shape
    flat = forms.reshape(n, k, kinds * places)
    power = np.maximum(np.einsum("nkm,nkm->nm", flat, flat), 1e-12)
    dot = np.einsum("nkm,nk->nm", flat, y)
    gain = np.where(power > 1e-6, dot**2 / power, 0.0)
    which = np.argmax(gain, axis=1)
    at = np.arange(n), which
    kind, place = np.divmod(which, places)
    return gain[at], kind, place, dot[at] / power[at]
