"""Bias and scale factor that change with time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.data import Array
from accelcal.effects.building_blocks import slow
from accelcal.effects.curves import RECORD, cosines
from accelcal.effects.mechanisms import INSTANT, TIME, Driver, product
from accelcal.effects.registry import CATALOGUE, Search, Shape, Traits, enter

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


def in_time(t: Array, start: float, length: float, tau: float = math.inf) -> Array:
    """Columns of a process by themselves, as those of the bias: Gauss-Markov, or a random walk without `tau`."""
    if tau < math.inf:
        return stationary(t, start, length, tau)
    j = np.arange(1, len(BIAS_COSINES) + 1)
    return cosines(t, start, length, np.sqrt(2.0 * length) / (np.pi * j))


def beyond_cosines(length: float, tau: float = math.inf) -> float:
    """Variance of a process of unit size that its columns lack, since it moves faster than their last cosine.

    Examples
    --------
    >>> round(beyond_cosines(60.0, 3.0), 3), round(beyond_cosines(60.0), 3)
    (0.123, 0.187)
    """
    w = np.pi * (len(BIAS_COSINES) + 0.5) / length
    return float(1.0 - 2.0 / np.pi * np.arctan(w * tau) if tau < math.inf else 1.0 / (w * np.pi))


CORRELATION = Shape("s", slow(0.02, 0.5), trials=3, spacing="log")
"""Correlation time of a Gauss-Markov process."""
MADE = "a tenth of {}"
"""Where the typical size of a process that is made on demand comes from."""


def process(name: str, tau: Shape | None = None) -> dict[str, Any]:
    """The process of a coefficient, its cosines (derivations 7.1) times what one unit adds, as a row of the catalogue.

    Parameters
    ----------
    name : effect whose coefficient it is.
    tau : correlation time of a Gauss-Markov process; None for a random walk.
    """
    stem, kind = CATALOGUE[name], "random_walk" if tau is None else "gauss_markov"
    times = RECORD | ({} if tau is None else {"tau": tau})
    if stem.shapes.keys() & times.keys():
        raise AccelcalError(
            f"{name}_{kind}: {name} has a shape parameter of its own that a process needs: {', '.join(stem.shapes)}"
        )

    return product(name, Driver("its path", "1", lambda s, **when: in_time(s.t, **when), shapes=times)) | {
        "card": f"""The coefficient of {name} is a {"Gauss-Markov process" if tau else "random walk"}.

    Equation: as bias_{kind}, times what one unit of {name} adds.
    Looks like: {stem.line("Looks like").rstrip(".")}, of a size that changes at random.
    Easily confused with: {name}, bias_random_walk, scale_random_walk.
    Separate by: {stem.line("Separate by").rstrip(".")}; a longer record.
    """,
        "unit": stem.unit if tau else "1/√s" if stem.unit == "1" else f"{stem.unit}/√s",
        "port": "process",
        "symbol": f"{'sigma' if tau else 'sqrt(q)'}({stem.symbol})",
        "scale": 0.1 * stem.prior.scale,
        "source": MADE.format(name),
        "parts": STATIONARY if tau else BIAS_COSINES,
        "traits": Traits(positive=True, memory=stem.traits.memory, changes=name),
        "search": Search(includes=(name,)),
        "product": None,
    }


enter(
    {
        "bias_drift": product("bias", TIME)
        | {
            "card": """Linear drift of the bias.

    Equation: e = K0t t.
    Looks like: a residual that is a straight line over time.
    Easily confused with: temperature_bias, warm_up, bias_random_walk, self_heating.
    Separate by: a longer record; a second one after a pause; temperature logged.
    """,
            "unit": "m/s³",
            "symbol": "K0t",
            "scale": 1e-5,
            "source": "1 mg in a quarter of an hour",
            "traits": Traits(common=True, changes="bias"),
        },
        "bias_step": product("bias", INSTANT)
        | {
            "card": """Step of the bias, after a shock or a change of the mount.

    Equation: e = dK0 [t >= instant].
    Looks like: two levels of the residual.
    Easily confused with: bias_random_walk, self_heating where motion begins, dropped samples, missed counts.
    Separate by: a longer record on either side; sample counters.
    """,
            "symbol": "dK0",
            "scale": 1e-3,
            "source": "life drift ±1 mg: IIS2ICLX",
            "traits": Traits(changes="bias"),
        },
        "bias_random_walk": process("bias")
        | {
            "card": """Random-walk bias: K0' is white with density qb.

    Equation: e = sqrt(qb) sum_j n_j sqrt(2 L)/(pi j) cos(pi j (t - start)/L), n_j independent with variance 1; with
    the bias in the model this is the random walk itself, cut after the last j.
    Looks like: a residual with slow random changes that grow with the length of the record.
    Easily confused with: temperature_bias where temperature is not recorded, bias_gauss_markov, bias_drift.
    Separate by: temperature logged; a long record at rest (Allan deviation).
    """,
            "unit": "(m/s²)/√s",
            "symbol": "sqrt(qb)",
            "scale": 1e-4,
            "source": "no published figure; Allan slope +1/2",
            "traits": Traits(positive=True, changes="bias", basis="cosines"),
        },
        "bias_gauss_markov": process("bias", CORRELATION)
        | {
            "card": """Gauss-Markov bias: K0' = -K0/tau + noise, standard deviation sigma_b.

    Equation: e = sigma_b (n_0 sqrt(2 tau/L) + sum_j n_j sqrt(4 tau/L / (1 + (w_j tau)²)) cos(w_j (t - start))),
    w_j = pi j/L, n_j independent with variance 1: its spectrum on the cosines of the record, good for tau well below L.
    The bias beside it is the mean of the process, which a record knows to sigma_b sqrt(2 tau/L).
    Looks like: a residual correlated over tau that returns to its mean.
    Easily confused with: bias_random_walk when tau exceeds the record; flicker noise.
    Separate by: a record of at least 10 tau.
    """,
            "symbol": "sigma_b",
            "scale": 3.4e-5,
            "source": "floor of 3.5 µg: ADXL355",
            "traits": Traits(positive=True, changes="bias", basis="cosines"),
        },
        "scale_drift": product("scale_factor", TIME)
        | {
            "card": """Linear drift of the scale factor.

    Equation: e = kt t a.
    Looks like: a residual proportional to acceleration whose size is a straight line over time.
    Easily confused with: temperature_scale.
    Separate by: temperature logged and not steady; a second record after a pause.
    """,
            "symbol": "kt",
            "scale": 1e-5,
            "source": "no published figure",
            "traits": Traits(changes="scale_factor"),
        },
        "scale_step": product("scale_factor", INSTANT)
        | {
            "card": """Step of the scale factor: a supply, a gain range, a mount that slipped.

    Equation: e = dk a [t >= instant].
    Looks like: a residual proportional to acceleration before or after an instant only.
    Easily confused with: scale_drift, temperature_scale.
    Separate by: a longer record on either side, with equal motion.
    """,
            "symbol": "dk",
            "scale": 1e-3,
            "source": "no published figure",
            "traits": Traits(changes="scale_factor"),
        },
        "scale_random_walk": process("scale_factor")
        | {
            "card": """Random-walk scale factor: k' is white with density qk.

    Equation: e = sqrt(qk) a sum_j n_j sqrt(2 L)/(pi j) cos(pi j (t - start)/L), n_j independent with variance 1; with
    the scale factor in the model this is the random walk itself, cut after the last j.
    Looks like: a residual proportional to acceleration whose size changes slowly and at random.
    Easily confused with: scale_drift, scale_step, temperature_scale where temperature is not recorded,
    scale_gauss_markov.
    Separate by: temperature logged; a longer record with steady motion.
    """,
            "symbol": "sqrt(qk)",
            "scale": 1e-4,
            "source": "no published figure",
            "traits": Traits(positive=True, changes="scale_factor", basis="cosines times acceleration"),
        },
        "scale_gauss_markov": process("scale_factor", replace(CORRELATION, bounds=slow(0.005, 0.5), trials=4))
        | {
            "card": """Gauss-Markov scale factor: k' = -k/tau + noise, standard deviation sigma_k.

    Equation: e = sigma_k a (n_0 sqrt(2 tau/L) + sum_j n_j sqrt(4 tau/L / (1 + (w_j tau)²)) cos(w_j (t - start))),
    w_j = pi j/L, n_j independent with variance 1: its spectrum on the cosines of the record, good for tau well below L.
    The scale factor beside it is the mean of the process, which a record knows to sigma_k sqrt(2 tau/L).
    Looks like: a residual proportional to acceleration whose size changes at random within tau.
    Easily confused with: scale_random_walk when tau exceeds the record; cubic where it is left out.
    Separate by: a record of at least 10 tau; motion of one amplitude throughout.
    """,
            "symbol": "sigma_k",
            "scale": 1e-3,
            "source": "no published figure; the paper's explanation of its section IV",
            "traits": Traits(positive=True, changes="scale_factor", basis="cosines times acceleration"),
        },
    }
)
