"""Rounded stamps and held samples: what stamps and values themselves show, and whether it matters on this motion."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import scipy

from accelcal.data import Array, Finding
from accelcal.data.clocks import rounding_std
from accelcal.data.quality import HELD, ROUNDED
from accelcal.diagnosis.noise_tests.noise_test import HELD_SAMPLES, ROUNDED_STAMPS, NoiseTest
from accelcal.diagnosis.noise_tests.residuals import Residuals, sample_noise
from accelcal.diagnosis.policy import HELD_SHARE, NOISE_TEST_ALPHA

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
        p = float(scipy.special.chdtrc(1.0, gain_of_noise(rounding_std(finding.size) * slope, count)))
        p_value = min(p_value, p)
        if p < NOISE_TEST_ALPHA:
            step = max(step, finding.size)
            treated = "no uniform clock explains them" if finding.jitter else "the instants of a uniform clock are used"
            texts.append(f"{finding.channel} to {1e3 * finding.size:.6g} ms ({treated})")
    std = rounding_std(step)
    text = f"time stamps are rounded: {', '.join(texts)}; rounding errs by {1e6 * std:.3g} us rms"
    return NoiseTest(
        ROUNDED_STAMPS, step, p_value, std, "s", 0.0, text if texts else "no time stamps are rounded", {"step": step}
    )


def gain_of_noise(ratio: Array, count: int) -> float:
    """Twice the log-likelihood that noise gains whose standard deviation is `ratio` times the known one, at times
    spread over `count` samples."""
    r = ratio**2
    return count * float(np.mean(r - np.log1p(r)))


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
    found = left_out is not None or repeats > HELD_SHARE
    text = "no samples of the output are held"
    if found:
        rate = (1.0 - min(repeats, 0.99)) / residuals.step
        text = f"samples of the output are held: the logger repeats those of a sensor that renews them at {rate:.4g} Hz"
        text += "; the repeats are left out" if left_out else ", and the repeats are in the record"
    parts = {"held": repeats, "coarse": float(repeats > HELD_SHARE), "tick": tick}
    std = rounding_std(tick) if found else 0.0
    return NoiseTest(HELD_SAMPLES, repeats, 0.0 if found else 1.0, std, "s", 0.0, text, parts)


def findings_of(residuals: Residuals, kind: str) -> Iterator[Finding]:
    """Findings of one kind in the run's recording."""
    return (finding for finding in residuals.run.recording.findings if finding.kind == kind)


def known_jitter(residuals: Residuals) -> float:
    """Standard deviation that rounding and holding leave in the stamps of the output, s; 0 where a clock undoes it."""
    name, findings = residuals.run.accel.name, residuals.run.recording.findings
    return math.hypot(*(finding.jitter for finding in findings if finding.channel == name))
