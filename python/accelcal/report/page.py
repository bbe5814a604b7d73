"""The report as one self-contained HTML page: with plotly.js inside, or with static figures."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from accelcal._support.errors import MissingExtra
from accelcal._support.locks import scratch_folder
from accelcal.io import atomic_write
from accelcal.plots import matplotlib, plotly
from accelcal.report.content import Content, Entry, entries
from accelcal.report.view import view
from accelcal.results.json_text import dumps, finite

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


Form = Literal["pdf", "png"]


def typeset(template: str, texts: Mapping[str, Any], figures: Mapping[str, bytes], form: Form = "pdf") -> Any:
    """Typeset texts and figures.

    Parameters
    ----------
    template : file of this folder, which reads the texts from report.json and figures by their file names.
    texts : by key.
    figures : content by file name.
    form : of the result: a PDF, or images of its pages.

    Returns
    -------
    The PDF as bytes; images as a list, one bytes object for each page.

    Raises
    ------
    MissingExtra
        If typst or matplotlib, whose typeface is used, is not installed.
    """
    try:
        import typst
    except ImportError as error:
        raise MissingExtra('a PDF needs typst; install it with: pip install "accelcal[pdf]"') from error
    with sources(template, texts, figures) as settings:
        made = typst.compile(**settings, format=form)
    return [made] if form == "png" and isinstance(made, bytes) else made


@contextmanager
def sources(template: str, texts: Mapping[str, Any], figures: Mapping[str, bytes]) -> Iterator[dict[str, Any]]:
    """A folder with everything that typst reads, as the arguments of its functions; it is gone afterwards."""
    import matplotlib

    with scratch_folder() as root:
        for name, content in figures.items():
            (root / name).write_bytes(content)
        (root / "report.json").write_text(dumps(dict(texts)), encoding="utf-8")
        source = resources.files("accelcal.report").joinpath(template).read_text(encoding="utf-8")
        (root / template).write_text(source, encoding="utf-8")
        fonts = Path(matplotlib.get_data_path(), "fonts", "ttf")
        yield {"input": str(root / template), "root": str(root), "font_paths": [str(fonts)]}


def pdf(content: Content, path: str | Path) -> None:
    """Write the report as PDF, whole or not at all: the first page is a summary, the details follow.

    Parameters
    ----------
    content : from `accelcal.report.gather`.
    path : file to write.

    Raises
    ------
    MissingExtra
        If typst or matplotlib is not installed.
    """
    atomic_write(path, typeset("paper.typ", *paper(content)))


def paper(content: Content) -> tuple[dict[str, Any], dict[str, bytes]]:
    """What is typeset: texts with the list of figures, and the figures by file name."""
    drawn, listed = {}, []
    for e in entries(content):
        if e.still is not None:
            drawn[f"{e.name}.svg"] = matplotlib.svg(matplotlib.draw(e.still))
            listed.append({"file": f"{e.name}.svg", "section": e.section, "caption": e.caption})
    return {**view(content), "figures": listed}, drawn
