"""Fig. 3 of the paper, output against acceleration, and Figs. 4 and 5, parameter estimates over time with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from accelcal.estimation.estimate import Fit
from accelcal.io import atomic
from accelcal.plots import nonlinearity, style

if TYPE_CHECKING:
    from accelcal.paper.tracks import ParameterTrack, Tracks

UNITS = {"k": "1", "K0": "m/s²", "K2": "(m/s²)⁻¹", "K3": "(m/s²)⁻²"}
_STYLES = (("tab:orange", 2.0), ("tab:blue", 1.0))
"""Colour and line width; the first is drawn below the others."""
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
    style.save(nonlinearity(fit), path)
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
    return (
        _figure(tracks.linear, out / "figure4.png", "Linear model: scale factor and bias"),
        _figure(tracks.cubic, out / "figure5.png", "Cubic model: scale factor, bias and nonlinear coefficients"),
    )


def _figure(tracks: Sequence[ParameterTrack], path: Path, title: str) -> Path:
    from matplotlib.figure import Figure

    names = tracks[0].names
    figure = Figure(figsize=(9.0, 2.1 * (len(names) + 1)), layout="constrained")
    axes = figure.subplots(len(names) + 1, 1, sharex=True)
    for i, (axis, name) in enumerate(zip(axes, names, strict=False)):
        for track, (colour, width) in zip(reversed(tracks), _STYLES, strict=True):
            estimate, sigma = track.estimates[:, i], track.sigmas[:, i]
            axis.fill_between(track.t, estimate - 2 * sigma, estimate + 2 * sigma, color=colour, alpha=0.2, linewidth=0)
            axis.plot(track.t, estimate, color=colour, linewidth=width, label=f"{track.title}, ±2 sigma")
        truth = tracks[0].truth[i]
        axis.axhline(truth, color="black", linewidth=0.8, linestyle="--", label="truth")
        half = _SPAN * max(track.sigmas[len(track.t) // 5, i] for track in tracks)
        axis.set_ylim(truth - half, truth + half)
        axis.set_ylabel(f"{name}  [{UNITS[name]}]")
        axis.grid(alpha=0.3)
    axes[0].legend(loc="upper right", fontsize="small", ncols=3)
    axes[0].set_title(title)
    axes[-1].plot(tracks[0].t, tracks[0].motion, color="gray", linewidth=0.5)
    axes[-1].set_ylabel("mean a²  [1]")
    axes[-1].set_ylim(0.0, 1.05)
    axes[-1].set_xlabel("time  [s]")
    axes[-1].set_xlim(0.0, float(np.max(tracks[0].t)))
    with atomic(path) as part:
        figure.savefig(part, format=path.suffix.removeprefix("."), dpi=120)
    return path
