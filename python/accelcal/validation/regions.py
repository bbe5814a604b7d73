"""Where a residual is large: its rms by position, velocity and acceleration, and what lies beyond the fitted range."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from accelcal.data.arrays import Array, Flags
from accelcal.effects.building_blocks import since_reversal
from accelcal.estimation.estimate import Fit
from accelcal.signals.signals import Signals
from accelcal.validation.comparison import BINS, Bins, Outside
from accelcal.validation.prediction import Coasting, Prediction, rms
from accelcal.validation.worst import seen_at


def bin_residual(ahead: Prediction, t: Array, residual: Array, motion: Signals, band: float) -> list[Bins]:
    """Mean residual against time and every variable of the motion."""
    run, noise = ahead.run, ahead.noise
    slow = float(ahead.reference_noise.as_acceleration(np.zeros(1))[0])
    density = (2.0 * noise.usual.q + slow) * ahead.values.scale**2  # one-sided, of the output
    # The mean of T seconds of noise with that density has variance density/(2 T).
    step = run.reading_step
    variables = {
        "time": (t, "s"),
        "position": (motion.p + run.origins.p, "m"),
        "velocity": (motion.v, "m/s"),
        "acceleration": (motion.a, "m/s²"),
        "jerk": (motion.jerk, "m/s³"),
        "time since reversal": (since_reversal(motion), "s"),
        **{name: (y + run.origins.of(name), run.recording.side[name].unit) for name, y in motion.side.items()},
    }
    found = []
    for name, (x, unit) in variables.items():
        known = np.isfinite(x)
        if not known.any():
            continue
        low, high = (float(v) for v in np.quantile(x[known], [0.001, 0.999]))
        if not high > low:
            continue
        edges = np.linspace(low, high, BINS + 1)
        index = np.clip(np.searchsorted(edges, x[known], side="right") - 1, 0, BINS - 1)
        count = np.bincount(index, minlength=BINS)
        total = np.bincount(index, weights=residual[known], minlength=BINS)
        mean = np.divide(total, count, out=np.zeros(BINS), where=count > 0)
        std = np.sqrt(np.divide(density, 2.0 * step * count, out=np.zeros(BINS), where=count >= 1.0 / (band * step)))
        at = np.full(len(x), -1)
        at[known] = index
        found.append(Bins(name, unit, edges, mean, std, seen_at(t, residual, at, mean)))
    return found


def beyond(fit: Fit, motion: Signals) -> tuple[str, ...]:
    """Sentences on variables of this run outside their fitted range."""
    sentences = []
    for key, (y, unit) in fitted_variables(fit, motion).items():
        low, high = fit.validity[key]
        share = float(np.mean((y < low) | (y > high)))
        if share > 0.001:
            span = f"[{low:.4g}, {high:.4g}] {unit}".rstrip()
            sentences.append(f"{100 * share:.1f} % of this run lies outside the fitted range of {key} {span}")
    return tuple(sentences)


def fitted_variables(fit: Fit, motion: Signals) -> dict[str, tuple[Array, str]]:
    """Variables of the motion that have a fitted range, with their units."""
    variables = {"a": (motion.a, "m/s²"), "v": (motion.v, "m/s"), "p": (motion.p + fit.origins.p, "m")}
    variables |= {
        name: (y + fit.origins.of(name), "degC" if name == "temperature" else "") for name, y in motion.side.items()
    }
    return {key: value for key, value in variables.items() if key in fit.validity}


def outside(
    fit: Fit, ahead: Prediction, t: Array, motion: Signals, coasting: Mapping[float, Coasting]
) -> tuple[Outside, ...]:
    """Count and errors of the readings outside the fitted ranges; empty where no range is known.

    Parameters
    ----------
    t : (n,) s, times of `motion`.
    coasting : drift by horizon. A window that leaves the range at any reading counts as outside.
    """
    run, variables = ahead.run, fitted_variables(fit, motion)
    if len(t) == 0 or not variables:
        return ()
    at = np.clip(np.searchsorted(t, run.t - 0.5 * run.reading_step), 0, len(t) - 1)
    known = ahead.counts & (np.abs(t[at] - run.t) <= run.reading_step)
    flags = {}
    for key, (y, _) in variables.items():
        low, high = fit.validity[key]
        flags[key] = known & ((y < low) | (y > high))[at]
    found = [
        scored(ahead, known, flags[key], coasting, key, unit, fit.validity[key]) for key, (_, unit) in variables.items()
    ]
    return (*found, scored(ahead, known, np.any(list(flags.values()), axis=0), coasting, "any", "", None))


def scored(
    ahead: Prediction,
    known: Flags,
    out: Flags,
    coasting: Mapping[float, Coasting],
    variable: str,
    unit: str,
    span: tuple[float, float] | None,
) -> Outside:
    """Errors inside and outside of a range."""
    left = np.cumsum(out)
    leaves = {h: left[c.ends] > left[c.starts] for h, c in coasting.items()}
    return Outside(
        variable=variable,
        unit=unit,
        range=span,
        count=int(out.sum()),
        of=int(known.sum()),
        one_step=(rms(ahead.e[known & ~out]), rms(ahead.e[out])),
        coast={h: (rms(c.rezeroed[~leaves[h]]), rms(c.rezeroed[leaves[h]])) for h, c in coasting.items()},
        starts={h: (int(np.sum(~leaves[h])), int(np.sum(leaves[h]))) for h in coasting},
    )
