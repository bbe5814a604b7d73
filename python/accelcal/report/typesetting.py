"""From texts and figures to a PDF: typst with the templates of this folder, in the typeface of the figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from accelcal._support.errors import MissingExtra
from accelcal._support.locks import scratch_folder
from accelcal.results.json_text import dumps

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
