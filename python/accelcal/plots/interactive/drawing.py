"""How interactive figures look: the palette of `accelcal.plots.style` in plotly, thinned traces, axes with units.

Text that comes from files goes through `escaped`, for plotly reads a few HTML tags in its texts.
"""

from __future__ import annotations

import html
import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from accelcal._support.extras import MissingExtra
from accelcal.data.arrays import Array
from accelcal.plots import style
from accelcal.plots.style import LineStyle, Theme, Thinned
from accelcal.results import words as formatting

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

POINTS = 4000
"""Of a trace that is drawn; the extremes survive."""
LINE = 125
"""Characters of a headline before it breaks, at 1280 pixels."""
DASHES = {"-": "solid", "--": "dash", "-.": "dashdot", ":": "dot"}
MARKERS = {"o": "circle", "s": "square", "^": "triangle-up", "D": "diamond"}
FAMILY = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', Arial, sans-serif"
HEAD, TEXT, SMALL = 15, 13, 12
"""Sizes of the headline, of axes, of legends."""
LEFT, BOTTOM = 78, 58
"""Pixels beside and under the axes."""
LETTER = 7.4
"""Pixels of a letter in labels of an axis."""


def new_figure(rows: int = 1, columns: int = 1, **layout: Any) -> Figure:
    """An empty figure with a grid of axes.

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    try:
        from plotly.subplots import make_subplots
    except ImportError as error:
        raise MissingExtra(
            'interactive figures need plotly; install it with: pip install "accelcal[report]"'
        ) from error
    return make_subplots(rows=rows, cols=columns, **layout)


def format_figure(
    figure: Figure,
    theme: Theme,
    headline: str,
    *,
    note: str = "",
    height: int = 360,
    legend: bool = True,
    titled: bool = False,
    left: int = LEFT,
) -> Figure:
    """Give a figure the colours of the theme, the sentence above it, small print, and room for all of that.

    Parameters
    ----------
    headline, note : the sentence and the small print.
    height : of the axes and what stands under them, pixels.
    legend : whether there is one.
    titled : whether panels have titles of their own.
    left : margin for the labels of the ordinate, pixels.
    """
    lines, small = textwrap.wrap(headline, LINE), textwrap.wrap(note, LINE + 20)
    text = "<br>".join(escaped(line) for line in lines)
    text += "".join(f"<br><span style='font-size:11px'>{escaped(line)}</span>" for line in small)
    key, panels = (26 if legend else 6), (22 if titled else 0)
    above = 12 + 20 * len(lines) + 15 * len(small) + key + panels
    inside = height - BOTTOM
    figure.layout.template = {}  # no default theme of plotly
    figure.update_layout(
        paper_bgcolor=theme.page,
        plot_bgcolor=theme.page,
        font={"family": FAMILY, "size": TEXT, "color": theme.ink},
        margin={"l": left, "r": 24, "t": above, "b": BOTTOM, "autoexpand": False},
        height=height + above,
        showlegend=legend,
        legend={
            "orientation": "h",
            "x": 0.0,
            "xanchor": "left",
            "y": 1.0 + panels / inside,
            "yanchor": "bottom",
            "bgcolor": "rgba(0,0,0,0)",
            "font": {"size": SMALL},
            "itemwidth": 36,
        },
        hoverlabel={"bgcolor": theme.page, "bordercolor": theme.grid, "font": {"color": theme.ink}},
        hovermode="closest",
        modebar={"bgcolor": "rgba(0,0,0,0)", "color": theme.grid, "activecolor": theme.ink},
    )
    axis = {
        "gridcolor": theme.grid,
        "zeroline": False,
        "linecolor": theme.ink,
        "showline": True,
        "ticks": "outside",
        "tickcolor": theme.ink,
        "title": {"font": {"size": TEXT}, "standoff": 8},
        "exponentformat": "power",
    }
    figure.update_xaxes(**axis)
    figure.update_yaxes(**axis)
    figure.update_annotations(font={"size": SMALL, "color": theme.ink})
    figure.add_annotation(
        name="headline",
        text=text,
        align="left",
        showarrow=False,
        font={"size": HEAD},
        **_paper(0.0, 1.0, xanchor="left", yanchor="bottom", xshift=8 - left, yshift=key + panels),
    )
    return figure


def _paper(x: float, y: float, **more: Any) -> dict[str, Any]:
    return {"x": x, "y": y, "xref": "paper", "yref": "paper", **more}


def logarithmic(low: float, high: float) -> dict[str, Any]:
    """Scale and ticks of a logarithmic axis between two values: 1, 2, 5 over few decades, else powers of ten."""
    low, high = math.log10(low), math.log10(high)
    steps = (1.0, 2.0, 5.0) if high - low < 2.6 else (1.0,)
    decades = range(math.floor(low), math.ceil(high) + 1)
    ticks = [m * 10.0**d for d in decades for m in steps if low - 1e-9 <= math.log10(m * 10.0**d) <= high + 1e-9]
    return {"type": "log", "range": [low, high], "tickvals": ticks, "ticktext": [tick(v) for v in ticks]}


def tick(value: float) -> str:
    """A number on a logarithmic axis.

    Examples
    --------
    >>> [tick(v) for v in (0.02, 50.0, 1e-7, 2e-7)]
    ['0.02', '50', '10⁻⁷', '2·10⁻⁷']
    """
    if 1e-3 <= value < 1e4:
        return f"{value:g}"
    digit, _, power = f"{value:.0e}".partition("e")
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{raised}" if digit == "1" else f"{digit}·10{raised}"


def display_scale(unit: str, *values: Array | float) -> tuple[float, str]:
    """Factor and unit in which the largest of some values reads well; also for times."""
    if unit != "s":
        return formatting.prefixed(unit, *values)
    factor, name = formatting.prefixed("m", *values)
    return factor, f"{name[:-1]}s"


def label_margin(names: Sequence[str]) -> int:
    """Left margin that the longest of some labels needs, pixels."""
    return int(30 + LETTER * max(map(len, names), default=0))


def message(figure: Figure, theme: Theme, headline: str, text: str) -> Figure:
    """A sentence in place of data that the record is too short for."""
    figure.add_annotation(text=escaped(text), showarrow=False, **_paper(0.5, 0.5))
    format_figure(figure, theme, headline, height=140, legend=False)
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False)
    return figure


def escaped(text: str) -> str:
    """Text with everything escaped that plotly would read as a tag."""
    return html.escape(text, quote=False)


def axis_title(quantity: str, unit: str) -> str:
    """Title of an axis: the quantity with its unit."""
    return escaped(formatting.label(quantity, unit))


def thin(t: Array, y: Array, points: int = POINTS) -> Thinned:
    """Keep the least and the largest value of each of `points`/2 stretches of equal length.

    Raises
    ------
    MissingExtra
        If tsdownsample is not installed.
    """
    n = len(t)
    if n <= points:
        return Thinned(t, y, n, n)
    try:
        from tsdownsample import MinMaxDownsampler
    except ImportError as error:
        raise MissingExtra(
            'interactive figures need tsdownsample; install it with: pip install "accelcal[report]"'
        ) from error
    thinner: Any = MinMaxDownsampler
    kept = thinner().downsample(np.ascontiguousarray(t), np.ascontiguousarray(y), n_out=points)
    return Thinned(t[kept], y[kept], len(kept), n)


def trace(
    figure: Figure,
    t: Array,
    y: Array,
    line: LineStyle,
    name: str,
    *,
    factor: float = 1.0,
    row: int = 1,
    column: int = 1,
    unit: str = "",
    **more: Any,
) -> Thinned:
    """Draw a time series, thinned, with breaks where the record has holes; return what is drawn."""
    drawn = thin(t, y)
    x, shown = style.with_breaks(drawn, t, factor)
    x, shown = x if _needs_digits(drawn.t) else np.asarray(x, dtype=np.float32), np.asarray(shown, dtype=np.float32)
    curve(
        figure, x, shown, line, name, row=row, column=column, unit=unit, width=1.1 if drawn.shown > 500 else 1.6, **more
    )
    return drawn


def _needs_digits(t: Array) -> bool:
    """Whether instants late in a record would blur in single precision, which else halves the page."""
    if len(t) < 2:
        return False
    return float(np.spacing(np.float32(np.max(np.abs(t))))) > 0.1 * float(np.median(np.diff(t)))


def curve(
    figure: Figure,
    x: NDArray[np.floating[Any]],
    y: NDArray[np.floating[Any]],
    line: LineStyle,
    name: str,
    *,
    row: int = 1,
    column: int = 1,
    unit: str = "",
    markers: bool = False,
    width: float = 1.8,
    **more: Any,
) -> None:
    """Draw a line, with markers where there are few points."""
    figure.add_scatter(
        x=x,
        y=y,
        name=escaped(name),
        mode="lines+markers" if markers else "lines",
        connectgaps=False,
        line={"color": line.colour, "dash": DASHES[line.line], "width": width},
        marker={"symbol": MARKERS[line.marker], "size": 7, "color": line.colour},
        hovertemplate=f"%{{y:.4g}} {escaped(unit)}<extra>{escaped(name)}</extra>",
        row=row,
        col=column,
        **more,
    )


def band(
    figure: Figure,
    x: Array,
    low: Array,
    high: Array,
    name: str,
    colour: str,
    *,
    row: int = 1,
    column: int = 1,
    legend: bool = True,
    group: str | None = None,
) -> None:
    """Fill the region between two curves, outlined so that it does not rely on colour."""
    line = {"color": colour, "width": 1.0, "dash": "dot"}
    common = {"x": x, "mode": "lines", "line": line, "legendgroup": group or name, "hoverinfo": "skip"}
    figure.add_scatter(y=low, showlegend=False, row=row, col=column, **common)
    figure.add_scatter(
        y=high,
        name=escaped(name),
        fill="tonexty",
        fillcolor=translucent(colour, 0.25),
        showlegend=legend,
        row=row,
        col=column,
        **common,
    )


def translucent(colour: str, alpha: float) -> str:
    """A colour of the palette with transparency."""
    r, g, b = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({r},{g},{b},{alpha:g})"


def thinning_note(*drawn: Thinned) -> str:
    """Note about thinning, for the trace that lost most points."""
    return max(drawn, key=lambda trace: trace.total - trace.shown).note if drawn else ""
