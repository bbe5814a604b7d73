"""Recordings with a hidden effect for the demo, and the sealed answer."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal._support.values import face, listing
from accelcal.data import Array, Recording, Rig
from accelcal.diagnosis.search.scan import scan
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import CATALOGUE, Effect, find, of_one_record
from accelcal.effects.building_blocks import lagged
from accelcal.estimation.estimate import Fit
from accelcal.estimation.gauss_newton import iterate
from accelcal.estimation.run import prepare
from accelcal.io import atomic_write
from accelcal.model import BASE, Model
from accelcal.signals.signals import Origins, Signals
from accelcal.simulation.motion import Motion
from accelcal.simulation.sensor import CXL02_RIG, Simulated, simulate
from accelcal.validation.comparison import ONE_SIDED
from accelcal.validation.differences import Comparison
from accelcal.verbs import add, compare, diagnose, fit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRUTH = {"bias": 0.05, "scale_factor": 0.01}
"""Base parameters of every hidden-effect demo."""
SECONDS = 60.0
STRENGTH = 5.0
"""A hidden effect is at least this many times the smallest detectable one: some 30 standard deviations."""
LIMITS = 12.0
"""Systematic error of the other recording under the base model, at least, in about its limits of detection."""
DIRECTIONS = 100.0
"""That a record resolves, about."""


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
        name
        for name, effect in CATALOGUE.items()
        if math.isfinite(limits.get(name, math.inf)) and not effect.family and effect.port != "noise"
    ]
    # a random one is of the sensor or the rig, not of one record, so that the other record shows what it takes away;
    # a few clipped samples would be outliers
    drawn = [
        name
        for name in possible
        if find(name).port == "output" and find(name).width == 1
        if not (of_one_record(find(name)) or find(name).traits.delay_class or find(name).traits.clips_at)
    ]
    effect = find(drawn[int(rng.integers(len(drawn)))] if name == "random" else name)
    if effect.name not in possible:
        why = "acts on noise alone" if effect.port == "noise" else "does not show on these records"
        why = "belongs to every model" if effect.name in BASE else why
        raise AccelcalError(f"{effect.name!r} cannot be hidden, it {why}; choose one of {', '.join(possible)}")
    shape = {key: float(rng.choice(declared.grid(state.signals))) for key, declared in effect.shapes.items()}
    origins = run.origins
    error = systematic_error(simulated_runs[1], effect, shape, origins)
    density = CXL02_RIG.sensor.noise or 0.0
    limit = math.sqrt(ONE_SIDED * math.sqrt(2.0 * DIRECTIONS) * density**2 / (2.0 * SECONDS))
    size = max(STRENGTH * limits[effect.name], LIMITS * limit / error if error > 0.0 else 0.0)
    size *= float(rng.choice([1.0] if effect.traits.positive else [-1.0, 1.0]))
    return Hidden(
        with_effect(simulated_runs[0], effect, size, shape, origins, seed),
        with_effect(simulated_runs[1], effect, size, shape, origins, seed + 1),
        effect.name,
        size,
        shape,
    )


def with_effect(
    simulated: Simulated, effect: Effect, size: float, shape: Mapping[str, float], origins: Origins, seed: int = 0
) -> Recording:
    """The recording with an effect in front of the low-pass of the sensor, or in the readings of the position."""
    recording, rig = simulated.recording, simulated.recording.rig
    channel = recording.position if effect.port == "position" else recording.accel
    s = exact_signals(simulated.truth.motion, channel.t, rig, origins)
    columns = effect.column(s, **shape).reshape(len(s.t), -1)
    weights = np.random.default_rng(seed).standard_normal(columns.shape[1])
    if effect.port != "process":
        weights /= np.linalg.norm(weights)
    added = size * (columns @ (np.ones(1) if columns.shape[1] == 1 and effect.port != "process" else weights))
    if effect.port == "position":
        return replace(recording, position=replace(channel, y=channel.y + added))
    if rig.lowpass is not None:
        added = lagged(added, rig.lowpass.tau, s.step, float(added[0]))
    return replace(recording, accel=replace(channel, y=channel.y + added))


def systematic_error(simulated: Simulated, effect: Effect, shape: Mapping[str, float], origins: Origins) -> float:
    """Rms error that one unit of an effect leaves beside bias, scale factor and delay; 0 where it is not at the sensor
    or has several coefficients."""
    if effect.port != "output" or effect.width > 1:
        return 0.0
    s = exact_signals(simulated.truth.motion, simulated.recording.accel.t, simulated.recording.rig, origins)
    base, column = np.stack([np.ones_like(s.t), s.a, s.jerk], axis=1), effect.column(s, **shape)
    return float(np.std(column - base @ np.linalg.lstsq(base, column, rcond=None)[0]))


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


@dataclass(frozen=True, slots=True)
class Loop:
    """The loop on two recordings of one rig: compare, see, learn, add, watch the error fall."""

    hidden: Hidden
    fit: Fit
    """Of the base model."""
    diagnosis: Diagnosis
    named: str
    """The effect that was added: of several that explain it as well the one with the least error on the held-out
    recording; empty where none was named."""
    better: Fit
    """With it."""
    comparison: Comparison
    """Of both on the held-out recording."""

    def plot(self, *, theme: Literal["light", "dark"] = "light") -> Figure:
        """Draw the five steps on one page.

        Raises
        ------
        MissingExtra
            If matplotlib is not installed.
        """
        figure: Figure = face("plots").loop(self.diagnosis, self.comparison, theme=theme)
        return figure


def loop(effect: str = "random", seed: int = 1, hidden: Hidden | None = None) -> Loop:
    """Run the loop on a rig with a hidden effect.

    Parameters
    ----------
    effect : to hide, "random" or "none".
    seed : of everything random.
    hidden : recordings that were made before.

    Examples
    --------
    >>> from accelcal import demo
    >>> demo.loop("cubic").named
    'cubic'
    """
    hidden = hidden or hide(effect, seed)
    first = fit(hidden.train)
    diagnosis = diagnose(first, hidden.train)
    named = next((name for name in diagnosis.effects if name not in first.model.effects), "")
    if not named:
        return Loop(hidden, first, diagnosis, "", first, compare(first, hidden.holdout))
    tied = next((group.members for group in diagnosis.classes if named in group.members), (named,))
    grown = dict[str, Fit]()
    for name in tied:
        with suppress(AccelcalError):  # some effects are accounted for already, as jumps of the position are
            grown[name] = add(first, hidden.train, name)
    several = compare([first, *grown.values()], hidden.holdout)
    if not grown:
        return Loop(hidden, first, diagnosis, "", first, several)
    best = min(grown, key=lambda name: several.errors[1 + list(grown).index(name)])
    pair = compare([first, grown[best]], hidden.holdout) if len(grown) > 1 else several
    return Loop(hidden, first, diagnosis, best, grown[best], pair)


def seal(hidden: Hidden, path: Path) -> None:
    """Write the answer encoded, so that reading the file does not disclose it."""
    answer = {"effect": hidden.effect, "size": hidden.size, "shape": dict(hidden.shape), **TRUTH}
    text = base64.b64encode(json.dumps(answer, allow_nan=False).encode()).decode()
    content = {"sealed": text, "open_with": "python -m base64 -d, on the text of 'sealed'"}
    atomic_write(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


__dir__ = listing(globals())
