"""Trials with hidden effects: a world is drawn and written to files, and the product is run on the files."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from accelcal import verbs
from accelcal.data.recording import Recording
from accelcal.estimation.estimate import Fit
from accelcal.io import load
from tests.worlds import CATALOGUE, MOTIONS, OUTSIDE, SENSORS, Hidden, Nuisances, World, at_d, signatures
from tests.worlds.scene import REFERENCE_TEMPERATURE

Outcome = dict[str, Any]
"""Result of a trial, as plain values for a line of JSON."""

MIXES = [(motion, sensor) for motion in MOTIONS for sensor in SENSORS]
VISIBLE = [name for name, effect in CATALOGUE.items() if effect.kind != "invisible"]
INVISIBLE = [name for name, effect in CATALOGUE.items() if effect.kind == "invisible"]
UNLIKE = ("vibration_rectification",)
"""Effects whose coefficient means another quantity here than in the worlds."""
ONE_PROCESS = ("bias_random_walk", "bias_gauss_markov", "scale_random_walk", "scale_gauss_markov")
"""A Gauss-Markov process with a time constant of the record's length is a random walk."""
DELAYS = ("time_offset", "sensor_lag", "sensor_resonance")
MOST_ALIKE = 0.9
"""Upper limit of the correlation of two effects of a pair."""
STRENGTHS = (10.0, 20.0, 40.0)
SHORT = 12.0
"""Length of held-out data whose errors nobody reads, s."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One record of one group of claims; the same trial always gives the same record."""

    group: int
    number: int
    seed: int
    names: tuple[str, ...] = ()
    """What is hidden."""
    d: float = 0.0
    length: float = 60.0
    """Of the record, s."""

    @property
    def rng(self) -> np.random.Generator:
        """Generator of everything that is drawn for this trial."""
        return np.random.default_rng([self.seed, self.group, self.number, round(10 * self.d)])

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.seed}/{self.group}/{self.number}/{self.d:g}/{'+'.join(self.names)}"


def plan(group: int, records: int, seed: int, effects: Sequence[str] = ()) -> Iterator[Trial]:
    """Trials of a group, evenly over effects, strengths, motions and sensors."""
    single = [name for name in effects or VISIBLE if name in VISIBLE]
    for n in range(records):
        if group == 1:
            yield Trial(1, n, seed)
        elif group == 2:
            for d in STRENGTHS:
                yield Trial(2, n, seed, (single[n % len(single)],), d)
        elif group == 3:
            yield Trial(3, n, seed, (single[n % len(single)],), 3.0)
        elif group == 4:
            yield Trial(4, n, seed, _several(n, seed, single, 3 if n % 5 == 4 else 2), 30.0 if n % 5 == 4 else 20.0)
        elif group == 5:
            yield Trial(5, n, seed, (INVISIBLE[n % len(INVISIBLE)],))
        elif group == 6:
            outside = [name for name in effects or OUTSIDE if name in OUTSIDE]
            yield Trial(6, n, seed, (outside[n % len(outside)],), 30.0)
        elif group == 8:
            yield Trial(8, n, seed, (single[n % len(single)],), 30.0)


def _several(number: int, seed: int, names: Sequence[str], count: int) -> tuple[str, ...]:
    rng = np.random.default_rng([seed, 4, number])
    while True:
        chosen = tuple(str(name) for name in rng.choice(names, count, replace=False))
        if sum(name in DELAYS for name in chosen) < 2:
            return chosen


def draw(trial: Trial, rig: World | None = None) -> World:
    """The world of a trial, its hidden effects at their strength.

    Of `rig` everything is kept that is not drawn, its rates for example; its seed is added to the one that is drawn.

    Raises
    ------
    ValueError
        If the effects cannot be seen, or not be separated, on any motion that was tried.
    """
    rng = trial.rng
    first = trial.number // max(1, _cycle(trial)) + int(rng.integers(len(MIXES))) if trial.names else trial.number
    nuisances = beside(trial.names, Nuisances.draw(rng))
    rig = rig or World()
    rig = replace(rig, seconds=trial.length, seed=rig.seed + int(rng.integers(2**31)), nuisances=nuisances)
    signs = rng.choice([-1.0, 1.0], len(trial.names))
    why = "nothing was tried"
    for attempt in range(5):
        motion, sensor = MIXES[(first + 3 * attempt) % len(MIXES)]
        hidden = tuple(hide(name, sign) for name, sign in zip(trial.names, signs, strict=True))
        world = replace(rig, motion=motion, sensor=sensor, hidden=hidden)
        try:
            if trial.d:
                for _ in range(2 if len(hidden) > 1 else 1):
                    for index in range(len(hidden)):
                        world = at_d(world, trial.d, index)
            if len(hidden) > 1 and _alike(world) >= MOST_ALIKE:
                raise ValueError(f"{' and '.join(trial.names)} look alike on {motion}")
            return world
        except ValueError as refused:
            why = str(refused)
    raise ValueError(why)


def beside(names: Sequence[str], nuisances: Nuisances) -> Nuisances:
    """The nuisances beside which the d of hidden effects means what it says."""
    if names:  # d counts what the base leaves of an effect; the base knows the low-pass
        nuisances = replace(nuisances, lowpass_error=0.0, lowpass_tolerance=0.0)
    if "vibration" in names:
        nuisances = replace(nuisances, vibration=0.0)
    if "quantisation" in names:
        nuisances = replace(nuisances, converter_bits=16)
    if set(names) & set(DELAYS):
        nuisances = replace(nuisances, clock_offset=0.0, clock_tolerance=0.0)
    return nuisances


def _cycle(trial: Trial) -> int:
    return {6: len(OUTSIDE), 5: len(INVISIBLE)}.get(trial.group, len(VISIBLE))


def hide(name: str, sign: float) -> Hidden:
    """An effect of its typical size; of both signs where it may have both."""
    effect = (CATALOGUE | OUTSIDE)[name]
    signed = effect.kind == "mean" and name not in ("saturation", *DELAYS[1:])
    return Hidden(name, sign * abs(effect.typical) if signed else abs(effect.typical))


def _alike(world: World) -> float:
    """Largest correlation between two hidden mean effects on this record."""
    mean = tuple(h for h in world.hidden if h.effect.kind == "mean")
    if len(mean) < 2:
        return 0.0
    X = signatures(replace(world, hidden=mean))
    size = np.linalg.norm(X, axis=0)
    rho = np.abs(X.T @ X / np.outer(size, size)) - np.eye(len(size))
    return float(np.max(rho))


def nearest_rival(world: World) -> float:
    """Largest correlation of the hidden effect with any other mean effect of the catalogue at its typical size."""
    name = world.hidden[0].name
    base = ("1", "a") if name in DELAYS else ("1", "a", "jerk")
    if name in ONE_PROCESS:
        return 1.0
    if world.hidden[0].effect.kind != "mean":
        return 0.0
    rivals = tuple(
        Hidden(rival, effect.typical)
        for rival, effect in CATALOGUE.items()
        if effect.kind == "mean" and rival != name and not (rival in DELAYS and name not in DELAYS)
    )
    X = signatures(replace(world, hidden=(world.hidden[0], *rivals)), base)
    size = np.maximum(np.linalg.norm(X, axis=0), 1e-12)
    return float(np.max(np.abs(X[:, 1:].T @ X[:, 0]) / (size[1:] * size[0])))


def run(trial: Trial) -> Outcome:
    """Draw, write, load, improve, judge nothing: what came out."""
    begin = time.process_time()
    outcome: Outcome = {"key": trial.key, **asdict(trial)}
    try:
        world = draw(trial)
    except ValueError as refused:
        return {**outcome, "skipped": str(refused)}
    settled = world.settled()
    outcome |= {
        "motion": world.motion,
        "sensor": world.sensor,
        "nuisances": asdict(world.nuisances),
        "hidden": [[h.name, h.magnitude, dict(h.shape)] for h in settled.hidden],
    }
    with tempfile.TemporaryDirectory() as folder:
        recording = load(world.record().write(folder))
        outcome["world_seconds"] = time.process_time() - begin
        begin = time.process_time()
        if trial.group == 8:
            other = next(m for m in (*MOTIONS, *MOTIONS) if m != world.motion and m not in ("tones", "long_rest"))
            unseen = load(settled.again(other, world.seed + 1).record().write(Path(folder), "unseen"))
            outcome |= held_out(trial, recording, unseen)
        else:
            begun = recording.position.t[0]
            short = recording.part(begun, begun + SHORT)  # judged is the verdict, in which held-out data have no part
            outcome |= improved(verbs.improve(recording, holdout=short), settled)
    outcome["seconds"] = time.process_time() - begin
    if trial.group == 2:
        outcome["rival"] = nearest_rival(world)
    return outcome


def improved(result: verbs.Improvement, world: World) -> Outcome:
    """Names, classes, verdict and estimates of an improvement."""
    first = result.steps[0].fit
    return {
        "effects": list(result.effects),
        "classes": [[tie.effect, *(m for m in tie.members if m != tie.effect)] for tie in result.classes],
        "verdict": result.diagnosis.verdict,
        "sentence": result.diagnosis.sentence,
        "top": [[c.effect, c.gain, c.dof, c.p_value] for c in result.diagnosis.scan.candidates[:4]],
        "noise_ratio": first.runs[0].noise.ratio,
        "estimates": errors(result.steps[-1].fit, world),
        "inseparable": [list(tie.members) for tie in result.diagnosis.inseparable],
    }


def at_output(hidden: Hidden, k: float) -> float:
    """Magnitude as the output shows it: behind a scale factor of 1 + k where the effect enters before it."""
    return hidden.magnitude * ((1.0 + k) if hidden.effect.place in ("force", "dynamics") else 1.0)


def errors(fit: Fit, world: World) -> dict[str, list[float]]:
    """Estimate, its standard deviation and the truth, for what has one number in both worlds."""
    k = float(world.scale_factor or 0.0)
    results: dict[str, list[float]] = {}
    truth = {"scale_factor": k}
    for hidden in world.hidden:
        if hidden.name in UNLIKE:
            continue
        truth[hidden.name] = at_output(hidden, k)
        if hidden.name == "saturation":
            truth[hidden.name] = 1.0
        if hidden.name == "temperature_scale":  # k is given at the model's reference temperature
            truth["scale_factor"] += hidden.magnitude * (fit.origins.temperature - REFERENCE_TEMPERATURE)
    for estimate in fit.estimates:
        if estimate.name in truth and estimate.std > 0.0:
            results[estimate.name] = [estimate.value, estimate.std, truth[estimate.name]]
    return results


def held_out(trial: Trial, recording: Recording, unseen: Recording) -> Outcome:
    """Coasting on another motion: base, found model, and the model that knows the true effect."""
    improvement = verbs.improve(recording, holdout=unseen)
    last = improvement.steps[-1]
    outcome = {
        "effects": list(improvement.effects),
        "classes": [[tie.effect, *(m for m in tie.members if m != tie.effect)] for tie in improvement.classes],
        "verdict": improvement.diagnosis.verdict,
        "base": coasting(improvement.steps[0].heldout),
        "found": coasting(last.heldout),
        "allowed": allowed(last.fit, unseen),
    }
    base = improvement.steps[0].fit
    oracle = base if trial.names[0] in base.model.effects else verbs.add(base, recording, trial.names[0])
    if "time_offset" in base.model.fixed:
        oracle = improvement.steps[1].fit
    return {**outcome, "oracle": coasting(verbs.compare(oracle, unseen)[0])}


def coasting(compared: Any) -> dict[str, float | None]:
    """One-step and rezeroed coasting errors, m."""
    return {"one_step": compared.one_step_rms, **{f"{h:g} s": v for h, v in compared.coast_rms.items()}}


def allowed(fit: Fit, unseen: Recording) -> dict[str, float]:
    """What the covariance of a model's own parameters adds to its errors on a motion, rms, m.

    One comparison to either side along each principal axis of the covariance: exact for errors that are linear in
    the parameters.
    """
    centre = coasting(verbs.compare(fit, unseen)[0])
    values, vectors = np.linalg.eigh(fit.covariance)
    total = dict.fromkeys(centre, 0.0)
    for value, axis in zip(values, vectors.T, strict=True):
        for side in (1.0, -1.0):
            moved = coasting(verbs.compare(shifted(fit, side * np.sqrt(max(value, 0.0)) * axis), unseen)[0])
            for key, there in moved.items():
                here = centre[key]
                if here is not None and there is not None:
                    total[key] += 0.5 * (there**2 - here**2)
    return {key: float(np.sqrt(max(value, 0.0))) for key, value in total.items()}


def shifted(fit: Fit, step: np.ndarray) -> Fit:
    """A fit whose free estimates are moved."""
    moved = {id(e): replace(e, value=e.value + float(s)) for e, s in zip(fit.free, step, strict=True)}
    return replace(fit, estimates=tuple(moved.get(id(e), e) for e in fit.estimates))
