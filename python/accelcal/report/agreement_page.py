"""The report on two calibrations: one HTML page without script, and the same as PDF."""

from __future__ import annotations

import base64
from importlib import resources
from pathlib import Path

from accelcal.calibration.agreement import Agreement
from accelcal.io import atomic_write
from accelcal.plots.static.agreement import agreement as draw
from accelcal.plots.style import THEMES, ThemeName
from accelcal.report.agreement_view import agreement_view
from accelcal.report.page import environment, svg
from accelcal.report.typesetting import typeset


def agreement_html(found: Agreement) -> str:
    """Return the page.

    Parameters
    ----------
    found : from `accelcal.calibration.agreement.agreement`.

    Raises
    ------
    MissingExtra
        If matplotlib or jinja2 is not installed.
    """
    folder = resources.files("accelcal.report")
    template = environment().from_string(folder.joinpath("agreement.html").read_text(encoding="utf-8"))
    style = folder.joinpath("page.css").read_text(encoding="utf-8")
    images: dict[str, str] = {theme: _image(found, theme) for theme in THEMES}
    return template.render(v=agreement_view(found), style=style, **images)


def agreement_pdf(found: Agreement, path: str | Path) -> None:
    """Write it as PDF, whole or not at all.

    Parameters
    ----------
    found : from `accelcal.calibration.agreement.agreement`.
    path : file to write.

    Raises
    ------
    MissingExtra
        If typst or matplotlib is not installed.
    """
    figures = {"agreement.svg": svg(draw(found, theme="light"))}
    atomic_write(path, typeset("agreement.typ", agreement_view(found), figures))


def _image(found: Agreement, theme: ThemeName) -> str:
    """The figure as a URL."""
    return f"data:image/svg+xml;base64,{base64.b64encode(svg(draw(found, theme=theme))).decode()}"
