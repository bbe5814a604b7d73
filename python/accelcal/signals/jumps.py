"""Jumps of acceleration or jerk: when, how large, behind which pole; their response and what samples miss of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data.arrays import Array, Flags


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


def output_of(found: Jumps, begin: float, step: float, n: int) -> Array:
    """Output that some jumps cause at `n` uniform times from `begin` on, s, each from its instant on, (n,) m/s².

    Jumps before `begin` count as motion that was there. Every pole forgets by the same factor from sample to sample,
    so that all of its jumps are one recursion.
    """
    output = np.zeros(n)
    for tau, of_jerk, t, size in groups(found):
        first = np.ceil((t - begin) / step - 1e-9).astype(np.intp)
        inside = (first >= 0) & (first < n)
        first, size, late = first[inside], size[inside], begin + step * first[inside] - t[inside]
        sizes: Array = np.bincount(first, size, n).astype(np.float64)
        level = np.cumsum(sizes)
        held = np.zeros(n)
        if tau > 0.0:
            held = np.bincount(first, size * np.exp(-late / tau), n).astype(np.float64)
            held = scipy.signal.lfilter([1.0], [1.0, -np.exp(-step / tau)], held)
        if of_jerk:
            risen = np.bincount(first, size * late, n) + step * np.append(0.0, level[:-1])
            output = output + np.cumsum(risen) - tau * (level - held)
        else:
            output = output + level - held
    return output


def groups(found: Jumps) -> Iterator[tuple[float, bool, Array, Array]]:
    """Time constant, whether of the jerk, instants and sizes of the jumps of one kind."""
    for tau in np.unique(found.tau):
        for of_jerk in (False, True):
            same = (found.tau == tau) & (found.of_jerk == of_jerk)
            if same.any():
                yield float(tau), of_jerk, found.t[same], found.size[same]


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
