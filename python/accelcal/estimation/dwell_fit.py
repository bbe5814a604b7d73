"""A fit to static dwells alone, and what any fit says of its dwells."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from accelcal.data import Array, Dwells, Positions
from accelcal.effects import find
from accelcal.estimation.dwell_rows import (
    DwellRows,
    Nuisances,
    acts_at_rest,
    dwell_rows,
    remainder,
    shown,
    stepped,
    with_scatter,
)
from accelcal.estimation.gauss_newton import Layout, NotIdentifiable, Output, solve
from accelcal.estimation.noise import REMARKED_BEYOND
from accelcal.estimation.plausible import plausible
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run_to_run import REMARK_ALPHA
from accelcal.estimation.values import Values
from accelcal.model import Model
from accelcal.signals.signals import Origins

ROUNDS, WEIGHING = 50, 6
"""Linearisations at most, and those after which the weights of the dwells stay."""
SETTLED = 1e-11
"""Steps are over once each is below this share of a standard deviation."""


@dataclass(frozen=True, slots=True)
class DwellFit:
    """Residuals of a fit at its dwells."""

    name: str
    digest: str
    angle: tuple[float, ...]
    """Elevation of each as declared, rad; empty of positions of three outputs, whose attitudes are unknown."""
    residual: tuple[float, ...]
    """Mean output less that of the model, of three outputs the norm of specific force less gravity, m/s²."""
    std: tuple[float, ...]
    """Its standard deviation by all that is declared and found, without the uncertainty of the model, m/s²."""
    zeros: tuple[tuple[str, float], ...]
    """Angle zero of each group, rad."""
    ratio: float
    """Scatter between dwells over what noise within them explains; NaN where no dwell is left over."""
    scatter: float
    """Standard deviation between dwells beyond all that is declared, m/s²; 0 where there is none."""
    p_value: float
    """Of the scatter under all that is declared; 1 where no dwell is left over."""
    freedom: int
    """Dwells less coefficients and angle zeros."""
    remarks: tuple[Remark, ...] = ()

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood of the residuals, normal and independent."""
        residual, variance = np.array(self.residual), np.square(self.std)
        return -0.5 * float(np.sum(residual**2 / variance + np.log(2.0 * math.pi * variance)))


def dwell_model(model: Model, dwells: Dwells) -> Model:
    """The model without the timing, which no dwell shows.

    Raises
    ------
    NotIdentifiable
        If it has effects that no dwell shows.
    """
    held = {term.name: 0.0 for term in model.free if term.owner == "timing" and term.effect.name in model.effects[:3]}
    model = model.drop(*(name for name in model.added if find(name).seen_by_sets and not acts_at_rest(find(name))))
    model = model.freeze(**held)
    for term in model.free:
        if not acts_at_rest(term.effect):
            raise NotIdentifiable(
                f"{dwells.name or 'dwells'}: {term.name} does not act on a sensor at rest; drop it, hold it with a "
                "value, or fit a motion together with the dwells"
            )
        if not shown(dwells, term.effect):
            raise NotIdentifiable(
                f"{dwells.name or 'dwells'}: {term.name} needs {' and '.join(term.effect.needs)}, which these dwells "
                "do not have; add the column, or drop the effect"
            )
    return model


def origins_of(dwells: Dwells) -> Origins:
    """Zero points that suit a set of dwells: their mean temperature."""
    return Origins(temperature=0.0 if dwells.temperature is None else float(np.mean(dwells.temperature)))


@dataclass(frozen=True, slots=True)
class DwellSolution:
    """Estimates of a model from dwells alone."""

    model: Model
    layout: Layout
    values: Values
    covariance: Array
    fit: DwellFit
    nuisances: Nuisances


def solve_dwells(model: Model, dwells: Dwells, origins: Origins) -> DwellSolution:
    """Generalised least squares with angle zeros, to the fixed point of angle and scatter.

    Raises
    ------
    NotIdentifiable
        If the attitudes do not determine the model.
    """
    model = dwell_model(model, dwells)
    layout = Layout.of(model, [Output(0)])
    if not layout.slots:
        raise NotIdentifiable(f"{dwells.name or 'dwells'}: every parameter is held; release at least one")
    x = layout.prior_mean(model)
    belief, nuisances = layout.prior_information(model), Nuisances()
    for number in range(ROUNDS):
        values = layout.scatter(x, model, 0)
        if number > 0:
            nuisances = stepped(dwells, values, origins, nuisances)
        if 1 < number < WEIGHING:
            nuisances = with_scatter(dwells, model, values, origins, nuisances)
        if number == WEIGHING:  # generalised least squares with these weights
            declared = dwell_rows(dwells, (), values, origins, replace(nuisances, scatter=0.0)).std
            nuisances = replace(nuisances, weighed=tuple(declared.tolist()))
        rows = dwell_rows(dwells, model.free, values, origins, nuisances)
        score = rows.columns.T @ rows.y + belief * (layout.prior_mean(model) - x)
        try:
            step, covariance = solve(rows.columns.T @ rows.columns + np.diag(belief), score, layout)
        except NotIdentifiable as error:
            raise NotIdentifiable(
                f"{dwells.name or 'dwells'}: {error}; {len(dwells)} dwells at "
                f"{len(set(np.round(np.sin(dwells.angle), 6)))} elevations do not determine it"
            ) from None
        x = x + step
        if number > WEIGHING and np.all(np.abs(step) <= SETTLED * np.sqrt(np.diag(covariance))):
            break
    values = layout.scatter(x, model, 0)
    nuisances = stepped(dwells, values, origins, nuisances)
    names = [term.name for term in model.free]
    k = names.index("scale_factor") if "scale_factor" in names else None
    std = 0.0 if k is None else math.sqrt(covariance[k, k])
    if std > MOST_UNCERTAIN * max(1.0, abs(values.scale)) or abs(values.scale) < LEAST_SCALE:
        raise NotIdentifiable(
            f"{dwells.name or 'dwells'}: 1 + k = {values.scale:.3g} with a standard deviation of {std:.2g}: the means "
            f"do not follow gravity along the axis; {MISTAKEN}"
        )
    result = seen_in(dwells, model, values, origins, nuisances)
    if not plausible(values.scale / (dwells.rig.ratio or 1.0)):
        wrong = remark("implausible_scale", scale=values.scale, cause=f"{dwells.name or 'dwells'}: {MISTAKEN}")
        result = replace(result, remarks=(*result.remarks, wrong))
    return DwellSolution(
        model,
        layout,
        values,
        covariance,
        result,
        nuisances,
    )


MOST_UNCERTAIN, LEAST_SCALE = 0.5, 1e-6
"""Relative standard deviation of 1 + k beyond which dwells show none, and the least 1 + k of a model."""
MISTAKEN = (
    "check column and unit of the means, scale of the sensor, sense of the angles, and [dwell] gravity, angle_std"
)
"""Possible causes of a scale factor that no sensor has, on dwells."""


LEAST_SCATTER_ALPHA = 1e-4
"""Probability of as little scatter between dwells below which a noise within them that is too large is said."""


def seen_in(dwells: Dwells, model: Model, values: Values, origins: Origins, nuisances: Nuisances) -> DwellFit:
    """Residuals of dwells under a model at given values."""
    alone = replace(
        dwells,
        angle_std=0.0,
        rig=replace(dwells.rig, sensor=replace(dwells.rig.sensor, bias_instability=None, random_walk=None)),
    )
    plain = replace(nuisances, scatter=0.0)
    rows = dwell_rows(dwells, model.free, values, origins, nuisances)
    declared = dwell_rows(dwells, model.free, values, origins, plain)
    result = left_of(dwells, rows, declared, dwell_rows(alone, model.free, values, origins, replace(plain, weighed=())))
    remarks = (*(remark("assumed", text=text) for text in dwells.assumptions), *result.remarks)
    return replace(result, angle=tuple(dwells.angle.tolist()), remarks=remarks)


def left_of(dwells: Dwells | Positions, rows: DwellRows, declared: DwellRows, white: DwellRows) -> DwellFit:
    """What rows say of dwells, beside those by all that is declared and by noise within them alone."""
    squares, freedom = remainder(declared)
    ratio = math.sqrt(remainder(white)[0] / freedom) if freedom > 0 else math.nan
    p_value = float(scipy.special.chdtrc(freedom, squares)) if freedom > 0 else 1.0
    text = ""
    if ratio > REMARKED_BEYOND:
        left = f"{math.sqrt(float(rows.left @ rows.left) / max(freedom, 1)):.2g} m/s²"
        causes = "instability of the bias, angles, temperature, or a term that the model lacks"
        causes = causes if isinstance(dwells, Dwells) else "instability of the bias, temperature, or a hand that shakes"
        reason = (
            "what is declared of the bias and the angles explains it"
            if p_value >= REMARK_ALPHA
            else f"{math.sqrt(rows.scatter):.2g} m/s² more than is declared, taken into the uncertainty: {causes}"
        )
        text = (
            f"the dwells scatter by {left}, {float(f'{ratio:.2g}'):g} times what noise within them explains; {reason}"
        )
    elif freedom > 0 and scipy.special.chdtr(freedom, freedom * ratio**2) < LEAST_SCATTER_ALPHA:
        text = (
            f"the dwells scatter {ratio:.2g} times as much as noise within them explains: is std that of the samples, "
            "in the unit of the mean or its own, as in std_mV? Effects are judged against it"
        )
    note = remark("dwells_scatter", text=f"{dwells.name or 'dwells'}: {text}", ratio=ratio, p=p_value)
    return DwellFit(
        name=dwells.name,
        digest=dwells.digest,
        angle=(),
        residual=tuple(rows.left.tolist()),
        std=tuple(rows.std.tolist()),
        zeros=tuple(rows.zeros.items()),
        ratio=ratio,
        scatter=math.sqrt(rows.scatter),
        p_value=p_value,
        freedom=freedom,
        remarks=(note,) if text else (),
    )
