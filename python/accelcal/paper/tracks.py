"""Figs. 4 and 5: parameter estimates over time with their 2-sigma bands (paper III-B)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from accelcal.data.arrays import Array
from accelcal.filters.choice import FilterChoice
from accelcal.paper.rows import SIGMAS, Item, Plan, Row
from accelcal.paper.tuning import ACI, CWPA, PLAIN_ADXL105, filtered, label, motion_states, prior_sigmas, start, tuned
from accelcal.simulation.motion import Motion
from accelcal.simulation.sensor import simulate

LINEAR_SENSOR = {"bias": 0.05, "scale_factor": 0.01}
CUBIC_SENSOR = {**LINEAR_SENSOR, "quadratic": -1e-3, "cubic": 1e-4}
"""An ADXL105 with the nonlinearity of a 1 %FS part, so that Fig. 5 has something to show."""
STATE_NAMES = {"k": "scale_factor", "K0": "bias", "K2": "quadratic", "K3": "cubic"}
_POINTS = 2000
"""Points drawn per curve."""


@dataclass(frozen=True, slots=True)
class ParameterTrack:
    """One filter's parameters over one record, thinned for drawing."""

    title: str
    t: Array
    """(n,) s."""
    names: tuple[str, ...]
    """(m,) k, K0[, K2, K3]."""
    estimates: Array
    """(n, m) SI."""
    sigmas: Array
    """(n, m) SI."""
    truth: Array
    """(m,) SI."""
    motion: Array
    """(n,) squared acceleration, mean over 1 s, over its largest value."""
    final_deviates: Array
    """(m,) last error over its sigma."""


@dataclass(frozen=True, slots=True)
class Tracks:
    """What Figs. 4 and 5 are drawn from."""

    linear: tuple[ParameterTrack, ...]
    """Fig. 4: ACI and CWPA."""
    cubic: tuple[ParameterTrack, ...]
    """Fig. 5: ACI and CWPA."""


def tracks_item(plan: Plan) -> tuple[Item, Tracks]:
    """Both figures and whether their bands end on the truth."""
    linear = parameter_tracks(plan, "linear", LINEAR_SENSOR, 130.0)
    cubic = parameter_tracks(plan, "cubic", CUBIC_SENSOR, 250.0)
    rows = tuple(_row(figure, track) for figure, tracks in (("Fig. 4", linear), ("Fig. 5", cubic)) for track in tracks)
    item = Item(
        name="tracks",
        title="Parameter tracks with 2-sigma bands, simulated ADXL105 without low-pass",
        source="III-B, Figs. 4 and 5",
        rows=rows,
    )
    return item, Tracks(linear, cubic)


def parameter_tracks(
    plan: Plan, model: Literal["linear", "cubic"], sensor: Mapping[str, float], seconds: float
) -> tuple[ParameterTrack, ...]:
    """ACI and CWPA of one sensor model on the same record of `sensor`."""
    names = ("k", "K0") if model == "linear" else ("k", "K0", "K2", "K3")
    rng = plan.repeat(f"tracks {model}", 1, lambda rng: rng)[0]
    simulated = simulate(
        "bursts", seconds=seconds, rig=PLAIN_ADXL105, parameters=sensor, rng=rng, a_rms=4.0, position_noise=0.0
    )
    noise = tuned(simulated.truth, PLAIN_ADXL105)
    truth = np.array([sensor[STATE_NAMES[name]] for name in names])

    def track(choice: FilterChoice) -> ParameterTrack:
        run = filtered(choice, simulated.recording, noise, start(choice, simulated.truth), prior_sigmas(choice))
        drawn = np.arange(0, len(run.times), max(1, len(run.times) // _POINTS))
        block = slice(motion_states(choice), None)
        squared = _mean_square(simulated.truth.motion, run.times[drawn])
        return ParameterTrack(
            title=label(choice),
            t=run.times[drawn],
            names=names,
            estimates=run.states[drawn, block],
            sigmas=np.sqrt(run.variances[drawn, block]),
            truth=truth,
            motion=squared / np.max(squared),
            final_deviates=(run.states[-1, block] - truth) / np.sqrt(run.variances[-1, block]),
        )

    # a straight line between samples would cost ACI (w dt)²/12 of the scale factor, 3e-4 at 15 Hz: outside its band
    return track(replace(ACI, model=model, interpolation="cubic")), track(replace(CWPA, model=model))


def _mean_square(motion: Motion, t: Array) -> Array:
    """Squared acceleration over the second around each t (n,) s; (m/s²)²."""
    window = np.linspace(-0.5, 0.5, 101)
    return np.asarray(np.mean([motion.acceleration(t + offset) ** 2 for offset in window], axis=0))


def _row(figure: str, track: ParameterTrack) -> Row:
    worst = float(np.max(np.abs(track.final_deviates)))
    ends = ", ".join(
        f"{name} {estimate:.4g} ± {2 * sigma:.1g}"
        for name, estimate, sigma in zip(track.names, track.estimates[-1], track.sigmas[-1], strict=True)
    )
    return Row(
        by="us",
        claim=f"{figure}, {track.title}: the bands end on the truth",
        expected=", ".join(f"{name} {value:g}" for name, value in zip(track.names, track.truth, strict=True)),
        measured=ends,
        value=worst,
        n=1,
        threshold=f"each within {SIGMAS:.2f} sigma (worst is {worst:.2f})",
        holds=worst < SIGMAS,
    )
