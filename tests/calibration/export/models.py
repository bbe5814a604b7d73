"""Fitted models of round or drawn numbers, built without a recording, and their inverse in forty digits."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal, localcontext

import numpy as np
from hypothesis import strategies as st

from accelcal.data.rig import Rig, Sensor, Uncertainty
from accelcal.effects import find
from accelcal.estimation.estimate import Fit
from accelcal.model import BASE, Estimate, Model
from accelcal.signals.signals import Origins

VOLTS = Sensor(model="ADXL105", serial="12", scale=0.0255, scale_unit="V", zero=2.5)
REFERENCE = 23.0
SHAPES = {
    "hysteresis": {"width": 0.1},
    "creep": {"tau": 2.0, "start": 0.0},
    "saturation": {"level": 12.0},
    "warm_up": {"tau": 9.0},
}
SENSORS = (
    Sensor(),
    VOLTS,
    Sensor(scale=-0.3, scale_unit="V", zero=0.0),
    Sensor(scale=104.4, scale_unit="count", zero=2048.0),
    Sensor(scale=-26112.0, scale_unit="count", zero=8388608.0),
)
NONLINEAR = ("scale_asymmetry", "quadratic", "odd_quadratic", "cubic")
THERMAL = ("temperature_bias", "temperature_scale")


def fit_of(
    values: Mapping[str, float],
    *,
    sensor: Sensor = VOLTS,
    acceleration: tuple[float, float] | None = (-15.0, 17.0),
    temperature: tuple[float, float] | None = None,
    std: float = 1e-6,
    uncertainty: Uncertainty = Uncertainty(),  # noqa: B008  (frozen)
) -> Fit:
    """A fit with these coefficients, diagonal covariance, and nothing else in it."""
    names = (*BASE, *(name for name in values if name not in BASE))
    model = Model(names, shapes={name: SHAPES[name] for name in names if name in SHAPES})
    given = {"time_offset": 1e-4, **values}
    estimates = tuple(Estimate(n, find(n).symbol, find(n).unit, given.get(n, 0.0), std, find(n).owner) for n in names)
    validity = {"v": (-0.1, 0.1)}
    validity |= {"a": acceleration} if acceleration else {}
    validity |= {"temperature": temperature} if temperature else {}
    return Fit(
        model=model,
        estimates=estimates,
        covariance=std**2 * np.eye(len(names)),
        runs=(),
        origins=Origins(temperature=REFERENCE),
        rig=Rig(sensor=sensor, uncertainty=uncertainty),
        validity=validity,
    )


def exact(fit: Fit, reading: float, temperature: float, near: float) -> Decimal:
    """The acceleration that the forward model of the effects' own cards takes to this reading."""
    with localcontext() as context:
        context.prec = 60
        c = {e.name: Decimal(e.value) for e in fit.estimates}
        sensor = fit.rig.sensor
        scale, zero = Decimal(sensor.scale or 1.0), Decimal(sensor.zero or 0.0)
        output = (Decimal(reading) - zero) / scale
        warm = Decimal(temperature) - Decimal(REFERENCE)
        gain = Decimal(1.0 + fit["scale_factor"].value) + c.get("temperature_scale", Decimal(0)) * warm
        output -= c["bias"] + c.get("temperature_bias", Decimal(0)) * warm
        even, two, odd, three = (c.get(name, Decimal(0)) for name in NONLINEAR)
        a = Decimal(near)
        for _ in range(12):
            u = gain * a + even * abs(a) + two * a**2 + odd * a * abs(a) + three * a**3
            side = 1 if a >= 0 else -1
            slope = gain + even * side + 2 * two * a + 2 * odd * abs(a) + 3 * three * a**2
            step = (output - u) / slope
            a += step
            if abs(step) < Decimal("1e-40"):
                break
        return a


@st.composite
def fits(draw: st.DrawFn) -> Fit:
    """Models from linear to one whose slope falls to a third, in V, counts or m/s², warm or not, level or upright."""
    share = st.floats(-1.0, 1.0).map(lambda x: round(x, 6))
    largest = draw(st.sampled_from([0.5, 17.0, 160.0]))
    low = draw(st.sampled_from([-1.0, -0.7, 0.1, 0.4])) * largest
    values = {"bias": 0.3 * draw(share), "scale_factor": 0.2 * draw(share)}
    size = {
        "scale_asymmetry": 0.02,
        "quadratic": 0.1 / largest,
        "odd_quadratic": 0.1 / largest,
        "cubic": 0.05 / largest**2,
        "temperature_bias": 1e-2,
        "temperature_scale": 5e-4,
    }
    for name in draw(st.sets(st.sampled_from([*NONLINEAR, *THERMAL]))):
        values[name] = size[name] * draw(share)
    sensor = draw(st.sampled_from(SENSORS))
    coldest = draw(st.sampled_from([-40.0, 15.0, 22.0]))
    warmest = coldest + draw(st.sampled_from([0.5, 25.0, 100.0]))
    return fit_of(values, sensor=sensor, acceleration=(low, largest), temperature=(coldest, warmest))
