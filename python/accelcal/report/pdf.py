"""The report as PDF: the texts and static figures of the page, typeset by typst."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from accelcal.io import atomic_write
from accelcal.plots import matplotlib
from accelcal.report.content import Content
from accelcal.report.figures import entries
from accelcal.report.typesetting import typeset
from accelcal.report.view import view


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
