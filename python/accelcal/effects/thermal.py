"""Temperature: recorded, or acting through the time since power-on and the work of the sensor."""

from __future__ import annotations

import numpy as np

from accelcal.data.arrays import Array
from accelcal.effects.building_blocks import lagged, slow
from accelcal.effects.registry import Search, Shape, Static, Traits, effect
from accelcal.signals.signals import Signals

RATE_SPAN = 1.0
"""Temperature rates are differences over this time to either side, s: sensors of temperature are slow and coarse."""


@effect(
    "temperature_bias",
    unit="m/s²/K",
    symbol="c1",
    scale=1e-3,
    source="typical 0.02 mg/K: IIS2ICLX; at most 0.2 mg/K: ADXL358; 0.5 mg/K: LIS3DH",
    needs=("temperature",),
    traits=Traits(common=True, static=Static(0, "c1 T", thermal=True)),
    search=Search(includes=("bias",)),
)
def temperature_bias(s: Signals) -> Array:
    """Bias grows in proportion to temperature, from the model's own reference temperature.

    Equation: e = c1 T.
    Looks like: a residual that follows temperature, moving or at rest.
    Easily confused with: bias_drift and warm_up while temperature changes steadily; bias_random_walk.
    Separate by: a temperature cycle that is not monotone in time, at least 1 K wide.
    """
    return s.temperature


@effect(
    "temperature_scale",
    unit="K⁻¹",
    symbol="kT",
    scale=1e-4,
    source="0.01 %/K: LIS3DH, IIS2ICLX; 0.02 %/K: ADXL358",
    needs=("temperature",),
    traits=Traits(common=True, static=Static(1, "kT T a", odd=True, thermal=True)),
    search=Search(includes=("scale_factor",)),
)
def temperature_scale(s: Signals) -> Array:
    """Scale factor changes in proportion to temperature.

    Equation: e = kT T a.
    Looks like: a residual proportional to acceleration, its size following temperature.
    Easily confused with: scale_drift while temperature changes steadily.
    Separate by: a temperature ramp up and down while moving.
    """
    return s.temperature * s.a


@effect(
    "temperature_rate",
    unit="m/s²/(K/s)",
    symbol="cg",
    scale=1e-2,
    source="no published figure; 0.1 K/min then gives 0.002 mg",
    needs=("temperature",),
    traits=Traits(memory=True),
)
def temperature_rate(s: Signals) -> Array:
    """Bias from a temperature gradient across the sensor, in proportion to the rate of change.

    Equation: e = cg dT/dt, dT/dt taken over one second to either side.
    Looks like: a loop of the residual over temperature.
    Easily confused with: temperature_bias with a lag between case and element, warm_up.
    Separate by: ramps at two rates.
    """
    T = s.temperature
    reach = max(1, round(RATE_SPAN / s.step))
    i = np.arange(len(T))
    low, high = np.maximum(i - reach, 0), np.minimum(i + reach, len(T) - 1)
    return (T[high] - T[low]) / np.maximum((high - low) * s.step, s.step)


@effect(
    "warm_up",
    unit="m/s²",
    symbol="b",
    scale=1e-2,
    source="no published figure; minutes after power-on",
    shapes={"tau": Shape("s", slow(0.04, 1.0), trials=5, spacing="log")},
    traits=Traits(changes="bias"),
    search=Search(includes=("bias",)),
)
def warm_up(s: Signals, tau: float) -> Array:
    """Bias that dies away after power-on, which is the model's origin of time.

    Equation: e = b exp(-t/tau), t >= 0.
    Looks like: a residual that moves fast at first and then settles.
    Easily confused with: bias_drift, temperature_bias, bias_random_walk, creep.
    Separate by: a record from cold and one after an hour of soak.
    """
    return np.exp(np.maximum(s.t, 0.0) / -tau)


@effect(
    "self_heating",
    unit="(m/s²)⁻¹",
    symbol="ch",
    scale=1e-4,
    source="no published figure; taken as K2",
    shapes={"tau": Shape("s", slow(0.015, 0.5), trials=5, spacing="log")},
    traits=Traits(memory=True),
)
def self_heating(s: Signals, tau: float) -> Array:
    """Bias from heat that motion makes in the sensor; before the record it was at rest.

    Equation: e = ch x, tau x' = a² - x.
    Looks like: a slow residual that follows the intensity of the motion.
    Easily confused with: bias_step where rest turns into motion, quadratic, bias_random_walk.
    Separate by: several changes between rest and motion, each longer than tau.
    """
    return lagged(s.a**2, tau, s.step, s.rest**2)
