"""Rows of static dwells: what each says of the coefficients of the sensor, its angle zero eliminated.

A dwell is one row of the regression, the effect functions at constant arguments (derivations 6.11). Dwells of one group
share an angle zero; rows are projected onto what no angle zero explains, so that their Gram matrix is the Schur
complement and adds to that of any motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from accelcal.data import ACROSS, Array, Dwells, Positions
from accelcal.data.arrays import VANISHING
from accelcal.effects import BUILT_IN, Effect, is_local, of_one_record
from accelcal.estimation.run_to_run import REMARK_ALPHA
from accelcal.estimation.values import Values
from accelcal.model import Model, Term, evaluate
from accelcal.signals.signals import Origins, Signals

SERIES = 16
"""Samples of the constant series that an effect with memory is evaluated on; the last is what a dwell shows."""
TURN = 1e-6
"""Half the difference of angles that a slope is taken over, rad."""
ZERO_STD = 0.1
"""Standard deviation of an angle zero where no level is declared, rad: some degrees."""
ORDINARY = {effect.name: 10.0 * effect.prior.typical for effect in BUILT_IN}
"""Coefficient that is ordinary for each effect."""


def acts_at_rest(effect: Effect) -> bool:
    """Whether an effect adds to the output of a sensor that dwells apart from its rig: it belongs to the sensor and to
    no clock, and is none that the mount makes."""
    return (
        effect.owner == "sensor"
        and effect.port == "output"
        and not of_one_record(effect)
        and not effect.traits.separated_by
    )


@dataclass(frozen=True, slots=True)
class DwellRows:
    """Whitened rows, angle zeros eliminated, and what was eliminated."""

    columns: Array
    """(n, m)"""
    y: Array
    """Residual of each row, (n,)."""
    zeros: dict[str, float]
    """Angle zero of each group, rad."""
    left: Array
    """Residual of each mean under the model and the angle zeros, (dwells,) m/s²."""
    std: Array
    """Standard deviation of each mean, (dwells,) m/s²."""
    freedom: int
    """Dwells less the angle zeros that they show."""
    scatter: float = 0.0
    """Variance of each mean beyond all that is declared, (m/s²)²."""


def signals_at(dwells: Dwells, angle: Array, scale: float, origins: Origins) -> Signals:
    """Constant arguments of the effects in dwells at some elevations, (n,) each."""
    nothing = np.zeros(len(dwells))
    warm = {} if dwells.temperature is None else {"temperature": dwells.temperature - origins.temperature}
    force = dwells.specific_force(angle)
    return Signals(t=nothing, p=nothing, v=nothing, a=force, jerk=nothing, scale=scale, rig=dwells.rig, side=warm)


def columns_at(dwells: Dwells | Positions, terms: Sequence[Term], s: Signals) -> Array:
    """Output per unit coefficient in each dwell, at one or several forces in turn, (n, m)."""
    X = np.zeros((len(s.t), len(terms)))
    effects = [term.effect for term in terms]
    there = [k for k, e in enumerate(effects) if (acts_at_rest(e) or e.needs == ACROSS) and shown(dwells, e)]
    local = [k for k in there if is_local(terms[k].effect)]
    for k, column in zip(local, evaluate([terms[k] for k in local], s), strict=True):
        X[:, k] = column
    remembering = [k for k in there if k not in local]
    for row, length in enumerate(np.resize(dwells.duration, len(s.t)) if remembering else ()):
        constant = s.at(np.full(SERIES, row))
        constant = replace(constant, t=np.linspace(0.0, float(length), SERIES))
        for k, column in zip(remembering, evaluate([terms[k] for k in remembering], constant), strict=True):
            X[row, k] = column[-1]
    return X


def shown(dwells: Dwells | Positions, effect: Effect) -> bool:
    """Whether dwells have the channels of an effect; positions of three outputs have what is across each of them."""
    across = ACROSS if isinstance(dwells, Positions) else ()
    return set(effect.needs) <= {*across, *(() if dwells.temperature is None else ("temperature",))}


def output_at(dwells: Dwells, angle: Array, values: Values, origins: Origins) -> Array:
    """Output of the model in dwells at some elevations, (n,) m/s²."""
    return output_of(dwells, signals_at(dwells, angle, values.scale, origins), values)


def output_of(dwells: Dwells | Positions, s: Signals, values: Values) -> Array:
    """Output of the model at constant arguments, (n,) m/s²."""
    coefficients = np.array([values.by_name[term.name] for term in values.terms])
    return np.asarray(s.a + columns_at(dwells, values.terms, s) @ coefficients)


@dataclass(frozen=True, slots=True)
class Nuisances:
    """Nuisances that are estimated of dwells beside the coefficients."""

    zeros: tuple[float, ...] = ()
    """Angle zero of each group, rad; all 0 where empty."""
    weighed: tuple[float, ...] = ()
    """Declared standard deviation of each mean, m/s²; that at the values and angles at hand where empty."""
    scatter: float = 0.0
    """Variance of each mean beyond all that is declared, (m/s²)²."""
    apart: tuple[str, ...] = ()
    """Coefficients that the dwells have values of their own of, since they differ from run to run."""


@dataclass(frozen=True, slots=True)
class Linearised:
    """Dwells at given coefficients and angle zeros."""

    groups: list[str]
    zeros: Array
    weight: Array
    """Inverse standard deviations, (n,)."""
    left: Array
    """Mean output less that of the model, (n,) m/s²."""
    signals: Signals
    Z: Array
    """Whitened columns of the angle zeros and of what is apart, the beliefs in the zeros last, (n + groups, z)."""
    shown: int
    """Columns of Z that the dwells themselves determine."""

    @property
    def y(self) -> Array:
        """Whitened residuals, the beliefs in the zeros last, (n + groups,)."""
        return np.concatenate([self.weight * self.left, -self.zeros * np.diag(self.Z[len(self.weight) :])])

    @classmethod
    def at(cls, dwells: Dwells, values: Values, origins: Origins, nuisances: Nuisances) -> Linearised:
        """Linearise."""
        groups = sorted(set(dwells.group))
        member = np.array([[group == g for g in groups] for group in dwells.group], dtype=np.float64)
        zeros = np.array(nuisances.zeros or (0.0,) * len(groups))
        angle = dwells.angle + member @ zeros
        ahead, behind, at = (output_at(dwells, angle + turn, values, origins) for turn in (TURN, -TURN, 0.0))
        declared = np.square(nuisances.weighed) if nuisances.weighed else dwells.variance_at(angle, values.scale)
        weight = 1.0 / np.sqrt(declared + nuisances.scatter)
        slope = (weight * (ahead - behind) / (2.0 * TURN))[:, None] * member
        belief = np.eye(len(groups)) / (dwells.rig.uncertainty.level or ZERO_STD)
        signals = signals_at(dwells, angle, values.scale, origins)
        columns = columns_at(dwells, [term for term in values.terms if term.name in nuisances.apart], signals)
        Z = np.vstack(
            [
                np.hstack([slope, weight[:, None] * columns]),
                np.hstack([belief, np.zeros((len(groups), columns.shape[1]))]),
            ]
        )
        shown = int(np.count_nonzero(np.linalg.norm(slope, axis=0) > np.diag(belief))) + columns.shape[1]
        return cls(groups, zeros, weight, dwells.mean - at, signals, Z, shown)


def dwell_rows(
    dwells: Dwells, terms: Sequence[Term], values: Values, origins: Origins, nuisances: Nuisances | None = None
) -> DwellRows:
    """Rows at given coefficients.

    Parameters
    ----------
    dwells : the set.
    terms : coefficients that become columns, (m,).
    values : at which the model is taken.
    origins : zero of the temperature.
    nuisances : angle zeros to linearise about, further scatter, and what is eliminated like the zeros.
    """
    at = Linearised.at(dwells, values, origins, nuisances or Nuisances())
    X = at.weight[:, None] * columns_at(dwells, terms, at.signals)
    X = np.vstack([X, np.zeros((len(at.groups), len(terms)))])
    basis = scipy.linalg.orth(at.Z, rcond=VANISHING)
    y = at.y - basis @ (basis.T @ at.y)
    return DwellRows(
        X - basis @ (basis.T @ X),
        y,
        dict(zip(at.groups, at.zeros.tolist(), strict=True)),
        y[: len(dwells)] / at.weight,
        1.0 / at.weight,
        len(dwells) - at.shown,
        0.0 if nuisances is None else nuisances.scatter,
    )


def stepped(dwells: Dwells, values: Values, origins: Origins, nuisances: Nuisances) -> Nuisances:
    """Angle zeros one Newton step on, at given coefficients.

    The zeros follow the coefficients step by step from 0: most likely for coefficients that are far off they would
    explain what those miss, by turning dwells at ±1 g, where any angle is about as good.
    """
    at = Linearised.at(dwells, values, origins, nuisances)
    step = np.linalg.lstsq(at.Z, at.y, rcond=VANISHING)[0][: len(at.zeros)]
    return replace(nuisances, zeros=tuple((at.zeros + step).tolist()))


def with_scatter(dwells: Dwells, model: Model, values: Values, origins: Origins, nuisances: Nuisances) -> Nuisances:
    """The variance between dwells beyond all that is declared: 0 where what a model leaves of them is as likely as not;
    else the one at which its sum of squares is what it should be."""

    def rows(variance: float) -> DwellRows:
        return dwell_rows(dwells, model.free, values, origins, replace(nuisances, scatter=variance))

    return replace(nuisances, scatter=further_variance(rows, float(np.max(dwells.variance))))


def further_variance(rows: Callable[[float], DwellRows], largest: float) -> float:
    """The same of rows by that variance, (m/s²)², each mean having at most the variance `largest` without it."""
    squares, freedom = remainder(rows(0.0))
    if freedom < 1 or scipy.special.chdtrc(freedom, squares) >= REMARK_ALPHA:
        return 0.0
    largest *= squares
    while remainder(rows(largest))[0] > freedom:
        largest *= 4.0
    return float(scipy.optimize.brentq(lambda v: remainder(rows(v))[0] - freedom, 0.0, largest, rtol=1e-12))


FORCE_STEP = 1e-3
"""Half the difference of specific forces that a slope is taken over, m/s²."""
ATTITUDE_STEPS = 3
"""Newton steps of the attitudes of positions; each leaves the share of their error that the scatter is of gravity."""


def position_rows(
    positions: Positions,
    terms: Sequence[Term],
    values: Sequence[Values],
    places: Sequence[Sequence[int]],
    width: int,
    origins: Origins,
    *,
    scatter: float = 0.0,
    white: bool = False,
    apart: Sequence[int] = (),
) -> DwellRows:
    """One row of each static position, its attitude eliminated (derivations 6.11).

    Parameters
    ----------
    positions : means of three outputs.
    terms : coefficients that become columns, (m,).
    values : of the three outputs, at which the model is taken.
    places : column of each term, of each output; outputs share what has one column.
    width : number of columns.
    origins : zero of the temperature.
    scatter : variance of each mean beyond all that is declared, (m/s²)².
    white : whether means are as certain as noise within them allows.
    apart : columns of which positions have values of their own.
    """
    n = len(positions)
    std = np.sqrt((positions.white if white else positions.variance) + scatter)
    force = (positions.mean - [of.bias for of in values]) / [of.scale for of in values]
    for _ in range(1 + ATTITUDE_STEPS):
        up = force / np.linalg.norm(force, axis=1)[:, None]
        force = positions.gravity * up
        trial = np.concatenate([force + FORCE_STEP * e for e in (np.zeros(3), *np.eye(3), *-np.eye(3))])
        of_axis = signals_in(positions, trial, values, origins)
        several = zip(of_axis, values, strict=True)
        output = np.column_stack([output_of(positions, s, of) for s, of in several]).reshape(7, n, 3)
        slope = np.moveaxis(output[1:4] - output[4:], 0, 2) / (2.0 * FORCE_STEP * std[:, :, None])
        left = (positions.mean - output[0]) / std
        across = np.linalg.svd(up[:, :, None])[0][:, :, 1:]
        turns = slope @ across
        force = force + np.einsum("nij,nj->ni", across @ np.linalg.pinv(turns), left)
    normal = np.cross(turns[:, :, 0], turns[:, :, 1])  # of all that no attitude explains
    gain = np.einsum("ni,nij,nj->n", normal, slope, up)
    normal, gain = normal / gain[:, None], np.abs(gain) / np.linalg.norm(normal, axis=1)
    X = np.zeros((n, width))
    for axis, s in enumerate(of_axis):
        columns = columns_at(positions, terms, s.at(slice(n)))
        X[:, places[axis]] += (normal[:, axis] / std[:, axis])[:, None] * columns
    y = np.einsum("ni,ni->n", normal, left)
    X, y = gain[:, None] * X, gain * y
    basis = column_basis(X[:, list(apart)])
    X, y = X - basis @ (basis.T @ X), y - basis @ (basis.T @ y)
    return DwellRows(X, y, {}, y / gain, 1.0 / gain, n - basis.shape[1], scatter)


def signals_in(positions: Positions, force: Array, values: Sequence[Values], origins: Origins) -> list[Signals]:
    """Constant arguments of the effects on each output at specific forces (n, 3), m/s²; positions in turn."""
    nothing = np.zeros(len(force))
    side = dict.fromkeys(ACROSS, nothing)
    if positions.temperature is not None:
        side["temperature"] = np.resize(positions.temperature - origins.temperature, len(force))
    return [
        Signals(
            t=nothing,
            p=nothing,
            v=nothing,
            a=force[:, axis],
            jerk=nothing,
            scale=of.scale,
            rig=positions.rig,
            bias=of.bias,
            coefficients=of.by_name,
            axis="xyz"[axis],
            side=side | {f"across_{k}": force[:, (axis + k) % 3] for k in (1, 2)},
        )
        for axis, of in enumerate(values)
    ]


def remainder(rows: DwellRows) -> tuple[float, int]:
    """Sum of squares that the columns leave of the rows, and its degrees of freedom."""
    basis = column_basis(rows.columns)
    left = rows.y - basis @ (basis.T @ rows.y)
    return float(left @ left), rows.freedom - basis.shape[1]


def column_basis(columns: Array) -> Array:
    """Orthonormal basis of columns (n, m), each scaled to its length."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    return np.asarray(scipy.linalg.orth(scaled, rcond=VANISHING)) if scaled.size else columns[:, :0]


def determines(dwells: Dwells, name: str) -> bool:
    """Whether dwells alone determine a parameter of the linear model, angle zeros unknown: to less than half of what is
    ordinary for it."""
    terms = [term for term in Model.linear().terms if acts_at_rest(term.effect)]
    rows = dwell_rows(dwells, terms, Values({term.name: 0.0 for term in terms}, tuple(terms)), Origins())
    ordinary = np.array([ORDINARY[term.name] for term in terms])
    X = rows.columns * ordinary
    share = np.sqrt(np.diag(np.linalg.inv(X.T @ X + np.eye(len(terms)))))
    return bool(share[[term.name for term in terms].index(name)] < 0.5)
