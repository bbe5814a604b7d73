"""Bias and scale factor that change with time."""

from __future__ import annotations

import numpy as np

from accelcal.data import Array
from accelcal.effects.building_blocks import instants, since, slow
from accelcal.effects.curves import RECORD, cosines
from accelcal.effects.registry import Search, Shape, Traits, effect
from accelcal.signals.signals import Signals

STEPS = 16
"""Instants at which a step is tried before it is refined."""
BIAS_COSINES = tuple(f"c{j}" for j in range(1, 33))
"""Cosines of a random-walk or Gauss-Markov bias, with half periods down to a thirty-second of the record."""
STATIONARY = (*BIAS_COSINES, "mean")
"""The same and a constant: the mean of a Gauss-Markov process over a record is random, too."""


def stationary(t: Array, start: float, length: float, tau: float) -> Array:
    """Columns of a Gauss-Markov process of standard deviation 1: cosines of a record, and its mean, (n, width).

    Beyond both ends it is expected to die away.
    """
    w = np.pi * np.arange(1, len(BIAS_COSINES) + 1) / length
    waves = cosines(t, start, length, np.sqrt(4.0 * tau / length / (1.0 + (w * tau) ** 2)))
    columns = np.column_stack([waves, np.full(len(t), np.sqrt(2.0 * tau / length))])
    beyond = np.maximum(start - t, t - start - length)
    if np.any(beyond > 0.0):
        columns *= np.exp(-np.maximum(beyond, 0.0) / tau)[:, None]
    return columns


@effect(
    "bias_drift",
    unit="m/s³",
    symbol="K0t",
    scale=1e-5,
    source="1 mg in a quarter of an hour",
    traits=Traits(common=True, changes="bias"),
    search=Search(includes=("bias",)),
)
def bias_drift(s: Signals) -> Array:
    """Linear drift of the bias.

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
    traits=Traits(changes="bias"),
    search=Search(includes=("bias",)),
)
def bias_step(s: Signals, instant: float) -> Array:
    """Step of the bias, after a shock or a change of the mount.

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
    parts=BIAS_COSINES,
    traits=Traits(positive=True, changes="bias", basis="cosines"),
    search=Search(includes=("bias",)),
)
def bias_random_walk(s: Signals, start: float, length: float) -> Array:
    """Random-walk bias: K0' is white with density qb.

    Equation: e = sqrt(qb) sum_j n_j sqrt(2 L)/(pi j) cos(pi j (t - start)/L), n_j independent with variance 1; with
    the bias in the model this is the random walk itself, cut after the last j.
    Looks like: a residual with slow random changes that grow with the length of the record.
    Easily confused with: temperature_bias where temperature is not recorded, bias_gauss_markov, bias_drift.
    Separate by: temperature logged; a long record at rest (Allan deviation).
    """
    j = np.arange(1, len(BIAS_COSINES) + 1)
    return cosines(s.t, start, length, np.sqrt(2.0 * length) / (np.pi * j))


@effect(
    "bias_gauss_markov",
    unit="m/s²",
    port="process",
    symbol="sigma_b",
    scale=3.4e-5,
    source="floor of 3.5 µg: ADXL355",
    shapes={**RECORD, "tau": Shape("s", slow(0.02, 0.5), trials=3, spacing="log")},
    parts=STATIONARY,
    traits=Traits(positive=True, changes="bias", basis="cosines"),
    search=Search(includes=("bias",)),
)
def bias_gauss_markov(s: Signals, start: float, length: float, tau: float) -> Array:
    """Gauss-Markov bias: K0' = -K0/tau + noise, standard deviation sigma_b.

    Equation: e = sigma_b (n_0 sqrt(2 tau/L) + sum_j n_j sqrt(4 tau/L / (1 + (w_j tau)²)) cos(w_j (t - start))),
    w_j = pi j/L, n_j independent with variance 1: its spectrum on the cosines of the record, good for tau well below L.
    The bias beside it is the mean of the process, which a record knows to sigma_b sqrt(2 tau/L).
    Looks like: a residual correlated over tau that returns to its mean.
    Easily confused with: bias_random_walk when tau exceeds the record; flicker noise.
    Separate by: a record of at least 10 tau.
    """
    return stationary(s.t, start, length, tau)


@effect(
    "scale_drift",
    unit="s⁻¹",
    symbol="kt",
    scale=1e-5,
    source="no published figure",
    traits=Traits(changes="scale_factor"),
    search=Search(includes=("scale_factor",)),
)
def scale_drift(s: Signals) -> Array:
    """Linear drift of the scale factor.

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
    traits=Traits(changes="scale_factor"),
    search=Search(includes=("scale_factor",)),
)
def scale_step(s: Signals, instant: float) -> Array:
    """Step of the scale factor: a supply, a gain range, a mount that slipped.

    Equation: e = dk a [t >= instant].
    Looks like: a residual proportional to acceleration before or after an instant only.
    Easily confused with: scale_drift, temperature_scale.
    Separate by: a longer record on either side, with equal motion.
    """
    return since(s, instant) * s.a


@effect(
    "scale_random_walk",
    unit="1/√s",
    port="process",
    symbol="sqrt(qk)",
    scale=1e-4,
    source="no published figure",
    shapes=RECORD,
    parts=BIAS_COSINES,
    traits=Traits(positive=True, changes="scale_factor", basis="cosines times acceleration"),
    search=Search(includes=("scale_factor",)),
)
def scale_random_walk(s: Signals, start: float, length: float) -> Array:
    """Random-walk scale factor: k' is white with density qk.

    Equation: e = sqrt(qk) a sum_j n_j sqrt(2 L)/(pi j) cos(pi j (t - start)/L), n_j independent with variance 1; with
    the scale factor in the model this is the random walk itself, cut after the last j.
    Looks like: a residual proportional to acceleration whose size changes slowly and at random.
    Easily confused with: scale_drift, scale_step, temperature_scale where temperature is not recorded,
    scale_gauss_markov.
    Separate by: temperature logged; a longer record with steady motion.
    """
    j = np.arange(1, len(BIAS_COSINES) + 1)
    return s.a[:, None] * cosines(s.t, start, length, np.sqrt(2.0 * length) / (np.pi * j))


@effect(
    "scale_gauss_markov",
    unit="1",
    port="process",
    symbol="sigma_k",
    scale=1e-3,
    source="no published figure; the paper's explanation of its section IV",
    shapes={**RECORD, "tau": Shape("s", slow(0.005, 0.5), trials=4, spacing="log")},
    parts=STATIONARY,
    traits=Traits(positive=True, changes="scale_factor", basis="cosines times acceleration"),
    search=Search(includes=("scale_factor",)),
)
def scale_gauss_markov(s: Signals, start: float, length: float, tau: float) -> Array:
    """Gauss-Markov scale factor: k' = -k/tau + noise, standard deviation sigma_k.

    Equation: e = sigma_k a (n_0 sqrt(2 tau/L) + sum_j n_j sqrt(4 tau/L / (1 + (w_j tau)²)) cos(w_j (t - start))),
    w_j = pi j/L, n_j independent with variance 1: its spectrum on the cosines of the record, good for tau well below L.
    The scale factor beside it is the mean of the process, which a record knows to sigma_k sqrt(2 tau/L).
    Looks like: a residual proportional to acceleration whose size changes at random within tau.
    Easily confused with: scale_random_walk when tau exceeds the record; cubic where it is left out.
    Separate by: a record of at least 10 tau; motion of one amplitude throughout.
    """
    return s.a[:, None] * stationary(s.t, start, length, tau)
