"""The report on two calibrations: one HTML page without script, and the same as PDF."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from accelcal.calibration.agreement import Agreement
from accelcal.io import atomic_write
from accelcal.plots import matplotlib
from accelcal.plots.model import agreement
from accelcal.plots.style import THEMES
from accelcal.report.agreement_view import agreement_view
from accelcal.report.page import environment, svg_url
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
    figure = agreement(found)
    images: dict[str, str] = {theme: svg_url(matplotlib.draw(figure, theme)) for theme in THEMES}
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
    figures = {"agreement.svg": matplotlib.svg(matplotlib.draw(agreement(found)))}
    atomic_write(path, typeset("agreement.typ", agreement_view(found), figures))
