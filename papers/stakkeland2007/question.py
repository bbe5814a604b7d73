"""The paper's open question, why did the linear model track better than a cubic one with significant terms (IV)?

Two answers, each an experiment. A coefficient that is fitted adds its uncertainty to the drift whether the sensor has
it or not: K2 and K3 of the paper's size are at break-even on an ADXL105. And an effect that is neither can make both
significant: here an output growing with v², as the rectified vibration of ball bearings does, which a fit on
point-to-point moves mistakes for curvature of the sensor. On a motion with larger accelerations that model tracks
several times worse, and `diagnose` names the right cause.

Then standard tests beside the motion, and parameter estimates over time (Figs. 3 to 5, III-B).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from accelcal.calibration.characteristic import straight_line
from accelcal.data import STANDARD_GRAVITY, Array, Channel, Recording, Rig, root_mean_square as rms
from accelcal.data.orientation import on_arm
from accelcal.demo import with_effect
from accelcal.diagnosis.experiment.drift_bandwidth import DWELL, DWELLS, TURN, tumble
from accelcal.effects import BUILT_IN, find, polynomial
from accelcal.estimation.estimate import Fit, estimate, estimate_dwells
from accelcal.estimation.run import prepare
from accelcal.filters.choice import FilterChoice, GaussMarkov
from accelcal.model import Model
from accelcal.simulation.motion import Motion
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, Simulated, simulate
from accelcal.validation.consistency import Consistency, consistency, nees
from accelcal.validation.prediction import Prediction, rms as drift_rms
from accelcal.verbs import add, diagnose
from papers.stakkeland2007.rows import (
    ACCEL_RATE,
    ACI,
    ALPHA,
    CURVED_SENSOR,
    CWPA,
    LARGEST,
    LINEAR_SENSOR,
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

SECONDS = 60.0
HORIZON = 5.0
"""Time without position, s."""
CURVATURE = {"quadratic": -1e-4, "cubic": 1e-5}
"""K2 and K3 as in III-A2: below the detection limits of an ADXL105 on this motion."""
PLAIN = 10.0
"""Multiple of `CURVATURE` that this motion shows."""
BREAK_EVEN = 2.0
"""Two drifts within this factor of each other: neither model is to be preferred."""
WINDAGE = 0.2
"""Coefficient of v², m/s² per (m/s)²: 2 mm/s² at 0.1 m/s, as a vibration of 2 m/s² rectified by K2 = 1e-3 gives."""


def noise_free(rig: Rig) -> Rig:
    """The rig with a noise-free sensor: its drift is the error of the model alone."""
    return replace(rig, sensor=replace(rig.sensor, noise=0.0))


@dataclass(frozen=True, slots=True)
class Drifts:
    """Error after `HORIZON` without position on a motion that no fit has seen, one figure per record, m."""

    linear: Array
    cubic: Array
    named: Array
    """Of the model with the effect that `diagnose` names first; empty where that is not run."""
    snr: Array
    """sqrt of the gain of K2 and K3 together, by their own covariance."""
    names: tuple[tuple[str, ...], ...]
    """Effects that `diagnose` names in each record."""


def question_item(plan: Plan) -> Item:
    """Linear against cubic when the sensor is curved too little, plainly, or not at all."""
    few, many = plan.runs(2, 24), plan.runs(2, 12)
    absent, small, large = (curved(plan, times, few) for times in (0.0, 1.0, PLAIN))
    windy = windage(plan, many)
    named = sum(names[:1] == ("velocity_squared",) for names in windy.names)
    return Item(
        name="question",
        title=f"Linear against cubic: drift {HORIZON:g} s after position is withheld, on another motion",
        source="IV, Table III and Fig. 5",
        rows=(
            _pair("K2, K3 that are fitted but absent cost drift", absent, "linear", "cubic"),
            _even("K2, K3 of the paper are at break-even, ADXL105", small),
            _pair(f"the cubic model tracks better when they are {PLAIN:g} times as large", large, "cubic", "linear"),
            Row(
                by="us",
                claim="an output growing with v² makes K2, K3 significant, though the sensor has neither",
                expected=f"median beyond {SIGMAS:.2f} sigma",
                measured=f"{np.median(windy.snr):.1f} sigma ({np.min(windy.snr):.1f} to {np.max(windy.snr):.1f})",
                value=float(np.median(windy.snr)),
                n=many,
                threshold=f"{SIGMAS:.2f} sigma",
                holds=bool(np.median(windy.snr) > SIGMAS),
                remark="CXL02, fitted on moves",
            ),
            _pair("the linear model then tracks better than the significant cubic one", windy, "linear", "cubic"),
            Row(
                by="us",
                claim="the diagnosis names velocity_squared instead",
                expected=f"{many} of {many}",
                measured=f"{named} of {many}",
                value=named / many,
                n=many,
                threshold="all",
                holds=named == many,
            ),
            _pair("with it the model tracks better than both", windy, "named", "linear"),
        ),
    )


def curved(plan: Plan, times: float, runs: int) -> Drifts:
    """A sensor with `times` the curvature of III-A2, fitted on one motion and followed on another."""
    sensor = LINEAR_SENSOR | {name: times * value for name, value in CURVATURE.items()}

    def once(rng: np.random.Generator) -> tuple[float, float, float]:
        train, test = (
            simulate("interleaved", seconds=SECONDS, rig=rig, parameters=sensor, rng=rng).recording
            for rig in (ADXL105_RIG, noise_free(ADXL105_RIG))
        )
        linear, cubic = estimate(Model.linear(), train), estimate(Model.cubic(), train)
        return drift(linear, test), drift(cubic, test), snr(cubic)

    linear, cubic, heldout = np.array(plan.repeat(f"question {times:g}", runs, once)).T
    return Drifts(linear, cubic, np.empty(0), heldout, ())


def windage(plan: Plan, runs: int) -> Drifts:
    """A linear sensor on a stage whose output gains `WINDAGE` v²."""
    effect = find("velocity_squared")

    def once(rng: np.random.Generator) -> tuple[float, float, float, float, tuple[str, ...]]:
        rows = [
            simulate(motion, seconds=SECONDS, rig=rig, parameters=LINEAR_SENSOR, rng=rng)
            for motion, rig in (("moves", CXL02_RIG), ("interleaved", noise_free(CXL02_RIG)))
        ]
        origins = prepare(rows[0].recording).origins
        train, test = (with_effect(record, effect, WINDAGE, {}, origins) for record in rows)
        linear, cubic = estimate(Model.linear(), train), estimate(Model.cubic(), train)
        named = diagnose(linear, train).effects
        grown = add(linear, train, *named[:1])
        return drift(linear, test), drift(cubic, test), drift(grown, test), snr(cubic), named

    result = plan.repeat("question windage", runs, once)
    linear, cubic, last, heldout = (np.array([run[i] for run in result]) for i in range(4))
    return Drifts(linear, cubic, last, heldout, tuple(run[4] for run in result))


def drift(fit: Fit, recording: Recording) -> float:
    """rms coasting error over one recording, m."""
    value = drift_rms(Prediction.of(fit, recording).at_horizon(HORIZON).rezeroed)
    assert value is not None  # the record is longer than the horizon
    return value


def snr(fit: Fit) -> float:
    """sqrt(theta' C⁻¹ theta) of K2 and K3."""
    free = [estimate.name for estimate in fit.free]
    i = [free.index(name) for name in ("quadratic", "cubic")]
    theta = np.array([fit.free[k].value for k in i])
    return float(np.sqrt(theta @ np.linalg.solve(fit.covariance[np.ix_(i, i)], theta)))


def _pair(claim: str, drifts: Drifts, better: str, worse: str) -> Row:
    first, second = getattr(drifts, better), getattr(drifts, worse)
    pair = paired(first, second)
    return Row(
        by="us",
        claim=claim,
        expected=f"{better} below {worse}",
        measured=f"{rms(first) * 1e3:.3g} mm against {rms(second) * 1e3:.3g} mm",
        value=pair.ratio,
        n=len(first),
        threshold=f"below 1 (mean log ratio is {pair.deviate:+.1f} sigma)",
        holds=pair.ratio < 1.0,
        remark=f"K2, K3 at {np.median(drifts.snr):.1f} sigma",
    )


def _even(claim: str, drifts: Drifts) -> Row:
    pair = paired(drifts.linear, drifts.cubic)
    return Row(
        by="us",
        claim=claim,
        expected=f"linear over cubic between 1/{BREAK_EVEN:g} and {BREAK_EVEN:g}",
        measured=f"{rms(drifts.linear) * 1e3:.3g} mm against {rms(drifts.cubic) * 1e3:.3g} mm",
        value=pair.ratio,
        n=len(drifts.linear),
        threshold=f"a factor of {BREAK_EVEN:g}",
        holds=1.0 / BREAK_EVEN < pair.ratio < BREAK_EVEN,
        remark=f"K2, K3 at {np.median(drifts.snr):.1f} sigma",
    )


TEST_SECONDS = 60.0
"""Of the motion."""
LEVEL, HEAD = math.radians(0.05), math.radians(0.001)
"""Angles as the paper levels its rig, and of a dividing head of 3.6 arc seconds."""
TRUTH = {"bias": 0.05, "scale_factor": 0.01, **dict(zip(polynomial(3), (1e-4, 1e-5), strict=True))}
AMPLITUDE = 15.0
"""Of the vibration test, m/s²."""
SHAKEN = 60.0
"""Its length, s."""
RIGS = {"ADXL105": ADXL105_RIG, "CXL02": CXL02_RIG}
SYMBOLS = dict(zip(TRUTH, ("K0", "k", "K2", "K3"), strict=True))


def standard_tests_item(plan: Plan) -> Item:
    """What tumble, vibration test and motion need and reach."""
    rows: list[Row] = []
    for name, rig in RIGS.items():
        result = plan.repeat(f"standard tests {name}", 1, lambda rng, rig=rig: tested(rng, rig))[0]  # type: ignore[misc]
        rows += (parameter_row(name, result, item) for item in TRUTH)
        rows += (angle_row(name, rig, result), vibration_row(name, rig, result))
    return Item(
        name="standard_tests",
        title=f"Tumble of {DWELLS} dwells of {DWELL:g} s, motion of {TEST_SECONDS:g} s, both in one fit",
        source="abstract, I",
        rows=tuple(rows),
    )


def tested(rng: np.random.Generator, rig: Rig) -> dict[str, Fit]:
    """One sensor through all tests: tumbles with angles of the paper's level (rough) and of a dividing head (fine), a
    motion, and both, the motion with the fine tumble.
    """
    plain = replace(rig, lowpass=None)
    run = simulate("tones", seconds=TEST_SECONDS, rig=plain, parameters=TRUTH, rng=rng).recording
    rough, fine = (tumble(TRUTH, plain, angle_std=angle, rng=rng) for angle in (LEVEL, HEAD))
    model = Model.cubic()
    return {
        "rough": estimate_dwells(model, rough),
        "fine": estimate_dwells(model, fine),
        "motion": estimate(model, run),
        "both": estimate(model, run.with_dwells(fine)),
    }


def parameter_row(name: str, results: Mapping[str, Fit], text: str) -> Row:
    """Uncertainty of one parameter by every test, and whether all of them hold the truth."""
    std = [fit[text].std for fit in results.values()]
    worst = max(abs(fit[text].value - TRUTH[text]) / fit[text].std for fit in results.values())
    minutes = DWELLS * (DWELL + TURN) / 60.0
    unit = results["motion"][text].unit.removeprefix("1")
    return Row(
        by="us",
        claim=f"{name}, {SYMBOLS[text]}: a motion and a tumble together are as certain as the better of the two",
        expected=f"within {LARGEST:g} standard deviations of the truth",
        measured=(
            f"tumble {minutes:.0f} min: {std[0]:.2g} (angles 0.05 deg), {std[1]:.2g} (0.001 deg); motion "
            f"{TEST_SECONDS / 60.0:g} min: {std[2]:.2g}; both {std[3]:.2g} {unit}; largest error {worst:.1f} sigma"
        ),
        value=std[2] / std[1],
        n=len(results),
        threshold=f"errors below {LARGEST:g} sigma; u(both) <= 1.05 of the less",
        holds=bool(worst < LARGEST and (std[3] <= 1.05 * min(std[1], std[2]) or text == "bias")),
        remark="a level motion shows K0 + g tilt, which the tumble separates" if text == "bias" else "",
    )


def angle_row(name: str, rig: Rig, results: Mapping[str, Fit]) -> Row:
    """The paper's claim for the scale factor: how exact the angles of a tumble must be to reach the motion."""
    wanted = results["motion"]["scale_factor"].std
    plain = replace(rig, lowpass=None)

    def missed(log_angle: float) -> float:
        dwells = tumble(TRUTH, plain, angle_std=math.exp(log_angle))
        return math.log(estimate_dwells(Model.cubic(), dwells)["scale_factor"].std / wanted)

    ends = math.log(math.radians(1e-5)), math.log(math.radians(5.0))
    possible = missed(ends[0]) < 0.0
    degrees = math.degrees(math.exp(scipy.optimize.brentq(missed, *ends, xtol=1e-3))) if possible else 0.0
    minutes = DWELLS * (DWELL + TURN) / 60.0
    return Row(
        by="paper",
        claim=f"{name}: a simpler alternative to tumble tests",
        expected=f"u(k) of a tumble in {TEST_SECONDS / 60.0:g} min without known angles",
        measured=f"u(k) = {wanted:.2g}; a tumble of {minutes:.0f} min needs angles to {degrees:.2g} deg for it",
        value=degrees,
        n=1,
        threshold="less time than the tumble, whose angles are better than 0.05 deg",
        holds=degrees < math.degrees(LEVEL),
        remark="one uncertainty for all angles, independent from dwell to dwell; the zero of the angles is estimated",
    )


def vibration_row(name: str, rig: Rig, results: Mapping[str, Fit]) -> Row:
    """K2 from the mean of a vibration test: mean = K0 + K2 A²/2."""
    noise = rig.sensor.noise or 0.0
    std = math.sqrt(2.0) * math.sqrt(0.5 * noise**2 / SHAKEN) * 2.0 / AMPLITUDE**2  # with and without vibration
    quadratic = polynomial(2)[0]
    motion = results["motion"][quadratic].std
    rng = np.random.default_rng(1)
    t = np.arange(0.0, SHAKEN, 1e-3)
    a = AMPLITUDE * np.sin(2.0 * np.pi * 80.0 * t)
    K0, k, K2, K3 = TRUTH.values()
    white = noise * math.sqrt(0.5 / 1e-3)
    shaken = np.mean(K0 + (1.0 + k) * a + K2 * a**2 + K3 * a**3 + white * rng.standard_normal(len(t)))
    still = np.mean(K0 + white * rng.standard_normal(len(t)))
    estimated = 2.0 * float(shaken - still) / AMPLITUDE**2
    sigma = abs(estimated - K2) / std
    return Row(
        by="us",
        claim=f"{name}, K2: the mean of a vibration test, K0 + K2 A²/2",
        expected=f"K2 = {K2:g} within {LARGEST:g} standard deviations",
        measured=f"{estimated:.3g} ± {std:.1g} after 2 x {SHAKEN:g} s at {AMPLITUDE:g} m/s²; motion ± {motion:.1g}",
        value=estimated,
        n=1,
        threshold=f"below {LARGEST:g} sigma ({sigma:.1f})",
        holds=sigma < LARGEST,
        remark="it takes a bias that does not change between shaking and rest",
    )


ARM, ARM_STD = 0.2, 1e-4
"""Of the centrifuge, and how well its length is measured, m."""
ANGLE_STD = 1e-5
"""Noise of its encoder, rad."""
SPEEDS, FULL = 12, 0.95
"""Speeds of the centrifuge, of which the last takes the sensor to this share of its range."""


def centrifuge_item(plan: Plan) -> Item:
    """An arm about a level axle, on an angle encoder, against the stage: the same sensor, noise and length."""
    rows: list[Row] = []
    for name, rig in RIGS.items():
        fits = plan.repeat(f"centrifuge {name}", 1, lambda rng, rig=rig: turned(rng, rig))[0]  # type: ignore[misc]
        rows += [centrifuge_row(name, fits, item) for item in ("scale_factor", *polynomial(3))]
    return Item(
        name="centrifuge",
        title=f"Arm of {1e3 * ARM:g} ± {1e3 * ARM_STD:g} mm at {SPEEDS} speeds and stage, {TEST_SECONDS:g} s each",
        source="abstract, I",
        rows=tuple(rows),
    )


def turned(rng: np.random.Generator, rig: Rig) -> dict[str, Fit]:
    """One sensor on the stage, and radially on an arm that steps through twelve speeds."""
    plain = replace(rig, lowpass=None)
    run = simulate("tones", seconds=TEST_SECONDS, rig=plain, parameters=TRUTH, rng=rng).recording
    return {"stage": estimate(Model.cubic(), run), "arm": estimate(Model.cubic(), on_centrifuge(rng, plain))}


def on_centrifuge(rng: np.random.Generator, rig: Rig) -> Recording:
    """The record of a sensor that reads -r rate² + g sin(angle)."""
    t = np.arange(0.0, TEST_SECONDS, 1.0 / ACCEL_RATE)
    fastest = math.sqrt((FULL * (rig.sensor.range or math.inf) - STANDARD_GRAVITY) / ARM)
    place = t / TEST_SECONDS * SPEEDS
    changing = np.clip((place % 1.0 - 0.4) / 0.6, 0.0, 1.0)  # two fifths at each speed, then on to the next
    rate = fastest * np.minimum(
        1.0, (place // 1.0 + 1.0 + changing**3 * (10.0 - 15.0 * changing + 6.0 * changing**2)) / SPEEDS
    )
    angle = scipy.integrate.cumulative_simpson(rate, x=t, initial=0.0)
    a = STANDARD_GRAVITY * np.sin(angle) - ARM * rate**2
    K0, k, K2, K3 = TRUTH.values()
    output = K0 + (1.0 + k) * a + K2 * a**2 + K3 * a**3
    output += (rig.sensor.noise or 0.0) * math.sqrt(0.5 * ACCEL_RATE) * rng.standard_normal(len(t))
    read = slice(None, None, 2)
    readings = angle[read] + ANGLE_STD * rng.standard_normal(len(t[read]))
    motion = on_arm(t[read], readings, ARM, 0.0, np.array([1.0, 0.0, 0.0]))
    level = float(np.mean(motion.gravity.y))
    on_rig = replace(rig, arm=ARM, arm_std=ARM_STD, axle=0.0, gravity_along_axis=level, resolution=None)
    return Recording(Channel("accel", t, output, "m/s^2"), motion.path, side=motion.side, rig=on_rig)


def centrifuge_row(name: str, fits: Mapping[str, Fit], text: str) -> Row:
    """Uncertainty of one parameter by both rigs, and whether both hold the truth."""
    stage, arm = (fits[rig][text] for rig in ("stage", "arm"))
    worst = max(abs(e.value - TRUTH[text]) / e.std for e in (stage, arm))
    unit = stage.unit.removeprefix("1")
    return Row(
        by="us",
        claim=f"{name}, {SYMBOLS[text]}: stage and arm agree with the truth",
        expected=f"within {LARGEST:g} standard deviations of the truth",
        measured=f"stage {stage.std:.2g}, arm {arm.std:.2g} {unit}".strip() + f"; largest error {worst:.1f} sigma",
        value=stage.std / arm.std,
        n=2,
        threshold=f"errors below {LARGEST:g} sigma",
        holds=bool(worst < LARGEST),
        remark="the stage needs a place to 1 um, the arm a level axle and slip rings",
    )


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


ParameterTracks = tuple[ParameterTrack, ...]


def tracks_item(plan: Plan) -> tuple[Item, tuple[ParameterTracks, ParameterTracks]]:
    """Figs. 4 and 5, each of ACI and CWPA, and whether their bands end on the truth."""
    linear = parameter_tracks(plan, "linear", LINEAR_SENSOR, 130.0)
    cubic = parameter_tracks(plan, "cubic", CURVED_SENSOR, 250.0)
    rows = tuple(_row(figure, track) for figure, tracks in (("Fig. 4", linear), ("Fig. 5", cubic)) for track in tracks)
    item = Item(
        name="tracks",
        title="Parameter tracks with 2-sigma bands, simulated ADXL105 without low-pass",
        source="III-B, Figs. 4 and 5",
        rows=rows,
    )
    return item, (linear, cubic)


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
    complete: Array
    """The same with the process in the model."""


def varying_item(plan: Plan) -> Item:
    """Significance, drift and name."""
    runs = plan.runs(3, 24)
    result = outcomes(plan, runs)
    pair = paired(result.linear, result.cubic)
    worst, least = rms(result.plain), rms(result.complete)
    p_value = float(scipy.special.chdtrc(2 * runs, np.sum(result.snr**2)))
    return Item(
        name="varying",
        title=f"Linear sensor whose scale factor varies by {SIGMA:g} within {TAU:g} s, ADXL105",
        source="IV, II-D",
        rows=(
            Row(
                "us",
                "K2, K3 that the sensor has not exceed their covariance when the scale factor varies",
                f"chi-square of all runs beyond p = {ALPHA:g}",
                f"{np.min(result.snr):.1f} to {np.max(result.snr):.1f} sigma, p = {p_value:.1g}",
                p_value,
                runs,
                f"{ALPHA:g}",
                holds=p_value < ALPHA,
            ),
            Row(
                "us",
                "the linear model then tracks better than the cubic one",
                "linear below cubic",
                f"{1e3 * rms(result.linear):.3g} mm against {1e3 * rms(result.cubic):.3g} mm",
                pair.ratio,
                runs,
                f"below 1 (mean log ratio is {pair.deviate:+.1f} sigma)",
                holds=pair.ratio < 1.0,
            ),
            Row(
                "us",
                "the diagnosis names the process, or confounds it with a drift or step",
                f"{runs} of {runs}",
                f"{int(np.sum(result.named))} of {runs}",
                float(np.mean(result.named)),
                runs,
                "all",
                holds=bool(np.all(result.named)),
            ),
            Row(
                "us",
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
            simulate("tones", seconds=VARYING_SECONDS, rig=ADXL105_RIG, parameters=LINEAR_SENSOR, rng=rng), rng
        ).recording
        test = simulate(
            "interleaved", seconds=VARYING_SECONDS, rig=noise_free(ADXL105_RIG), parameters=LINEAR_SENSOR, rng=rng
        ).recording
        linear, cubic = estimate(Model.linear(), train), estimate(Model.cubic(), train)
        missing = diagnose(linear, train).scan.detected
        named = bool(missing) and not PROCESSES.isdisjoint(missing[0].members)
        fit = estimate(missing[0].enter(linear.model), train) if named else linear
        error, rest = (f["scale_factor"].value - LINEAR_SENSOR["scale_factor"] for f in (linear, fit))
        return (
            drift(linear, test),
            drift(cubic, test),
            snr(cubic),
            float(named),
            error / linear["scale_factor"].std,
            rest / fit["scale_factor"].std,
        )

    return Outcomes(*np.array(plan.repeat("varying", runs, once)).T)


def varied(simulated: Simulated, rng: np.random.Generator) -> Simulated:
    """The record with a scale factor that varies: k(t) a(t) added to the output, k by its exact recursion."""
    accel = simulated.recording.accel
    keep = float(np.exp(-np.median(np.diff(accel.t)) / TAU))
    k = np.empty(len(accel.t))
    k[0] = SIGMA * rng.standard_normal()
    for i, shock in enumerate(SIGMA * np.sqrt(1.0 - keep**2) * rng.standard_normal(len(k) - 1), 1):
        k[i] = keep * k[i - 1] + shock
    y = accel.y + k * simulated.truth.motion.acceleration(accel.t)
    recording = replace(simulated.recording, accel=replace(accel, y=y), digest=f"varied {rng.integers(1 << 60)}")
    return replace(simulated, recording=recording)


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
        recording = record(rng, rig, curved=curved)
        cut_record = cut(recording.recording)
        return [judged(design, recording, cut_record, rig) for design in designs.values()]

    values = np.array(plan.repeat(world, runs, once))
    return {
        name: Reached(values[:, i, 0], consistency(values[:, i, 1], 2, 1.0 - ALPHA)) for i, name in enumerate(designs)
    }


def record(rng: np.random.Generator, rig: Rig, *, curved: bool) -> Simulated:
    """A record of one world."""
    K2, K3 = CURVATURE_SIGMAS * rng.standard_normal(2) if curved else (0.0, 0.0)
    sensor = {"bias": 0.05, "quadratic": K2, "cubic": K3}
    simulation = simulate("tones", seconds=SEEN + GAP, rig=rig, parameters=sensor, rng=rng, position_noise=0.0)
    return simulation if curved else varied(simulation, rng)


def cut(recording: Recording) -> Recording:
    """Without the positions of the last second."""
    position = recording.position
    inside = position.t < SEEN
    return replace(recording, position=replace(position, t=position.t[inside], y=position.y[inside]))


def judged(design: Design, simulated: Simulated, recording: Recording, rig: Rig) -> tuple[float, float]:
    """Position error (m) and NEES of position and velocity at the end."""
    choice, truth = design.choice, simulated.truth
    sigmas = dict(zip(choice.states(), prior_sigmas(choice), strict=True)) | dict(design.sigmas)
    prior = np.array(list(sigmas.values()))
    track = filtered(choice, recording, tuned(truth, rig), start(choice, truth), prior, parameters=design.processes)
    error = track.states[-1, :2] - truth.motion.derivatives(track.times[-1:])[:2, 0]
    return abs(float(error[0])), float(nees(error, track.covariance[:2, :2]))


def _nees_row(claim: str, result: Reached, verdict: str) -> Row:
    low, high = result.consistency.low, result.consistency.high
    return Row(
        by="us",
        claim=claim,
        expected="2" if verdict == "consistent" else f"above {high:.2f}",
        measured=f"NEES of p, v {result.consistency.mean:.3g}; position error {1e3 * rms(result.errors):.3g} mm rms",
        value=result.consistency.mean,
        n=result.consistency.runs,
        threshold=f"{1.0 - ALPHA:.1%} region {low:.2f} to {high:.2f}",
        holds=result.consistency.verdict == verdict,
    )


def _error_row(claim: str, results: Mapping[str, Reached], rival: str) -> Row:
    pair = paired(results["considered"].errors, results[rival].errors)
    size = {name: 1e3 * rms(design.errors) for name, design in results.items()}
    return Row(
        by="paper",
        claim=claim,
        expected=f"considered below {rival}",
        measured=(
            f"{size['considered']:.3g} mm against {size[rival]:.3g} mm ({pair.verdict}); estimated "
            f"{size['estimated']:.3g} mm"
        ),
        value=pair.ratio,
        n=len(results[rival].errors),
        threshold=f"2 % and {SIGMAS:.2f} sigma (mean log ratio is {pair.deviate:+.1f} sigma)",
        holds=pair.verdict == "smaller",
        remark="it makes the stated uncertainty true, not the error small (derivations 5.2)",
    )


MAPPING_SECONDS = 60.0
LINE_AMPLITUDE = 10.0
"""Range of the line, ± m/s²."""
WITHIN = math.sqrt(-2.0 * math.log(ALPHA))
"""Half-width in sigma of a band that holds a whole curve of two coefficients (Scheffé): chi-square of 2 is 2 ln 1/p."""


def mapping_item(plan: Plan) -> tuple[Item, Fit]:
    """The curve of a curved and of a straight sensor; the fit of the curved one for the figure."""
    curved, straight = (
        fitted(plan, name, sensor) for name, sensor in (("curved", CURVED_SENSOR), ("straight", LINEAR_SENSOR))
    )
    item = Item(
        name="mapping",
        title=f"Deviation from a straight line within ±{LINE_AMPLITUDE:g} m/s², ADXL105, {MAPPING_SECONDS:g} s",
        source="Fig. 3",
        rows=(
            curve_row("the fitted curve is that of a sensor with K2 = -1e-3, K3 = 1e-4", curved, CURVED_SENSOR),
            curve_row("a straight sensor has a straight curve", straight, LINEAR_SENSOR),
        ),
    )
    return item, curved


def fitted(plan: Plan, name: str, sensor: Mapping[str, float]) -> Fit:
    """A cubic model on one record of a sensor."""
    rng = plan.repeat(f"mapping {name}", 1, lambda rng: rng)[0]
    simulation = simulate("tones", seconds=MAPPING_SECONDS, rig=ADXL105_RIG, parameters=sensor, rng=rng, a_rms=4.0)
    return estimate(Model.cubic(), simulation.recording)


def true_deviation(sensor: Mapping[str, float], a: Array) -> Array:
    """What a line leaves of K2 a² + K3 a³ at equally spaced accelerations (n,) m/s²."""
    y = sum((sensor.get(name, 0.0) * a**power for power, name in enumerate(polynomial(3), 2)), np.zeros(len(a)))
    return np.asarray(y - np.polynomial.Polynomial.fit(a, y, 1)(a))


def curve_row(claim: str, fit: Fit, sensor: Mapping[str, float]) -> Row:
    """Whether the curve of a fit is that of a sensor."""
    line = straight_line(fit, -LINE_AMPLITUDE, LINE_AMPLITUDE)
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
