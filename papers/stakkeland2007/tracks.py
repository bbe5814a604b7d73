"""Figs. 4 and 5: parameter estimates over time with their 2-sigma bands (paper III-B)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from accelcal.calibration.characteristic import straight_line
from accelcal.data import Array, Recording, Rig
from accelcal.effects import BUILT_IN, polynomial
from accelcal.estimation.estimate import Fit, estimate
from accelcal.filters.choice import FilterChoice, GaussMarkov
from accelcal.model import Model
from accelcal.simulation.motion import Motion
from accelcal.simulation.sensor import ADXL105_RIG, Simulated, simulate
from accelcal.validation.consistency import Consistency, consistency, nees
from accelcal.verbs import diagnose
from papers.stakkeland2007.question import BASE, drift, noise_free, snr
from papers.stakkeland2007.rows import (
    ACI,
    ALPHA,
    CWPA,
    PLAIN_ADXL105,
    PLAIN_CXL02,
    SIGMAS,
    Item,
    Plan,
    Row,
    filtered,
    label,
    motion_states,
    paired,
    prior_sigmas,
    start,
    tuned,
)

LINEAR_SENSOR = {"bias": 0.05, "scale_factor": 0.01}
CUBIC_SENSOR = {**LINEAR_SENSOR, "quadratic": -1e-3, "cubic": 1e-4}
"""An ADXL105 with the nonlinearity of a 1 %FS part, so that Fig. 5 has something to show."""
STATE_NAMES = {"k": "scale_factor", "K0": "bias", "K2": "quadratic", "K3": "cubic"}
_POINTS = 2000
"""Points drawn per curve."""


@dataclass(frozen=True, slots=True)
class ParameterTrack:
    """One filter's parameters over one record, thinned for drawing."""

    title: str
    t: Array
    """(n,) s."""
    names: tuple[str, ...]
    """(m,) k, K0[, K2, K3]."""
    estimates: Array
    """(n, m) SI."""
    sigmas: Array
    """(n, m) SI."""
    truth: Array
    """(m,) SI."""
    motion: Array
    """(n,) squared acceleration, mean over 1 s, over its largest value."""
    final_deviates: Array
    """(m,) last error over its sigma."""


@dataclass(frozen=True, slots=True)
class Tracks:
    """What Figs. 4 and 5 are drawn from."""

    linear: tuple[ParameterTrack, ...]
    """Fig. 4: ACI and CWPA."""
    cubic: tuple[ParameterTrack, ...]
    """Fig. 5: ACI and CWPA."""


def tracks_item(plan: Plan) -> tuple[Item, Tracks]:
    """Both figures and whether their bands end on the truth."""
    linear = parameter_tracks(plan, "linear", LINEAR_SENSOR, 130.0)
    cubic = parameter_tracks(plan, "cubic", CUBIC_SENSOR, 250.0)
    rows = tuple(_row(figure, track) for figure, tracks in (("Fig. 4", linear), ("Fig. 5", cubic)) for track in tracks)
    item = Item(
        name="tracks",
        title="Parameter tracks with 2-sigma bands, simulated ADXL105 without low-pass",
        source="III-B, Figs. 4 and 5",
        rows=rows,
    )
    return item, Tracks(linear, cubic)


def parameter_tracks(
    plan: Plan, model: Literal["linear", "cubic"], sensor: Mapping[str, float], seconds: float
) -> tuple[ParameterTrack, ...]:
    """ACI and CWPA of one sensor model on the same record of `sensor`."""
    names = ("k", "K0") if model == "linear" else ("k", "K0", "K2", "K3")
    rng = plan.repeat(f"tracks {model}", 1, lambda rng: rng)[0]
    simulated = simulate(
        "bursts", seconds=seconds, rig=PLAIN_ADXL105, parameters=sensor, rng=rng, a_rms=4.0, position_noise=0.0
    )
    noise = tuned(simulated.truth, PLAIN_ADXL105)
    truth = np.array([sensor[STATE_NAMES[name]] for name in names])

    def track(choice: FilterChoice) -> ParameterTrack:
        run = filtered(choice, simulated.recording, noise, start(choice, simulated.truth), prior_sigmas(choice))
        drawn = np.arange(0, len(run.times), max(1, len(run.times) // _POINTS))
        block = slice(motion_states(choice), None)
        squared = _mean_square(simulated.truth.motion, run.times[drawn])
        return ParameterTrack(
            title=label(choice),
            t=run.times[drawn],
            names=names,
            estimates=run.states[drawn, block],
            sigmas=np.sqrt(run.variances[drawn, block]),
            truth=truth,
            motion=squared / np.max(squared),
            final_deviates=(run.states[-1, block] - truth) / np.sqrt(run.variances[-1, block]),
        )

    # a straight line between samples would cost ACI (w dt)²/12 of the scale factor, 3e-4 at 15 Hz: outside its band
    return track(replace(ACI, model=model, interpolation="cubic")), track(replace(CWPA, model=model))


def _mean_square(motion: Motion, t: Array) -> Array:
    """Squared acceleration over the second around each t (n,) s; (m/s²)²."""
    window = np.linspace(-0.5, 0.5, 101)
    return np.asarray(np.mean([motion.acceleration(t + offset) ** 2 for offset in window], axis=0))


def _row(figure: str, track: ParameterTrack) -> Row:
    worst = float(np.max(np.abs(track.final_deviates)))
    ends = ", ".join(
        f"{name} {estimate:.4g} ± {2 * sigma:.1g}"
        for name, estimate, sigma in zip(track.names, track.estimates[-1], track.sigmas[-1], strict=True)
    )
    return Row(
        by="us",
        claim=f"{figure}, {track.title}: the bands end on the truth",
        expected=", ".join(f"{name} {value:g}" for name, value in zip(track.names, track.truth, strict=True)),
        measured=ends,
        value=worst,
        n=1,
        threshold=f"each within {SIGMAS:.2f} sigma (worst is {worst:.2f})",
        holds=worst < SIGMAS,
    )


SIGMA, TAU = 0.01, 0.5
"""Standard deviation and correlation time (s) of the scale factor."""
VARYING_SECONDS = 60.0
PROCESSES = frozenset(e.name for e in BUILT_IN if e.port == "process" and e.traits.changes == "scale_factor")
"""Names that are right."""


@dataclass(frozen=True, slots=True)
class Outcomes:
    """Figures of each run, (runs,)."""

    linear: Array
    """Error after `HORIZON` without position on a motion that no fit has seen, m."""
    cubic: Array
    snr: Array
    """K2 and K3 together in standard deviations of their covariance."""
    named: Array
    """Whether the first effect that is missing is such a process, or confounded with one."""
    plain: Array
    """Error of k of the linear model in its standard deviations."""
    known: Array
    """The same with the process in the model."""


def varying_item(plan: Plan) -> Item:
    """Significance, drift and name."""
    runs = plan.runs(3, 24)
    found = outcomes(plan, runs)
    pair = paired(found.linear, found.cubic)
    worst, least = float(np.sqrt(np.mean(found.plain**2))), float(np.sqrt(np.mean(found.known**2)))
    p_value = float(scipy.special.chdtrc(2 * runs, np.sum(found.snr**2)))
    return Item(
        name="varying",
        title=f"Linear sensor whose scale factor varies by {SIGMA:g} within {TAU:g} s, ADXL105",
        source="IV, II-D",
        rows=(
            _varying_row(
                "K2, K3 that the sensor has not exceed their covariance when the scale factor varies",
                f"chi-square of all runs beyond p = {ALPHA:g}",
                f"{np.min(found.snr):.1f} to {np.max(found.snr):.1f} sigma, p = {p_value:.1g}",
                p_value,
                runs,
                f"{ALPHA:g}",
                holds=p_value < ALPHA,
            ),
            _varying_row(
                "the linear model then tracks better than the cubic one",
                "linear below cubic",
                f"{1e3 * _rms(found.linear):.3g} mm against {1e3 * _rms(found.cubic):.3g} mm",
                pair.ratio,
                runs,
                f"below 1 (mean log ratio is {pair.deviate:+.1f} sigma)",
                holds=pair.ratio < 1.0,
            ),
            _varying_row(
                "the loop names the process, or confounds it with a drift or step",
                f"{runs} of {runs}",
                f"{int(np.sum(found.named))} of {runs}",
                float(np.mean(found.named)),
                runs,
                "all",
                holds=bool(np.all(found.named)),
            ),
            _varying_row(
                "with the process in the model k has the error that it states",
                "rms error of k below 2 sigma, without it above",
                f"{least:.1f} sigma with it, {worst:.1f} without",
                least,
                runs,
                "2 sigma",
                holds=least < 2.0 < worst,
            ),
        ),
    )


def outcomes(plan: Plan, runs: int) -> Outcomes:
    """The experiment."""

    def once(rng: np.random.Generator) -> tuple[float, ...]:
        train = varied(
            simulate("tones", seconds=VARYING_SECONDS, rig=ADXL105_RIG, parameters=BASE, rng=rng), rng
        ).recording
        test = simulate(
            "interleaved", seconds=VARYING_SECONDS, rig=noise_free(ADXL105_RIG), parameters=BASE, rng=rng
        ).recording
        linear, cubic = estimate(Model.linear(), train), estimate(Model.cubic(), train)
        missing = diagnose(linear, train).scan.found
        named = bool(missing) and not PROCESSES.isdisjoint(missing[0].members)
        fit = estimate(missing[0].enter(linear.model), train) if named else linear
        error, known = (f["scale_factor"].value - BASE["scale_factor"] for f in (linear, fit))
        return (
            drift(linear, test),
            drift(cubic, test),
            snr(cubic),
            float(named),
            error / linear["scale_factor"].std,
            known / fit["scale_factor"].std,
        )

    return Outcomes(*np.array(plan.repeat("varying", runs, once)).T)


def varied(made: Simulated, rng: np.random.Generator) -> Simulated:
    """The record with a scale factor that varies: k(t) a(t) added to the output, k by its exact recursion."""
    accel = made.recording.accel
    keep = float(np.exp(-np.median(np.diff(accel.t)) / TAU))
    k = np.empty(len(accel.t))
    k[0] = SIGMA * rng.standard_normal()
    for i, shock in enumerate(SIGMA * np.sqrt(1.0 - keep**2) * rng.standard_normal(len(k) - 1), 1):
        k[i] = keep * k[i - 1] + shock
    y = accel.y + k * made.truth.motion.acceleration(accel.t)
    recording = replace(made.recording, accel=replace(accel, y=y), digest=f"varied {rng.integers(1 << 60)}")
    return replace(made, recording=recording)


def _varying_row(claim: str, expected: str, measured: str, value: float, n: int, threshold: str, *, holds: bool) -> Row:
    return Row("us", claim, expected, measured, value, n, threshold, bool(holds))


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))


SEEN, GAP = 20.0, 1.0
"""Time with position and then without, s."""
CURVATURE_SIGMAS = (1e-3, 1e-4)
"""Prior of K2 and K3 in the second world, (m/s²)⁻¹ and (m/s²)⁻²."""
PROCESS = {"k": GaussMarkov(q=2.0 * SIGMA**2 / TAU, tau=TAU)}
"""The scale factor of the first world, as its filters know it."""
KNOWN = 1e-9
"""Standard deviation of a parameter that a filter takes as known."""


@dataclass(frozen=True, slots=True)
class Design:
    """One way to treat the uncertain parameters."""

    choice: FilterChoice
    sigmas: Mapping[str, float]
    """Prior of the uncertain parameters that the filter carries."""
    processes: Mapping[str, GaussMarkov] | None = None


@dataclass(frozen=True, slots=True)
class Reached:
    """One design over n records."""

    errors: Array
    """(n,) m: absolute position error after the gap."""
    consistency: Consistency
    """Of position and velocity there."""

    @property
    def rms(self) -> float:
        """Position error, m."""
        return float(np.sqrt(np.mean(self.errors**2)))


LINEAR = replace(ACI, interpolation="cubic")
CUBIC = replace(LINEAR, model="cubic")
SCALE_DESIGNS: Mapping[str, Design] = {
    "estimated as constant": Design(LINEAR, {"k": SIGMA}),
    "considered": Design(replace(LINEAR, consider=("k",)), {"k": SIGMA}, PROCESS),
    "ignored": Design(LINEAR, {"k": KNOWN}),
    "estimated": Design(LINEAR, {"k": SIGMA}, PROCESS),
}
"""The varying scale factor."""
CURVATURE_DESIGNS: Mapping[str, Design] = {
    "estimated": Design(CUBIC, dict(zip(("K2", "K3"), CURVATURE_SIGMAS, strict=True))),
    "considered": Design(replace(CUBIC, consider=("K2", "K3")), dict(zip(("K2", "K3"), CURVATURE_SIGMAS, strict=True))),
    "ignored": Design(LINEAR, {}),
}
"""Constant K2 and K3."""


def consider_item(plan: Plan) -> Item:
    """Consistency and error of every design in both worlds."""
    runs = plan.runs(12, 60)
    scale = reached(plan, "consider scale", PLAIN_ADXL105, SCALE_DESIGNS, runs)
    curvature = reached(plan, "consider curvature", PLAIN_CXL02, CURVATURE_DESIGNS, runs)
    varies, constant = f"k varies by {SIGMA:g} within {TAU:g} s", "K2, K3 constant and unknown"
    return Item(
        name="consider",
        title=f"Uncertain parameters considered (Schmidt-Kalman), estimated or ignored: {GAP:g} s without position",
        source="IV, [4]",
        rows=(
            _nees_row(f"{varies}, considered: consistent", scale["considered"], "consistent"),
            _nees_row(f"{varies}, estimated as a process: consistent", scale["estimated"], "consistent"),
            _nees_row(
                f"{varies}, estimated as constant: overconfident", scale["estimated as constant"], "overconfident"
            ),
            _nees_row(f"{varies}, ignored: overconfident", scale["ignored"], "overconfident"),
            _error_row("the suboptimal design tracks better, k varies", scale, "estimated as constant"),
            _nees_row(f"{constant}, considered: consistent", curvature["considered"], "consistent"),
            _nees_row(f"{constant}, estimated: consistent", curvature["estimated"], "consistent"),
            _nees_row(f"{constant}, ignored: overconfident", curvature["ignored"], "overconfident"),
            _error_row("the suboptimal design tracks better, K2 and K3 constant", curvature, "ignored"),
        ),
    )


def reached(plan: Plan, world: str, rig: Rig, designs: Mapping[str, Design], runs: int) -> dict[str, Reached]:
    """Every design on the same records; the world is that of the scale factor if no design is cubic."""
    curved = any(design.choice.model == "cubic" for design in designs.values())

    def once(rng: np.random.Generator) -> list[tuple[float, float]]:
        made = record(rng, rig, curved=curved)
        seen = cut(made.recording)
        return [judged(design, made, seen, rig) for design in designs.values()]

    values = np.array(plan.repeat(world, runs, once))
    return {
        name: Reached(values[:, i, 0], consistency(values[:, i, 1], 2, 1.0 - ALPHA)) for i, name in enumerate(designs)
    }


def record(rng: np.random.Generator, rig: Rig, *, curved: bool) -> Simulated:
    """A record of one world."""
    K2, K3 = CURVATURE_SIGMAS * rng.standard_normal(2) if curved else (0.0, 0.0)
    sensor = {"bias": 0.05, "quadratic": K2, "cubic": K3}
    made = simulate("tones", seconds=SEEN + GAP, rig=rig, parameters=sensor, rng=rng, position_noise=0.0)
    return made if curved else varied(made, rng)


def cut(recording: Recording) -> Recording:
    """Without the positions of the last second."""
    position = recording.position
    seen = position.t < SEEN
    return replace(recording, position=replace(position, t=position.t[seen], y=position.y[seen]))


def judged(design: Design, made: Simulated, seen: Recording, rig: Rig) -> tuple[float, float]:
    """Position error (m) and NEES of position and velocity at the end."""
    choice, truth = design.choice, made.truth
    sigmas = dict(zip(choice.states(), prior_sigmas(choice), strict=True)) | dict(design.sigmas)
    prior = np.array(list(sigmas.values()))
    track = filtered(choice, seen, tuned(truth, rig), start(choice, truth), prior, parameters=design.processes)
    error = track.states[-1, :2] - truth.motion.derivatives(track.times[-1:])[:2, 0]
    return abs(float(error[0])), float(nees(error, track.covariance[:2, :2]))


def _nees_row(claim: str, found: Reached, verdict: str) -> Row:
    low, high = found.consistency.low, found.consistency.high
    return Row(
        by="us",
        claim=claim,
        expected="2" if verdict == "consistent" else f"above {high:.2f}",
        measured=f"NEES of p, v {found.consistency.mean:.3g}; position error {1e3 * found.rms:.3g} mm rms",
        value=found.consistency.mean,
        n=found.consistency.runs,
        threshold=f"{1.0 - ALPHA:.1%} region {low:.2f} to {high:.2f}",
        holds=found.consistency.verdict == verdict,
    )


def _error_row(claim: str, found: Mapping[str, Reached], rival: str) -> Row:
    pair = paired(found["considered"].errors, found[rival].errors)
    best = found["estimated"].rms
    return Row(
        by="paper",
        claim=claim,
        expected=f"considered below {rival}",
        measured=(
            f"{1e3 * found['considered'].rms:.3g} mm against {1e3 * found[rival].rms:.3g} mm ({pair.verdict}); "
            f"estimated {1e3 * best:.3g} mm"
        ),
        value=pair.ratio,
        n=len(found[rival].errors),
        threshold=f"2 % and {SIGMAS:.2f} sigma (mean log ratio is {pair.deviate:+.1f} sigma)",
        holds=pair.verdict == "smaller",
        remark="it makes the stated uncertainty true, not the error small (derivations 5.2)",
    )


MAPPING_SECONDS = 60.0
AMPLITUDE = 10.0
"""Range of the line, ± m/s²."""
WITHIN = math.sqrt(-2.0 * math.log(ALPHA))
"""Half-width in sigma of a band that holds a whole curve of two coefficients (Scheffé): chi-square of 2 is 2 ln 1/p."""


def mapping_item(plan: Plan) -> tuple[Item, Fit]:
    """The curve of a curved and of a straight sensor; the fit of the curved one for the figure."""
    curved, straight = (
        fitted(plan, name, sensor) for name, sensor in (("curved", CUBIC_SENSOR), ("straight", LINEAR_SENSOR))
    )
    item = Item(
        name="mapping",
        title=f"Deviation from a straight line within ±{AMPLITUDE:g} m/s², ADXL105, {MAPPING_SECONDS:g} s",
        source="Fig. 3",
        rows=(
            curve_row("the fitted curve is that of a sensor with K2 = -1e-3, K3 = 1e-4", curved, CUBIC_SENSOR),
            curve_row("a straight sensor has a straight curve", straight, LINEAR_SENSOR),
        ),
    )
    return item, curved


def fitted(plan: Plan, name: str, sensor: Mapping[str, float]) -> Fit:
    """A cubic model on one record of a sensor."""
    rng = plan.repeat(f"mapping {name}", 1, lambda rng: rng)[0]
    made = simulate("tones", seconds=MAPPING_SECONDS, rig=ADXL105_RIG, parameters=sensor, rng=rng, a_rms=4.0)
    return estimate(Model.cubic(), made.recording)


def true_deviation(sensor: Mapping[str, float], a: Array) -> Array:
    """What a line leaves of K2 a² + K3 a³ at equally spaced accelerations (n,) m/s²."""
    y = sum((sensor.get(name, 0.0) * a**power for power, name in enumerate(polynomial(3), 2)), np.zeros(len(a)))
    return np.asarray(y - np.polynomial.Polynomial.fit(a, y, 1)(a))


def curve_row(claim: str, fit: Fit, sensor: Mapping[str, float]) -> Row:
    """Whether the curve of a fit is that of a sensor."""
    line = straight_line(fit, -AMPLITUDE, AMPLITUDE)
    truth = true_deviation(sensor, line.a)
    at = line.largest
    worst = float(np.max(np.abs(line.deviation - truth) / line.deviation_std))
    return Row(
        by="us",
        claim=claim,
        expected=f"{1e3 * truth[at]:+.3g} mm/s² at {line.a[at]:+.3g} m/s²",
        measured=f"{1e3 * line.deviation[at]:+.3g} ± {2e3 * line.deviation_std[at]:.2g} mm/s²; worst {worst:.1f} sigma",
        value=worst,
        n=1,
        threshold=f"the whole curve within {WITHIN:.2f} sigma",
        holds=worst < WITHIN,
        remark="band of 2 sigma",
    )
