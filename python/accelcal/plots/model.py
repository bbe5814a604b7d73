"""Figures of a fit: its parameters, its characteristic, and how far two calibrations of one sensor agree."""

from __future__ import annotations

import numpy as np

from accelcal.calibration.agreement import LIMIT, Agreement
from accelcal.calibration.characteristic import StraightLine, straight_line
from accelcal.data import MICRO_G, NORMAL_95
from accelcal.effects import find, spelled
from accelcal.estimation.allan import OutputNoise, RestNoise
from accelcal.estimation.estimate import Fit
from accelcal.io.dwells import Rests
from accelcal.model import Estimate
from accelcal.plots.figure import (
    COLUMNS,
    Axis,
    Band,
    Figure,
    Level,
    Line,
    Mark,
    Panel,
    Points,
    Role,
    Stretch,
    Text,
    on_rows,
)
from accelcal.results.words import concise, number, prefixed, with_unit

LINEAR_REACH = 30.0
"""Estimates beyond this many typical sizes are drawn on a logarithmic axis, linear about zero."""
REACH = 10.0
"""|En| beyond this is drawn on a logarithmic axis."""
MARGIN = 0.04
"""Of the range of the outputs, above the highest rest, for its number."""


def parameters(fit: Fit) -> Figure:
    """Draw each estimate with two standard deviations, over the typical size of its effect.

    Parameters
    ----------
    fit : from `accelcal.fit`.
    """
    scale = np.array([find(e.name).prior.typical for e in fit.estimates])
    y = np.array([e.value for e in fit.estimates]) / scale
    reach = 2.0 * np.array([e.std for e in fit.estimates]) / scale
    fixed = np.array([e.name in fit.model.fixed for e in fit.estimates], dtype=bool)
    texts = [_value(e, fit) for e in fit.estimates]
    marks: list[Level | Points] = [Level(0.0, upright=True)]
    kinds: tuple[tuple[str, Role], ...] = (("estimated", "model"), ("held fixed", "floor"))
    for chosen, (name, role) in zip((~fixed, fixed), kinds, strict=True):
        rows = np.flatnonzero(chosen)
        if len(rows):
            error = reach[rows] if name == "estimated" else None
            hover = [texts[i] for i in rows]
            marks.append(Points(y[rows], rows.astype(float), name, role, error, True, error is None, hover))
    largest = float(np.max(np.abs(y) + reach, initial=0.0))
    names = Axis(
        range=(len(texts) - 0.5, -0.5),
        ticks=(range(len(texts)), [_name(e) for e in fit.estimates]),
        beside=texts,
    )
    title = "estimate / typical size, ± 2 standard deviations"
    size = Axis(title, "1", "symlog" if largest > LINEAR_REACH else "linear")
    text = f"{len(fit.free)} estimated parameters, standard uncertainty in parentheses"
    return Figure((Panel(tuple(marks), size, names, height=30.0 + 40.0 * len(texts)),), text)


def _name(estimate: Estimate) -> str:
    run = (estimate.axis and f", {estimate.axis}") + ("" if estimate.run is None else f", run {estimate.run + 1}")
    return f"{estimate.symbol}  {spelled(estimate.name)}{run}"


def _value(estimate: Estimate, fit: Fit) -> str:
    """A value as metrologists write it, with its unit: 0.012 34(5) m/s² is 0.01234 ± 0.00005."""
    if estimate.name in fit.model.fixed:
        return f"{with_unit(f'{estimate.value:g}', estimate.unit)} (fixed)"
    return with_unit(concise(estimate.value, estimate.std), estimate.unit)


def nonlinearity(fit: Fit) -> Figure:
    """Draw the output against acceleration over the trained range, and its deviation from the best straight line.

    Bands hold 95 % at each acceleration, by the covariance of the fit. That of the deviation has no share of bias and
    scale factor.

    Parameters
    ----------
    fit : from `accelcal.fit`, any model.

    Raises
    ------
    ValueError
        If the fit has seen one acceleration only.
    """
    line = straight_line(fit)
    wide, reach = NORMAL_95 * line.output_std, NORMAL_95 * line.deviation_std
    factor, unit = prefixed("m/s²", np.abs(line.deviation) + reach)
    above = (
        Band(line.a, line.output - wide, line.output + wide, outlined=False),
        Line(line.a, line.output, "output", "model"),
        Line(line.a, line.offset + line.slope * line.a, "best straight line", "other"),
    )
    below = (
        Band(line.a, (line.deviation - reach) * factor, (line.deviation + reach) * factor, "95 % band"),
        Line(line.a, line.deviation * factor, "deviation", "residual"),
        Level(0.0),
    )
    a = Axis("acceleration along the input axis", "m/s²")
    panels = (
        Panel(above, a, Axis("output", "m/s²"), height=200.0),
        Panel(below, a, Axis("deviation from the line", unit), height=200.0),
    )
    return Figure(panels, _sentence(line), shared_x=True)


def _sentence(line: StraightLine) -> str:
    at, span = line.largest, f"{line.a[0]:.3g} to {line.a[-1]:.3g} m/s²"
    if not np.any(line.deviation_std):
        return f"Output over {span}: the model is a straight line, slope {line.slope:.5f}"
    factor, unit = prefixed("m/s²", abs(float(line.deviation[at])), float(line.deviation_std[at]))
    return (
        f"Output over {span}: largest deviation from the best straight line {factor * line.deviation[at]:+.3g} ± "
        f"{factor * NORMAL_95 * line.deviation_std[at]:.2g} {unit} at {line.a[at]:+.3g} m/s², "
        f"{100.0 * abs(line.deviation[at]) / line.span:.2g} % of the span"
    )


def agreement(result: Agreement) -> Figure:
    """Draw the difference of the characteristics with its expanded uncertainty, and En of every common parameter.

    Parameters
    ----------
    result : from `accelcal.calibration.agreement.agreement`.
    """
    curve = result.characteristic
    left = Panel((), Axis(), Axis(), sentence="The ranges of acceleration do not overlap.")
    if curve is not None:
        factor, unit = prefixed("m/s²", curve.difference, curve.expanded)
        half = factor * curve.expanded
        marks = (
            Band(curve.a, -half, half, "± expanded uncertainty, |En| ≤ 1", outlined=False),
            Line(curve.a, factor * curve.difference, "second − first", solid=True),
        )
        left = Panel(marks, Axis("acceleration", "m/s²"), Axis("difference of output", unit), height=240.0)
    shown = [parameter for parameter in result.parameters if parameter.en is not None]
    en, rows = np.array([parameter.en for parameter in shown], dtype=np.float64), np.arange(float(len(shown)))
    reach = 1.15 * max(2.0, float(np.abs(en).max(initial=0.0)))
    names = Axis(range=(len(shown) - 0.5, -0.5), ticks=(rows.tolist(), on_rows(parameter.name for parameter in shown)))
    scaled = Axis("En", "1", "symlog" if reach > REACH else "linear", (-reach, reach))
    right = Panel(
        (Level(low=-LIMIT, high=LIMIT, role="band", upright=True), Points(en, rows)), scaled, names, height=240.0
    )
    return Figure((left, right), columns=2)


def allan(noise: RestNoise) -> Figure:
    """Draw the Allan deviation of each output at rest with its 95 % band and the terms that are determined, and its
    bias over temperature.

    Parameters
    ----------
    noise : from `accelcal.rest`.
    """
    panels = [panel for output in noise.outputs for panel in _at_rest(output)]
    return Figure(tuple(panels), f"{noise.name or 'Record'} at rest", columns=min(len(panels), 3))


def _at_rest(output: OutputNoise) -> list[Panel]:
    tau, size = output.tau, MICRO_G
    roles: tuple[Role, ...] = ("other", "floor", "before")
    names = ("noise density", "bias instability", "random walk")
    parts = zip(output.allan(tau), output.terms, names, roles, strict=True)
    lines = [Line(tau, y / size, name, role) for y, term, name, role in parts if term.determined]
    total = np.linalg.norm(output.allan(tau), axis=0) / size
    band = Band(tau, output.low / size, output.high / size, "95 %", outlined=False)
    points = Points(tau, output.deviation / size, "Allan deviation", "measured")
    marks: list[Mark] = [band, *lines, Line(tau, total, "all terms", "model", solid=True), points]
    if output.minimum is not None:
        at, least = output.minimum
        marks.append(Level(at, upright=True, text=f"minimum {with_unit(number(least / size, 3), 'µg')}"))
    shown = np.concatenate([output.low, output.high]) / size
    y = Axis("Allan deviation", "µg", "log", (0.5 * float(shown.min()), 2.0 * float(shown.max())))
    panels = [Panel(tuple(marks), Axis("averaging time", "s", "log"), y, output.output)]
    if (warm_up := output.warm_up) is not None:
        factor, unit = prefixed("m/s²", warm_up.bias)
        means = Points(warm_up.temperature, factor * warm_up.bias, "means", "measured")
        fitted = Line(warm_up.temperature, factor * warm_up.fitted, "over temperature", "model")
        panels.append(Panel((means, fitted), Axis("temperature", "°C"), Axis("output", unit), output.output))
    return panels


def rests(dwells: Rests) -> Figure:
    """Draw outputs over time, every rest shaded and numbered.

    Parameters
    ----------
    dwells : rests of one record.
    """
    roles: tuple[Role, ...] = ("measured", "model", "other", "floor")
    lines = [
        Line(dwells.t, y, name if len(dwells.names) > 1 else "", role, COLUMNS)
        for name, y, role in zip(dwells.names, dwells.outputs.T, roles, strict=False)
    ]
    top = float(dwells.outputs.max()) + MARGIN * float(np.ptp(dwells.outputs))
    numbers = [Text(0.5 * (rest.start + rest.end), top, str(i), "center") for i, rest in enumerate(dwells.rests, 1)]
    return Figure(
        (Panel((*lines, *numbers), Axis("time", "s"), Axis("output", dwells.unit)),),
        f"{dwells.name}: {len(dwells.rests)} rests found; look at them before they are used",
        stretches=tuple(Stretch(rest.start, rest.end, role="grid") for rest in dwells.rests),
    )
