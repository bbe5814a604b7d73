"""Quantisation as part of the noise: the probability of the codes themselves instead of a density.

Derivations 7.12. A code u = D round(x/D) of x = model + normal noise has the probability that x lies in its cell; noise
of the same variance that is not rounded gives it its density times D.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from accelcal.data import Array
from accelcal.diagnosis.noise_model.growing import total_with_std
from accelcal.diagnosis.noise_tests.quantisation import quantisation
from accelcal.diagnosis.noise_tests.residuals import Residuals
from accelcal.effects import Effect
from accelcal.estimation.noise import NoiseEffect, NoiseScore

MOVING = 8
"""Samples to either side over which the output moves by more than a step where rounding errors are independent: at rest
all of them are one."""
LEAST_NOISE = 1e-3
"""Least noise beside the rounding, in steps."""
LEAST_PROBABILITY = 1e-12
"""Least probability of a code: no sample decides alone."""


def sample_residuals(residuals: Residuals) -> Array:
    """Samples less the output that the model predicts, while that moves by more than a step, (m,) m/s².

    Those about jumps of the motion are left out.
    """
    place, model = residuals.place, residuals.model
    padded = np.pad(model, MOVING, mode="edge")
    moving = np.abs(padded[2 * MOVING :] - padded[: -2 * MOVING]) > residuals.lsb
    kept = ~residuals.unresolved[place] & residuals.sampled[place] & moving[place]
    return np.asarray((residuals.u - model[place])[kept])


def code_log_probability(r: Array, step: float, noise: float) -> Array:
    """Logarithm of the probability of codes that differ by `r` (m,) from what the model predicts."""
    upper, lower = (r + 0.5 * step) / noise, (r - 0.5 * step) / noise
    folded = np.where(r > 0.0, -lower, upper), np.where(r > 0.0, -upper, lower)
    return np.asarray(
        np.log(np.maximum(scipy.special.ndtr(folded[0]) - scipy.special.ndtr(folded[1]), LEAST_PROBABILITY))
    )


def rounded_noise(several: Sequence[Residuals], effect: Effect) -> NoiseEffect:
    """Step of the converter, which the values themselves show without error, and the noise beside it."""
    step = several[0].lsb
    r = np.concatenate([sample_residuals(residuals) for residuals in several])
    if step <= 0.0 or len(r) == 0:
        return NoiseEffect(effect.name, effect.symbol, effect.unit, 0.0, 0.0, effect.owner, 1.0, "no step", {})
    plain = math.sqrt(float(np.mean(r**2)))
    best = scipy.optimize.minimize_scalar(
        lambda log: -float(np.sum(code_log_probability(r, step, step * math.exp(log)))),
        bounds=(math.log(LEAST_NOISE), math.log(max(10.0, 10.0 * plain / step))),
        method="bounded",
    )
    noise = step * math.exp(float(best.x))
    p = min(quantisation(residuals).p_value for residuals in several)
    text = f"steps of {step:.3g} m/s² beside a noise of {noise:.3g} m/s² of a sample"
    particulars = {"step": step, "noise": noise, "without": plain}
    return NoiseEffect(effect.name, effect.symbol, effect.unit, step**2, 0.0, effect.owner, p, text, particulars)


def score_of_rounding(residuals: Residuals, known: NoiseEffect) -> NoiseScore | None:
    """Gain of the log probability of the codes of a record by the rounding, over noise of the variance that its samples
    have and that is not rounded; None where the output never moves by a step."""
    r, step = sample_residuals(residuals), known.particulars["step"]
    if len(r) == 0:
        return None
    noise, plain = known.particulars["noise"], math.sqrt(float(np.mean(r**2)))
    density = -0.5 * (r / plain) ** 2 - math.log(plain) - 0.5 * math.log(2.0 * math.pi)
    gain = code_log_probability(r, step, noise) - np.maximum(density + math.log(step), math.log(LEAST_PROBABILITY))
    total, std = total_with_std(gain)
    power = float(np.mean(r**2))
    ratio, without = power / (noise**2 + step**2 / 12.0), power / plain**2
    return NoiseScore(known.name, "accel", total, std, len(r), ratio, without, "mean square")
