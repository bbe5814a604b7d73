"""Bias and scale factor that change with time."""

from __future__ import annotations

import numpy as np

from accelcal.data.arrays import Array
from accelcal.effects.building_blocks import instants, since, slow
from accelcal.effects.curves import RECORD, cosines
from accelcal.effects.registry import Search, Shape, Traits, effect
from accelcal.signals.signals import Signals

STEPS = 16
"""Instants at which a step is tried before it is refined."""
WANDERING = tuple(f"c{j}" for j in range(1, 33))
"""Cosines of a wandering bias: changes down to a thirty-second of half the record."""


@effect(
    "bias_drift",
    unit="m/s³",
    symbol="K0t",
    scale=1e-5,
    source="1 mg in a quarter of an hour",
    traits=Traits(common=True),
    search=Search(includes=("bias",)),
)
def bias_drift(s: Signals) -> Array:
    """Bias grows at a steady rate.

    Equation: e = K0t t.
    Looks like: a residual that is a straight line over time.
    Easily confused with: temperature_bias, warm_up, bias_random_walk, self_heating.
    Separate by: a longer record; a second one after a pause; temperature logged.
    """
    return s.t


@effect(
    "bias_step",
    unit="m/s²",
    symbol="dK0",
    scale=1e-3,
    source="life drift ±1 mg: IIS2ICLX",
    shapes={"instant": Shape("s", instants, trials=STEPS)},
    search=Search(includes=("bias",)),
)
def bias_step(s: Signals, instant: float) -> Array:
    """Bias jumps once, after a shock or a change of the mount.

    Equation: e = dK0 [t >= instant].
    Looks like: two levels of the residual.
    Easily confused with: bias_random_walk, self_heating where motion begins, dropped samples, missed counts.
    Separate by: a longer record on either side; sample counters.
    """
    return since(s, instant)


@effect(
    "bias_random_walk",
    unit="(m/s²)/√s",
    port="process",
    symbol="sqrt(qb)",
    scale=1e-4,
    source="no published figure; Allan slope +1/2",
    shapes=RECORD,
    parts=WANDERING,
    traits=Traits(positive=True, basis="cosines"),
    search=Search(includes=("bias",)),
)
def bias_random_walk(s: Signals, start: float, length: float) -> Array:
    """Bias wanders without bound: K0' is white with density qb.

    Equation: e = sqrt(qb) sum_j n_j sqrt(2 L)/(pi j) cos(pi j (t - start)/L), n_j independent with variance 1; with
    the bias beside it this is the random walk itself, cut after the last j.
    Looks like: a residual that wanders, the more the longer the record.
    Easily confused with: temperature_bias where temperature is not recorded, bias_gauss_markov, bias_drift.
    Separate by: temperature logged; a long record at rest (Allan deviation).
    """
    j = np.arange(1, len(WANDERING) + 1)
    return cosines(s.t, start, length, np.sqrt(2.0 * length) / (np.pi * j))


@effect(
    "bias_gauss_markov",
    unit="m/s²",
    port="process",
    symbol="sigma_b",
    scale=3.4e-5,
    source="floor of 3.5 µg: ADXL355",
    shapes={**RECORD, "tau": Shape("s", slow(0.02, 0.5), trials=3, spacing="log")},
    parts=WANDERING,
    traits=Traits(positive=True, basis="cosines"),
    search=Search(includes=("bias",)),
)
def bias_gauss_markov(s: Signals, start: float, length: float, tau: float) -> Array:
    """Bias wanders within bounds: K0' = -K0/tau + noise, standard deviation sigma_b.

    Equation: e = sigma_b sum_j n_j sqrt(4 tau/L / (1 + (w_j tau)²)) cos(w_j (t - start)), w_j = pi j/L, n_j
    independent with variance 1: its spectrum on the cosines of the record, good for tau well below L.
    Looks like: a residual correlated over tau that returns to its mean.
    Easily confused with: bias_random_walk when tau exceeds the record; flicker noise.
    Separate by: a record of at least 10 tau.
    """
    w = np.pi * np.arange(1, len(WANDERING) + 1) / length
    return cosines(s.t, start, length, np.sqrt(4.0 * tau / length / (1.0 + (w * tau) ** 2)))


@effect(
    "scale_drift",
    unit="s⁻¹",
    symbol="kt",
    scale=1e-5,
    source="no published figure",
    search=Search(includes=("scale_factor",)),
)
def scale_drift(s: Signals) -> Array:
    """Scale factor grows at a steady rate.

    Equation: e = kt t a.
    Looks like: a residual proportional to acceleration whose size is a straight line over time.
    Easily confused with: temperature_scale.
    Separate by: temperature logged and not steady; a second record after a pause.
    """
    return s.t * s.a


@effect(
    "scale_step",
    unit="1",
    symbol="dk",
    scale=1e-3,
    source="no published figure",
    shapes={"instant": Shape("s", instants, trials=STEPS)},
    search=Search(includes=("scale_factor",)),
)
def scale_step(s: Signals, instant: float) -> Array:
    """Scale factor jumps once: a supply, a gain range, a mount that slipped.

    Equation: e = dk a [t >= instant].
    Looks like: a residual proportional to acceleration before or after an instant only.
    Easily confused with: scale_drift, temperature_scale.
    Separate by: a longer record on either side, with equal motion.
    """
    return since(s, instant) * s.a
