"""How figures look: palette and themes, axes with units, traces thinned without losing an extreme.

Colours are those of Okabe and Ito (2008), which readers with any colour vision can distinguish; line style or marker is
the second cue. Figures are objects with a canvas of their own: nothing is kept in global state.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array
from accelcal.io import atomic
from accelcal.results.words import grouped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure, SubFigure
from accelcal._support.extras import MissingExtra

ThemeName = Literal["light", "dark"]

OKABE_ITO: Mapping[str, str] = MappingProxyType(
    {
        "black": "#000000",
        "orange": "#E69F00",
        "sky blue": "#56B4E9",
        "bluish green": "#009E73",
        "yellow": "#F0E442",
        "blue": "#0072B2",
        "vermillion": "#D55E00",
        "reddish purple": "#CC79A7",
    }
)

PIXELS_PER_INCH = 160
"""Of written images: eight inches are 1280 pixels."""
COLUMNS = 2000
"""Pixel columns of a trace; each keeps its least and its largest value."""
BAND_COLUMNS = 300
"""Columns of a band, each at its median."""
GAP = 8.0
"""A trace is interrupted where an interval exceeds this many usual ones."""
SMALL, NORMAL, LARGE = 8.0, 9.0, 10.5
"""Sizes of type, points."""
LETTER = 0.54
"""Mean width of a letter over the size of its type."""


@dataclass(frozen=True, slots=True)
class LineStyle:
    """How one kind of curve is drawn, in two cues: colour, and line style or marker."""

    colour: str
    line: str
    marker: str


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours of a page and of what is drawn on it."""

    name: ThemeName
    page: str
    ink: str
    grid: str
    measured: LineStyle
    model: LineStyle
    other: LineStyle
    """A second curve of the model."""
    floor: LineStyle
    """Noise floor."""
    residual: LineStyle
    """A residual drawn without other curves."""
    band: str
    """Fill of the regions expected from noise."""

    @property
    def line_styles(self) -> tuple[LineStyle, ...]:
        """All line styles, for figures with curves of equal rank."""
        return self.measured, self.model, self.other, self.floor


LIGHT = Theme(
    name="light",
    page="#FFFFFF",
    ink="#1A1A1A",
    grid="#DDDDDD",
    measured=LineStyle(OKABE_ITO["black"], "-", "o"),
    model=LineStyle(OKABE_ITO["blue"], "--", "s"),
    other=LineStyle(OKABE_ITO["vermillion"], "-.", "^"),
    floor=LineStyle(OKABE_ITO["bluish green"], ":", "D"),
    residual=LineStyle(OKABE_ITO["blue"], "-", "s"),
    band=OKABE_ITO["orange"],
)

DARK = Theme(
    name="dark",
    page="#15171C",
    ink="#E8E8E8",
    grid="#3A3E47",
    measured=LineStyle("#FFFFFF", "-", "o"),  # the palette's black, for a dark page
    model=LineStyle(OKABE_ITO["sky blue"], "--", "s"),
    other=LineStyle(OKABE_ITO["yellow"], "-.", "^"),
    floor=LineStyle(OKABE_ITO["bluish green"], ":", "D"),
    residual=LineStyle(OKABE_ITO["sky blue"], "-", "s"),
    band=OKABE_ITO["orange"],
)

THEMES: Mapping[ThemeName, Theme] = MappingProxyType({"light": LIGHT, "dark": DARK})


def theme_of(name: ThemeName) -> Theme:
    """Return the theme called `name`.

    Raises
    ------
    ValueError
        If there is none.
    """
    if name not in THEMES:
        raise ValueError(f"there is no theme {name!r}; choose one of {', '.join(THEMES)}")
    return THEMES[name]


def line_of_model(theme: Theme, number: int, count: int) -> LineStyle:
    """Line of one of several models, in order: the last is the current one, the one before it differs in both cues."""
    return theme.model if number == count - 1 else (theme.other, theme.floor)[(count - 2 - number) % 2]


def require_matplotlib() -> None:
    """Ask for matplotlib before long work whose figures need it.

    Raises
    ------
    MissingExtra
        If it is not installed.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise MissingExtra('figures need matplotlib; install it with: pip install "accelcal[plot]"') from error


def new_figure(width: float, height: float, theme: Theme) -> Figure:
    """Return an empty figure with a canvas of its own.

    Parameters
    ----------
    width, height : inches.

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(
        figsize=(width, height), dpi=PIXELS_PER_INCH, facecolor=theme.page, edgecolor=theme.page, layout="constrained"
    )
    FigureCanvasAgg(figure)
    return figure


def format_axes(axes: Axes, theme: Theme, *, x: str, y: str, title: str = "") -> None:
    """Give axes the colours of the theme, and titles that carry units.

    Parameters
    ----------
    x, y : titles as `label` makes them.
    title : of the panel, optional.
    """
    axes.set_facecolor(theme.page)
    axes.grid(True, color=theme.grid, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(which="both", colors=theme.ink, labelsize=SMALL)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(theme.ink)
    axes.set_xlabel(x, color=theme.ink, fontsize=NORMAL)
    axes.set_ylabel(y, color=theme.ink, fontsize=NORMAL)
    if title:
        axes.set_title(title, color=theme.ink, fontsize=NORMAL, loc="left")


@dataclass(frozen=True, slots=True)
class Thinned:
    """The points of a trace that are drawn."""

    t: Array
    y: Array
    shown: int
    total: int

    @property
    def note(self) -> str:
        """A note about the thinning; empty when every point is drawn."""
        if self.shown == self.total:
            return ""
        return f"{grouped(self.shown)} of {grouped(self.total)} points shown"


def thin(t: Array, y: Array, columns: int = COLUMNS) -> Thinned:
    """Keep the least and the largest value of each pixel column; extremes survive, statistics do not.

    Parameters
    ----------
    t : (n,) rising; columns are equally wide in it.
    y : (n,) same length.
    columns : up to twice as many points remain.

    Examples
    --------
    >>> thin(np.arange(400_000.0), np.sin(np.arange(400_000.0))).note
    '4 000 of 400 000 points shown'
    """
    n = len(t)
    if n <= 2 * columns:
        return Thinned(t, y, n, n)
    order, first, last = _by_column(t, y, columns)
    kept = np.unique(np.concatenate([order[first], order[last]]))
    return Thinned(t[kept], y[kept], len(kept), n)


def column_medians(t: Array, y: Array, columns: int = BAND_COLUMNS) -> tuple[Array, Array]:
    """Median of each pixel column: a band without its jitter.

    Parameters
    ----------
    t : (n,) rising.
    y : (n,) half-width of a band.

    Returns
    -------
    Times from the first to the last of `t`, and medians.
    """
    if len(t) <= 2 * columns:
        return t, y
    order, first, last = _by_column(t, y, columns)
    at = 0.5 * (t[first] + t[last])
    at[0], at[-1] = t[0], t[-1]
    return at, y[order[(first + last) // 2]]


def _by_column(t: Array, y: Array, columns: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Rows in order of pixel column, then of value; where in that order each occupied column begins and ends."""
    column = np.minimum(((t - t[0]) * (columns / (t[-1] - t[0]))).astype(np.intp), columns - 1)
    first = np.flatnonzero(np.diff(column, prepend=-1))
    return np.lexsort((y, column)), first, np.append(first[1:], len(t)) - 1


def trace(
    axes: Axes, t: Array, y: Array, line: LineStyle, *, factor: float = 1.0, name: str = "", columns: int = COLUMNS
) -> Thinned:
    """Draw a time series, thinned, with breaks where the record has holes.

    Parameters
    ----------
    t, y : (n,) full data.
    factor : to the unit of the axis.
    name : in the legend.

    Returns
    -------
    What is drawn, before `factor`.
    """
    drawn = thin(t, y, columns)
    dense = drawn.shown > 500
    axes.plot(
        *with_breaks(drawn, t, factor),
        color=line.colour,
        linestyle=line.line,
        linewidth=0.8 if dense else 1.3,
        label=name or "_",
        rasterized=dense,
    )
    return drawn


def with_breaks(drawn: Thinned, t: Array, factor: float) -> tuple[Array, Array]:
    """Points to draw, with a NaN wherever the full record `t` pauses."""
    step = np.diff(t)
    holes = t[:-1][step > GAP * np.median(step)] if len(step) else step
    at = np.unique(np.searchsorted(drawn.t, holes, side="right"))
    at = at[(at > 0) & (at < len(drawn.t))]
    return np.insert(drawn.t, at, np.nan), np.insert(drawn.y * factor, at, np.nan)


def plain_decades(axis: Axis, decades: float) -> None:
    """Numbers such as 20 and 0.5 on a logarithmic axis that spans so many decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 3.0 else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axis.set_minor_locator(LogLocator(subs=()))


def note(axes: Axes, text: str, theme: Theme) -> None:
    """Small print under the right end of the axes; the title of the axis makes room."""
    if text:
        axes.set_xlabel(axes.get_xlabel(), loc="left")
        axes.annotate(
            text,
            (1.0, 0.0),
            xycoords="axes fraction",
            xytext=(0.0, -2.9 * SMALL),
            textcoords="offset points",
            ha="right",
            va="top",
            fontsize=SMALL - 1.0,
            color=theme.ink,
            alpha=0.8,
        )


def message(axes: Axes, text: str, theme: Theme) -> None:
    """A sentence in place of data that the record is too short for."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_xlabel("")
    axes.set_ylabel("")
    axes.spines[:].set_visible(False)
    wrapped = textwrap.fill(text, 44)
    axes.text(0.5, 0.5, wrapped, transform=axes.transAxes, ha="center", va="center", color=theme.ink, fontsize=NORMAL)


def legend(axes: Axes, theme: Theme, columns: int = 4) -> None:
    """The legend, in a row above the axes, where it covers no data."""
    _legend(axes, theme, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, ncols=columns)


def shared_legend(part: Figure | SubFigure, axes: Axes, theme: Theme) -> None:
    """One legend for all panels, in a row below them; its entries are those of `axes`."""
    handles, labels = axes.get_legend_handles_labels()
    _legend(part, theme, handles=handles, labels=labels, loc="outside lower left", ncols=len(labels))


def _legend(owner: Axes | Figure | SubFigure, theme: Theme, **place: Any) -> None:
    owner.legend(
        frameon=False,
        fontsize=SMALL,
        labelcolor=theme.ink,
        borderpad=0.2,
        handlelength=2.6,
        columnspacing=1.4,
        **place,
    )


def headline(part: Figure | SubFigure, text: str, theme: Theme, size: float = LARGE) -> None:
    """The sentence over a figure or a part of one, broken to its width."""
    inches = part.bbox.width / part.figure.dpi
    wrapped = textwrap.fill(text, max(20, int(inches * 72.0 / (LETTER * size)) - 2))
    part.suptitle(wrapped, x=0.01, ha="left", fontsize=size, color=theme.ink, parse_math=False)  # $ of a file name


def save(figure: Figure, path: Path) -> None:
    """Write a figure, whole or not at all; the ending says which format.

    The time of writing is left out, so that equal figures are equal files.
    """
    kind = path.suffix.removeprefix(".")
    with atomic(path) as part:
        figure.savefig(part, format=kind, dpi="figure", metadata={"Date": None} if kind == "svg" else None)
