"""The loop in Chromium on records of the independent worlds: an effect drawn at random, and nothing at all."""

import os

import numpy as np
import pytest

import accelcal as ac
from accelcal import verbs
from accelcal.effects import spelled
from accelcal.estimation.estimate import estimate
from accelcal.validation.differences import headline_horizon
from tests.hidden.trials import DELAYS, allowed, coasting
from tests.worlds import CATALOGUE, Hidden, Nuisances, World, at_d

from .test_browser import LONG, drop, fit, number, tab  # noqa: F401  (the fixture that opens a fresh workbench)
from .test_server import server  # noqa: F401  (the fixture that runs it)

STRENGTH = 36.0
"""d on the whole record: above 30 on the part that is fitted."""
SECONDS = 40.0
SEEDS = (3, 8) if os.environ.get("ACCELCAL_BROWSER") == "every" else (3,)
MEANS = [name for name, effect in CATALOGUE.items() if effect.kind == "mean" and name not in DELAYS]
MOTIONS = ("interleaved", "bursts", "moves")


def drawn(seed: int) -> World:
    """A world with an effect that this motion can show, drawn at random."""
    rng = np.random.default_rng([51, seed])
    silent = Nuisances(clock_offset=float(rng.uniform(-2e-5, 2e-5)), clock_tolerance=2e-5)
    while True:
        hidden = (Hidden(str(rng.choice(MEANS)), 0.0),)
        hidden = (Hidden(hidden[0].name, abs(CATALOGUE[hidden[0].name].typical)),)
        motion, sensor = str(rng.choice(MOTIONS)), str(rng.choice(["CXL02", "ADXL105"]))
        try:
            return at_d(
                World(motion, sensor, hidden, seed=int(rng.integers(2**31)), nuisances=silent, seconds=SECONDS),
                STRENGTH,
                0,
            )
        except ValueError:
            continue


def parts(path):
    """The part that the workbench fits, and the part that it holds out."""
    data = ac.load(path)
    begin, end = data.position.t[0], data.position.t[-1]
    split = round(end - verbs.HELD_OUT * (end - begin), 3)
    return data.without((split, max(data.accel.t[-1], end))), data.part(split, max(data.accel.t[-1], end))


def load(page, path):
    drop(page, path, path.with_suffix(".toml"))
    page.get_by_role("button", name="Fit the linear model").wait_for(timeout=LONG)


def shows(page, value):
    """Wait until the page shows an error, to the last digit."""
    page.wait_for_function(
        "v => document.querySelector('[data-number=error]')?.dataset.value === v", arg=repr(value), timeout=LONG
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_an_effect_drawn_at_random_is_added_and_the_error_falls(tab, seed, tmp_path):  # noqa: F811
    world = drawn(seed)
    path = world.record().write(tmp_path)
    load(tab, path)
    fit(tab)
    before = number(tab, "error")
    train, unseen = parts(path)
    model = estimate(ac.Model.linear(), train)
    alone = verbs.compare(model, unseen)
    horizon, base = f"{headline_horizon(alone[0]):g} s", coasting(alone[0])
    assert before == alone.errors[0]
    fits = [model]
    informed = verbs.add(model, train, world.hidden[0].name)
    print(f"{world.hidden[0].name} on {world.motion}, {world.sensor}")
    for _ in range(verbs.MOST_EFFECTS):
        missing = verbs.diagnose(model, train).scan.detected
        if not missing:
            break
        tab.get_by_role("button", name=f"Add {spelled(missing[0].effect)}", exact=True).click()
        model = verbs.add(model, train, missing[0].effect)
        fits.append(model)
        shows(tab, verbs.compare(fits, unseen).errors[-1])
    tab.get_by_text("Detection limits: no missing effect is larger than").wait_for(timeout=LONG)
    result, oracle, more = (
        coasting(verbs.compare(model, unseen)[0]),
        coasting(verbs.compare(informed, unseen)[0]),
        allowed(model, unseen),
    )
    assert result["one_step"] < base["one_step"]
    if base[horizon] >= 2.5 * oracle[horizon]:  # unaided, a model that knows sgn v may drift more than others
        assert base[horizon] >= 2.0 * result[horizon]
    for key in ("one_step", horizon):
        assert result[key] <= 1.05 * np.hypot(oracle[key], more[key])
    tab.get_by_role("tab", name="Export").click()
    with tab.expect_download(timeout=LONG) as report:
        tab.get_by_role("button", name="Report (.html)").click()
    assert report.value.suggested_filename.endswith(".html")


def test_a_world_in_which_nothing_is_hidden_offers_nothing(tab, tmp_path):  # noqa: F811
    path = World("interleaved", "CXL02", (), seed=5, nuisances=Nuisances(), seconds=SECONDS).record().write(tmp_path)
    load(tab, path)
    fit(tab)
    assert tab.locator("[data-verdict]").get_attribute("data-verdict") == "adequate"
    assert tab.get_by_role("button", name="Add", exact=False).count() == 0
