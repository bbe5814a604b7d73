"""What a figure is: panels of marks, as data; `matplotlib` and `plotly` draw it.

A mark holds numbers in the units of its axes, a name, and a role; which colour and line a role has stands in `style`.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from inspect import Signature, signature
from types import MappingProxyType
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from accelcal._support.errors import AccelcalError
from accelcal.data import MICRO_G, Array
from accelcal.effects import spelled
from accelcal.results import words as formatting
from accelcal.results.comparisons import fall, source_of_noise
from accelcal.results.words import grouped, label
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Comparison

ThemeName = Literal["light", "dark"]
Role = Literal["measured", "model", "other", "floor", "residual", "band", "before", "fault", "ink", "grid"]
"""What a mark shows: the measurement, the (current) model, a second curve of it, the noise floor, a residual without
other curves, what noise alone explains, the same quantity of the model before, a fault."""
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
    styles: Mapping[Role, LineStyle]
    """How marks are drawn by their role; all others in ink."""

    def style(self, role: Role) -> LineStyle:
        """How a mark of this role is drawn."""
        return self.styles.get(role) or LineStyle(self.ink, "-", "o")


def theme_with(name: ThemeName, page: str, ink: str, grid: str, curves: tuple[str, str, str]) -> Theme:
    """A theme whose measurement, model and second curve of a model have given colours."""
    measured, model, other = curves
    styles: dict[Role, LineStyle] = {
        "measured": LineStyle(measured, "-", "o"),
        "model": LineStyle(model, "--", "s"),
        "other": LineStyle(other, "-.", "^"),
        "floor": LineStyle(OKABE_ITO["bluish green"], ":", "D"),
        "residual": LineStyle(model, "-", "s"),
        "band": LineStyle(OKABE_ITO["orange"], "-", "o"),
        "grid": LineStyle(grid, "-", "o"),
        "fault": LineStyle(other, "-", "X"),
    }
    return Theme(name, page, ink, grid, MappingProxyType(styles))


LIGHT = theme_with(
    "light", "#FFFFFF", "#1A1A1A", "#DDDDDD", (OKABE_ITO["black"], OKABE_ITO["blue"], OKABE_ITO["vermillion"])
)
DARK = theme_with(  # the palette's black is white on a dark page
    "dark", "#15171C", "#E8E8E8", "#3A3E47", ("#FFFFFF", OKABE_ITO["sky blue"], OKABE_ITO["yellow"])
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
        raise AccelcalError(f"there is no theme {name!r}; choose one of {', '.join(THEMES)}")
    return THEMES[name]


def role_of_model(number: int, count: int) -> Role:
    """Role of one of several models, in order: the last is the current one, the one before it differs in both cues."""
    return "model" if number == count - 1 else ("other", "floor")[(count - 2 - number) % 2]


T = TypeVar("T")
COLUMNS = 2000
"""Pixel columns of a series; each keeps its least and its largest value."""
BAND_COLUMNS = 300
"""Columns of a band, each at its median."""
GAP = 8.0
"""A series is interrupted where an interval exceeds this many usual ones."""
DENSE = 500
"""A line through more points is drawn thin."""


@dataclass(frozen=True)
class Line:
    """A curve; one of `columns` is a series over rising `x`, thinned to them and interrupted where `x` pauses."""

    x: Array
    y: Array
    name: str = ""
    """In the legend; marks of one name in several panels are one entry."""
    role: Role = "model"
    columns: int = 0
    solid: bool = False
    """Whether it is drawn without the dashes of its role."""
    marker: str = ""
    """Of each point, "." for that of the role; "" for none."""
    opacity: float = 1.0

    @cached_property
    def thinned(self) -> tuple[Array, Array]:
        """The points that are drawn, without breaks."""
        return thin(self.x, self.y, self.columns) if self.columns else (self.x, self.y)

    @cached_property
    def drawn(self) -> tuple[Array, Array]:
        """The points that are drawn, with a NaN in either wherever the record pauses."""
        x, y = self.thinned
        if not self.columns or len(self.x) < 2:
            return x, y
        step = np.diff(self.x)
        at = np.unique(np.searchsorted(x, self.x[:-1][step > GAP * np.median(step)], side="right"))
        at = at[(at > 0) & (at < len(x))]
        return np.insert(x, at, np.nan), np.insert(y, at, np.nan)


@dataclass(frozen=True)
class Band:
    """A filled region between two curves."""

    x: Array
    low: Array
    high: Array
    name: str = ""
    role: Role = "band"
    outlined: bool = True

    @cached_property
    def drawn(self) -> tuple[Array, Array, Array]:
        """Abscissa, lower and upper edge; of a long one the median of each column, which has no jitter."""
        x, low, high = column_medians(self.x, self.low, self.high)
        return x, low, high


@dataclass(frozen=True)
class Points:
    """Markers; with `error` a bar of that half-width through each, along x where they are `across`."""

    x: Array
    y: Array
    name: str = ""
    role: Role = "model"
    error: Array | None = None
    across: bool = False
    hollow: bool = False
    hover: Sequence[str] = ()
    """What is said of each where the pointer rests on it."""


@dataclass(frozen=True)
class Bars:
    """Bars at 0, 1, 2 ... with intervals, horizontal where they are `across`; hatched where they are not `solid`."""

    y: Array
    """Their ends."""
    solid: Sequence[bool]
    names: tuple[str, str] = ("", "")
    """Of solid and of hatched bars, in the legend."""
    low: Array | None = None
    high: Array | None = None
    text: Sequence[str] = ()
    """Lines beside each."""
    top: Array | None = None
    """Where the text begins; by default at the end of the bar."""
    hover: Sequence[str] = ()
    role: Role = "model"
    across: bool = False


@dataclass(frozen=True)
class Level:
    """A straight line through the whole panel at `at`, or the region from `low` to `high`, or both."""

    at: float = math.nan
    low: float = math.nan
    high: float = math.nan
    name: str = ""
    role: Role = "ink"
    upright: bool = False
    """Whether it stands at an abscissa."""
    text: str = ""
    """Beside an upright line."""


@dataclass(frozen=True)
class Tiles:
    """A matrix of coloured tiles, from -`limit` to `limit`; NaN is left empty."""

    z: Array
    """(rows, columns), the first row on top."""
    rows: Sequence[str]
    columns: Sequence[str]
    text: Sequence[Sequence[str]]
    hover: Sequence[Sequence[str]]
    limit: float
    slanted: bool = False
    """Whether the names of the columns are long."""


@dataclass(frozen=True)
class Text:
    """Words at a point, that begin there or are centred."""

    x: float
    y: float
    text: str
    align: Literal["left", "center"] = "left"


Mark = Line | Band | Points | Bars | Level | Tiles | Text


@dataclass(frozen=True)
class Axis:
    """An axis; without a unit its title is drawn as it stands."""

    title: str = ""
    unit: str | None = None
    scale: Literal["linear", "log", "symlog"] = "linear"
    """Linear from -1 to 1 and logarithmic beyond is `symlog`, which an interactive figure draws linear."""
    range: tuple[float, float] | None = None
    """From the lower or left to the upper or right end, which may be the smaller one."""
    ticks: tuple[Sequence[float], Sequence[str]] | None = None
    """Where they are and what they say."""
    beside: Sequence[str] = ()
    """What stands at the far end of each tick."""
    few: bool = False
    """Whether there is room for four numbers only."""
    grid: bool = True

    @property
    def label(self) -> str:
        """The title with its unit."""
        return self.title if self.unit is None else label(self.title, self.unit)

    @property
    def all_ticks(self) -> tuple[Sequence[float], Sequence[str]] | None:
        """The declared ticks, else those of a logarithmic axis with a range; None where the library chooses them."""
        if self.ticks is None and self.scale == "log" and self.range is not None:
            return decades(*self.range)
        return self.ticks


def on_rows(names: Iterable[str]) -> list[str]:
    """Names of effects beside rows as people write them; the long ones on two lines, so that the marks keep room."""
    return [textwrap.fill(spelled(name), ROW) for name in names]


ROW = 18
"""Letters of a line beside a row."""


@dataclass(frozen=True)
class Panel:
    """Axes with their marks, or a sentence in place of data that the record is too short for."""

    marks: tuple[Mark, ...]
    x: Axis
    y: Axis
    title: str = ""
    height: float = 300.0
    """px of an interactive figure."""
    sentence: str = ""


@dataclass(frozen=True)
class Stretch:
    """A stretch of time that is marked in all panels, named unless the name is empty."""

    begin: float
    end: float
    name: str = ""
    role: Role = "band"
    strong: bool = False


@dataclass(frozen=True)
class Figure:
    """Panels from the upper left to the lower right, the sentence over them and small print."""

    panels: tuple[Panel, ...]
    headline: str = ""
    note: str = ""
    columns: int = 1
    shared_x: bool = False
    """Whether all panels have one abscissa, named under the last."""
    stretches: tuple[Stretch, ...] = ()
    legend: bool = True
    key: str = field(default="", compare=False)
    """Under which an interactive page keeps its view while the data change."""

    @property
    def rows(self) -> list[float]:
        """Height of each row of panels, px."""
        heights = [panel.height for panel in self.panels]
        return [max(heights[i : i + self.columns]) for i in range(0, len(heights), self.columns)]

    def scaled(self, share: float) -> Figure:
        """The figure with panels of a share of their height."""
        return replace(self, panels=tuple(replace(panel, height=share * panel.height) for panel in self.panels))

    @property
    def small_print(self) -> str:
        """The note, then how the series that lost most points was thinned."""
        lines = [mark for panel in self.panels for mark in panel.marks if isinstance(mark, Line)]
        counts = [(len(line.thinned[0]), len(line.x)) for line in lines]
        thinned = points_shown(*max(counts, key=lambda count: count[1] - count[0], default=(0, 0)))
        return "; ".join(filter(None, (self.note, thinned)))


def sentence(headline: str, text: str) -> Figure:
    """A figure of a sentence, in place of data that the record is too short for."""
    return Figure((Panel((), Axis(), Axis(), height=140.0, sentence=text),), headline)


def drawing(define: Callable[..., Figure], draw: Callable[[Figure, ThemeName], T]) -> Callable[..., T]:
    """A function that defines a figure and draws it in the theme `theme`, "light" or "dark"."""

    @wraps(define)
    def drawn(*given: Any, theme: ThemeName = "light", **options: Any) -> T:
        return draw(define(*given, **options), theme)

    drawn.__doc__ = f'{(define.__doc__ or "").rstrip()}\n\n    It is drawn in the theme `theme`, "light" or "dark".\n'
    public = signature(define).replace(return_annotation=Signature.empty)
    setattr(drawn, "__signature__", public)  # noqa: B010  (a function has the attribute for `help` alone)
    return drawn


def points_shown(shown: int, total: int) -> str:
    """A note about thinning; empty when every point is drawn."""
    return "" if shown == total else f"{grouped(shown)} of {grouped(total)} points shown"


def thin(t: Array, y: Array, columns: int = COLUMNS) -> tuple[Array, Array]:
    """Keep the least and the largest value of each pixel column; extremes survive, statistics do not.

    Parameters
    ----------
    t : (n,) rising; columns are equally wide in it.
    y : (n,) same length.
    columns : up to twice as many points remain.

    Examples
    --------
    >>> len(thin(np.arange(400_000.0), np.sin(np.arange(400_000.0)))[0])
    4000
    """
    n = len(t)
    if n <= 2 * columns:
        return t, y
    first = _columns(t, columns)
    size = np.diff(first, append=n)
    rows = []
    for extreme in (np.fmin, np.fmax):
        at = np.flatnonzero(y == np.repeat(extreme.reduceat(y, first), size))
        rows.append(at[np.diff(np.searchsorted(first, at, side="right"), prepend=0) > 0])
    rows_shown = np.unique(np.concatenate(rows))
    return t[rows_shown], y[rows_shown]


def column_medians(x: Array, *several: Array, columns: int = BAND_COLUMNS) -> tuple[Array, ...]:
    """Abscissae from the first to the last of `x` (n,), rising, and the median of each of `several` (n,) by column."""
    if len(x) <= 2 * columns:
        return (x, *several)
    parts = list(zip(_columns(x, columns), [*_columns(x, columns)[1:], len(x)], strict=True))
    at = np.array([0.5 * (x[a] + x[b - 1]) for a, b in parts])
    at[0], at[-1] = x[0], x[-1]
    return (at, *(np.array([np.median(y[a:b]) for a, b in parts]) for y in several))


def _columns(t: Array, columns: int) -> NDArray[np.intp]:
    """The first row of each pixel column that holds any."""
    edges = np.linspace(t[0], t[-1], columns + 1)[:-1]
    return np.unique(np.searchsorted(t, edges)).astype(np.intp)


def decades(low: float, high: float) -> tuple[list[float], list[str]]:
    """Ticks of a logarithmic axis between two values: 1, 2, 5 over few decades, else powers of ten."""
    low, high = math.log10(low), math.log10(high)
    steps = (1.0, 2.0, 5.0) if high - low < 2.6 else (1.0,)
    powers = range(math.floor(low), math.ceil(high) + 1)
    ticks = [m * 10.0**d for d in powers for m in steps if low - 1e-9 <= math.log10(m * 10.0**d) <= high + 1e-9]
    return ticks, [tick(v) for v in ticks]


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


CANDIDATES = 12
"""Candidates that are drawn."""


def imposed_band_note(comparison: Evaluation) -> str:
    """A remark where predicted deviations are not valid."""
    text = "; the fit used a prescribed band, so its predicted deviations are not valid"
    return "" if comparison.nis is not None else text


def error_reduction_sentence(comparison: Comparison) -> str:
    """The error of the first and of the last model in one sentence."""
    full_scale = comparison.fits[0].rig.sensor.range
    source = source_of_noise(comparison.noise_floor.sensor)
    return f"{fall(list(comparison), full_scale=full_scale)[:-1]} ({source})"


def ruled(comparison: Comparison) -> tuple[float, str]:
    """Factor and unit in which the errors of a comparison are drawn: mg, or metres with a prefix."""
    if comparison.headline.unit == "m/s²":
        large = max(comparison.errors) >= 100.0 * MICRO_G
        return (1.0 / (1e3 * MICRO_G), "mg") if large else (1.0 / MICRO_G, "µg")
    return formatting.prefixed("m", np.array(comparison.errors), comparison.floor.value)


SMALLEST_SHARE = 0.005
"""Share of the error's power below which a table that shows per cent says that nothing has changed."""


def share_text(comparison: Comparison, number: int) -> str:
    """What a step did to the error: the part of the excess over noise that it removes, and whether that is all."""
    share = comparison.shares[number]
    if number and comparison.at_floor[number] and comparison.at_floor[number - 1]:
        return "not detectable"
    if share is None:
        return "not detectable" if comparison.at_floor[number] else ""
    if share < 0.0:
        return "error rises" if share < -SMALLEST_SHARE else "no change"
    if comparison.at_floor[number]:
        return f"{round(100.0 * min(share, 1.0))} % of its power explained, down to the noise"
    return f"{'more than 99.9' if share > 0.999 else f'{100.0 * share:.3g}'} % of its power explained"
