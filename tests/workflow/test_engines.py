"""`method=` names an engine: the replay, the weak form, or a live filter over a record."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import accelcal as ac
from accelcal.estimation.recursive import fit_recursive
from accelcal.simulation.sensor import CXL02_RIG, Simulated


@pytest.fixture(scope="module")
def simulated() -> Simulated:
    truth = {"bias": 0.05, "scale_factor": 0.01}
    rng = np.random.default_rng(36)
    return ac.simulate("interleaved", seconds=12.0, rig=CXL02_RIG, parameters=truth, rng=rng)


@pytest.mark.parametrize(
    ("method", "engine"), [("replay", "replay"), ("weak", "weak"), (ac.FilterChoice("aci", "linear"), "replay")]
)
def test_every_engine_estimates_the_truth(simulated: Simulated, method: Any, engine: str) -> None:
    # five standard deviations: false-alarm rate 6e-7 an estimate; zero is further away than that
    fit = ac.fit(simulated.recording, method=method)
    assert fit.engine == engine
    for name, true in (("bias", 0.05), ("scale_factor", 0.01)):
        assert abs(fit[name].value - true) < 5.0 * fit[name].std < abs(fit[name].value)


def test_a_live_filter_is_an_engine_of_fit(simulated: Simulated) -> None:
    choice = ac.FilterChoice("aci", "linear")
    fit, other = ac.fit(simulated.recording, method=choice), fit_recursive(choice, simulated.recording)[0]
    assert [(e.name, e.value, e.std) for e in fit.estimates] == [(e.name, e.value, e.std) for e in other.estimates]


def test_a_live_filter_refuses_what_it_cannot_use(simulated: Simulated) -> None:
    choice = ac.FilterChoice("aci", "linear")
    for wrong in ({"band": 5.0}, {"model": ac.Model.linear()}):
        with pytest.raises(ac.AccelcalError, match="leave out model, band and origins"):
            ac.fit(simulated.recording, method=choice, **wrong)
    with pytest.raises(ac.AccelcalError, match="fits one recording"):
        ac.fit([simulated.recording, simulated.recording], method=choice)
