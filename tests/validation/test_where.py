"""Where a model fails: one row for each variable, p that holds for all regions together, and the time it is seen at."""

from __future__ import annotations

import io
import warnings
from contextlib import redirect_stdout
from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.cli.printing import show
from accelcal.results import comparisons
from accelcal.signals.signals import Signals
from accelcal.simulation import CXL02_RIG
from accelcal.validation import systematic
from accelcal.validation.comparison import Bins, Evaluation, Region
from accelcal.validation.regions import STRETCHES, largest_of, seen_at, variables_of, worst_regions, worst_sentence
from benches.regions import evaluation_of, false_regions

VARIABLES = ("time", "position", "velocity", "acceleration", "jerk", "time since reversal")


def bins_of(variable: str, score: np.ndarray, std: float = 1e-3) -> Bins:
    """Bins with these scores."""
    n = len(score)
    share = np.full(n, 1.0 / n)
    return Bins(variable, "m/s", np.linspace(-1.0, 1.0, n + 1), std * score, np.full(n, std), share=share)


def test_the_rate_of_a_coarse_temperature_is_that_of_its_ramp() -> None:
    # A thermometer of 0.1 K on a ramp of 0.2 K/s steps every half second; its samples are 10 ms apart.
    t = np.arange(0.0, 20.0, 0.01)
    zero = np.zeros_like(t)
    side = {"temperature": 0.1 * np.floor(2.0 * t)}
    rate, unit = variables_of(Signals(t, zero, zero, zero, zero, 1.0, CXL02_RIG, side=side))["temperature rate"]
    assert unit == "K/s"
    assert rate[100:-100] == pytest.approx(0.2, abs=0.051)  # a sample by itself: 0 or 10 K/s


def densities(rng: np.random.Generator, n: int = 12, freedom: int = 20) -> Bins:
    """Ratios of densities as noise alone gives them."""
    ratio = rng.chisquare(freedom, n) / freedom
    return Bins("frequency", "Hz", np.linspace(0.0, 10.0, n + 1), ratio, np.full(n, np.sqrt(2.0 / freedom)))


def test_p_counts_every_region_that_was_looked_at() -> None:
    # 2000 records of noise alone, 84 regions each: the least p falls below 5 % in 5 % of them; 3.5 to 6 % is 3 sigma.
    rng, alarms, cases = np.random.default_rng(3), 0, 2000
    for _ in range(cases):
        bins = [*(bins_of(name, rng.standard_normal(12)) for name in VARIABLES), densities(rng)]
        alarms += min(region.p for region in worst_regions(bins, 1e-3)) < 0.05
    print(f"least adjusted p below 5 %: {alarms} of {cases}")
    assert 0.035 < alarms / cases < 0.06


def test_p_without_the_count_would_alarm() -> None:
    # The twin: the raw p value of the worst of 84 regions.
    rng, alarms = np.random.default_rng(4), 0
    for _ in range(200):
        bins = [bins_of(name, rng.standard_normal(12)) for name in (*VARIABLES, "temperature")]
        alarms += min(region.p for region in worst_regions(bins, 1e-3)) / 84.0 < 0.05
    assert alarms > 180


def test_the_worst_region_of_each_variable_is_a_row() -> None:
    score = np.zeros(12)
    score[7] = -9.0
    bins = [bins_of("velocity", np.full(12, 0.5)), bins_of("acceleration", score), bins_of("jerk", np.zeros(12), 0.0)]
    frequency = Bins("frequency", "Hz", np.linspace(0.0, 12.0, 13), np.full(12, 4.0), np.full(12, 0.1))
    rows = worst_regions([frequency, *bins], 2e-3)
    assert [row.variable for row in rows] == ["acceleration", "frequency", "velocity"]  # jerk has too little data
    first, spectrum, last = rows
    assert (first.low, first.high) == (pytest.approx(1.0 / 6.0), pytest.approx(1.0 / 3.0))
    assert first.excess == pytest.approx(-9e-3)
    assert first.share == pytest.approx((81.0 - 1.0) / 12.0 * 1e-6 / 4e-6)
    assert first.p == pytest.approx(36 * 2.257e-19, rel=1e-3)
    assert (spectrum.excess, spectrum.excess_unit, spectrum.share) == (2.0, "1", None)
    assert last.p == 1.0
    assert worst_sentence(rows, 36).startswith("acceleration between 0.1667 and 0.3333 m/s: mean residual -0.009 m/s²")
    assert worst_sentence((), 0) == "the record is too short to say where the model fails"


def test_a_region_is_seen_where_the_residual_is() -> None:
    t = np.arange(4000) * 0.01
    index = (np.arange(4000) // 5) % 2
    residual = np.zeros(4000)
    residual[1510:1520] = (3.0 * index - 1.0)[1510:1520]  # against bin 0 and along bin 1, between 15.1 and 15.2 s
    at = seen_at(t, residual, index, np.array([-1.0, 1.0, 0.5]))
    for begin, end in at[:2]:
        assert begin <= 15.1 < 15.19 <= end
        assert end - begin <= t[-1] / STRETCHES
    assert np.all(np.isnan(at[2]))  # nothing lies in it


def test_slow_noise_makes_no_region_and_a_cubic_beside_it_does() -> None:
    # Three honest records with 1/f noise and a random walk: one is named in 100. The twin names all.
    honest = [evaluation_of(number, 71, slow=True) for number in range(3)]
    print([evaluation.worst for evaluation in honest])
    assert sum(false_regions(evaluation)["named"] for evaluation in honest) == 0
    assert evaluation_of(0, 71, slow=True, error="cubic").worst_regions[0].variable == "acceleration"


def test_slow_noise_as_white_noise_makes_regions(monkeypatch: pytest.MonkeyPatch) -> None:
    # The twin: too few samples to measure the noise, so that it is that of the model.
    monkeypatch.setattr(systematic, "LEAST_SAMPLES", 10**9)
    assert sum(false_regions(evaluation_of(number, 71, slow=True))["named"] for number in range(2)) == 2


@pytest.mark.parametrize(("sigma", "named"), [(3.9, False), (4.1, True)])
def test_the_largest_mean_error_begins_at_zero_where_no_region_is_named(sigma: float, named: bool) -> None:
    # 3.9 sigma in one of twelve regions is 0.1 %: the interval of 95 % alone would not reach zero.
    score = np.zeros(12)
    score[3] = sigma
    several = [bins_of("velocity", score)]
    largest = largest_of(several, 1.0)
    assert largest is not None
    assert (largest[1].low > 0.0) == named
    assert (" between " in worst_sentence(worst_regions(several, 1e-2), 12)) == named


def test_no_region_is_seen_beside_holes() -> None:
    rng, t = np.random.default_rng(4), np.arange(6000) / 200.0
    w, a = 2.0 * np.pi * np.array([0.7, 1.3, 2.9]), np.array([1.0, 1.3, 2.0])
    waves = a * np.sin(np.outer(t, w))
    u = 0.05 + waves.sum(axis=1) + 1e-2 * rng.standard_normal(t.size)
    z = -(waves / w**2).sum(axis=1) + 1e-4 * rng.standard_normal(t.size)
    rig = ac.Rig(ac.Sensor(noise=1e-3))

    def of(remaining: np.ndarray) -> ac.Recording:
        units = {"accel": "m/s^2", "position": "m"}
        return ac.Recording.from_arrays(t, u, z[remaining], position_t=t[remaining], units=units, rig=rig)

    fit = ac.fit(of(t >= 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        whole, holed = ac.compare(fit, of(t >= 0.0))[0], ac.compare(fit, of((t + 0.5) % 2.0 > 0.2))[0]
    assert whole.worst_regions
    assert (holed.worst, holed.worst_regions) == (worst_sentence((), 0), ())
    assert len(holed.accel_residual[0])  # it is no short record


@pytest.fixture(scope="module")
def evaluation() -> Evaluation:
    """A model without the cubic that the record holds."""
    rng = np.random.default_rng(2)
    simulation = ac.simulate("interleaved", seconds=20.0, rig=CXL02_RIG, parameters={"cubic": 2e-3}, rng=rng)
    return ac.compare(ac.fit(simulation.recording), simulation.recording)[0]


def test_a_change_of_set_up_takes_nothing_from_a_share(evaluation: Evaluation) -> None:
    t, residual = evaluation.accel_residual
    moved = systematic.failing(
        replace(evaluation, accel_residual=(t, residual + 1.0), accel_rms=1.0), evaluation.bins, 1.0
    )
    assert moved.worst_regions[0].share == pytest.approx(evaluation.worst_regions[0].share)


def test_all_faces_say_the_same(evaluation: Evaluation) -> None:
    assert Evaluation.from_json(evaluation.to_json()).worst_regions == evaluation.worst_regions
    with redirect_stdout(io.StringIO()) as out:
        show(evaluation, "regions")
    message = out.getvalue()
    head, rows = evaluation.table("regions").cells
    assert all(title in message for title in head)
    first = rows[0]
    assert first[0] == "acceleration"
    assert evaluation.worst_regions[0].p < 1e-6
    assert all(cell in message for cell in first)
    frame = evaluation.to_dataframe("regions")
    assert [frame.loc["acceleration", key] for key in ("low", "high", "sigma", "p")] == [
        getattr(evaluation.worst_regions[0], key) for key in ("low", "high", "sigma", "p")
    ]


def test_cells_have_units_that_read_well(evaluation: Evaluation) -> None:
    columns = evaluation.table("regions").shown

    def cells(region: Region) -> tuple[str, ...]:
        return tuple(column.cell(comparisons.region_row(region)) for column in columns)

    region = Region("velocity", "m/s", -0.08, 0.02, 4e-4, "m/s²", 5.0, 0.01, 0.0, (1.0, 2.0))
    assert cells(region) == ("velocity", "−80 to 20 mm/s", "+400 µm/s²", "5.0", "1 %", "<1e−300")
    late = replace(region, variable="time", unit="s", low=1234.5, high=1240.25, share=None)
    assert cells(late)[1] == "1234.5 to 1240.25 s"
    assert cells(late)[4] == "–"
