"""`method=` names an engine: the replay, the weak form, or a live filter over a record."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

import accelcal as ac
from accelcal.estimation.engines import ENGINES, ForwardFilter, Method, Replay
from accelcal.estimation.estimate import estimate, solve_runs
from accelcal.estimation.run import PreparedRun
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
    assert fit.engine.name == engine
    for name, true in (("bias", 0.05), ("scale_factor", 0.01)):
        assert abs(fit[name].value - true) < 5.0 * fit[name].std < abs(fit[name].value)


@pytest.mark.parametrize(
    "method", ["replay", "weak", *(ac.FilterChoice(system, "linear") for system in ("aci", "cwpa"))], ids=str
)
def test_no_engine_asks_where_a_scale_or_a_clock_has_its_zero(simulated: Simulated, method: Any) -> None:
    """A thousandth of a standard deviation; a filter that began at another zero would take a meter for a motion."""
    here = simulated.recording
    accel, position = (replace(channel, t=channel.t + 512.0) for channel in (here.accel, here.position))
    there = replace(here, accel=accel, position=replace(position, y=position.y + 2.0))
    fits = [ac.fit(recording, method=method) for recording in (here, there)]
    for name in ("bias", "scale_factor"):
        estimates = [fit[name] for fit in fits]
        assert estimates[1].value == pytest.approx(estimates[0].value, abs=1e-3 * estimates[0].std)
        assert estimates[1].std == pytest.approx(estimates[0].std, rel=1e-3)


def test_a_live_filter_is_an_engine_of_fit(simulated: Simulated) -> None:
    choice = ac.FilterChoice("aci", "linear")
    fit, replayed = (ac.fit(simulated.recording, method=method) for method in (choice, "replay"))
    state = solve_runs(ac.Model.linear(), [simulated.recording], engine=ENGINES["replay"]).states[0]
    rows = ForwardFilter(choice).over(replayed, state)
    for name, symbol in (
        ("scale_factor", "k"),
        ("bias", "K0"),
    ):  # level and normally mounted: the parameters themselves
        assert fit[name].value == pytest.approx(rows.estimate[symbol], rel=1e-12)
    assert fit["time_offset"].value == replayed["time_offset"].value


def test_every_name_of_method_is_a_row_of_the_engines() -> None:
    assert get_args(Method) == tuple(ENGINES)
    assert {ENGINES[engine.second].second for engine in ENGINES.values()} == {"replay", "weak"}


def test_a_further_engine_is_one_class_and_one_row(simulated: Simulated, monkeypatch: pytest.MonkeyPatch) -> None:
    class Sparse(Replay):
        """The replay of every second reading."""

        name = "sparse"

        def prepare(self, run: PreparedRun) -> PreparedRun:
            return replace(run, t=run.t[::2].copy(), z=run.z[::2].copy(), engine=self.name)

    monkeypatch.setitem(ENGINES, "sparse", Sparse())  # type: ignore[misc]
    fit = estimate(ac.Model.linear(), simulated.recording, method="sparse")  # type: ignore[arg-type]
    whole = estimate(ac.Model.linear(), simulated.recording)
    assert (fit.method, fit.engine.name) == ("sparse", "sparse")
    assert fit.runs[0].readings == (whole.runs[0].readings + 1) // 2
    assert abs(fit["bias"].value - 0.05) < 5.0 * fit["bias"].std


def test_a_live_filter_refuses_what_it_cannot_use(simulated: Simulated) -> None:
    choice = ac.FilterChoice("aci", "linear")
    for wrong in ({"band": 5.0}, {"model": ac.Model.linear()}):
        with pytest.raises(ac.AccelcalError, match="leave out model, band and origins"):
            ac.fit(simulated.recording, method=choice, **wrong)
    with pytest.raises(ac.AccelcalError, match="fits one recording"):
        ac.fit([simulated.recording, simulated.recording], method=choice)
