"""What correlates with what: closed forms of docs/correlations.md beside fits of simulated records.

From the top of the repository: python -m benches.correlations
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import accelcal as ac
from accelcal.data.rig import STANDARD_GRAVITY as G
from accelcal.simulation import CXL02_RIG
from accelcal.simulation.motion import Motion, Tones

SECONDS = 30.0
RIG = replace(CXL02_RIG, lowpass=None)
BIAS, SCALE = 0.05, 0.01


@dataclass(frozen=True)
class Row:
    """One claim of the page: the closed form, the fit, and how far the fit may be from it."""

    claim: str
    expected: float
    fitted: float
    tolerance: float
    scale: float = 1.0
    unit: str = ""

    @property
    def holds(self) -> bool:
        """Whether the fit agrees with the closed form."""
        return abs(self.fitted - self.expected) <= self.tolerance

    @property
    def text(self) -> str:
        """A row of the table of the page."""
        numbers = (f"{x * self.scale:.4g} {self.unit}".rstrip() for x in (self.expected, self.fitted, self.tolerance))
        return f"| {self.claim} | {' | '.join(numbers)} |"


def sine(frequency: float, amplitude: float, seconds: float = SECONDS, vibration: float = 0.0) -> Motion:
    """A sine of the acceleration that neither begins nor ends at rest, and a vibration of 200 Hz."""
    f = np.array([frequency, 200.0])
    size = np.array([amplitude, vibration]) / (2.0 * math.pi * f) ** 2
    return Motion((Tones(size, f, np.zeros(2)),), seconds, name="sine")


def swell(rms: float) -> Motion:
    """A motion whose acceleration is nearly Gaussian, of frequencies from 0.2 to 1 Hz."""
    rng = np.random.default_rng(20)
    f = np.linspace(0.2, 1.0, 40)
    size = np.full(40, rms / math.sqrt(20.0)) / (2.0 * math.pi * f) ** 2
    return Motion((Tones(size, f, 2.0 * math.pi * rng.random(40)),), 4.0 * SECONDS, name="swell")


def record(
    motion: Motion | str, seed: int, rig: ac.Rig = RIG, encoder: float = 0.0, tilt: float = 0.0, **settings: float
) -> ac.Recording:
    """One record; `tilt` (rad) is that of the stage, `encoder` the scale error of its reading."""
    truth = {"bias": BIAS + (1.0 + SCALE) * rig.polarity * G * tilt, "scale_factor": SCALE, **settings}
    rng = np.random.default_rng(seed)
    seconds = motion.seconds if isinstance(motion, Motion) else SECONDS
    simulated = ac.simulate(motion, seconds=seconds, rig=rig, parameters=truth, rng=rng).recording
    position = replace(simulated.position, y=simulated.position.y * (1.0 + encoder))
    return replace(simulated, position=position, name=f"record {seed}", digest=f"{seed}")


def correlation(fit: ac.Fit, a: str, b: str) -> float:
    """Correlation of two estimates."""
    return float(fit.correlations().loc[a, b])


def entered(fit: ac.Fit, runs: list[ac.Recording], effect: str) -> ac.Fit:
    """A fit with an effect that a set of runs may already have brought into the model."""
    return fit if effect in {estimate.name for estimate in fit.estimates} else ac.add(fit, runs, effect)


def delay() -> Iterator[Row]:
    """Scale factor and time offset."""
    fit = ac.fit(record("tones", 1))
    yield Row(
        "ρ(k, t0), motion that begins and ends at rest", 0.0, correlation(fit, "scale_factor", "time_offset"), 0.01
    )
    w = 2.0 * math.pi
    for seconds in (2.25, 10.25):
        cut = ac.fit(record(sine(1.0, 8.0, seconds), 2))
        cos2, sin2 = (seconds / 2.0 + s * math.sin(2.0 * w * seconds) / (4.0 * w) for s in (1.0, -1.0))
        rho = math.sin(w * seconds) ** 2 / (2.0 * w) / math.sqrt(cos2 * sin2)
        yield Row(
            f"size of ρ(k, t0), sine of 1 Hz cut off after {seconds:g} s",
            rho,
            abs(correlation(cut, "scale_factor", "time_offset")),
            0.5 * rho,
        )
    late = record(sine(10.0, 10.0), 3, time_offset=2e-3)
    held = ac.fit(late, model=ac.Model.linear().freeze(time_offset=0.0))
    x = w * 10.0 * 2e-3
    yield Row(
        "error of k, a delay of 2 ms held at zero, 10 Hz",
        (1.0 + SCALE) * (math.cos(x) - 1.0),
        held["scale_factor"].value - SCALE,
        2e-4,
        100.0,
        "%",
    )


def tilt() -> Iterator[Row]:
    """Bias and tilt."""
    angle = 1e-3
    level, turned = record("tones", 4, tilt=angle), record("tones", 5, replace(RIG, mount="reversed"), tilt=angle)
    fit = ac.fit(level)
    yield Row(
        "bias of a stage tilted by 1 mrad, minus K0",
        (1 + SCALE) * G * angle,
        fit["bias"].value - BIAS,
        1e-3,
        1e3,
        "mm/s²",
    )
    both = ac.fit([level, turned])
    both = entered(both, [level, turned], "tilt")
    yield Row("bias, with a run of the reversed sensor", BIAS, both["bias"].value, 1e-3, 1e3, "mm/s²")
    yield Row("tilt, the same two runs", angle, both["tilt"].value, 1e-4, 1e3, "mrad")
    yield Row("u(bias) of both runs over that of one", math.sqrt(0.5), both["bias"].std / fit["bias"].std, 0.1)


def rectification() -> Iterator[Row]:
    """Bias and K2."""
    model = ac.Model.linear().add("quadratic")
    sine_fit = ac.fit(record(sine(1.0, 8.0), 6, quadratic=2e-3), model=model)
    yield Row("ρ(K0, K2), a sine", -math.sqrt(2.0 / 3.0), correlation(sine_fit, "bias", "quadratic"), 0.05)
    shaken = ac.fit(record(sine(1.0, 8.0, vibration=4.0), 6, quadratic=2e-3), model=model)
    claim = "change of the bias by a vibration of 4 m/s² at 200 Hz, K2 = 2e-3 in the model"
    yield Row(claim, 2e-3 * 4.0**2 / 2.0, shaken["bias"].value - sine_fit["bias"].value, 2e-3, 1e3, "mm/s²")
    fit = ac.fit(record(swell(4.0), 7, quadratic=2e-3), model=model)
    yield Row("ρ(K0, K2), Gaussian motion", -math.sqrt(1.0 / 3.0), correlation(fit, "bias", "quadratic"), 0.1)


def amplitude() -> Iterator[Row]:
    """Scale factor and K3, and what the amplitude does."""
    cubic = ac.Model.linear().add("quadratic", "cubic")
    fits = {A: ac.fit(record(sine(1.0, A), 8, cubic=1e-3), model=cubic) for A in (4.0, 8.0)}
    yield Row("ρ(k, K3), a sine", -math.sqrt(0.9), correlation(fits[8.0], "scale_factor", "cubic"), 0.02)
    for name, power in (("quadratic", 2), ("cubic", 3)):
        ratio = fits[4.0][name].std / fits[8.0][name].std
        yield Row(f"u({'K' + str(power)}) at 4 m/s² over that at 8 m/s²", 2.0**power, ratio, 0.1 * 2.0**power)
    for A in (4.0, 8.0):
        line = ac.fit(record(sine(5.0, A), 9, cubic=1e-3))
        yield Row(
            f"error of k, K3 = 1e-3 left out, a sine of {A:g} m/s² at 5 Hz",
            0.75e-3 * A**2,
            line["scale_factor"].value - SCALE,
            1e-3,
            100.0,
            "%",
        )
    random = ac.fit(record(swell(4.0), 10, cubic=1e-3), model=cubic)
    yield Row("ρ(k, K3), Gaussian motion", -math.sqrt(0.6), correlation(random, "scale_factor", "cubic"), 0.1)


def encoder() -> Iterator[Row]:
    """Scale factor and scale of the encoder."""
    eps = 5e-4
    runs = [
        record("tones", 11 + i, replace(RIG, axis=axis), encoder=eps) for i, axis in enumerate(("level", "up", "down"))
    ]
    true = ac.fit(record("tones", 11))
    level = ac.fit(runs[0])
    yield Row(
        "change of k by an encoder scale of 5e-4",
        -eps * (1.0 + SCALE),
        level["scale_factor"].value - true["scale_factor"].value,
        1e-5,
    )
    three = ac.fit(runs)
    three = entered(three, runs, "encoder_scale")
    yield Row("encoder scale, from runs level, up and down", eps, three["encoder_scale"].value, 1e-4)
    yield Row("k, the same runs", SCALE, three["scale_factor"].value, 2e-4, 100.0, "%")


TOPICS = (delay, tilt, rectification, amplitude, encoder)
"""Sections of the page."""


def main() -> int:
    """Print the table of the page; 1 where a closed form misses."""
    rows = [row for topic in TOPICS for row in topic()]
    print("| claim | closed form | fitted | may differ by |\n|---|---|---|---|")
    print("\n".join(row.text for row in rows))
    return 0 if all(row.holds for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
