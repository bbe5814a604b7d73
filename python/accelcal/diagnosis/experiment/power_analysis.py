"""Power analysis: detection limits of a record, a fitted run or a planned motion, and the effects that it confounds.

The distance of an effect from zero is d = |theta| sqrt(A), A = its information once the base is projected out
(derivations D3.5). A depends on motion and noise alone; what was measured does not enter. A planned motion has the
noise of the data sheet.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from accelcal._support.arguments import checked
from accelcal._support.errors import AccelcalError
from accelcal._support.process import one_thread, within
from accelcal.data import Array, Channel, Recording, Rig, median_step
from accelcal.diagnosis.experiment.detectability import (
    Detectability,
    DetectionModel,
    Group,
    Power,
    random_process_gains,
)
from accelcal.diagnosis.experiment.drift_bandwidth import drift_bandwidth
from accelcal.diagnosis.faults import usable
from accelcal.diagnosis.policy import DETECTION_PROBABILITY, FAMILYWISE_ALPHA
from accelcal.diagnosis.search.beam import SearchRules, entry_gains
from accelcal.diagnosis.search.confounding import TIED_CORRELATION, contribution_correlation, largest
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.scan import detectable_sizes
from accelcal.diagnosis.search.scores import CandidateScores, scaled_gram, variance_gain
from accelcal.effects import Effect
from accelcal.estimation.drive import DriveIntegrals
from accelcal.estimation.estimate import Fit, require_motion, solve_runs
from accelcal.estimation.noise import NoiseSearch
from accelcal.estimation.run import prepare
from accelcal.estimation.run_state import RunState
from accelcal.estimation.smoothing import SmoothedMotion, Thinning, sensor_signals
from accelcal.estimation.values import Noise, Values
from accelcal.model import Model
from accelcal.signals.processing import low_pass, motion_bandwidth
from accelcal.simulation.motion import Motion

ACCEL_RATE = 1667.0
"""Rate of the output unless another is given, Hz."""
POSITION_RATE = 833.5
"""Rate of the encoder readings unless another is given, Hz."""
DEGREE = 7
"""Degree of the spline through set-points: its third derivative is smooth."""
RANDOM_PROCESS_PATHS = 40
"""Simulated paths from which the smallest detectable intensity of a random process is read."""
RANDOM_PROCESS_LEAST = 8
"""Paths with the least gains, of which the quantile is: theirs are found between trial intensities as well."""


@checked
@one_thread
def power(
    model: Model | Fit,
    recording: Recording,
    *,
    extra: Sequence[Effect] | None = None,
    alpha: float = FAMILYWISE_ALPHA,
    start: float | None = None,
    end: float | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Power:
    """What a record can detect: the smallest detectable size of every effect, and the effects that it confounds.

    Parameters
    ----------
    model : what is known already, a model or a fit.
    recording : it is fitted first, up to its first break.
    extra : users' effects to consider besides the built-in catalogue; by default all that are registered.
    alpha : family-wise false-alarm rate of `diagnose`.
    start, end : s, optional; only this part of the recording is used.
    progress : called with the share of the work that is done, 0 to 1.

    Raises
    ------
    NotIdentifiable
        If the motion does not excite what the model already contains.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("bursts", seconds=20.0, rig=ac.simulation.ADXL105_RIG, parameters={}, rng=rng)
    >>> limits = power(ac.Model.linear(), simulated.recording)
    >>> limits.detection("quadratic", limits["quadratic"].smallest[0]) > 0.94
    True
    """
    model = model.model if isinstance(model, Fit) else model
    if start is None and end is None:
        whole = usable(recording)
        start, end = whole.start, whole.end
    progress(0.1)
    solution = solve_runs(model, [recording], start=start, end=end, progress=within(progress, 0.1, 0.4))
    result = detectability_of(solution.states[0], model, extra, alpha)
    progress(0.9)
    return with_drift(result)


def with_drift(result: Power) -> Power:
    """The detection limits with the detectable drift bandwidth of the same run."""
    return replace(result, drift=drift_bandwidth(result.of_run.state, result.of_run.model))


def detectability_of(
    state: RunState, model: Model, extra: Sequence[Effect] | None = None, alpha: float = FAMILYWISE_ALPHA
) -> Power:
    """What the motion and the noise of one run can detect."""
    detection_model = DetectionModel.of(state, model, extra, alpha)
    items, rules, evidence = detection_model.items, detection_model.rules, detection_model.evidence
    best: dict[str, tuple[int, tuple[float, ...], tuple[float, ...]]] = {}
    for i, item in enumerate(items):
        d, smallest = detectable_sizes(evidence, i, rules)
        name = item.effect.name
        if name not in best or min(smallest) < min(best[name][2]):
            best[name] = (i, d, smallest)
    for name, (i, d, _) in best.items():
        if items[i].effect.port == "process":
            best[name] = (i, d, (intensity(evidence, i, rules),))
    invisible = {name for name, (_, _, smallest) in best.items() if not math.isfinite(min(smallest))}
    best_index = {name: i for name, (i, _, _) in best.items() if name not in invisible}
    rivals_of = {name: rivals(evidence, i, best_index) for name, i in best_index.items()}
    detectabilities = tuple(
        Detectability(
            effect=name,
            unit=items[i].effect.unit,
            shape=dict(items[i].shape),
            parts=items[i].effect.parts if len(d) > 1 else ("",),
            d=d,
            smallest=smallest,
            largest=contribution_at_limit(items[i], smallest, state),
            largest_unit="m" if items[i].effect.port == "position" else "m/s²",
            members=(name, *rivals_of.get(name, {})),
            experiment=items[i].effect.experiment,
        )
        for name, (i, d, smallest) in best.items()
    )
    return Power(
        detectabilities=detectabilities,
        ties=confounded_groups(detectabilities, rivals_of),
        examined=rules.examined,
        blocks=rules.blocks,
        alpha=alpha,
        name=state.run.recording.name,
        detection_model=detection_model,
    )


def intensity(evidence: CandidateScores, i: int, rules: SearchRules) -> float:
    """Least intensity s of a random process that enters on 95 % of its paths: scores b ~ N(0, A + s² A²).

    Evaluated on `RANDOM_PROCESS_PATHS` fixed paths; square roots of their gains are nearly normal, hence the quantile
    of the roots.
    """
    A = evidence.G[evidence.columns[i], evidence.columns[i]]
    required = math.sqrt(max(entry_gains(rules.examined, rules.blocks, rules.alpha)))
    values, vectors = np.linalg.eigh(A)
    values = np.maximum(values, 0.0)
    z = np.random.default_rng(0).standard_normal((RANDOM_PROCESS_PATHS, len(values)))

    def undetected(log_s: float) -> bool:
        paths = z * np.sqrt(values + math.exp(2.0 * log_s) * values**2) @ vectors.T
        gains = random_process_gains(A, paths)
        for k in np.argsort(gains)[:RANDOM_PROCESS_LEAST]:
            gains[k] = variance_gain(A, paths[k])[0]
        return float(np.quantile(np.sqrt(gains), 1.0 - DETECTION_PROBABILITY)) < required

    low = -0.5 * math.log(float(np.max(values, initial=1e-300)))
    high = low + math.log(1e3)  # a thousand standard deviations of the most visible mode
    if undetected(high):
        return math.inf
    for _ in range(8):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if undetected(middle) else (low, middle)
    return math.exp(0.5 * (low + high))


def contribution_at_limit(item: Hypothesis, smallest: tuple[float, ...], state: RunState) -> float:
    """Largest contribution of the most visible part, at its smallest detectable size."""
    if not math.isfinite(min(smallest)):
        return math.inf
    estimate = np.zeros(1 if item.effect.port == "process" else len(item.terms))
    k = int(np.argmin(smallest))
    estimate[k] = smallest[k]
    return largest(item, estimate, state)


def rivals(evidence: CandidateScores, i: int, best_index: Mapping[str, int]) -> dict[str, float]:
    """Effects whose signature at one of their trial shapes correlates with that of hypothesis `i`, with |rho|."""
    item = evidence.items[i]
    if item.effect.family:
        return {}
    direction = most_visible_direction(evidence, i)
    correlations: dict[str, float] = {}
    for j, rival in enumerate(evidence.items):
        name = rival.effect.name
        if name == item.effect.name or name not in best_index or rival.effect.family:
            continue
        rho = contribution_correlation(evidence, evidence.G, i, j, direction)
        if rho > max(TIED_CORRELATION, correlations.get(name, 0.0)):
            correlations[name] = min(rho, 1.0)
    return dict(sorted(correlations.items(), key=lambda pair: -pair[1]))


def most_visible_direction(evidence: CandidateScores, i: int) -> Array:
    """The mixture of a hypothesis's columns with the largest information."""
    scaled, size = scaled_gram(evidence.G[evidence.columns[i], evidence.columns[i]])
    return np.asarray(np.linalg.eigh(scaled)[1][:, -1] / size)


def confounded_groups(
    detectabilities: Sequence[Detectability], rivals_of: Mapping[str, Mapping[str, float]]
) -> tuple[Group, ...]:
    """Each effect with all that are confounded with it, largest group first; a group that is part of another is
    dropped."""
    groups: list[Group] = []
    for detectability in sorted(detectabilities, key=lambda s: -len(s.members)):
        if len(detectability.members) == 1 or any(set(detectability.members) <= set(g.members) for g in groups):
            continue
        groups.append(
            Group(detectability.members, min(rivals_of[detectability.effect].values()), detectability.experiment)
        )
    return tuple(groups)


@dataclass(frozen=True, slots=True)
class SetPoints:
    """A part of a motion that runs through set-points, smooth through jerk."""

    spline: Any
    """Interpolating B-spline of position, m over s."""
    end: float
    """Time of the last set-point, s; the stage stays there."""

    start = -math.inf
    stop = math.inf
    final = 0.0

    def derivatives(self, t: Array) -> Array:
        inside = np.clip(t, 0.0, self.end)
        return np.stack([np.asarray(self.spline(inside, nu)) for nu in range(4)])


def through(t: Array, p: Array, name: str = "") -> Motion:
    """The motion through set-points, a spline of degree 7; its time begins at 0.

    Parameters
    ----------
    t : (n,) s, rising.
    p : (n,) m.
    name : name of the motion in messages.

    Raises
    ------
    ValueError
        If there are too few set-points.
    """
    from scipy.interpolate import make_interp_spline

    if len(t) <= DEGREE:
        raise AccelcalError(f"{name or 'motion'}: {len(t)} set-points; at least {DEGREE + 1} are needed")
    end = float(t[-1] - t[0])
    return Motion((SetPoints(make_interp_spline(t - t[0], p, k=DEGREE), end),), end, name=name)


def power_of_motion(
    motion: Motion,
    rig: Rig,
    *,
    seconds: float | None = None,
    model: Model | None = None,
    accel_rate: float = ACCEL_RATE,
    position_rate: float = POSITION_RATE,
    encoder_noise: float | None = None,
    extra: Sequence[Effect] | None = None,
    alpha: float = FAMILYWISE_ALPHA,
) -> Power:
    """Detection limits of a planned motion: smallest detectable size of every effect, and the effects that it
    confounds.

    Parameters
    ----------
    motion : the plan; `through` makes one from set-points.
    rig : noise density of the sensor, its low-pass and mount, resolution of the encoder.
    seconds : length of the record, s; the planned length by default.
    model : what is known already; the linear model by default.
    accel_rate, position_rate : Hz.
    encoder_noise : standard deviation of a reading before it is rounded, m; by default as declared, else one step of
        the encoder.
    extra : effects of the user's own, next to the catalogue.
    alpha : family-wise false-alarm rate of `diagnose`.

    Raises
    ------
    ValueError
        If the rig declares no noise density, or neither resolution nor encoder noise are known.
    NotIdentifiable
        If the plan does not move.

    Examples
    --------
    >>> from accelcal.simulation.motion import motion
    >>> from accelcal.simulation.sensor import ADXL105_RIG
    >>> limits = power_of_motion(motion("bursts", 20.0, np.random.default_rng(1)), ADXL105_RIG)
    >>> bool(limits["quadratic"].smallest[0] < limits["odd_quadratic"].smallest[0])
    True
    """
    model = Model.linear() if model is None else model
    length = motion.seconds if seconds is None else seconds
    noise = planned_noise(rig, encoder_noise, name=motion.name or "planned motion")
    state = planned_state(motion, rig, length, noise, model, accel_rate, position_rate)
    return with_drift(detectability_of(state, model, extra, alpha))


def power_of_set_points(
    recording: Recording, *, extra: Sequence[Effect] | None = None, alpha: float = FAMILYWISE_ALPHA
) -> Power:
    """Detection limits of a file of set-points, with a reading at each of them and two outputs between readings.

    Parameters
    ----------
    recording : position (n,) m; the output is not used.
    extra : effects of the user's own, next to the catalogue.
    alpha : family-wise false-alarm rate of `diagnose`.
    """
    t, p = recording.position.t, recording.position.y
    motion, rate = through(t, p, recording.name), 1.0 / median_step(t)
    return power_of_motion(motion, recording.rig, accel_rate=2.0 * rate, position_rate=rate, extra=extra, alpha=alpha)


def planned_noise(rig: Rig, encoder_noise: float | None = None, *, name: str = "planned motion") -> Noise:
    """Noise of the data sheet: q = N²/2 for a one-sided density N, R = noise² + resolution²/12.

    Raises
    ------
    ValueError
        If one of them is not declared; messages call the motion `name`.
    """
    if rig.sensor.noise is None:
        raise AccelcalError(
            f"{name}: the noise density of the sensor is not declared, so nothing can be said of a planned motion. "
            'Write in the sidecar\n[sensor]\nnoise = "225 ug/sqrt(Hz)"'
        )
    encoder_noise = rig.reading_noise if encoder_noise is None else encoder_noise
    if rig.resolution is None and encoder_noise is None:
        raise AccelcalError(
            f"{name}: neither resolution nor noise of the encoder are known, so nothing can be said of a planned "
            "motion. Write in the sidecar\n"
            '[channels]\nposition = { column = "position_m", unit = "m", noise = "1 um" }'
        )
    step = rig.resolution or 0.0
    position_noise = step if encoder_noise is None else encoder_noise
    return Noise(0.5 * rig.sensor.noise**2, position_noise**2 + step**2 / 12.0)


def planned_state(
    motion: Motion,
    rig: Rig,
    seconds: float,
    noise: Noise,
    model: Model,
    accel_rate: float = ACCEL_RATE,
    position_rate: float = POSITION_RATE,
) -> RunState:
    """The fitted run that a planned motion would give, with exact signals and the gains of the declared noise.

    The coefficients are those of a perfect sensor: detection limits change by the scale error only, a percent or two.
    Nothing measured enters, so the filter is run over readings of zero and the innovations are zero.
    """
    t = np.arange(0.0, seconds, 1.0 / accel_rate)
    p, v, a, jerk = motion.derivatives(t)
    readings = np.arange(0.0, seconds, 1.0 / position_rate)
    recording = Recording(
        accel=Channel("accel", t, rig.polarity * (a + rig.gravity), "m/s²"),
        position=Channel("position", readings, motion.position(readings), "m"),
        rig=rig,
        name=motion.name,
    )
    run = prepare(recording)
    require_motion(run)
    values = Values({term.name: model.fixed.get(term.name, 0.0) for term in model.terms}, model.terms)
    still = np.zeros_like(run.t)
    integrals = DriveIntegrals(run.t, still, still, still, np.arange(len(run.t)) == 0, still)
    density, crossover = noise.r * run.reading_step, run.crossover(noise)
    cutoff, _ = motion_bandwidth(a, accel_rate, q=noise.q, reading_density=density, crossover=crossover)
    grid = Thinning.of(t, run.accel_step, cutoff)
    a, jerk = (low_pass(y, accel_rate, cutoff) for y in (a, jerk))  # as the signals of a real run are
    signals = sensor_signals(run, grid.t, SmoothedMotion(*(grid.thin(y) for y in (p, v, a, jerk))), values, cutoff)
    return RunState(run, values, noise, integrals, None, signals, None, NoiseSearch(noise))
