"""The paper's first answer to its open question (IV): "relatively high frequency variations in the parameters".

A linear sensor whose scale factor is a Gauss-Markov process is fitted with the linear and the cubic model. K2 and K3,
which it has not, come out beyond what their covariance allows, and on another motion the linear model tracks better.
The product names the process, and with it k and its uncertainty agree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.effects import BUILT_IN
from accelcal.estimation.estimate import estimate
from accelcal.model import Model
from accelcal.paper.question import BASE, drift, noise_free, snr
from accelcal.paper.rows import ALPHA, Item, Plan, Row, paired
from accelcal.simulation.sensor import ADXL105_RIG, Simulated, simulate
from accelcal.workflow import diagnose

SIGMA, TAU = 0.01, 0.5
"""Standard deviation and correlation time (s) of the scale factor."""
SECONDS = 60.0
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
            _row(
                "K2, K3 that the sensor has not exceed their covariance when the scale factor varies",
                f"chi-square of all runs beyond p = {ALPHA:g}",
                f"{np.min(found.snr):.1f} to {np.max(found.snr):.1f} sigma, p = {p_value:.1g}",
                p_value,
                runs,
                f"{ALPHA:g}",
                holds=p_value < ALPHA,
            ),
            _row(
                "the linear model then tracks better than the cubic one",
                "linear below cubic",
                f"{1e3 * _rms(found.linear):.3g} mm against {1e3 * _rms(found.cubic):.3g} mm",
                pair.ratio,
                runs,
                f"below 1 (mean log ratio is {pair.deviate:+.1f} sigma)",
                holds=pair.ratio < 1.0,
            ),
            _row(
                "the loop names the process, or confounds it with a drift or step",
                f"{runs} of {runs}",
                f"{int(np.sum(found.named))} of {runs}",
                float(np.mean(found.named)),
                runs,
                "all",
                holds=bool(np.all(found.named)),
            ),
            _row(
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
        train = varied(simulate("tones", seconds=SECONDS, rig=ADXL105_RIG, parameters=BASE, rng=rng), rng).recording
        test = simulate("interleaved", seconds=SECONDS, rig=noise_free(ADXL105_RIG), parameters=BASE, rng=rng).recording
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


def _row(claim: str, expected: str, measured: str, value: float, n: int, threshold: str, *, holds: bool) -> Row:
    return Row("us", claim, expected, measured, value, n, threshold, bool(holds))


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))
