"""The report as PDF: the texts and static figures of the page, typeset by typst."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from accelcal._support.extras import MissingExtra
from accelcal._support.scratch import scratch_folder
from accelcal.io import atomic_write
from accelcal.report.content import Content
from accelcal.report.figures import entries
from accelcal.report.page import svg
from accelcal.report.view import view
from accelcal.serialization.json_text import dumps


def pdf(content: Content, path: str | Path) -> None:
    """Write the report as PDF, whole or not at all.

    Parameters
    ----------
    content : from `accelcal.report.gather`.
    path : file to write.

    Raises
    ------
    MissingExtra
        If typst or matplotlib is not installed.
    """
    try:
        import typst
    except ImportError as error:
        raise MissingExtra('a PDF needs typst; install it with: pip install "accelcal[pdf]"') from error
    with scratch_folder() as root:
        figures = []
        for e in entries(content):
            if e.static is not None:
                (root / f"{e.name}.svg").write_bytes(svg(e.static("light")))
                figures.append({"file": f"{e.name}.svg", "section": e.section, "caption": e.caption})
        (root / "report.json").write_text(dumps({**view(content), "figures": figures}), encoding="utf-8")
        source = resources.files("accelcal.report").joinpath("paper.typ").read_text(encoding="utf-8")
        (root / "paper.typ").write_text(source, encoding="utf-8")
        made = typst.compile(str(root / "paper.typ"), root=str(root))
    atomic_write(path, made)
