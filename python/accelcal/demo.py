"""Recordings with a hidden effect for the demo, and the sealed answer."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal._support.values import listing
from accelcal.data import Array, Channel, Recording, Rig
from accelcal.diagnosis.search.scan import scan
from accelcal.effects import CATALOGUE, Effect, find
from accelcal.effects.building_blocks import lagged
from accelcal.estimation.gauss_newton import iterate
from accelcal.estimation.run import prepare
from accelcal.io import atomic_write
from accelcal.model import Model
from accelcal.signals.signals import Origins, Signals
from accelcal.simulation.motion import Motion
from accelcal.simulation.sensor import CXL02_RIG, Simulated, simulate

TRUTH = {"bias": 0.05, "scale_factor": 0.01}
"""Base parameters of every hidden-effect demo."""
SECONDS = 60.0
STRENGTH = 5.0
"""A hidden effect is this many times the smallest detectable one of the record."""


@dataclass(frozen=True, slots=True)
class Hidden:
    """What was put into a pair of recordings."""

    train: Recording
    holdout: Recording
    effect: str | None
    """None when nothing is hidden."""
    size: float
    shape: Mapping[str, float]


def hide(name: str, seed: int) -> Hidden:
    """Simulate two recordings of one rig with one hidden effect.

    Parameters
    ----------
    name : an effect of the catalogue, "random" or "none".
    seed : of everything random.

    Raises
    ------
    ValueError
        If the effect is unknown, belongs to the base, or cannot be put into a record of this rig.
    """
    choice, *motions = np.random.SeedSequence(seed).spawn(3)
    rng = np.random.default_rng(choice)
    simulated_runs = [
        simulate("interleaved", seconds=SECONDS, rig=CXL02_RIG, parameters=TRUTH, rng=np.random.default_rng(s))
        for s in motions
    ]
    train, holdout = (simulated.recording for simulated in simulated_runs)
    if name == "none":
        return Hidden(train, holdout, None, 0.0, {})
    run = prepare(train)
    state = iterate(Model.linear(), [run], [None]).states[0]
    limits = scan([state], Model.linear()).detection_limits
    possible = [
        n
        for n, effect in CATALOGUE.items()
        if math.isfinite(limits.get(n, math.inf))
        and not effect.family
        and effect.port == "output"
        and effect.width == 1
    ]
    effect = find(possible[int(rng.integers(len(possible)))] if name == "random" else name)
    if effect.name not in possible:
        raise AccelcalError(f"{effect.name!r} cannot be hidden in this demo; choose one of {', '.join(possible)}")
    shape = {key: float(rng.choice(declared.grid(state.signals))) for key, declared in effect.shapes.items()}
    size = float(rng.choice([1.0] if effect.traits.positive else [-1.0, 1.0])) * STRENGTH * limits[effect.name]
    origins = run.origins
    return Hidden(
        with_effect(simulated_runs[0], effect, size, shape, origins),
        with_effect(simulated_runs[1], effect, size, shape, origins),
        effect.name,
        size,
        shape,
    )


def with_effect(
    simulated: Simulated, effect: Effect, size: float, shape: Mapping[str, float], origins: Origins
) -> Recording:
    """The recording with an effect of the sensor added in front of the low-pass."""
    recording, rig = simulated.recording, simulated.recording.rig
    accel = recording.accel
    s = exact_signals(simulated.truth.motion, accel.t, rig, origins)
    added = size * effect.column(s, **shape)
    if rig.lowpass is not None:
        added = lagged(added, rig.lowpass.tau, s.step, float(added[0]))
    return replace(recording, accel=Channel(accel.name, accel.t, accel.y + added, accel.unit))


def exact_signals(motion: Motion, t: Array, rig: Rig, origins: Origins) -> Signals:
    """Signals of a motion that is known exactly."""
    p, v, a, jerk = motion.derivatives(t)
    return Signals(
        t=t - origins.t,
        p=p - origins.p,
        v=v,
        a=rig.polarity * (a + rig.gravity),
        jerk=rig.polarity * jerk,
        scale=1.0 + TRUTH["scale_factor"],
        bias=TRUTH["bias"],
        rig=rig,
    )


def seal(hidden: Hidden, path: Path) -> None:
    """Write the answer encoded, so that reading the file does not disclose it."""
    answer = {"effect": hidden.effect, "size": hidden.size, "shape": dict(hidden.shape), **TRUTH}
    text = base64.b64encode(json.dumps(answer, allow_nan=False).encode()).decode()
    content = {"sealed": text, "open_with": "python -m base64 -d, on the text of 'sealed'"}
    atomic_write(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


__dir__ = listing(globals())
