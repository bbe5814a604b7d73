"""The accelerometer-side residual takes effects at the smoothed motion: the causal filter knows a reversal too late."""

import numpy as np
import pytest

import accelcal as ac
from accelcal.validation import evaluation
from accelcal.validation.noise_floor import Ruler
from accelcal.validation.prediction import Prediction
from tests.worlds import Hidden, Nuisances, World

SLACK = -1.4e-6


def test_with_the_hidden_slack_the_residual_of_another_record_falls(tmp_path, monkeypatch):
    world = World("long_rest", "ADXL105", (Hidden("encoder_backlash", SLACK),), seed=5, nuisances=Nuisances())
    train = ac.load(world.record().write(tmp_path))
    unseen = ac.load(world.again(world.motion, 6).record().write(tmp_path, "unseen"))
    base = ac.fit(train)
    added = ac.add(base, train, "encoder_backlash")
    assert added["encoder_backlash"].value == pytest.approx(SLACK, rel=0.3)
    ruler = Ruler.of([base, added])
    before, after = (error.accel_rms for error in ac.compare([base, added], unseen))
    print(f"residual without the slack {before:.5g}, with it {after:.5g} m/s²")
    assert after < 0.999 * before
    # the twin: at the motion of the causal filter the slack is crossed late, which doubles the jumps
    ahead = Prediction.of(ruler.held_by(added), unseen)
    monkeypatch.setattr(evaluation, "smoothed_drive", lambda ahead: ahead.drive)
    late = float(np.sqrt(np.mean(evaluation.accel_residual(ahead, ahead.crossover)[1] ** 2)))
    assert late > before
