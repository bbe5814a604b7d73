"""Quantisation: converter steps above the noise, the rounding they cost, and stamps of finite resolution.

Derivations 7.12. A code u = D round(x/D) of x = model + normal noise has the probability that x lies in its cell; noise
of the same variance that is not rounded gives it its density times D.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from accelcal.data import Array, Finding, in_usual_unit
from accelcal.data.clocks import rounding_std
from accelcal.data.quality import HELD, ROUNDED
from accelcal.diagnosis.noise.growing import total_with_std
from accelcal.diagnosis.noise.noise_test import HELD_SAMPLES, ROUNDED_STAMPS, STEPS, NoiseTest
from accelcal.diagnosis.noise.residuals import Residuals, sample_noise
from accelcal.diagnosis.policy import COARSE_STEP_RATIO, HELD_SHARE, NOISE_TEST_ALPHA, WHOLE_BITS_TOLERANCE
from accelcal.effects import Effect
from accelcal.estimation.noise import NoiseEffect, NoiseScore


def quantisation(residuals: Residuals) -> NoiseTest:
    """Test of the converter's step against the noise of one sample.

    That values lie on a grid is no matter of chance. The p value says whether it matters: the noise of rounding, D²/12,
    would gain twice the log-likelihood sum(r - ln(1 + r)) over the sensor's own noise, r their ratio at each frequency;
    chi-square with one degree of freedom. A fine step that the declared range implies is not reported.
    """
    noise = sample_noise(residuals)
    ratio = residuals.lsb / noise if noise > 0.0 else 0.0
    p_value = 1.0
    if residuals.lsb > 0.0 and (ratio > COARSE_STEP_RATIO or not has_whole_bits(residuals)):
        p_value = float(scipy.special.chdtrc(1.0, rounding_gain(residuals, noise)))
    p_value = 0.0 if ratio > COARSE_STEP_RATIO else p_value
    text = "quantisation of the output is negligible"
    if residuals.lsb > 0.0 and p_value < NOISE_TEST_ALPHA:
        text = f"the output is quantised in steps of {residuals.lsb:.3g} m/s², {ratio:.2g} times the noise of a sample"
    parts = {"step": residuals.lsb, "noise": noise, "coarse": float(ratio > COARSE_STEP_RATIO)}
    return NoiseTest(STEPS, ratio, p_value, residuals.lsb, "m/s²", 0.0, text, parts)


def rounding_gain(residuals: Residuals, noise: float) -> float:
    """Twice the log-likelihood that white rounding noise gains over low-passed noise with a sample's standard
    deviation."""
    keep = math.exp(-residuals.step / residuals.tau) if residuals.tau > 0.0 else 0.0
    turn = np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    floor = noise**2 * (1.0 - keep**2) / (1.0 + keep**2 - 2.0 * keep * turn)
    return gain_of_noise(residuals.lsb**2 / 12.0 / floor, len(residuals.u))


def has_whole_bits(residuals: Residuals) -> bool:
    """Whether the declared range holds 2^m steps, m whole: the converter that the data sheet implies."""
    limit = residuals.run.rig.sensor.range
    if limit is None or residuals.lsb <= 0.0:
        return False
    bits = math.log2(limit / residuals.lsb)
    return abs(bits - round(bits)) < WHOLE_BITS_TOLERANCE


CHANCE_LAGS = 8, 12, 16
"""Samples by which readings lie apart that are equal by chance: further than any logger holds one."""


def repeated_share(u: Array) -> float:
    """Share of samples (n,) that repeat the one before while the motion goes on, beyond those that equal one further
    before by chance.

    The motion goes on where the output changes by more than usual over so many samples as no logger holds. At rest a
    coarse sensor repeats its codes, and three of them behind a calibration matrix leave no grid that would tell.
    """
    reach = CHANCE_LAGS[0]
    change = np.abs(u[reach:] - u[:-reach])
    repeats = (u[1:] == u[:-1])[reach // 2 :][: len(change)]
    moving = change > math.sqrt(float(np.mean(change**2)))
    by_chance = float(np.mean([np.mean(u[lag:] == u[:-lag]) for lag in CHANCE_LAGS]))
    return max(0.0, float(np.mean(repeats[moving])) - by_chance) if moving.any() else 0.0


def rounded_stamps(residuals: Residuals) -> NoiseTest:
    """Test of stamps that lie on a grid.

    That they do is no matter of chance, and it was found when the record was read. The p value says whether it matters:
    the noise that rounding makes of the motion, as far as no clock undoes it, would gain twice the log-likelihood
    sum(r - ln(1 + r)), r its variance over that of a sample; chi-square with one degree of freedom.
    """
    jerk, v = residuals.signals.jerk, residuals.signals.v
    scale, noise = residuals.state.values.scale, residuals.state.noise
    of_channel = {
        residuals.run.accel.name: (scale * jerk / max(sample_noise(residuals), 1e-300), len(residuals.u)),
        residuals.run.recording.position.name: (v / math.sqrt(noise.r), len(residuals.run.t)),
    }
    p_value, step, texts = 1.0, 0.0, []
    for finding in findings_of(residuals, ROUNDED):
        slope, count = of_channel[finding.channel]
        p = float(scipy.special.chdtrc(1.0, gain_of_noise((rounding_std(finding.size) * slope) ** 2, count)))
        p_value = min(p_value, p)
        if p < NOISE_TEST_ALPHA:
            step = max(step, finding.size)
            treated = "no uniform clock explains them" if finding.jitter else "the instants of a uniform clock are used"
            texts.append(f"{finding.channel} to {1e3 * finding.size:.6g} ms ({treated})")
    std = rounding_std(step)
    text = f"time stamps are rounded: {', '.join(texts)}; rounding errs by {in_usual_unit(std, 's')} rms"
    return NoiseTest(
        ROUNDED_STAMPS, step, p_value, std, "s", 0.0, text if texts else "no time stamps are rounded", {"step": step}
    )


def gain_of_noise(ratio: Array, count: int) -> float:
    """Twice the log-likelihood that noise gains whose variance is `ratio` times the known one, at times or frequencies
    that stand for `count` samples."""
    return count * float(np.mean(ratio - np.log1p(ratio)))


def held_samples(residuals: Residuals) -> NoiseTest:
    """Test of samples that repeat the one before, left out when the record was read or still in it.

    A logger that is faster than its sensor repeats every few readings, whatever the motion does, so that the share of
    repeats in motion decides. Readings on a grid that was lost in a conversion of units repeat those some samples
    before as often; such repeats are not counted.
    """
    u = residuals.u
    repeats = repeated_share(u) if residuals.lsb == 0.0 and len(u) > CHANCE_LAGS[-1] else 0.0
    left_out = next((f for f in findings_of(residuals, HELD) if f.channel == residuals.run.accel.name), None)
    tick = left_out.size if left_out else residuals.step / (1.0 - min(repeats, 0.99))
    held = left_out is not None or repeats > HELD_SHARE
    text = "no samples of the output are held"
    if held:
        rate = (1.0 - min(repeats, 0.99)) / residuals.step
        text = f"samples of the output are held: the logger repeats those of a sensor that renews them at {rate:.4g} Hz"
        text += "; the repeats are left out" if left_out else ", and the repeats are in the record"
    parts = {"held": repeats, "coarse": float(repeats > HELD_SHARE), "tick": tick}
    std = rounding_std(tick) if held else 0.0
    return NoiseTest(HELD_SAMPLES, repeats, 0.0 if held else 1.0, std, "s", 0.0, text, parts)


def findings_of(residuals: Residuals, kind: str) -> Iterator[Finding]:
    """Findings of one kind in the run's recording."""
    return (finding for finding in residuals.run.recording.findings if finding.kind == kind)


def known_jitter(residuals: Residuals) -> float:
    """Standard deviation that rounding and holding leave in the stamps of the output, s; 0 where a clock undoes it."""
    name, findings = residuals.run.accel.name, residuals.run.recording.findings
    return math.hypot(*(finding.jitter for finding in findings if finding.channel == name))


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
    usable = ~residuals.unresolved[place] & residuals.sampled[place] & moving[place]
    return np.asarray((residuals.u - model[place])[usable])


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


def score_of_rounding(residuals: Residuals, effect: NoiseEffect) -> NoiseScore | None:
    """Gain of the log probability of the codes of a record by the rounding, over noise of the variance that its samples
    have and that is not rounded; None where the output never moves by a step."""
    r, step = sample_residuals(residuals), effect.particulars["step"]
    if len(r) == 0:
        return None
    noise, plain = effect.particulars["noise"], math.sqrt(float(np.mean(r**2)))
    density = -0.5 * (r / plain) ** 2 - math.log(plain) - 0.5 * math.log(2.0 * math.pi)
    gain = code_log_probability(r, step, noise) - np.maximum(density + math.log(step), math.log(LEAST_PROBABILITY))
    total, std = total_with_std(gain)
    power = float(np.mean(r**2))
    ratio, without = power / (noise**2 + step**2 / 12.0), power / plain**2
    return NoiseScore(effect.name, "accel", total, std, len(r), ratio, without, "mean square")
