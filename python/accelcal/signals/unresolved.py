"""Motion that sampling does not resolve: steps and kinks of the acceleration, told apart from wrong samples.

A set-point whose acceleration or jerk jumps holds content above any sampling rate. At each sample that its neighbours
do not predict, a likelihood ratio on the raw output decides between one or two wrong samples and such a jump behind the
low-pass of the sensor (derivations 7.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array, Flags
from accelcal.signals.series import grid_step, interpolation_errors, local_spread

Places = NDArray[np.intp]

EVENT_SIGMA = 5.0
"""Standard deviations of its interpolation error beyond which a sample is looked at; noise exceeds them once in 2
million samples."""
ISOLATED = 4
"""Samples to either side whose interpolation errors one event moves."""
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
PLACES = np.arange(-4.0, 4.05, 0.1)
"""Instants of a jump that are tried, in samples from the one that stands out."""
POLES = (0.0, 1.0, 3.0)
"""Time constants that are tried beside the declared one, in samples: a sensor's own poles are seldom declared."""
NEAR = 1.65
"""Samples within which a single jump lies from the sample that stands out the most."""
PAIR_STRIDE = 3
"""Instants of a pair are tried at every third of `PLACES`."""
DISTINCT = 1e-3
"""Share of their energy by which two forms must differ to be fitted together."""
CHUNK = 256
"""Events whose windows are held at a time."""


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


def jumps(t: Array, u: Array, step: float, tau: float) -> Jumps:
    """Find the jumps of acceleration and jerk in an output.

    Parameters
    ----------
    t, u : (n,) times, s, and output, m/s².
    step : usual spacing of the samples, s.
    tau : time constant of the declared low-pass, s; 0 where there is none.
    """
    if len(u) < 4 * HALF_WINDOW:
        return NO_JUMPS
    score, spread = prediction_scores(t, u)
    return examined(t, u, spread, local_maxima(score, ISOLATED, EVENT_SIGMA), step, tau)


def jumps_at(t: Array, u: Array, places: Places, step: float, tau: float) -> Jumps:
    """Those of some samples that a jump explains; parameters as of `jumps`."""
    if len(u) < 4 * HALF_WINDOW or len(places) == 0:
        return NO_JUMPS
    return examined(t, u, prediction_scores(t, u)[1], places, step, tau)


def prediction_scores(t: Array, u: Array) -> tuple[Array, Array]:
    """Interpolation error of each sample over its standard deviation, and the noise of a sample, m/s², (n,) each."""
    error, gain = interpolation_errors(t, u)
    spread = np.hypot(local_spread(error / gain), grid_step(u) / np.sqrt(12.0))
    return np.abs(error) / (gain * spread), spread


def examined(t: Array, u: Array, spread: Array, peaks: Places, step: float, tau: float) -> Jumps:
    """The jumps among some samples that stand out; `spread` (n,) is the noise of each sample, m/s²."""
    peaks = peaks[(peaks >= HALF_WINDOW) & (peaks < len(u) - HALF_WINDOW)]
    found = [classified(t, u, spread, peaks[k : k + CHUNK], step, tau) for k in range(0, len(peaks), CHUNK)]
    if not found:
        return NO_JUMPS
    instant, size, pole, of_jerk, certain, ratio = (np.concatenate(part) for part in zip(*found, strict=True))
    after = ISOLATED * step + np.maximum(pole, tau) * np.log1p(ratio)
    return Jumps(instant, size, of_jerk > 0.0, pole, certain > 0.0, np.full_like(after, 0.5 * ISOLATED * step), after)


def local_maxima(score: Array, reach: int, least: float) -> Places:
    """Places whose score is above `least` and the largest within `reach` samples."""
    above = np.flatnonzero(score > least)
    if len(above) == 0:
        return above
    padded = np.pad(score, reach)
    around = padded[above[:, None] + np.arange(2 * reach + 1)]
    return np.asarray(above[np.argmax(around, axis=1) == reach])


def classified(
    t: Array, u: Array, spread: Array, peaks: Places, step: float, tau: float
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Of some samples that stand out those that a jump explains: the fields of `Jumps`, flags as 0 and 1, and its
    size over the noise."""
    rows = peaks[:, None] + np.arange(-HALF_WINDOW, HALF_WINDOW + 1)
    x = (t[rows] - t[peaks][:, None]) / step
    y = u[rows] / spread[peaks][:, None]
    baseline, _ = np.linalg.qr(x[:, :, None] ** np.arange(BASELINE))
    y = y - np.einsum("nkb,nb->nk", baseline, np.einsum("nkb,nk->nb", baseline, y))
    wrong = np.zeros((1, 2 * HALF_WINDOW + 1, 5))
    wrong[0, HALF_WINDOW + np.arange(-2, 3), np.arange(5)] = 1.0
    wrong_forms = without(baseline, np.broadcast_to(wrong, (len(peaks), *wrong.shape[1:])))
    energy = np.einsum("nk,nk->n", y, y)
    wrong_gain = energy - least_remaining(wrong_forms, y, 2)
    poles = tuple(dict.fromkeys((tau / step, *POLES)))
    after = np.maximum(x[:, :, None] - PLACES, 0.0)
    responses = [response for pole in poles for response in jump_responses(after, pole)]
    forms = without(baseline, np.concatenate(responses, axis=2))
    near = np.flatnonzero(np.tile(np.abs(PLACES) < NEAR, len(responses)))
    gain, which, size = best_form(forms[:, :, near], y)
    which = near[which]
    kept = (gain > wrong_gain) & explained(energy, gain)
    certain = gain > CERTAIN[0] * wrong_gain + CERTAIN[1]
    left = np.flatnonzero(~kept)
    if len(left):  # two jumps so close that one window holds both, against wrong samples in a row
        second = pair_gain(forms[left], y[left])
        spoiled = energy[left] - least_remaining(wrong_forms[left], y[left], 3)
        certain[left] = second > PAIR_CERTAIN * spoiled + CERTAIN[1]
        kept[left] = certain[left] & explained(energy[left], second)
    number, place = np.divmod(which[kept], len(PLACES))
    of_jerk = number % 2 == 1
    unit = np.where(of_jerk, step, 1.0)
    pole_of = np.asarray(poles)[number // 2] * step
    return (
        t[peaks[kept]] + PLACES[place] * step,
        size[kept] * spread[peaks[kept]] / unit,
        pole_of,
        of_jerk.astype(np.float64),
        certain[kept].astype(np.float64),
        np.abs(size[kept]),
    )


def jump_responses(after: Array, pole: float) -> tuple[Array, Array]:
    """Response of a pole to a unit step and to a unit ramp at times `after` their beginning, all in samples."""
    begun = (after > 0.0).astype(np.float64)
    if pole <= 0.0:
        return begun, after
    decay = np.exp(-after / pole)
    return begun * (1.0 - decay), after - pole * (1.0 - decay)


def explained(energy: Array, gain: Array) -> Flags:
    """Whether a form that gains so much leaves no more than noise, or a small share, of the samples' energy."""
    return np.asarray(energy - gain < np.maximum(UNEXPLAINED[0], UNEXPLAINED[1] * gain))


def without(baseline: Array, forms: Array) -> Array:
    """Forms (n, k, m) less their parts in an orthonormal baseline (n, k, b)."""
    return np.asarray(forms - baseline @ (baseline.transpose(0, 2, 1) @ forms))


def pair_gain(forms: Array, y: Array) -> Array:
    """Twice the log-likelihood that the best two forms of one kind, at two of the instants, gain together, (n,)."""
    best = np.zeros(len(y))
    for kind in range(forms.shape[2] // len(PLACES)):
        these = forms[:, :, kind * len(PLACES) : (kind + 1) * len(PLACES) : PAIR_STRIDE]
        gram = np.einsum("nkm,nkl->nml", these, these)
        dot = np.einsum("nkm,nk->nm", these, y)
        power = np.einsum("nmm->nm", gram)
        volume = power[:, :, None] * power[:, None, :] - gram**2
        crossed = dot[:, :, None] ** 2 * power[:, None, :] + dot[:, None, :] ** 2 * power[:, :, None]
        crossed -= 2.0 * dot[:, :, None] * dot[:, None, :] * gram
        certain = volume > DISTINCT * power[:, :, None] * power[:, None, :]
        gain = np.where(certain, crossed / np.where(certain, volume, 1.0), 0.0)
        best = np.maximum(best, gain.max(axis=(1, 2)))
    return best


def least_remaining(forms: Array, y: Array, several: int) -> Array:
    """Energy of samples that the best `several` neighbouring forms of some do not explain, (n,)."""
    begins = range(forms.shape[2] - several + 1)
    return np.asarray(np.min([remaining(forms[:, :, k : k + several], y) for k in begins], axis=0))


def remaining(forms: Array, y: Array) -> Array:
    """Energy of samples (n, k) that no sum of some forms (n, k, m) explains, (n,)."""
    spanned, _ = np.linalg.qr(forms)
    left = y - np.einsum("nkm,nm->nk", spanned, np.einsum("nkm,nk->nm", spanned, y))
    return np.asarray(np.einsum("nk,nk->n", left, left))


def best_form(forms: Array, y: Array) -> tuple[Array, Array, Array]:
    """Twice the log-likelihood that the best of some forms (n, k, m) gains, which it is, and its size, (n,) each."""
    power = np.maximum(np.einsum("nkm,nkm->nm", forms, forms), 1e-12)
    dot = np.einsum("nkm,nk->nm", forms, y)
    gain = np.where(power > 1e-6, dot**2 / power, 0.0)
    which = np.argmax(gain, axis=1)
    at = np.arange(len(y)), which
    return gain[at], which, dot[at] / power[at]


def lost_velocity(found: Jumps, step: float) -> Array:
    """Standard deviation of the velocity that samples `step` s apart miss at each jump, (n,) m/s (derivations 7.5)."""
    if len(found.t) == 0:
        return np.empty(0)
    phase = (np.arange(64) + 0.5) / 64.0
    x = np.maximum(found.tau, 0.02 * step)[:, None] / step  # time constants in samples
    of_step = (0.5 - phase) - (np.exp(-phase / x) / -np.expm1(-1.0 / x) - x)
    of_ramp = 0.5 * (phase - phase**2) - x * of_step
    missed = np.where(found.of_jerk, of_ramp.std(axis=1) * step**2, of_step.std(axis=1) * step)
    return np.asarray(np.abs(found.size) * missed)
