"""Figures for plotly.js, as plain dictionaries: the library itself is imported where a notebook asks for its Figure.

Text that comes from files goes through `escaped`, for plotly reads a few HTML tags in its texts.
"""

from __future__ import annotations

import base64
import html
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from accelcal._support.errors import optional
from accelcal.plots import figure as data
from accelcal.plots.figure import (
    DENSE,
    OKABE_ITO,
    Axis,
    Band,
    Bars,
    Figure,
    Level,
    Line,
    Mark,
    Panel,
    Points,
    Stretch,
    Text,
    Theme,
    ThemeName,
    Tiles,
    theme_of,
)

if TYPE_CHECKING:
    from plotly.graph_objects import Figure as Drawn

WIDE = 125
"""Characters of a headline before it breaks, at 1280 pixels."""
DASHES = {"-": "solid", "--": "dash", "-.": "dashdot", ":": "dot"}
SYMBOLS = {"o": "circle", "s": "square", "^": "triangle-up", "D": "diamond", "X": "x", "P": "cross"}
FAMILY = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', Arial, sans-serif"
HEAD, TEXT, SMALL = 15, 13, 12
"""Sizes of the headline, of axes, of legends."""
LEFT, RIGHT, BOTTOM = 88, 24, 58
"""Pixels beside and under the axes."""
BELOW, BETWEEN, SHARED = 82, 30, 24
"""Pixels between two rows of panels: with titles of axes, with titles of panels alone, and with neither."""
ASIDE = 0.22
"""Between two columns, as a share of the width of one."""
LETTER = 7.4
"""Pixels of a letter in labels of an axis."""


def as_dict(figure: Figure, theme: ThemeName = "light", *, headline: bool = True) -> dict[str, Any]:
    """A figure as plotly.js reads it, ready for JSON: data and layout; arrays as bytes in base64.

    Parameters
    ----------
    figure : of any function of `accelcal.plots` that defines one.
    theme : "light" or "dark".
    headline : whether the sentence and the small print stand in the figure.

    Raises
    ------
    ValueError
        If there is no such theme.
    """
    return Page(figure, theme_of(theme), headline=headline).content


def moving(define: Callable[..., Figure]) -> Callable[..., Drawn]:
    """A function that defines a figure, now one that returns it as a Figure of plotly, for a notebook."""
    return data.drawing(define, drawn)


def drawn(figure: Figure, theme: ThemeName = "light") -> Drawn:
    """A figure as a Figure of plotly.

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    drawing: Drawn = optional("plotly.graph_objects", "interactive figures need", "report").Figure(
        as_dict(figure, theme)
    )
    return drawing


class Page:
    """What is drawn: traces, axes, shapes and notes of one figure."""

    def __init__(self, figure: Figure, look: Theme, *, headline: bool) -> None:
        self.figure, self.look = figure, look
        self.traces: list[dict[str, Any]] = []
        self.shapes: list[dict[str, Any]] = []
        self.notes: list[dict[str, Any]] = []
        self.axes: dict[str, dict[str, Any]] = {}
        self.in_legend: set[str] = set()
        rows, titled = figure.rows, any(panel.title for panel in figure.panels)
        gap = (BETWEEN + SMALL if titled else SHARED) if figure.shared_x else BELOW
        self.inside = sum(rows) + gap * (len(rows) - 1)
        tops = [sum(rows[:i]) + gap * i for i in range(len(rows))]
        self.columns = min(figure.columns, len(figure.panels))
        for stretch in figure.stretches:
            self._stretch(stretch)
        width = 1.0 / (self.columns + ASIDE * (self.columns - 1))
        for number, panel in enumerate(figure.panels):
            row, column = divmod(number, self.columns)
            left = column * (1.0 + ASIDE) * width
            high = 1.0 - tops[row] / self.inside
            self._panel(number, panel, (left, left + width), (high - panel.height / self.inside, high))
        self.content = {"data": self.traces, "layout": self._layout(headline=headline, titled=titled)}

    def _panel(self, number: int, panel: Panel, across: tuple[float, float], upward: tuple[float, float]) -> None:
        self.at = "" if number == 0 else str(number + 1)
        for letter, other, axis, domain in (("x", "y", panel.x, across), ("y", "x", panel.y, upward)):
            layout = self._axis(axis)
            layout |= {"domain": [max(0.0, domain[0]), min(1.0, domain[1])], "anchor": f"{other}{self.at}"}
            if panel.sentence:
                layout["visible"] = False
            self.axes[f"{letter}axis{self.at}"] = layout
        x, last = self.axes[f"xaxis{self.at}"], len(self.figure.panels)
        if self.figure.shared_x and number + 1 < last:
            x |= {"matches": f"x{last}", "showticklabels": False}
            del x["title"]["text"]
        middle, top = 0.5 * (across[0] + across[1]), upward[1]
        if panel.title:
            self._note(panel.title, middle, top, xref="paper", yref="paper", xanchor="center", yanchor="bottom")
        if panel.sentence:
            self._note(panel.sentence, middle, 0.5 * (upward[0] + top), xref="paper", yref="paper")
        for mark in panel.marks:
            self._mark(mark, panel)
        if panel.y.beside and panel.y.ticks is not None:
            for at, text in zip(panel.y.ticks[0], panel.y.beside, strict=True):
                self._note(text, across[1], at, xref="paper", xanchor="left", xshift=4)

    def _axis(self, axis: Axis) -> dict[str, Any]:
        layout: dict[str, Any] = {
            "gridcolor": self.look.grid,
            "showgrid": axis.grid,
            "zeroline": False,
            "linecolor": self.look.ink,
            "showline": True,
            "ticks": "outside",
            "tickcolor": self.look.ink,
            "title": {"text": escaped(axis.label), "font": {"size": TEXT}, "standoff": 8},
            "exponentformat": "power",
        }
        if axis.few:
            layout["nticks"] = 5
        if axis.scale == "log":
            layout["type"] = "log"
        if axis.range is not None:
            layout["range"] = [math.log10(v) if axis.scale == "log" else float(v) for v in axis.range]
        if axis.all_ticks is not None:
            values, texts = axis.all_ticks
            layout |= {"tickvals": [float(v) for v in values], "ticktext": [lines(text) for text in texts]}
        return layout

    def _trace(self, name: str, hover: str | Sequence[str] | None, **more: Any) -> None:
        """A trace of the current panel; the first of a name stands for all of them in the legend."""
        if hover is None:
            more["hoverinfo"] = "skip"
        elif isinstance(hover, str):
            more["hovertemplate"] = hover
        else:
            more |= {"customdata": [escaped(text) for text in hover], "hovertemplate": "%{customdata}<extra></extra>"}
        if name:
            more |= {"name": escaped(name), "legendgroup": name}
        more["showlegend"] = bool(name) and name not in self.in_legend
        self.in_legend.add(name)
        self.traces.append({"xaxis": f"x{self.at}", "yaxis": f"y{self.at}", **more})

    def _shape(self, colour: str, alpha: float, **more: Any) -> None:
        """A region without edges behind the traces, unless it is a line."""
        fill = {"fillcolor": translucent(colour, alpha), "line": {"width": 0}, "layer": "below"}
        self.shapes.append({"type": "rect", **fill, **more})

    def _note(self, text: str, x: float, y: float, **more: Any) -> None:
        place = {"x": x, "y": y, "xref": f"x{self.at}", "yref": f"y{self.at}", "showarrow": False}
        font = {"size": SMALL, "color": self.look.ink}
        self.notes.append({"text": lines(text), "font": font, **place, **more})

    def _mark(self, mark: Mark, panel: Panel) -> None:
        unit = "" if panel.y.unit in (None, "1") else f" {escaped(str(panel.y.unit))}"
        match mark:
            case Line():
                line, (x, y) = self.look.style(mark.role), mark.drawn
                dense = len(x) > DENSE
                name = escaped(mark.name or panel.y.title)
                self._trace(
                    mark.name,
                    None if mark.role == "ink" and not mark.name else f"%{{y:.4g}}{unit}<extra>{name}</extra>",
                    type="scatter",
                    mode="lines+markers" if mark.marker else "lines",
                    x=packed(x),
                    y=packed(y),
                    connectgaps=False,
                    opacity=mark.opacity,
                    line={
                        "color": line.colour,
                        "dash": "solid" if mark.solid else DASHES[line.line],
                        "width": 1.1 if dense else 1.7,
                    },
                    marker={
                        "symbol": SYMBOLS[line.marker if mark.marker in ("", ".") else mark.marker],
                        "size": 7,
                        "color": line.colour,
                    },
                )
            case Band():
                self._band(mark)
            case Points():
                self._points(mark, unit)
            case Bars():
                self._bars(mark, unit)
            case Level():
                self._level(mark, panel.x)
            case Tiles():
                self._tiles(mark)
            case Text():
                anchor = {"xanchor": mark.align, "xshift": 6 if mark.align == "left" else 0}
                self._note(mark.text, mark.x, mark.y, **anchor)

    def _band(self, mark: Band) -> None:
        x, low, high = mark.drawn
        finite = np.isfinite(low) & np.isfinite(high)
        colour = self.look.style(mark.role).colour
        line = {"color": colour, "width": 1.0 if mark.outlined else 0.0, "dash": "dot"}
        common = {"type": "scatter", "x": packed(x[finite]), "mode": "lines", "line": line}
        group = {"legendgroup": mark.name} if mark.name else {}
        self._trace("", None, y=packed(low[finite]), **common, **group)
        self._trace(
            mark.name, None, y=packed(high[finite]), fill="tonexty", fillcolor=translucent(colour, 0.25), **common
        )

    def _points(self, mark: Points, unit: str) -> None:
        line = self.look.style(mark.role)
        more: dict[str, Any] = {}
        if mark.error is not None:
            size = {"type": "data", "array": packed(mark.error), "color": line.colour, "thickness": 1.3, "width": 3}
            more["error_x" if mark.across else "error_y"] = size
        symbol = SYMBOLS[line.marker] + ("-open" if mark.hollow else "")
        more["marker"] = {"symbol": symbol, "size": 4 if len(mark.x) > DENSE else 8, "color": line.colour}
        hover = mark.hover or f"%{{y:.4g}}{unit}<extra>{escaped(mark.name)}</extra>"
        self._trace(mark.name, hover, type="scatter", mode="markers", x=packed(mark.x), y=packed(mark.y), **more)

    def _bars(self, mark: Bars, unit: str) -> None:
        colour = self.look.style(mark.role).colour
        along, to = ("y", "x") if mark.across else ("x", "y")
        for solid, name in zip((True, False), mark.names, strict=True):
            rows = [i for i, inside in enumerate(mark.solid) if inside == solid]
            if not rows:
                continue
            more: dict[str, Any] = {along: rows, to: [float(mark.y[i]) for i in rows]}
            if mark.low is not None and mark.high is not None:
                ends = {"array": packed((mark.high - mark.y)[rows]), "arrayminus": packed((mark.y - mark.low)[rows])}
                more[f"error_{to}"] = {"type": "data", **ends, "color": self.look.ink, "thickness": 1.6, "width": 6}
            more["marker"] = {
                "color": colour if solid else translucent(colour, 0.15),
                "line": {"color": colour, "width": 1.5},
                "pattern": {"shape": "" if solid else "/", "size": 6, "fgcolor": colour},
            }
            hover = [mark.hover[i] for i in rows] if mark.hover else f"%{{{to}:.4g}}{unit}<extra></extra>"
            self._trace(name, hover, type="bar", width=0.6, orientation="h" if mark.across else "v", **more)
        for i, (text, end) in enumerate(zip(mark.text, mark.y if mark.top is None else mark.top, strict=False)):
            if mark.across:
                self._note(text, float(end), i, xanchor="left", xshift=2)
            else:
                self._note(text, i, float(end), yanchor="bottom", yshift=2)

    def _level(self, mark: Level, x_axis: Axis) -> None:
        line = self.look.style(mark.role)
        style = {"color": line.colour, "dash": DASHES[line.line], "width": 1.0 if mark.role == "ink" else 1.8}
        if mark.upright:
            ends = {"xref": f"x{self.at}", "yref": f"y{self.at} domain", "y0": 0.0, "y1": 1.0}
            region, at = {"x0": mark.low, "x1": mark.high}, {"x0": mark.at, "x1": mark.at}
        else:
            ends = {"xref": f"x{self.at} domain", "yref": f"y{self.at}", "x0": 0.0, "x1": 1.0}
            region, at = {"y0": mark.low, "y1": mark.high}, {"y0": mark.at, "y1": mark.at}
        named = {"showlegend": mark.name not in self.in_legend, "name": escaped(mark.name), "legendgroup": mark.name}
        if math.isfinite(mark.low):
            more = named if mark.name and math.isnan(mark.at) else {}
            self._shape(line.colour, 0.18, **ends, **region, **more)
        if math.isfinite(mark.at):
            more = named if mark.name else {}
            self._shape(line.colour, 0.0, **ends, **at, type="line", line=style, layer="above", **more)
        self.in_legend.add(mark.name)
        if mark.text:
            x = math.log10(mark.at) if x_axis.scale == "log" else mark.at
            place = {"yref": f"y{self.at} domain", "xanchor": "right", "yanchor": "top", "textangle": -90}
            self._note(mark.text, x, 1.0, **place)

    def _tiles(self, mark: Tiles) -> None:
        names = [escaped(name) for name in mark.rows]
        self.traces.append(
            {
                "type": "heatmap",
                "xaxis": f"x{self.at}",
                "yaxis": f"y{self.at}",
                "z": [packed(row) for row in np.clip(mark.z, -mark.limit, mark.limit)],
                "x": [escaped(name) for name in mark.columns],
                "y": names,
                "text": [[escaped(text) for text in row] for row in mark.text],
                "texttemplate": "%{text}",
                "customdata": [[escaped(text) for text in row] for row in mark.hover],
                "hovertemplate": "%{customdata}<extra></extra>",
                "hoverongaps": False,
                "xgap": 2,
                "ygap": 2,
                "zmin": -mark.limit,
                "zmax": mark.limit,
                "colorscale": [[0.0, OKABE_ITO["blue"]], [0.5, self.look.page], [1.0, OKABE_ITO["vermillion"]]],
                "showscale": False,
                "showlegend": False,
            }
        )
        plain = {"type": "category", "showgrid": False, "showline": False, "ticks": ""}
        self.axes[f"xaxis{self.at}"] |= plain | ({"tickangle": -50} if mark.slanted else {})
        self.axes[f"yaxis{self.at}"] |= plain | {"autorange": "reversed"}

    def _stretch(self, stretch: Stretch) -> None:
        """Shade a stretch over all panels and name it."""
        colour, self.at = self.look.style(stretch.role).colour, ""
        line = {"width": 2 if stretch.strong else 1, "dash": "solid" if stretch.strong else "dash", "color": colour}
        if stretch.role == "grid":
            line = {"width": 0}
        ends = {"x0": stretch.begin, "x1": stretch.end, "y0": 0.0, "y1": 1.0}
        alpha = 0.5 if stretch.role == "grid" else 0.16
        self._shape(colour, alpha, xref="x", yref="paper", **ends, line=line)
        if stretch.name:
            middle = 0.5 * (stretch.begin + stretch.end)
            self._note(stretch.name, middle, 1.0, yref="paper", yanchor="top", bgcolor=self.look.page)

    def _layout(self, *, headline: bool, titled: bool) -> dict[str, Any]:
        """Colours, the sentence with the small print above, and room for everything."""
        figure, look = self.figure, self.look
        large, small = textwrap.wrap(figure.headline, WIDE), textwrap.wrap(figure.small_print, WIDE + 20)
        shown = figure.legend and any(drawn.get("showlegend") for drawn in (*self.traces, *self.shapes))
        key, panels = (26 if shown else 6), (22 if titled else 0)
        above = 12 + key + panels
        left, right, below = LEFT, RIGHT, BOTTOM
        for panel in figure.panels:
            tiles = [mark for mark in panel.marks if isinstance(mark, Tiles)]
            names = [*(panel.y.ticks[1] if panel.y.ticks else ()), *(name for mark in tiles for name in mark.rows)]
            left = max(left, label_margin(names))
            right = max(right, label_margin(panel.y.beside) if panel.y.beside else 0)
            below += 16 * max((text.count("\n") for text in panel.x.ticks[1]), default=0) if panel.x.ticks else 0
            below += max((int(0.8 * label_margin(m.columns)) - 18 for m in tiles if m.slanted), default=0)
        if headline and figure.headline:
            above += 20 * len(large) + 15 * len(small)
            words = [*map(escaped, large), *(f"<span style='font-size:11px'>{escaped(line)}</span>" for line in small)]
            place = {"xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom", "align": "left"}
            self._note("", 0.0, 1.0, **place, name="headline", xshift=8 - left, yshift=key + panels)
            self.notes[-1] |= {"text": "<br>".join(words), "font": {"size": HEAD, "color": look.ink}}
        layout: dict[str, Any] = {
            **self.axes,
            "shapes": self.shapes,
            "annotations": self.notes,
            "paper_bgcolor": look.page,
            "plot_bgcolor": look.page,
            "font": {"family": FAMILY, "size": TEXT, "color": look.ink},
            "margin": {"l": left, "r": right, "t": above, "b": below, "autoexpand": False},
            "height": int(self.inside) + above + below,
            "showlegend": shown,
            "legend": {
                "orientation": "h",
                "x": 0.0,
                "xanchor": "left",
                "y": 1.0 + panels / self.inside,
                "yanchor": "bottom",
                "bgcolor": "rgba(0,0,0,0)",
                "font": {"size": SMALL},
                "itemwidth": 36,
                "tracegroupgap": 0,
            },
            "hoverlabel": {"bgcolor": look.page, "bordercolor": look.grid, "font": {"color": look.ink}},
            "hovermode": "closest",
            "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": look.grid, "activecolor": look.ink},
        }
        return layout | ({"uirevision": figure.key} if figure.key else {})


def least_width(figure: Figure, drawn: Mapping[str, Any]) -> int:
    """Width at which the titles of panels and axes stand beside each other, and each name in the legend, pixels.

    Parameters
    ----------
    figure, drawn : what was drawn, and `as_dict` of it.
    """
    margin, columns = drawn["layout"]["margin"], min(figure.columns, len(figure.panels))
    titles = [len(text) for panel in figure.panels for text in (panel.title, panel.x.label)]
    names = [len(str(part.get("name") or "")) + KEY for part in (*drawn["data"], *drawn["layout"]["shapes"])]
    inside = max(columns * max(titles, default=0), max(names, default=0))
    return int(margin["l"] + margin["r"] + LETTER * inside)


KEY = 7
"""Letters that a symbol takes in the legend."""


def packed(values: NDArray[np.floating[Any]]) -> dict[str, str] | list[float | None]:
    """Numbers as plotly.js reads them: few as a list, many as bytes, in single precision where that is enough."""
    several = np.asarray(values, dtype=np.float64)
    if len(several) <= DENSE:
        return [v if math.isfinite(v) else None for v in several.tolist()]
    kind = "f8" if _needs_digits(several) else "f4"
    return {"dtype": kind, "bdata": base64.b64encode(several.astype(f"<{kind}").tobytes()).decode()}


def _needs_digits(values: NDArray[np.float64]) -> bool:
    """Whether rising values would blur in single precision, as instants late in a record do."""
    steps = np.diff(values[np.isfinite(values)])
    if not len(steps) or steps.min() < 0.0:
        return False
    return float(np.spacing(np.float32(np.nanmax(np.abs(values))))) > 0.1 * float(np.median(steps))


def label_margin(names: Sequence[str]) -> int:
    """Margin that the longest of some labels needs, pixels."""
    return int(30 + LETTER * max((len(line) for name in names for line in name.splitlines()), default=0))


def lines(text: str) -> str:
    """Escaped text with its breaks."""
    return escaped(text).replace("\n", "<br>")


def escaped(text: str) -> str:
    """Text with everything escaped that plotly would read as a tag."""
    return html.escape(text, quote=False)


def translucent(colour: str, alpha: float) -> str:
    """A colour of the palette with transparency."""
    r, g, b = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({r},{g},{b},{alpha:g})"
