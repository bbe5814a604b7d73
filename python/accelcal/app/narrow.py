"""Figures for a narrow window: panels that stand side by side are put one under the other."""

from __future__ import annotations

import copy
import math
import textwrap
from dataclasses import replace
from typing import Any, TypeAlias

from accelcal.app.figures import Picture

WIDTH = 272
"""Width of the axes on a phone, px."""
PANEL = 170
"""Height of a panel, px."""
TALLEST = 230
"""Most that the axes of a figure with one panel take, px."""
GAP = 88
"""Height between two panels, for the labels of the upper axis and the title of the lower panel, px."""
LEFT = 62
"""Most that the labels of an ordinate take, px."""
LETTER, KEY, ROW = 6.5, 44, 19
"""Width of a letter and of a key of the legend, and height of a row of it, px."""
BESIDE = 0.02
"""Distance between a title and the middle of its panel that is still its own, as a share of the figure."""
ABSCISSA, ORDINATE = 36, 24
"""Letters in a line of a title along the abscissa, and along the ordinate."""
LINE = 16
"""Height of a line of a title, px."""
HALF = 500
"""Width of the axes of a figure that has half of a wide window, px."""

Axes: TypeAlias = "tuple[dict[str, Any], dict[str, Any]]"
"""Abscissa and ordinate of a panel."""


def narrowed(picture: Picture) -> Picture:
    """The same figure with its panels in one column, and with short lines at its sides."""
    figure = copy.copy(picture.figure)
    layout = figure["layout"] = copy.deepcopy(figure["layout"])
    panels = axes_of(layout)
    margin, left = layout["margin"], LEFT
    if len({x["domain"][0] for x, _ in panels}) > 1:
        stack(layout, panels)
    elif any(isinstance(y, str) for trace in figure["data"] for y in _listed(trace)):
        figure["data"] = [
            {**trace, "y": [y.replace(", ", ",<br>", 1) if isinstance(y, str) else y for y in _listed(trace)]}
            for trace in figure["data"]
        ]
        left = 2 * LEFT
    elif len(panels) == 1:
        layout["height"] = min(layout["height"], margin["t"] + margin["b"] + TALLEST)
    if any([wrap_titles(axes) for axes in panels]):
        left += LINE
    if layout.get("showlegend", False):
        figure["data"] = [wrap_name(trace) for trace in figure["data"]]
        layout["shapes"] = [wrap_name(shape) for shape in layout.get("shapes", [])]
    margin["l"], margin["r"] = min(margin["l"], left), min(margin["r"], 12)
    make_room(figure, WIDTH)
    return replace(picture, figure=figure)


def roomy(picture: Picture) -> Picture:
    """The same figure with room for the legend where the window is wide and the figure half as wide."""
    figure = {**picture.figure, "layout": copy.deepcopy(picture.figure["layout"])}
    make_room(figure, HALF)
    return replace(picture, figure=figure)


def make_room(figure: dict[str, Any], width: float) -> None:
    """Make room above the axes for every row of the legend; `width` of the axes in px."""
    layout = figure["layout"]
    more = ROW * (legend_rows(figure, width) - 1)
    layout["margin"]["t"], layout["height"] = layout["margin"]["t"] + more, layout["height"] + more


def wrap_name(trace: dict[str, Any]) -> dict[str, Any]:
    """A trace whose name in the legend, where a line does not hold it, has several; plotly would cut it."""
    name = str(trace.get("name") or "")
    letters = int((WIDTH - KEY) / LETTER)
    return {**trace, "name": _wrapped(name, letters)} if len(name) > letters else trace


def wrap_titles(axes: Axes) -> bool:
    """Wrap the titles of a panel's axes and the names along its abscissa; whether its ordinate has two lines now."""
    x, y = axes
    for axis, letters in ((x, ABSCISSA), (y, ORDINATE)):
        title = axis.get("title") or {}
        if title.get("text"):
            title.update(text=_wrapped(title["text"], letters), font={**title.get("font", {}), "size": 12})
    names = x.get("ticktext")
    if isinstance(names, list) and names:
        x["ticktext"] = [
            "<br>".join(_wrapped(part, max(8, 44 // len(names))) for part in n.split("<br>")) for n in names
        ]
    return "<br>" in str((y.get("title") or {}).get("text", ""))


def axes_of(layout: dict[str, Any]) -> list[Axes]:
    """Axes of each panel, from the upper left to the lower right."""
    found = []
    for key, y in layout.items():
        if key.startswith("yaxis") and "overlaying" not in y:
            x = layout.get(f"xaxis{str(y.get('anchor', 'x')).removeprefix('x')}")
            if isinstance(x, dict) and "domain" in x and "domain" in y:
                found.append((x, y))
    return sorted(found, key=lambda pair: (-pair[1]["domain"][1], pair[0]["domain"][0]))


def stack(layout: dict[str, Any], panels: list[Axes]) -> None:
    """Give every panel the whole width and a height of its own; its title goes with it."""
    inside = len(panels) * PANEL + (len(panels) - 1) * GAP
    margin, notes = layout["margin"], layout.get("annotations", [])
    before = layout["height"] - margin["t"] - margin["b"]
    layout["height"] = inside + margin["t"] + margin["b"]
    layout["annotations"] = copy.deepcopy(notes)
    for i, (x, y) in enumerate(panels):
        middle, top = sum(x["domain"]) / 2.0, y["domain"][1]
        new_top = 1.0 - i * (PANEL + GAP) / inside
        for old, new in zip(notes, layout["annotations"], strict=True):
            if abs(old.get("x", -1.0) - middle) < BESIDE and abs(old.get("y", -1.0) - top) < BESIDE:
                new.update(x=0.5, y=new_top, text=_wrapped(old["text"], ABSCISSA))
        x["domain"], y["domain"] = [0.0, 1.0], [max(0.0, new_top - PANEL / inside), new_top]
        x["showticklabels"] = y["showticklabels"] = True
    legend = layout.get("legend", {})
    if legend.get("y", 0.0) > 1.0:
        legend["y"] = 1.0 + (legend["y"] - 1.0) * before / inside


def legend_rows(figure: dict[str, Any], width: float) -> int:
    """Lines that a horizontal legend takes: one where all fits, else its widest entry sets the columns."""
    if not figure["layout"].get("showlegend", False):
        return 1
    named = [trace for trace in figure["data"] if trace.get("showlegend", True) and trace.get("name")]
    named += [shape for shape in figure["layout"].get("shapes", []) if shape.get("showlegend")]
    groups = {trace.get("legendgroup") or trace["name"]: str(trace["name"]) for trace in named}
    names = [name.split("<br>") for name in groups.values()]
    widths = [KEY + LETTER * max(map(len, lines)) for lines in names]
    more = sum(len(lines) - 1 for lines in names)
    if sum(widths) <= width:
        return 1 + more
    return math.ceil(len(widths) / max(1, math.floor(width / max(widths)))) + more


def _listed(trace: dict[str, Any]) -> list[Any]:
    y = trace.get("y")
    return y if isinstance(y, list) else []


def _wrapped(text: str, letters: int) -> str:
    return "<br>".join(textwrap.wrap(text, letters)) if "<" not in text else text
