"""Several recordings: the one whose scale factor differs is said, and equal ones are not."""

from __future__ import annotations

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Recording
from accelcal.simulation import ADXL105_RIG


def runs(scales: tuple[float, ...]) -> list[Recording]:
    """Recordings of one sensor whose scale factor may change between them."""
    return [
        ac.simulate(
            "tones",
            seconds=12.0,
            rig=ADXL105_RIG,
            parameters={"bias": 0.05, "scale_factor": scale},
            rng=np.random.default_rng(40 + number),
        ).recording
        for number, scale in enumerate(scales)
    ]


@pytest.mark.parametrize("departs", [True, False])
def test_the_recording_that_disagrees_is_said(departs: bool) -> None:
    fit = ac.fit(runs((0.01, 0.02 if departs else 0.01, 0.01)))
    messages = [remark.sentence for remark in fit.remarks if remark.code == "runs_disagree"]
    assert bool(messages) == departs
    if departs:
        assert "scale_factor" in messages[0]
        assert "cannot be distinguished" in messages[0]
