"""Spectrum of the residual and of the predicted noise, with spectral lines named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal.diagnosis.noise_tests.noise_test import NoiseTest
from accelcal.effects import spelled
from accelcal.estimation.estimate import Fit
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import ThemeName
from accelcal.validation.comparison import Comparison, Spectrum
from accelcal.validation.spectrum import accel_spectrum, one_step_spectrum

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def lines(findings: Sequence[NoiseTest]) -> list[tuple[float, str]]:
    """Frequencies that were found, Hz, each with its name."""
    return [(f.parts["frequency"], spelled(f.effect)) for f in findings if "frequency" in f.parts]


def spectrum(
    fit: Fit, comparison: Comparison, findings: Sequence[NoiseTest] = (), *, theme: ThemeName = "light"
) -> Figure:
    """Draw the density of the accelerometer-side residual, and of one-step residuals over their predicted deviation.

    Parameters
    ----------
    fit : that predicts the noise.
    comparison : of that fit, from `accelcal.compare`.
    findings : of a diagnosis; those with a frequency are named.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    panels = _panels(fit, comparison)
    if not panels:
        return drawing.message(drawing.new_figure(), palette, "Spectrum", "The record is too short for a spectrum.")
    figure = drawing.new_figure(
        1, len(panels), subplot_titles=[panel.title for panel in panels], horizontal_spacing=0.11
    )
    for column, panel in enumerate(panels, 1):
        _draw(figure, panel, column, palette)
        f = panel.spectrum.frequency
        for at, name in lines(findings):
            if f[0] <= at <= f[-1]:
                _mark(figure, at, name, palette, column)
    outside = max(panel.outside for panel in panels)
    named = "; ".join(f"{name} at {at:.4g} Hz" for at, name in lines(findings))
    drawing.format_figure(
        figure,
        palette,
        f"Spectrum of the residual: up to {100.0 * outside:.0f} % of frequencies outside the band, 5 % by chance",
        note=f"lines found: {named}" if named else "no significant line",
        height=360,
        titled=True,
    )
    for column, panel in enumerate(panels, 1):
        f = panel.spectrum.frequency
        across = drawing.logarithmic(float(f[0]), float(f[-1]))
        figure.update_xaxes(**across, title_text=drawing.axis_title("frequency", "Hz"), row=1, col=column)
        upward = drawing.logarithmic(*_reach(panel.spectrum))
        figure.update_yaxes(**upward, title_text=drawing.axis_title(panel.quantity, panel.unit), row=1, col=column)
    return figure


@dataclass(frozen=True, slots=True)
class Panel:
    """One spectrum with its titles."""

    spectrum: Spectrum
    quantity: str
    unit: str
    title: str

    @property
    def outside(self) -> float:
        """Share of the frequencies at which the density leaves its 95 % region."""
        ratio = self.spectrum.density / self.spectrum.predicted
        return float(np.mean((ratio < self.spectrum.low) | (ratio > self.spectrum.high)))


def _panels(fit: Fit, comparison: Comparison) -> list[Panel]:
    """The spectra that the record is long enough for."""
    below, whole = accel_spectrum(fit, comparison), one_step_spectrum(comparison)
    found = []
    if below is not None:
        found.append(Panel(below, "accelerometer residual", "(m/s²)/√Hz", "accelerometer residual, inside the band"))
    if whole is not None:
        title = "one-step residual, up to half the reading rate"
        found.append(Panel(whole, "one-step residual / predicted σ", "1/√Hz", title))
    return found


def _draw(figure: Figure, panel: Panel, column: int, palette: style.Theme) -> None:
    """Residual and predicted noise of one panel; the legend is that of the first."""
    seen, expected = panel.spectrum, np.sqrt(panel.spectrum.predicted)
    first = column == 1
    drawing.band(
        figure,
        seen.frequency,
        expected * seen.low**0.5,
        expected * seen.high**0.5,
        "95 % of predicted noise",
        palette.band,
        legend=first,
        group="band",
        row=1,
        column=column,
    )
    drawn = drawing.thin(seen.frequency, np.sqrt(seen.density))
    common: dict[str, Any] = {"unit": panel.unit, "showlegend": first, "row": 1, "column": column}
    drawing.curve(figure, drawn.t, drawn.y, palette.residual, "residual", width=1.1, legendgroup="residual", **common)
    drawing.curve(figure, seen.frequency, expected, palette.floor, "predicted noise", legendgroup="floor", **common)


def _reach(seen: Spectrum) -> tuple[float, float]:
    """Ends of the ordinate: residual and prediction whole, and at least two decades."""
    y = np.sqrt(np.concatenate([np.maximum(seen.density, 1e-300), seen.predicted]))
    low, high = 0.8 * float(np.quantile(y, 0.002)), 1.6 * float(y.max())
    middle = float(np.sqrt(low * high))
    return min(low, 0.1 * middle), max(high, 10.0 * middle)


def _mark(figure: Figure, at: float, name: str, palette: style.Theme, column: int) -> None:
    """A dash-dotted line at a frequency, with its name; annotations on a logarithmic axis are placed by logarithm."""
    place = {"row": 1, "col": column, "yref": "y domain" if column == 1 else f"y{column} domain"}
    line = {"color": palette.other.colour, "dash": "dashdot", "width": 1.4}
    figure.add_shape(type="line", x0=at, x1=at, y0=0.0, y1=1.0, line=line, **place)
    figure.add_annotation(
        x=math.log10(at),
        y=1.0,
        yanchor="top",
        xanchor="right",
        showarrow=False,
        textangle=-90,
        text=drawing.escaped(f"{name} {at:.4g} Hz"),
        **place,
    )
