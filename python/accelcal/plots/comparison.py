"""Figures of a comparison: simulation, unaided drift, residuals over time, and one page of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from accelcal.data import NORMAL_95, Array, instant
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.estimation.estimate import Fit
from accelcal.plots import matplotlib
from accelcal.plots.diagnosis import added_variable, error_reduction, ranking
from accelcal.plots.figure import (
    COLUMNS,
    Axis,
    Band,
    Figure,
    Level,
    Line,
    Mark,
    Panel,
    Role,
    ThemeName,
    imposed_band_note,
    sentence,
)
from accelcal.plots.model import nonlinearity, parameters
from accelcal.plots.residuals import autocorrelation, histogram, regions
from accelcal.plots.timeline import TIME, closely, overlay
from accelcal.results.comparisons import quoted
from accelcal.results.words import grouped, length, prefixed
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Comparison, headline_horizon

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawn

TRANSIENT = 1.5
"""Predicted deviations beyond this many medians, as before the filter has settled, do not size the axis."""
PALE = 0.35
"""Opacity of what the previous model gave."""
RESIDUAL, DRIFT = "Accelerometer residual", "Unaided drift"
"""What a headline begins with."""
DRIFTS: tuple[tuple[str, Role], ...] = (
    ("bias of this run re-estimated", "model"),
    ("all parameters from the fit", "other"),
    ("noise floor", "floor"),
)
"""Curves of `drifts`."""


def simulated(comparison: Evaluation) -> Figure:
    """Draw measured and simulated position, and below them the error of the simulation.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    """
    t, measured, position = comparison.simulated
    error, spread = position - measured, 2.0 * comparison.simulated_std
    factor, unit = prefixed("m", measured, position)
    error_factor, error_unit = prefixed("m", error)
    largest = float(np.abs(error).max())
    edge = 1.1 * error_factor * max(largest, min(float(spread.max()), 3.0 * largest))  # a band grows beyond all bounds
    reach = spread * error_factor
    above = (
        Line(t, measured * factor, "measured", "measured", COLUMNS),
        Line(t, position * factor, "simulated", "model", COLUMNS),
    )
    below = (
        Level(0.0),
        Band(t, -reach, reach, "expected from noise, ± 2 σ"),
        Line(t, error * error_factor, "simulated − measured", "residual", COLUMNS),
    )
    headline = f"Simulated without position from {instant(t[0])} s on: rms error {length(comparison.simulated_rms)}"
    panels = (
        Panel(above, TIME, Axis("position", unit), height=220.0),
        Panel(below, TIME, Axis("error", error_unit, range=(-edge, edge) if edge > 0.0 else None), height=160.0),
    )
    return Figure(panels, headline, shared_x=True)


def coasting(comparison: Evaluation, *, beside: Sequence[Evaluation] = ()) -> Figure:
    """Draw rms unaided drift against the time since position was withheld, with its noise floor.

    Parameters
    ----------
    comparison : from `accelcal.compare`; horizons that the record does not allow are absent.
    beside : further outputs of the sensor, whose drifts set unit and ordinate as well.
    """
    points, *others = map(drifts, (comparison, *beside))
    ticks = points[0][0].tolist()
    if not ticks:
        least = min(comparison.coast_rms, default=1.0)
        return sentence(DRIFT, f"The record is too short for a drift over {least:g} s.")
    every = np.concatenate([y for several in (points, *others) for _, y in several])
    factor, unit = prefixed("m", every)
    drawn = tuple(
        Line(h, y * factor, name, role, marker=".") for (name, role), (h, y) in zip(DRIFTS, points, strict=True)
    )
    middle, ratio = factor * math.sqrt(every.min() * every.max()), math.sqrt(every.max() / every.min())
    reach = max(1.5 * ratio, math.sqrt(10.0))  # a flat curve must not appear steep
    time = Axis(
        "time without position",
        "s",
        "log",
        (ticks[0] / 1.4, ticks[-1] * 1.4),
        (ticks, [f"{h:g}\n{(n := comparison.coast_starts[h])} start{'s'[: n != 1]}" for h in ticks]),
    )
    drift = Axis("rms unaided drift", unit, "log", (middle / reach, middle * reach))
    return Figure((Panel(drawn, time, drift),), drift_headline(comparison))


def drifts(comparison: Evaluation) -> list[Array]:
    """Horizons in s and drifts in m, (2, n) each: with the bias re-estimated, with all parameters from the fit, and of
    noise alone."""
    curves = (comparison.coast_rms, comparison.coast_frozen_rms, comparison.drift_floors)
    allowed = ([(h, y) for h, y in sorted(curve.items()) if y is not None] for curve in curves)
    return [np.array(pairs).reshape(-1, 2).T for pairs in allowed]


def drift_headline(comparison: Evaluation) -> str:
    """The drift that is quoted first, with its noise floor."""
    horizon = headline_horizon(comparison)
    if horizon is None:
        return f"{DRIFT}: the record is too short"
    floor = comparison.drift_floors.get(horizon)
    beside = "" if floor is None else f", noise floor {length(floor)}"
    return f"{DRIFT} after {horizon:g} s: {length(comparison.coast_rms[horizon] or 0.0)} rms{beside}"


def one_step(comparison: Evaluation, *, previous: Evaluation | None = None) -> Figure:
    """Draw one-step residuals against time with the band that should hold 95 % of them.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    previous : of the previous model, on the same recording; drawn pale.
    """
    (t, e), std, unit = comparison.residual, comparison.residual_std, "m"
    what = f"One-step residuals: rms {length(comparison.one_step_rms)}"
    if comparison.innovations is not None:  # the reference is no position
        (t, e), std, unit = comparison.innovations, np.ones(len(comparison.innovations[1])), "1"
        what = f"Innovations over their predicted deviation: rms {math.sqrt(np.mean(e**2)):.3f}"
    reach, settled = NORMAL_95 * std, std <= TRANSIENT * np.median(std)
    edge = 1.15 * float(max(np.abs(e[settled]).max(), reach[settled].max()))
    share = f"{100.0 * float(np.mean(np.abs(e) <= reach)):.1f} % of {grouped(len(e))} inside the 95 % band"
    factor, unit = prefixed(unit, edge)
    marks = list[Mark]()
    if previous is not None:
        at, old = previous.innovations or previous.residual
        edge = max(edge, 1.15 * float(np.quantile(np.abs(old), 0.999)))
        marks.append(Line(at, old * factor, "before", "before", COLUMNS, opacity=PALE))
    reach = np.minimum(reach, 1.1 * edge) * factor
    marks += [
        Line(t, e * factor, "residual", "residual", COLUMNS),
        Band(t, -reach, reach, "predicted 95 % band"),
    ]
    beyond = int(np.count_nonzero(np.abs(e) > edge))
    off = f"{grouped(beyond)} reading{'s'[: beyond > 1]} beyond the axis" if beyond else ""
    y = Axis("one-step residual", unit, range=(-edge * factor, edge * factor))
    return Figure((Panel(tuple(marks), TIME, y, height=262.0),), f"{what}, {share}{imposed_band_note(comparison)}", off)


def accel_residual(
    comparison: Evaluation, *, previous: Evaluation | None = None, beside: Sequence[Evaluation] = ()
) -> Figure:
    """Draw the accelerometer residual below the highest frequency at which the encoder is a reference.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    previous : of the previous model, on the same recording; drawn pale.
    beside : further outputs of the sensor, whose residuals set unit and ordinate as well.
    """
    t, residual = comparison.accel_residual
    if len(t) == 0:
        return sentence(RESIDUAL, f"The record is too short for a residual below {comparison.band:.3g} Hz.")
    every = np.concatenate([residual, *(other.accel_residual[1] for other in beside)])
    factor, unit = prefixed("m/s²", every)
    rms = comparison.accel_rms * factor
    marks: list[Mark] = [
        Line(t, residual * factor, "output − model", "residual", COLUMNS),
        Level(rms, name="± rms", role="other"),
        Level(-rms, name="± rms", role="other"),
    ]
    if previous is not None and len(previous.accel_residual[0]):
        at, old = previous.accel_residual
        marks.insert(0, Line(at, old * factor, "before", "before", COLUMNS, opacity=PALE))
    text = f"{RESIDUAL} below {comparison.band:.3g} Hz: rms {rms:.3g} {unit}"
    edge = 1.05 * factor * float(np.abs(every).max())
    y = Axis("accelerometer residual", unit, range=(-edge, edge) if beside else None)
    return Figure((Panel(tuple(marks), TIME, y, height=262.0),), text)


def residual_of_axes(
    axes: Mapping[str, Evaluation], *, previous: Mapping[str, Evaluation] = MappingProxyType({})
) -> Figure:
    """Draw the accelerometer residual of each output of a sensor, one under the other in one unit over one time axis.

    Parameters
    ----------
    axes : from `accelcal.compare`, by axis.
    previous : of the previous model, on the same recordings; drawn pale.
    """
    beside = (*axes.values(), *previous.values())
    return side_by_side(
        RESIDUAL,
        {a: accel_residual(evaluation, previous=previous.get(a), beside=beside) for a, evaluation in axes.items()},
        1,
    )


def coasting_of_axes(axes: Mapping[str, Evaluation]) -> Figure:
    """Draw the unaided drift of each output of a sensor, side by side in one unit with one ordinate.

    Parameters
    ----------
    axes : from `accelcal.compare`, by axis.
    """
    return side_by_side(DRIFT, {axis: coasting(e, beside=tuple(axes.values())) for axis, e in axes.items()}, 3)


def side_by_side(name: str, figures: Mapping[str, Figure], columns: int) -> Figure:
    """Figures of one panel for each output as one, whose panels say what the headlines said beyond their `name`; one
    figure alone as it is."""
    panels = tuple(
        replace(figure.panels[0], title=f"{axis}{figure.headline.removeprefix(name).partition(',')[0]}", height=220.0)
        for axis, figure in figures.items()
    )
    if len(panels) == 1:
        return next(iter(figures.values()))
    return Figure(panels, f"{name} of the outputs {', '.join(figures)}", columns=columns, shared_x=columns == 1)


def overview(fit: Fit, comparison: Evaluation, *, theme: ThemeName = "light") -> Drawn:
    """Draw one page: simulation, unaided drift, one-step residuals, and the most significant regions.

    Parameters
    ----------
    fit : the model that was compared.
    comparison : from `accelcal.compare`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    parts = (simulated(comparison), coasting(comparison), one_step(comparison), regions(comparison, 2))
    return matplotlib.page(parts, summary_sentence(fit, comparison), theme)


def loop(diagnosis: Diagnosis, comparison: Comparison, *, theme: ThemeName = "light") -> Drawn:
    """Draw one page: measured and modelled, where it fails, the candidates, the evidence, the error before and after.

    Parameters
    ----------
    diagnosis : of the model that lacks an effect.
    comparison : of that model and of the one with the effect, on held-out data.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    lacking = comparison.evaluations[0][0]
    added = [name for name in comparison.fits[-1].model.added if name not in diagnosis.fit.model.added]
    parts = (
        replace(closely([(comparison.names[0], lacking)]), headline="1  Measured and modelled, held-out data"),
        replace(regions(lacking, 1), headline="2  Where the model fails", note="", legend=False),
        replace(ranking(diagnosis, 6), headline=f"3  Candidates, of {diagnosis.scan.examined}", note="", legend=False),
        replace(added_variable(diagnosis, lacking, *added[:1]), headline="4  Error against the effect, held-out data"),
        replace(error_reduction(comparison), headline="5  The error before and after"),
    )
    measure = comparison.headline
    errors = " → ".join(quoted(measure, evaluation).split(" (")[0] for evaluation in comparison)
    text = f"{comparison.names[-1]}, {measure.name}: {errors} rms on unseen data"
    return matplotlib.page(parts, text, theme, (4.0, 3.0, 4.0, 7.0, 4.0))


def write(comparison: Comparison, directory: str | Path, *, theme: ThemeName = "light") -> list[Path]:
    """Write every figure as PNG and SVG, all of them or none.

    Parameters
    ----------
    comparison : from `accelcal.compare`. Of several models or recordings: the errors, and each recording with all
        models.
    directory : made if it does not exist. Dark figures end in "-dark", so both themes can share a folder.
    theme : "light" or "dark".

    Returns
    -------
    The files, the overview first.

    Raises
    ------
    MissingExtra
        If matplotlib is not installed; nothing is written then.
    """

    def of_several() -> Iterator[tuple[str, Drawn]]:
        for number, evaluations in enumerate(comparison.evaluations, start=1):
            name = "overlay" if len(comparison.evaluations) == 1 else f"overlay-{number}"
            yield name, matplotlib.draw(overlay(list(zip(comparison.names, evaluations, strict=True))), theme)
        yield "error_reduction", matplotlib.draw(error_reduction(comparison), theme)

    def of_single(fit: Fit, evaluation: Evaluation) -> Iterator[tuple[str, Drawn]]:
        yield "overview", overview(fit, evaluation, theme=theme)
        of_evaluation: tuple[Callable[..., Figure], ...] = (
            overlay,
            simulated,
            coasting,
            one_step,
            regions,
            accel_residual,
            histogram,
            autocorrelation,
        )
        drawn = [(define, define(evaluation)) for define in of_evaluation]
        for define, figure in (*drawn, (parameters, parameters(fit)), (nonlinearity, nonlinearity(fit))):
            yield define.__name__, matplotlib.draw(figure, theme)

    alone = len(comparison) == len(comparison.evaluations) == 1
    drawn = of_single(comparison.fits[0], comparison[0]) if alone else of_several()
    return matplotlib.write(drawn, directory, theme)


def summary_sentence(fit: Fit, comparison: Evaluation) -> str:
    """The key figures: one-step rms, unaided drift with its noise floor, largest residual."""
    drifted = drift_headline(comparison)
    added = ", ".join(e.symbol for e in fit.estimates)
    return (
        f"{comparison.recording or 'recording'}, model with {added}: one-step rms "
        f"{length(comparison.one_step_rms)}; {drifted[:1].lower()}{drifted[1:]}; {comparison.worst}"
    )
