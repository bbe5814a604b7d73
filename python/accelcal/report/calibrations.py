"""Texts and numbers of a report on two calibrations, printed by both HTML page and PDF."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

from accelcal._core import __version__
from accelcal.calibration.agreement import BEYOND_BY_CHANCE, LIMIT, Agreement, ComparedParameter
from accelcal.calibration.characteristic import budget
from accelcal.effects import spelled
from accelcal.estimation.estimate import Fit
from accelcal.io import atomic_write
from accelcal.model import Estimate
from accelcal.plots import matplotlib
from accelcal.plots.figure import THEMES
from accelcal.plots.model import agreement
from accelcal.report.page import environment, svg_url, typeset
from accelcal.results.words import about, number, plain

BADGES = {
    "agree": "the calibrations agree",
    "differ": "the calibrations differ",
    "not comparable": "not comparable",
}


def agreement_view(found: Agreement) -> dict[str, Any]:
    """Everything that is printed, by section."""
    first, second = found.names
    return {
        "title": f"Comparison of two calibrations: {first} and {second}",
        "verdict": {"agree": "adequate"}.get(found.verdict, found.verdict),
        "badge": BADGES[found.verdict],
        "sentence": sentence(found),
        "notes": list(notes(found)),
        "names": list(found.names),
        "parameters": [row(found, one) for one in found.parameters],
        "changes": [list(change) for change in found.changes],
        "method": METHOD,
        "files": [
            {"of": name, "name": file, "digest": digest}
            for name, fit in zip(found.names, found.fits, strict=True)
            for file, digest in fit.sources
        ],
        "version": f"accelcal {__version__}",
    }


METHOD = (
    "Difference: second less first. Uncertainties are expanded, coverage factor 2 (about 95 %); that of the difference "
    "is the root of the sum of squares. En is the difference over its expanded uncertainty; |En| ≤ 1 means agreement "
    "(ISO 13528, ISO/IEC 17043)."
)


def sentence(found: Agreement) -> str:
    """The verdict with its numbers."""
    several = len(found.compared)
    curve = found.characteristic
    if found.verdict == "not comparable":
        return "The two calibrations have no parameter and no range of acceleration in common."
    if found.verdict == "agree":
        parts = []
        if several:
            largest = max(found.compared, key=lambda one: abs(one.en or 0.0))
            parts.append(
                f"in {counted(several)} of the sensor (largest |En| {ratio(abs(largest.en or 0.0))}, "
                f"{spelled(largest.name)})"
            )
        if curve is not None:
            parts.append(f"in the characteristic (largest |En| {ratio(abs(float(curve.en[curve.worst])))})")
        return f"The two calibrations agree {' and '.join(parts)}."
    parts = [f"{spelled(one.name)} (En {ratio(one.en or 0.0)})" for one in found.differing]
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


def notes(found: Agreement) -> Iterator[str]:
    """What must be read with the verdict."""
    first, second = found.fits
    serials = [fit.rig.sensor.serial for fit in found.fits]
    if all(serials) and serials[0] != serials[1]:
        yield f"The serial numbers differ ({serials[0]} and {serials[1]}): these are two sensors."
    if found.shared:
        yield (
            f"Both fits have used {', '.join(found.shared)}: the results are not independent, and En is no test of "
            "agreement."
        )
    lacking = [
        f"{spelled(one.name)} (only in {found.names[0] if one.first is not None else found.names[1]})"
        for one in found.only_in_one
    ]
    if lacking:
        yield (
            f"The models differ: {', '.join(lacking)}. Coefficients of different models are not directly comparable; "
            "the characteristics are."
        )
    if found.characteristic is None:
        yield "The ranges of acceleration do not overlap: the characteristics are not compared."
    if len(found.compared) > 1:
        some = 100.0 * (1.0 - (1.0 - BEYOND_BY_CHANCE) ** len(found.compared))
        yield (
            f"Where nothing has changed, at least one of {len(found.compared)} parameters exceeds |En| = 1 in "
            f"{some:.0f} % of comparisons."
        )
    for name, fit in zip(found.names, (first, second), strict=True):
        yield from undeclared(name, fit)


def undeclared(name: str, fit: Fit) -> Iterator[str]:
    """Contributions that the uncertainties of a calibration lack."""
    missing = [spelled(key.removeprefix("uncertainty.")) for key in budget(fit).missing]
    if missing:
        yield f"The uncertainties of {name} are those of the data alone; not declared: {', '.join(missing)}."


def row(found: Agreement, one: ComparedParameter) -> dict[str, Any]:
    """One line of the table of parameters."""
    return {
        "name": spelled(one.name),
        "symbol": one.symbol,
        "owner": one.owner,
        "first": value(one.first, one.expanded[0]),
        "second": value(one.second, one.expanded[1]),
        "difference": "" if one.difference is None else plain(one.unit, one.difference, one.joint or 0.0),
        "en": "" if one.en is None else ratio(one.en),
        "apart": one in found.differing,
    }


def value(e: Estimate | None, expanded: float) -> str:
    """One value with its expanded uncertainty."""
    if e is None:
        return "not in the model"
    return plain(e.unit, e.value, expanded) if expanded > 0.0 else f"{plain(e.unit, e.value, 0.0)} (held)"


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
