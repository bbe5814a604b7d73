"""A record at rest throughout: recognised from the signals, before any fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from accelcal.diagnosis.policy import RELATION_LEAST_BLOCKS, REST_LOG_LIKELIHOOD, REST_NOISE_RATIO
from accelcal.diagnosis.relation import BANDS_PER_DECADE, MOST_BLOCKS, RelationColumns, unexplained
from accelcal.estimation.estimate import require_motion
from accelcal.estimation.gauss_newton import NotIdentifiable
from accelcal.estimation.run import PreparedRun


def require_motion_above_noise(runs: Sequence[PreparedRun]) -> None:
    """Refuse runs of which none shows a motion above the noise.

    Raises
    ------
    NotIdentifiable
        With the departure from a resting position, and the noise that it does not exceed.
    """
    if not all(at_rest(run) for run in runs):
        return
    run = runs[0]
    require_motion(run)
    raise NotIdentifiable(
        f"{run.recording.name or 'recording'}: at rest throughout: position departs from a steady drift by "
        f"{1e6 * departure(run):.3g} um rms, its own noise, and the output explains none of it; acceleration was not "
        "excited, so scale_factor and time_offset cannot be estimated. Record a run in which the stage moves"
    )


def at_rest(run: PreparedRun) -> bool:
    """Whether the readings are noise about a steady drift, and the output explains none of it.

    The second condition keeps a vibration that is smaller than the noise of a reading but that the output sees.
    """
    noise = float(np.sqrt(run.reading_variance_guess))
    return departure(run) <= REST_NOISE_RATIO * noise and not explained(run)


def departure(run: PreparedRun) -> float:
    """Root mean square departure of the readings from constant acceleration, m: what bias cannot be told from."""
    x = run.t - run.t[0]
    fitted = np.polynomial.Polynomial.fit(x, run.z, 2)
    return float(np.sqrt(np.mean((run.z - fitted(x)) ** 2)))


def explained(run: PreparedRun) -> bool:
    """Whether output and encoder are related in any band: gain of log-likelihood over a constant acceleration alone.

    Each period of a band counts as one independent sample.
    """
    columns = RelationColumns(run)
    top = 0.5 / run.reading_step  # readings may be slower than the motion
    lowest = RELATION_LEAST_BLOCKS / float(run.t[-1] - run.t[0])
    if lowest >= top:
        return False
    count = max(2, int(np.ceil(BANDS_PER_DECADE * np.log10(top / lowest))) + 1)
    for band in np.geomspace(top, lowest, count):
        gram, _ = columns.in_band(float(band)).blocks(MOST_BLOCKS)
        if len(gram) < 2:
            continue
        share = float(unexplained(gram.sum(axis=0, keepdims=True))[1][0])
        periods = float(band) * float(run.t[-1] - run.t[0])
        if -0.5 * periods * np.log1p(-min(share, 1.0 - 1e-15)) > REST_LOG_LIKELIHOOD:
            return True
    return False
