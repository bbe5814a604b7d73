"""Clocks that drift apart are read exactly: their delay grows to where a column of the jerk no longer describes it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import accelcal as ac
from accelcal.estimation.values import Values
from tests.regimes.regimes import CXL02, TABLE
from tests.regimes.rig import Clocks, Rig

SKEW = 3e-4


def test_stamps_and_instants_are_inverse() -> None:
    values = Values({"time_offset": 2e-3, "clock_skew": SKEW})
    t = 1e3 + np.linspace(0.0, 60.0, 7)
    np.testing.assert_allclose(values.instants(values.stamps(t, 1e3), 1e3), t, rtol=0, atol=1e-12)
    np.testing.assert_allclose(values.stamps(t, 1e3) - t, 2e-3 + SKEW * (t - 1e3), rtol=0, atol=1e-12)
    plain = Values({"time_offset": 2e-3})
    np.testing.assert_array_equal(plain.stamps(t, 1e3), t + 2e-3)


def test_a_skew_of_milliseconds_leaves_scale_and_offset_right(tmp_path: Path) -> None:
    rig = Rig(CXL02, clocks=Clocks(skew=SKEW))
    record = replace(TABLE["s-skew"], profile="random", rig=rig, seconds=12.0).build(4)
    recording = ac.load(record.write(tmp_path))
    fit = ac.fit(recording, ac.Model.linear().add("clock_skew"))
    truth = {**record.truth, "clock_skew": SKEW}
    for name, true in truth.items():
        assert abs(fit[name].value - true) < 4.0 * fit[name].std, name
    assert fit["clock_skew"].std < 0.02 * SKEW
    # The twin: to the one who knows of no skew, the offset is another.
    plain = ac.fit(recording)
    assert abs(plain["time_offset"].value - truth["time_offset"]) > 20.0 * plain["time_offset"].std


def test_a_clock_that_counts_from_1970_estimates_what_one_from_zero_does():
    """The step of numpy.arange from such a stamp on is off by 5e-5: K2 was, by 8 standard deviations."""
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 20.0, 2e-3)
    angles = [2.0 * np.pi * f * t + phase for f, phase in ((1.3, 0.0), (7.1, 1.0), (11.3, 2.0))]
    a = sum(2.0 * np.sin(angle) for angle in angles)
    p = sum(-2.0 / (2.0 * np.pi * f) ** 2 * np.sin(angle) for f, angle in zip((1.3, 7.1, 11.3), angles, strict=True))
    output = 0.1 + 1.01 * a + 5e-3 * a**2 + 3e-3 * rng.standard_normal(len(t))
    position = p + 3e-7 * rng.standard_normal(len(t))
    units = {"t": "s", "accel": "m/s^2", "position": "m"}
    fits = [
        ac.fit(ac.Recording.from_arrays(t + start, output, position, units=units), ac.Model.linear().add("quadratic"))
        for start in (0.0, 1.7e9)
    ]
    for name in ("bias", "scale_factor", "quadratic", "time_offset"):
        assert abs(fits[1][name].value - fits[0][name].value) < 0.1 * fits[0][name].std
