"""Figures drawn by matplotlib, for paper and mail: the only module that imports it, when a figure is drawn.

A drawn figure has a canvas of its own: nothing is kept in global state.
"""

from __future__ import annotations

import io as memory
import math
import textwrap
from collections.abc import Callable, Iterable, Sequence
from functools import partial, update_wrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from accelcal._support.arguments import kind_of
from accelcal._support.errors import optional
from accelcal.io import atomic, together
from accelcal.plots import figure as data
from accelcal.plots.figure import (
    DENSE,
    OKABE_ITO,
    Axis,
    Band,
    Bars,
    Level,
    Line,
    Mark,
    Panel,
    Points,
    Text,
    Theme,
    ThemeName,
    Tiles,
    theme_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

PIXELS_PER_INCH = 160
"""Of written images: eight inches are 1280 pixels."""
WIDTH = 8.0
"""Inches."""
A4_LANDSCAPE = (11.69, 8.27)
"""Inches."""
INTERACTIVE = 95.0
"""Pixels of a panel of an interactive figure that are an inch here."""
TITLES, ABOVE = 0.45, 0.7
"""Inches under the panels of a row for the titles of their axes, and above the first row."""
LONGEST_TITLE = 30
"""Characters of a panel's title in normal type, three panels side by side."""
SMALL, NORMAL, LARGE = 8.0, 9.0, 10.5
"""Sizes of type, points."""
LETTER = 0.54
"""Mean width of a letter over the size of its type."""


def require() -> None:
    """Ask for matplotlib before long work whose figures need it.

    Raises
    ------
    MissingExtra
        If it is not installed.
    """
    optional("matplotlib", "figures need", "plot")


def new_figure(width: float, height: float, look: Theme) -> Figure:
    """An empty figure, `width` by `height` inches, with a canvas of its own."""
    require()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    canvas = Figure(
        figsize=(width, height), dpi=PIXELS_PER_INCH, facecolor=look.page, edgecolor=look.page, layout="constrained"
    )
    FigureCanvasAgg(canvas)
    return canvas


def draw(figure: data.Figure, theme: ThemeName = "light", into: Figure | SubFigure | None = None) -> Figure:
    """Draw a figure, on a canvas of its own where it has no place in another.

    Parameters
    ----------
    figure : of any function of `accelcal.plots` that defines one.
    theme : "light" or "dark".
    into : a figure of matplotlib or a part of it (`subfigures`), empty, with `layout="constrained"`.

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    TypeError
        If `into` is no such part.
    ValueError
        If there is no such theme.
    """
    look = theme_of(theme)
    if into is not None:
        if not hasattr(into, "subfigures"):
            raise TypeError(f"into is {kind_of(into)}; expected a figure of matplotlib, or one of its subfigures(...)")
        draw_into(into, figure, look, NORMAL)
        return into.figure
    rows = figure.rows
    titled = 1 if figure.shared_x else len(rows)
    canvas = new_figure(WIDTH, ABOVE + TITLES * titled + sum(rows) / INTERACTIVE, look)
    draw_into(canvas, figure, look)
    return canvas


def page(
    parts: Sequence[data.Figure], headline: str, theme: ThemeName = "light", widths: Sequence[float] = ()
) -> Figure:
    """Draw some figures in two rows on one page, A4 landscape, under a sentence of its own; by default equally wide."""
    look = theme_of(theme)
    canvas = new_figure(*A4_LANDSCAPE, look)
    half = (len(parts) + 1) // 2
    several = np.asarray(canvas.subfigures(2, 1, hspace=0.03)).flat
    for row, place in zip(several, (slice(half), slice(half, None)), strict=True):
        shares = widths[place] or None
        columns = np.atleast_1d(np.asarray(row.subfigures(1, len(parts[place]), wspace=0.03, width_ratios=shares)))
        for part, figure in zip(columns, parts[place], strict=True):
            draw_into(part, figure, look, NORMAL)
    write_headline(canvas, headline, look, LARGE)
    return canvas


def still(define: Callable[..., data.Figure]) -> Callable[..., Figure]:
    """A function that defines a figure, now one that draws it, into `into` where that is given."""
    alone = data.drawing(define, draw)

    def drawn(*given: Any, into: Figure | SubFigure | None = None, **options: Any) -> Figure:
        return data.drawing(define, partial(draw, into=into))(*given, **options)

    update_wrapper(drawn, alone)
    drawn.__doc__ = f"{alone.__doc__}    `into` is a figure of matplotlib, or one of its subfigures, to draw it into.\n"
    return drawn


def draw_into(part: Figure | SubFigure, figure: data.Figure, look: Theme, size: float = LARGE) -> None:
    """Draw a figure into a part of a page, with a headline of `size` points."""
    rows, columns = figure.rows, min(figure.columns, len(figure.panels))
    grid = part.subplots(len(rows), columns, squeeze=False, sharex=figure.shared_x, height_ratios=rows).ravel()
    for axes in grid[len(figure.panels) :]:
        axes.set_visible(False)
    in_legend: set[str] = set()
    for number, (axes, panel) in enumerate(zip(grid, figure.panels, strict=False)):
        last = not figure.shared_x or number == len(figure.panels) - 1
        format_axes(axes, panel, look, last=last, title="left" if columns > 1 else "right")
        for mark in panel.marks:
            draw_mark(axes, mark, look, in_legend)
        for stretch in figure.stretches:
            colour = look.style(stretch.role).colour
            name = _name(stretch.name, in_legend)
            axes.axvspan(stretch.begin, stretch.end, color=colour, alpha=0.25, linewidth=0.0, label=name, zorder=0)
        if panel.sentence:
            write_sentence(axes, panel.sentence, look)
        elif panel.marks:
            set_axis(axes, "x", panel.x, look)
            set_axis(axes, "y", panel.y, look)
        if columns == 1 and figure.legend:
            legend(axes, *_entries([axes]), look, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
    if columns > 1 and figure.legend:
        handles, labels = _entries(list(grid))
        legend(part, handles, labels, look, loc="outside lower left", title=figure.small_print)
    elif figure.small_print:
        part.supxlabel(figure.small_print, x=0.99, ha="right", fontsize=SMALL - 1.0, color=look.ink, alpha=0.8)
    part.align_ylabels()
    write_headline(part, figure.headline, look, size)


def format_axes(axes: Axes, panel: Panel, look: Theme, *, last: bool, title: Literal["left", "right"]) -> None:
    """Give axes the colours of the theme and titles with units; that of a shared abscissa under the last panel."""
    axes.set_facecolor(look.page)
    for along, axis in (("x", panel.x), ("y", panel.y)):
        if axis.grid:
            axes.grid(axis=along, color=look.grid, linewidth=0.6)  # type: ignore[arg-type]
    axes.set_axisbelow(True)
    axes.tick_params(which="both", colors=look.ink, labelsize=SMALL)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(look.ink)
    axes.set_xlabel(panel.x.label if last else "", color=look.ink, fontsize=NORMAL)
    axes.set_ylabel(panel.y.label, color=look.ink, fontsize=NORMAL)
    size = NORMAL if len(panel.title) <= LONGEST_TITLE else SMALL - 1.0
    axes.set_title(panel.title, color=look.ink, fontsize=size, loc=title, parse_math=False)


def set_axis(axes: Axes, along: str, declared: Axis, look: Theme) -> None:
    """Scale, range and ticks of one axis."""
    from matplotlib.ticker import MaxNLocator

    axis = getattr(axes, f"{along}axis")
    options = {"linthresh": 1.0} if declared.scale == "symlog" else {}
    if declared.scale != "linear":  # which would set other ticks
        getattr(axes, f"set_{along}scale")(declared.scale, **options)
    if declared.scale == "symlog":
        axis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    elif declared.scale == "linear" and declared.few:
        axis.set_major_locator(MaxNLocator(4))
    if declared.range is not None:
        getattr(axes, f"set_{along}lim")(*declared.range)
    if declared.all_ticks is not None:
        axis.set_ticks(*declared.all_ticks)
        axis.set_ticks([], minor=True)
    if declared.beside:
        assert along == "y"
        assert declared.ticks is not None
        right = axes.secondary_yaxis("right")
        right.set_yticks(declared.ticks[0], declared.beside)
        right.tick_params(length=0.0, colors=look.ink, labelsize=SMALL)
        right.spines["right"].set_visible(False)


def draw_mark(axes: Axes, mark: Mark, look: Theme, in_legend: set[str]) -> None:
    """Draw one mark; a name that was said before is not said again."""
    match mark:
        case Line():
            line, (x, y) = look.style(mark.role), mark.drawn
            dense = len(x) > DENSE
            axes.plot(
                x,
                y,
                color=line.colour,
                linestyle="-" if mark.solid else line.line,
                linewidth=0.8 if dense else 1.4,
                marker=line.marker if mark.marker == "." else mark.marker or "none",
                markersize=4.5,
                alpha=mark.opacity,
                label=_name(mark.name, in_legend),
                rasterized=dense,
            )
        case Band():
            x, low, high = mark.drawn
            colour, dense = look.style(mark.role).colour, len(x) > DENSE
            name, alpha = _name(mark.name, in_legend), 0.25 if mark.outlined else 0.4
            axes.fill_between(x, low, high, color=colour, alpha=alpha, linewidth=0.0, label=name, rasterized=dense)
            for edge in (low, high) if mark.outlined else ():
                axes.plot(x, edge, color=colour, linestyle=(0, (6, 2)), linewidth=1.1, rasterized=dense)
        case Points():
            line, dense = look.style(mark.role), len(mark.x) > DENSE
            size: dict[str, Any] = {"xerr" if mark.across else "yerr": mark.error}
            axes.errorbar(
                mark.x, mark.y, **size, color=line.colour, linestyle="none", marker=line.marker,
                markerfacecolor=look.page if mark.hollow else line.colour, markersize=2.2 if dense else 4.5,
                capsize=3.0, elinewidth=1.1, label=_name(mark.name, in_legend), rasterized=dense,
            )  # fmt: skip
        case Bars():
            _bars(axes, mark, look, in_legend)
        case Level():
            line = look.style(mark.role)
            across, span = (axes.axvline, axes.axvspan) if mark.upright else (axes.axhline, axes.axhspan)
            name = _name(mark.name, in_legend)
            if math.isfinite(mark.low):
                called = "_" if math.isfinite(mark.at) else name
                span(mark.low, mark.high, color=line.colour, alpha=0.2, linewidth=0.0, label=called, zorder=0)
            if math.isfinite(mark.at):
                width = 0.8 if mark.role == "ink" else 1.6
                across(mark.at, color=line.colour, linestyle=line.line, linewidth=width, label=name)
            if mark.text:
                place: dict[str, Any] = {
                    "xycoords": axes.get_xaxis_transform(),
                    "textcoords": "offset points",
                    "va": "top",
                }
                axes.annotate(mark.text, (mark.at, 1.0), (-2, -2), ha="right", rotation=90, **place, **_small(look))
        case Tiles():
            _tiles(axes, mark, look)
        case Text():
            middle = mark.align == "center"
            axes.annotate(
                mark.text, (mark.x, mark.y), (0 if middle else 4, 0), textcoords="offset points", ha=mark.align,
                va="center", annotation_clip=False, **_small(look),
            )  # fmt: skip


def _bars(axes: Axes, mark: Bars, look: Theme, in_legend: set[str]) -> None:
    colour, rows = look.style(mark.role).colour, np.arange(len(mark.y))
    draw_bar: Any = axes.barh if mark.across else axes.bar
    for i, (y, solid) in enumerate(zip(mark.y, mark.solid, strict=True)):
        fill = {"color": colour if solid else look.page, "edgecolor": colour, "hatch": "" if solid else "//"}
        draw_bar(i, y, 0.6, label=_name(mark.names[not solid], in_legend), **fill)
    if mark.low is not None and mark.high is not None:
        reach: Any = np.nan_to_num([mark.y - mark.low, mark.high - mark.y])
        ends: dict[str, Any] = {"xerr" if mark.across else "yerr": reach, "ecolor": look.ink, "capsize": 4.0}
        axes.errorbar(*((mark.y, rows) if mark.across else (rows, mark.y)), linestyle="none", **ends)
    for i, (text, end) in enumerate(zip(mark.text, mark.y if mark.top is None else mark.top, strict=False)):
        place: dict[str, Any] = {"textcoords": "offset points", **_small(look)}
        if mark.across:
            axes.annotate(text, (end, i), (3, 0), va="center", **place)
        else:
            axes.annotate(text, (i, end), (0, 3), ha="center", **place)


def _tiles(axes: Axes, mark: Tiles, look: Theme) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    colours = [OKABE_ITO["blue"], look.page, OKABE_ITO["vermillion"]]
    axes.imshow(
        np.clip(mark.z, -mark.limit, mark.limit),
        aspect="auto",
        vmin=-mark.limit,
        vmax=mark.limit,
        cmap=LinearSegmentedColormap.from_list("excess", colours),
    )
    for (i, j), value in np.ndenumerate(mark.z):
        if mark.text[i][j]:
            ink = "#FFFFFF" if abs(value) > 0.6 * mark.limit else look.ink
            axes.text(j, i, mark.text[i][j], ha="center", va="center", fontsize=SMALL, color=ink)
    axes.set_xticks(
        range(len(mark.columns)),
        mark.columns,
        rotation=50 if mark.slanted else 0,
        ha="right" if mark.slanted else "center",
    )
    axes.set_yticks(range(len(mark.rows)), mark.rows)
    axes.grid(False)


def _small(look: Theme) -> dict[str, Any]:
    return {"fontsize": SMALL, "color": look.ink, "parse_math": False}


def _name(name: str, in_legend: set[str]) -> str:
    """A label for the legend, "_" for one that is not to be there."""
    new = name if name and name not in in_legend else "_"
    in_legend.add(name)
    return new


def _entries(several: Sequence[Axes]) -> tuple[list[Any], list[str]]:
    pairs = [pair for axes in several for pair in zip(*axes.get_legend_handles_labels(), strict=True)]
    return [handle for handle, _ in pairs], [name for _, name in pairs]


def legend(owner: Axes | Figure | SubFigure, handles: list[Any], labels: list[str], look: Theme, **place: Any) -> None:
    """The legend outside of the axes, where it covers no data: in one row, or in two where the owner is narrower."""
    if labels:
        place = {"ncols": len(labels)} | place
        box = owner.legend(
            handles, labels, frameon=False, fontsize=SMALL, labelcolor=look.ink, borderpad=0.2, borderaxespad=0.2,
            handlelength=2.6, columnspacing=1.4, title_fontsize=SMALL - 1.0, alignment="left", **place,
        )  # fmt: skip
        if place["ncols"] == len(labels) > 1 and box.get_window_extent().width > owner.bbox.width:
            box.remove()
            legend(owner, handles, labels, look, **place | {"ncols": -(-len(labels) // 2)})
            return
        box.get_title().set_color(look.ink)
        for text in box.get_texts():
            text.set_parse_math(False)


def write_sentence(axes: Axes, text: str, look: Theme) -> None:
    """A sentence in place of data."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_xlabel("")
    axes.set_ylabel("")
    axes.spines[:].set_visible(False)
    place: dict[str, Any] = {"transform": axes.transAxes, "ha": "center", "va": "center"}
    axes.text(0.5, 0.5, textwrap.fill(text, 44), color=look.ink, fontsize=NORMAL, **place)


def write_headline(part: Figure | SubFigure, text: str, look: Theme, size: float) -> None:
    """The sentence over a figure or a part of one, broken to its width."""
    if not text:
        return
    inches = part.bbox.width / part.figure.dpi
    wrapped = textwrap.fill(text, max(20, int(inches * 72.0 / (LETTER * size)) - 2))
    part.suptitle(wrapped, x=0.01, ha="left", fontsize=size, color=look.ink, parse_math=False)  # $ of a file name


def save(drawn: Figure, path: Path) -> None:
    """Write a drawn figure, whole or not at all; the ending says which format.

    The time of writing is left out, so that equal figures are equal files.
    """
    kind = path.suffix.removeprefix(".")
    with atomic(path) as part:
        drawn.savefig(part, format=kind, dpi="figure", metadata={"Date": None} if kind == "svg" else None)


def write(figures: Iterable[tuple[str, Figure]], directory: str | Path, theme: ThemeName) -> list[Path]:
    """Write drawn figures as PNG and SVG, each under its name, all of them or none; return the files.

    The folder is made if it does not exist. Dark figures end in "-dark", so both themes can share it.
    """
    folder, ending = Path(directory), "-dark" if theme == "dark" else ""
    written: list[Path] = []
    with together():
        for name, drawn in figures:
            folder.mkdir(parents=True, exist_ok=True)
            for kind in ("png", "svg"):
                written.append(folder / f"{name}{ending}.{kind}")
                save(drawn, written[-1])
    return written


def svg(drawn: Figure) -> bytes:
    """A drawn figure as SVG for a page; text is drawn literally, a $ as a $."""
    from matplotlib.text import Text as Drawn

    for text in drawn.findobj(Drawn):
        text.set_parse_math(False)
    out = memory.BytesIO()
    metadata = {"Date": None, "Creator": None, "Format": None, "Type": None}
    drawn.savefig(out, format="svg", dpi=PIXELS_PER_INCH * 0.6, metadata=metadata)
    return out.getvalue()
