"""The report as one self-contained HTML page: with plotly.js inside, or with static figures."""

from __future__ import annotations

import base64
import json
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from accelcal._support.errors import MissingExtra
from accelcal.io import atomic_write
from accelcal.plots import matplotlib, plotly
from accelcal.report.content import Content
from accelcal.report.figures import Entry, entries
from accelcal.report.view import view
from accelcal.results.json_text import finite

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure as StaticFigure

SECTIONS = ("first", "found", "apart", "falling", "where", "response", "parameters", "data")
"""Sections that hold figures."""
DRAWN = ("x", "y", "z", "text", "customdata")
"""Data of a trace, equal in both themes."""


def html(content: Content) -> str:
    """Return the interactive page.

    Parameters
    ----------
    content : from `accelcal.report.gather`.

    Raises
    ------
    MissingExtra
        If plotly, which holds plotly.js, or jinja2 is not installed.
    """
    shown = [
        {"name": e.name, "section": e.section, "caption": e.caption, "json": script_json(both_themes(e))}
        for e in entries(content)
    ]
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise MissingExtra('the report needs plotly; install it with: pip install "accelcal[report]"') from error
    return render(content, shown, get_plotlyjs())


def light(content: Content) -> str:
    """Return the page without script: static figures, small enough to mail.

    Raises
    ------
    MissingExtra
        If matplotlib or jinja2 is not installed.
    """
    shown = []
    for e in entries(content):
        if e.still is not None:
            image = svg_url(matplotlib.draw(e.still))
            shown.append({"name": e.name, "section": e.section, "caption": e.caption, "image": image})
    return render(content, shown, "")


def write(text: str, path: str | Path) -> None:
    """Write a page, whole or not at all."""
    atomic_write(path, text)


def render(content: Content, figures: list[dict[str, Any]], library: str) -> str:
    """Fill the template; everything but plotly.js and figure data is escaped."""
    folder = resources.files("accelcal.report")
    template = environment().from_string(folder.joinpath("page.html").read_text(encoding="utf-8"))
    by_section = {name: [f for f in figures if f["section"] == name] for name in SECTIONS}
    return template.render(
        v=view(content),
        figures=by_section,
        plotly=library,
        style=folder.joinpath("page.css").read_text(encoding="utf-8"),
        script=folder.joinpath("page.js").read_text(encoding="utf-8") if library else "",
    )


def environment() -> Environment:
    """What fills templates: everything is escaped, and nothing may be missing.

    Raises
    ------
    MissingExtra
        If jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError as error:
        raise MissingExtra('the report needs jinja2; install it with: pip install "accelcal[report]"') from error
    return jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)


def both_themes(entry: Entry) -> dict[str, Any]:
    """A figure in the light theme, and its differences in the dark one."""
    day, night = (plotly.as_dict(entry.figure, theme) for theme in ("light", "dark"))
    skins = [{key: value for key, value in trace.items() if key not in DRAWN} for trace in night["data"]]
    return {"data": day["data"], "layout": day["layout"], "dark": {"data": skins, "layout": night["layout"]}}


def script_json(value: Any) -> str:
    """JSON for a script element: no text in it can end that element."""
    text = json.dumps(finite(value), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def svg_url(drawn: StaticFigure) -> str:
    """A static figure as a URL that holds it."""
    return f"data:image/svg+xml;base64,{base64.b64encode(matplotlib.svg(drawn)).decode()}"
