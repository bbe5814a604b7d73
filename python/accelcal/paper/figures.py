"""Fig. 3 of the paper, output against acceleration, and Figs. 4 and 5, parameter estimates over time with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from accelcal.estimation.estimate import Fit
from accelcal.plots import matplotlib
from accelcal.plots.figure import Axis, Band, Figure, Level, Line, Mark, Panel
from accelcal.plots.model import nonlinearity
from accelcal.plots.style import Role

if TYPE_CHECKING:
    from accelcal.paper.tracks import ParameterTrack, Tracks

UNITS = {"k": "1", "K0": "m/s²", "K2": "(m/s²)⁻¹", "K3": "(m/s²)⁻²"}
_ROLES: tuple[Role, ...] = ("band", "model")
"""Of the filters; the first is drawn below the others."""
_SPAN = 8.0
"""Half height of a panel, in standard deviations at a fifth of the record."""


def draw_mapping(fit: Fit, out: Path) -> Path:
    """Writes Fig. 3 as PNG.

    Parameters
    ----------
    fit : of a curved sensor.
    out : Path
        Directory; created if absent.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "figure3.png"
    matplotlib.save(matplotlib.draw(nonlinearity(fit)), path)
    return path


def draw_tracks(tracks: Tracks, out: Path) -> tuple[Path, ...]:
    """Writes both figures as PNG.

    Parameters
    ----------
    tracks : Tracks
    out : Path
        Directory; created if absent.

    Returns
    -------
    tuple of Path
        The files.
    """
    out.mkdir(parents=True, exist_ok=True)
    drawn = {
        "figure4.png": _figure(tracks.linear, "Linear model: scale factor and bias"),
        "figure5.png": _figure(tracks.cubic, "Cubic model: scale factor, bias and nonlinear coefficients"),
    }
    for name, figure in drawn.items():
        matplotlib.save(matplotlib.draw(figure), out / name)
    return tuple(out / name for name in drawn)


def _figure(tracks: Sequence[ParameterTrack], headline: str) -> Figure:
    """Estimates of every filter with two standard deviations about the truth, and the motion under them."""
    time, panels = Axis("time", "s", range=(0.0, max(float(track.t[-1]) for track in tracks))), []
    for i, name in enumerate(tracks[0].names):
        truth, marks = float(tracks[0].truth[i]), list[Mark]()
        for track, role in zip(reversed(tracks), _ROLES, strict=True):
            estimate, reach = track.estimates[:, i], 2.0 * track.sigmas[:, i]
            said = f"{track.title}, ±2 sigma"
            marks += [
                Band(track.t, estimate - reach, estimate + reach, role=role, outlined=False),
                Line(track.t, estimate, said, role, solid=True),
            ]
        half = _SPAN * max(track.sigmas[len(track.t) // 5, i] for track in tracks)
        size = Axis(name, UNITS[name], range=(truth - half, truth + half))
        panels.append(Panel((*marks, Level(truth, name="truth")), time, size, height=160.0))
    motion = Line(tracks[0].t, tracks[0].motion, role="ink", opacity=0.5)
    panels.append(Panel((motion,), time, Axis("mean a²", "1", range=(0.0, 1.05)), height=160.0))
    return Figure(tuple(panels), headline, shared_x=True)
