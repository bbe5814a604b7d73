"""Detectable drift bandwidth: the smallest sinusoidal change of bias and scale factor that a record shows.

The paper's introduction: conventional tests limit the bandwidth of detectable variations (derivations D3.8).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.data import STANDARD_GRAVITY, Array, Dwells, Rig
from accelcal.diagnosis.search.scores import BaseProjection
from accelcal.effects import Effect, find, found_by, static_terms
from accelcal.estimation.estimate import estimate_dwells
from accelcal.estimation.run_state import RunState
from accelcal.model import BASE, Model, Term
from accelcal.signals.signals import Signals

DWELLS, DWELL, TURN = 24, 60.0, 15.0
"""Number of dwells, length of each and time to turn to the next, s."""
SAMPLES = 1e4
"""Samples of each, which give the deviation of one from that of their mean."""


def tumble(
    parameters: Mapping[str, float], rig: Rig, *, angle_std: float, rng: np.random.Generator | None = None
) -> Dwells:
    """24 dwells of a minute each.

    Parameters
    ----------
    parameters : coefficients of the sensor's static characteristic by effect, SI; 0 where not given.
    rig : its sensor's noise density is that of the dwells.
    angle_std : declared standard deviation of an angle, rad.
    rng : draws noise and angles; without it the dwells have neither, both are still declared.
    """
    drawn = np.zeros((2, DWELLS)) if rng is None else rng.standard_normal((2, DWELLS))
    angle = np.arange(DWELLS) * 2.0 * np.pi / DWELLS
    white = math.sqrt(0.5 * (rig.sensor.noise or 0.0) ** 2 / DWELL)
    a = STANDARD_GRAVITY * np.sin(angle + angle_std * drawn[0])
    mean = a + white * drawn[1]
    for name, term in static_terms().items():
        if not term.thermal:
            mean += parameters.get(name, 0.0) * np.array([term.per_unit(float(position), 0.0) for position in a])
    return Dwells(
        angle=angle,
        mean=mean,
        std=np.full(DWELLS, white * math.sqrt(SAMPLES)),
        duration=np.full(DWELLS, DWELL),
        samples=np.full(DWELLS, SAMPLES),
        group=("0",) * DWELLS,
        rig=rig,
        angle_std=angle_std,
        name="tumble",
    )


SIGMA = 5.0
"""Standard deviations that the smallest change has, whatever its phase."""
POINTS = 32
"""Frequencies."""
SLOWEST = 0.25
"""Lowest frequency in periods per record."""
SAMPLES_A_PERIOD = 5.0
"""Of the grid of the signals, at the highest frequency."""
SUMS_A_PERIOD = 6.0
"""Of the rows of the Gram matrix, at the highest frequency."""
HEAD = math.radians(0.001)
"""Standard deviation of an angle of the tumble test, that of a dividing head of 3.6 arc seconds, rad."""


@dataclass(frozen=True, slots=True)
class TumbleLimit:
    """What a tumble test shows of the same: a change that is slow against it."""

    seconds: float
    """Its length, s."""
    frequency: float
    """Highest frequency of a change that repeated tumbles follow, half their rate, Hz."""
    bias: float
    """Five standard deviations, m/s²."""
    scale_factor: float
    """1"""


@dataclass(frozen=True, slots=True)
class DriftBandwidth:
    """Smallest amplitude of a sinusoidal change that a record shows at 5 standard deviations, against its frequency."""

    frequency: Array
    """(n,) Hz"""
    bias: Array
    """Of the bias, (n,) m/s²; infinite where the record cannot show it."""
    scale_factor: Array
    """Of the scale factor, (n,) 1."""
    tumble: TumbleLimit

    def highest(self, parameter: str, amplitude: float) -> float:
        """Highest frequency at which a change of "bias" or "scale_factor" by an amplitude is shown, Hz; 0: none is."""
        if parameter not in BASE[:2]:
            raise AccelcalError(f"{parameter!r}: the drift bandwidth is known of {' and '.join(BASE[:2])}")
        smallest = self.bias if parameter == BASE[0] else self.scale_factor
        return float(np.max(self.frequency[smallest <= amplitude], initial=0.0))


def drift_bandwidth(state: RunState, model: Model) -> DriftBandwidth:
    """The detectable drift bandwidth of a fitted run.

    Parameters
    ----------
    state : the run; its motion and noise count, what was measured does not.
    model : its free coefficients are estimated beside the change.
    """
    run = BaseProjection(state, model)
    s = state.signals
    length = float(state.run.t[-1] - state.run.t[0])
    top = min(1.0 / (SAMPLES_A_PERIOD * s.step), run.rate / SUMS_A_PERIOD)
    frequency = np.geomspace(SLOWEST / length, top, POINTS)
    line = found_by("line")
    changes = (line, times_acceleration(line))
    terms = [
        Term(effect, part, {"frequency": float(f)})
        for effect in changes
        for f in frequency
        for part in range(effect.width)
    ]
    G, _, curvature, *_ = run.remainder(terms)
    amplitudes = np.array([amplitude(G[k : k + 2, k : k + 2], curvature[k : k + 2]) for k in range(0, len(terms), 2)])
    bias, scale = np.split(amplitudes, 2)
    return DriftBandwidth(frequency, bias, scale, tumble_limit(state))


def times_acceleration(line: Effect) -> Effect:
    """A sinusoidal change of the scale factor, from one of the output."""

    def changed(s: Signals, frequency: float) -> Array:
        return s.a[:, None] * line.column(s, frequency=frequency)

    return replace(line, name=f"{BASE[1]}.{line.name}", unit=find(BASE[1]).unit, function=changed)


def amplitude(information: Array, curvature: Array) -> float:
    """Amplitude of sine and cosine together that is 5 standard deviations of its estimate at the worst phase."""
    least = float(np.linalg.eigvalsh(information)[0])
    return SIGMA / math.sqrt(least) if least > 1e-9 * float(np.max(curvature)) else math.inf


def tumble_limit(state: RunState) -> TumbleLimit:
    """What a tumble of 24 dwells reaches with the noise of a fitted run."""
    rig = state.run.rig
    density = abs(state.values.scale) * math.sqrt(2.0 * state.noise.usual.q)
    plain = replace(rig, lowpass=None, sensor=replace(rig.sensor, noise=density))
    fit = estimate_dwells(Model.linear(), tumble({}, plain, angle_std=HEAD))
    seconds = DWELLS * (DWELL + TURN)
    bias, scale = (SIGMA * fit[name].std for name in BASE[:2])
    return TumbleLimit(seconds, 0.5 / seconds, bias, scale)
