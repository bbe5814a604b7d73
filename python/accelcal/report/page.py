"""Reports as pages that open offline, with plotly.js or static figures inside, and as PDF; also on two calibrations."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from accelcal._core import __version__
from accelcal._support.errors import optional
from accelcal._support.locks import scratch_folder
from accelcal._support.process import one_thread
from accelcal.calibration.agreement import BEYOND_BY_CHANCE, LIMIT, Agreement, ComparedParameter
from accelcal.calibration.characteristic import budget
from accelcal.effects import spelled
from accelcal.estimation.estimate import Fit
from accelcal.io import atomic_write
from accelcal.model import Estimate
from accelcal.plots import matplotlib, plotly
from accelcal.plots.figure import THEMES, Figure
from accelcal.plots.model import agreement
from accelcal.report.content import AxesContent, Content, Entry, entries
from accelcal.report.view import view
from accelcal.results.json_text import dumps, finite
from accelcal.results.words import about, number, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure as StaticFigure


DRAWN = ("x", "y", "z", "text", "customdata")
"""Data of a trace, equal in both themes."""


@one_thread
def html(content: Content | AxesContent) -> str:
    """Return the interactive page.

    Parameters
    ----------
    content : from `accelcal.report.gather`.

    Raises
    ------
    MissingExtra
        If plotly, which holds plotly.js, or jinja2 is not installed.
    """
    shown = [interactive(entry) for entry in entries(content)]
    return render(content, shown, optional("plotly.offline", "the report needs", "report").get_plotlyjs())


@one_thread
def light(content: Content | AxesContent) -> str:
    """Return the page without script: static figures, small enough to mail.

    Raises
    ------
    MissingExtra
        If matplotlib or jinja2 is not installed.
    """
    shown = [
        {"name": e.name, "section": e.section, "caption": e.caption, "image": svg_url(matplotlib.draw(e.still()))}
        for e in entries(content)
        if e.still is not None
    ]
    return render(content, shown, "")


def write(text: str, path: str | Path) -> None:
    """Write a page, whole or not at all."""
    atomic_write(path, text)


def render(content: Content | AxesContent, figures: list[dict[str, Any]], library: str) -> str:
    """Fill the template; everything but plotly.js and figure data is escaped."""
    sections = {figure["section"] for figure in figures}
    by_section = {name: [f for f in figures if f["section"] == name] for name in sections}
    script = text_of("page.js") if library else ""
    return filled("page.html", v=view(content), figures=by_section, plotly=library, script=script)


def filled(template: str, package: str = "accelcal.report", **texts: Any) -> str:
    """A template of a package with texts, each of which is escaped, in the style of all pages; nothing may be missing.

    Raises
    ------
    MissingExtra
        If jinja2 is not installed.
    """
    jinja2 = optional("jinja2", "the report needs", "report")
    pages = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return str(pages.from_string(text_of(template, package)).render(style=text_of("page.css"), **texts))


def text_of(name: str, package: str = "accelcal.report") -> str:
    """The text of a file of a package."""
    return resources.files(package).joinpath(name).read_text(encoding="utf-8")


def interactive(entry: Entry) -> dict[str, Any]:
    """A figure for the page with script, which breaks its sentence and small print to the width of the window."""
    figure = entry.figure()
    drawn = both_themes(figure)
    return {
        **{"name": entry.name, "section": entry.section, "caption": entry.caption},
        **{"headline": figure.headline, "small": figure.small_print, "width": plotly.least_width(figure, drawn)},
        "json": script_json(drawn),
    }


def both_themes(figure: Figure) -> dict[str, Any]:
    """A figure in the light theme, and its differences in the dark one."""
    day, night = (plotly.as_dict(figure, theme, headline=False) for theme in ("light", "dark"))
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
    typst = optional("typst", "a PDF needs", "pdf")
    with sources(template, texts, figures) as settings:
        document = typst.compile(**settings, format=form)
    return [document] if form == "png" and isinstance(document, bytes) else document


@contextmanager
def sources(template: str, texts: Mapping[str, Any], figures: Mapping[str, bytes]) -> Iterator[dict[str, Any]]:
    """A folder with everything that typst reads, as the arguments of its functions; it is gone afterwards."""
    import matplotlib

    with scratch_folder() as root:
        for name, content in figures.items():
            (root / name).write_bytes(content)
        (root / "report.json").write_text(dumps(dict(texts)), encoding="utf-8")
        (root / template).write_text(text_of(template), encoding="utf-8")
        fonts = Path(matplotlib.get_data_path(), "fonts", "ttf")
        yield {"input": str(root / template), "root": str(root), "font_paths": [str(fonts)]}


def pdf(content: Content | AxesContent, path: str | Path) -> None:
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


@one_thread
def paper(content: Content | AxesContent) -> tuple[dict[str, Any], dict[str, bytes]]:
    """What is typeset: texts with the list of figures, and the figures by file name."""
    still = [(f"{e.name}.svg", e, e.still) for e in entries(content) if e.still is not None]
    listed = [{"file": file, "section": e.section, "caption": e.caption} for file, e, _ in still]
    return {**view(content), "figures": listed}, {
        file: matplotlib.svg(matplotlib.draw(define())) for file, _, define in still
    }


BADGES = {
    "agree": "the calibrations agree",
    "differ": "the calibrations differ",
    "not comparable": "not comparable",
}


def agreement_view(result: Agreement) -> dict[str, Any]:
    """Everything that is printed, by section."""
    first, second = result.names
    return {
        "title": f"Comparison of two calibrations: {first} and {second}",
        "verdict": {"agree": "adequate"}.get(result.verdict, result.verdict),
        "badge": BADGES[result.verdict],
        "sentence": sentence(result),
        "notes": list(notes(result)),
        "names": list(result.names),
        "parameters": [row(result, parameter) for parameter in result.parameters],
        "changes": [list(change) for change in result.changes],
        "method": METHOD,
        "files": [
            {"of": name, "name": file, "digest": digest}
            for name, fit in zip(result.names, result.fits, strict=True)
            for file, digest in fit.sources
        ],
        "version": f"accelcal {__version__}",
    }


METHOD = (
    "Difference: second less first. Uncertainties are expanded, coverage factor 2 (about 95 %); that of the difference "
    "is the root of the sum of squares. En is the difference over its expanded uncertainty; |En| ≤ 1 means agreement "
    "(ISO 13528, ISO/IEC 17043)."
)


def sentence(result: Agreement) -> str:
    """The verdict with its numbers."""
    several = len(result.compared)
    curve = result.characteristic
    if result.verdict == "not comparable":
        return "The two calibrations have no parameter and no range of acceleration in common."
    if result.verdict == "agree":
        parts = []
        if several:
            largest = max(result.compared, key=lambda parameter: abs(parameter.en or 0.0))
            parts.append(
                f"in {counted(several)} of the sensor (largest |En| {ratio(abs(largest.en or 0.0))}, "
                f"{spelled(largest.name)})"
            )
        if curve is not None:
            parts.append(f"in the characteristic (largest |En| {ratio(abs(float(curve.en[curve.worst])))})")
        return f"The two calibrations agree {' and '.join(parts)}."
    parts = [f"{spelled(parameter.name)} (En {ratio(parameter.en or 0.0)})" for parameter in result.differing]
    if curve is not None and abs(float(curve.en[curve.worst])) > LIMIT:
        i = curve.worst
        size, where = about("m/s²", float(curve.difference[i])), number(float(curve.a[i]), 3)
        parts.append(f"the characteristic (by {size} at {where} m/s², En {ratio(float(curve.en[i]))})")
    return f"The two calibrations differ in {' and '.join(parts)}."


def ratio(en: float) -> str:
    """En with two decimals, one from 10 on.

    Examples
    --------
    >>> ratio(-0.741), ratio(20.13), ratio(-0.0003)
    ('−0.74', '20.1', '0.00')
    """
    return f"{round(en, 2) + 0.0:.{1 if abs(en) >= 10.0 else 2}f}".replace("-", "−")


def counted(several: int) -> str:
    """A number of parameters."""
    return "the one common parameter" if several == 1 else f"all {several} common parameters"


def notes(result: Agreement) -> Iterator[str]:
    """What must be read with the verdict."""
    first, second = result.fits
    serials = [fit.rig.sensor.serial for fit in result.fits]
    if all(serials) and serials[0] != serials[1]:
        yield f"The serial numbers differ ({serials[0]} and {serials[1]}): these are two sensors."
    if result.shared:
        yield (
            f"Both fits have used {', '.join(result.shared)}: the results are not independent, and En is no test of "
            "agreement."
        )
    lacking = [
        f"{spelled(parameter.name)} (only in {result.names[0] if parameter.first is not None else result.names[1]})"
        for parameter in result.only_in_one
    ]
    if lacking:
        yield (
            f"The models differ: {', '.join(lacking)}. Coefficients of different models are not directly comparable; "
            "the characteristics are."
        )
    if result.characteristic is None:
        yield "The ranges of acceleration do not overlap: the characteristics are not compared."
    if len(result.compared) > 1:
        some = 100.0 * (1.0 - (1.0 - BEYOND_BY_CHANCE) ** len(result.compared))
        yield (
            f"Where nothing has changed, at least one of {len(result.compared)} parameters exceeds |En| = 1 in "
            f"{some:.0f} % of comparisons."
        )
    for name, fit in zip(result.names, (first, second), strict=True):
        yield from undeclared(name, fit)


def undeclared(name: str, fit: Fit) -> Iterator[str]:
    """Contributions that the uncertainties of a calibration lack."""
    missing = [spelled(key.removeprefix("uncertainty.")) for key in budget(fit).missing]
    if missing:
        yield f"The uncertainties of {name} are those of the data alone; not declared: {', '.join(missing)}."


def row(result: Agreement, parameter: ComparedParameter) -> dict[str, Any]:
    """One line of the table of parameters."""
    return {
        "name": spelled(parameter.name),
        "symbol": parameter.symbol,
        "owner": parameter.owner,
        "first": value(parameter.first, parameter.expanded[0]),
        "second": value(parameter.second, parameter.expanded[1]),
        "difference": ""
        if parameter.difference is None
        else plain(parameter.unit, parameter.difference, parameter.joint or 0.0),
        "en": "" if parameter.en is None else ratio(parameter.en),
        "apart": parameter in result.differing,
    }


def value(e: Estimate | None, expanded: float) -> str:
    """One value with its expanded uncertainty."""
    if e is None:
        return "not in the model"
    return plain(e.unit, e.value, expanded) if expanded > 0.0 else f"{plain(e.unit, e.value, 0.0)} (held)"


def agreement_html(result: Agreement) -> str:
    """Return the page.

    Parameters
    ----------
    result : from `accelcal.calibration.agreement.agreement`.

    Raises
    ------
    MissingExtra
        If matplotlib or jinja2 is not installed.
    """
    figure = agreement(result)
    images: dict[str, str] = {theme: svg_url(matplotlib.draw(figure, theme)) for theme in THEMES}
    return filled("agreement.html", v=agreement_view(result), **images)


def agreement_pdf(result: Agreement, path: str | Path) -> None:
    """Write it as PDF, whole or not at all.

    Parameters
    ----------
    result : from `accelcal.calibration.agreement.agreement`.
    path : file to write.

    Raises
    ------
    MissingExtra
        If typst or matplotlib is not installed.
    """
    figures = {"agreement.svg": matplotlib.svg(matplotlib.draw(agreement(result)))}
    atomic_write(path, typeset("agreement.typ", agreement_view(result), figures))
