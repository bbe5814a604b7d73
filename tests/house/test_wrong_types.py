"""Arguments of the wrong type: refused before any work, with what was found, what was expected, how to come by it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

import accelcal as ac
from accelcal._support.arguments import accepts, hints_of
from accelcal.effects import from_expression
from accelcal.simulation import CXL02_RIG
from tests.house.test_layers import MODULES


@pytest.fixture(scope="module")
def run() -> ac.Recording:
    rng = np.random.default_rng(1)
    return ac.simulate("tones", seconds=10.0, rig=CXL02_RIG, parameters={"bias": 0.05}, rng=rng).recording


@pytest.fixture(scope="module")
def fit(run: ac.Recording) -> ac.Fit:
    return ac.fit(run)


WRONG: dict[str, tuple[Any, str]] = {
    "fit turned round": (lambda r, f: ac.fit(ac.Model.linear(), r), r"fit\(recordings, model\): recordings is a Model"),
    "fit a file name": (lambda r, f: ac.fit("run.csv"), r'"run.csv".*accelcal\.load'),
    "fit an array": (lambda r, f: ac.fit(r.accel.y), r"array of shape.*from_arrays"),
    "fit a list of names": (lambda r, f: ac.fit(["a.csv"]), r'list with the text "a.csv"'),
    "fit a word": (lambda r, f: ac.fit(r, "linear"), r"Model\.linear\(\)"),
    "fit at text": (lambda r, f: ac.fit(r, start="1 s"), r"start is .*expected a number"),
    "diagnose with bare sizes": (
        lambda r, f: ac.diagnose(f, r, prior={"cubic": 1e-4}),
        r"prior is a dict of str to float; expected a mapping of text to a Prior .*Prior\(0\.0, 1e-4\)",
    ),
    "improve with numbers for names": (
        lambda r, f: ac.improve(r, prior={3: ac.Prior(0.0, 1e-4)}),
        r"prior is a dict of int to Prior; expected a mapping of text",
    ),
    "add a function": (lambda r, f: ac.Model.linear().add(lambda s: s.p), r"a function.*@accelcal\.effect"),
    "add an effect": (lambda r, f: ac.Model.linear().add(ac.effects.find("cubic")), r'Give its name, "cubic"'),
    "add a formula": (
        lambda r, f: ac.add(f, r, from_expression("air_drag", "v*abs(v)")),
        r'names is an Own; expected text\. Give its name, "air_drag"',
    ),
    "hold at text": (lambda r, f: ac.Model.linear().freeze(bias="0"), r"bias is .*expected a number"),
    "grow without a run": (lambda r, f: ac.add(f, "cubic"), r"add\(fit, recordings, \*names\): recordings is the text"),
    "diagnose turned round": (lambda r, f: ac.diagnose(r, f), r"fit is a Recording"),
    "compare turned round": (lambda r, f: ac.compare(r, f), r"fits is a Recording"),
    "a word among the horizons": (
        lambda r, f: ac.compare(f, r, horizons=[1.0, "2 s"]),
        r"horizons is a list .*expected a list of numbers",
    ),
    "fit nothing": (lambda r, f: ac.fit([]), r"list of recordings is empty; expected at least one"),
    "a rate that is none": (
        lambda r, f: ac.diagnose(f, r, alpha=float("nan")),
        r"diagnose\(fit, recordings\): alpha is nan; expected a number between 0 and 1",
    ),
    "a rate in per cent": (lambda r, f: ac.power(f, r, alpha=5), r"alpha is 5; expected a number between 0 and 1"),
    "fewer effects than none": (lambda r, f: ac.improve(r, most=-1), r"most is -1; expected .*not negative"),
    "a horizon behind": (lambda r, f: ac.compare(f, r, horizons=[-1.0]), r"horizons is .*expected positive numbers"),
    "a start that is none": (lambda r, f: ac.fit(r, start=float("nan")), r"start is nan; expected a time"),
    "an end that is none": (lambda r, f: ac.fit(r, end=np.float32("nan")), r"end is .*nan.*; expected a time"),
    "fit behind the end": (lambda r, f: ac.fit(r, start=99.0), r"0 encoder readings between .* widen start and end"),
    "improve a model": (lambda r, f: ac.improve(ac.Model.linear()), r"recordings is a Model"),
    "power turned round": (lambda r, f: ac.power(r, f), r"model is a Recording; expected a Model or a Fit"),
    "save nowhere": (lambda r, f: f.save(3), r"path is 3; expected text or a Path"),
    "load a number": (lambda r, f: ac.load(3), r"path is 3; expected text or a Path"),
    "arrays for channels": (lambda r, f: ac.Recording(r.accel.t, r.accel.y, r.position.y), r"expected a Channel"),
    "a word for a rig": (lambda r, f: ac.Recording(r.accel, r.position, "level"), r"expected a Rig"),
    "an axis of no name": (lambda r, f: ac.Rig(axis="sideways"), r"'level' or 'up' or 'down'"),
    "a noise with its unit": (lambda r, f: ac.Sensor(noise="20 ug"), r"noise is .*expected a number"),
    "a scale with its unit": (
        lambda r, f: ac.Sensor(scale="0.1 V/g"),
        r'in SI units\..*units\.sensitivity\("0\.1 V/g"',
    ),
    "a word for a model": (lambda r, f: ac.Model("linear"), r"effects is the text"),
    "a slip in a name": (lambda r, f: ac.Model.linear().freeze(biass=1.0), r"'biass' is fixed .*did you mean 'bias'\?"),
    "a filter of no name": (lambda r, f: ac.FilterChoice("ekf"), r"'aci' or 'cwpa'"),
    "one unit for all": (
        lambda r, f: ac.Recording.from_arrays(r.accel.t, r.accel.y, r.position.y, units="m"),
        r'units is the text "m"; expected a unit by column',
    ),
    "a sidecar for a rig": (
        lambda r, f: ac.Recording.from_arrays(r.accel.t, r.accel.y, r.position.y, units={}, rig="rig.toml"),
        r'rig is the text "rig.toml"',
    ),
    "a negative density": (lambda r, f: ac.Sensor(noise=-1e-3), r"Sensor: noise is -0\.001; expected .*not negative"),
    "a negative tolerance": (lambda r, f: ac.Rig(offset_tolerance=-1.0), r"Rig: offset_tolerance is -1"),
    "a width that is none": (lambda r, f: ac.Prior(0.0, float("nan")), r"Prior: std is nan"),
    "a fit to track": (
        lambda r, f: ac.LiveModel(f, r.rig, rate=1e3, q=1e-6, r_position=1e-12, position=0.0),
        r"LiveModel: model is a Fit; Model\.linear",
    ),
    "a frame that is none": (lambda r, f: ac.Recording.from_dataframe(r.accel.y), r"expected a pandas DataFrame"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_type_is_refused_in_a_sentence(run: ac.Recording, fit: ac.Fit, case: str) -> None:
    call, message = WRONG[case]
    with pytest.raises((TypeError, ValueError), match=message):
        call(run, fit)


UNITS: dict[str, tuple[Any, str]] = {
    "unknown": (lambda t: ac.Channel("accel", t, t, "blobs"), "unknown unit"),
    "unpaired": (lambda t: ac.Channel("accel", t, t[1:], "g"), "as many of each"),
    "two columns": (lambda t: ac.Channel("accel", t, np.ones((3, 2)), "g"), "one dimension"),
    "text": (lambda t: ac.Channel("accel", t, ["a", "b", "c"], "g"), "real numbers"),
    "mass": (
        lambda t: ac.Recording(ac.Channel("accel", t, t, "kg"), ac.Channel("position", t, t, "m"), ac.Rig()),
        "kg",
    ),
    "volts": (
        lambda t: ac.Recording(ac.Channel("accel", t, t, "V"), ac.Channel("position", t, t, "m"), ac.Rig()),
        "scale",
    ),
    "own effect": (lambda t: from_expression("odd_one", "a**5", unit="foo"), "foo"),
}


@pytest.mark.parametrize("case", UNITS)
def test_a_wrong_unit_or_shape_is_refused(case: str) -> None:
    call, message = UNITS[case]
    with pytest.raises(ValueError, match=message):
        call(np.arange(3.0))


@pytest.mark.parametrize(("unit", "factor"), [("g", 9.80665), ("mg", 9.80665e-3), ("m/s²", 1.0), ("mm/s^2", 1e-3)])
def test_a_channel_converts_its_unit(unit: str, factor: float) -> None:
    result = ac.Channel("accel", [0.0, 1.0], [1, 2], unit)
    np.testing.assert_allclose(result.y, [factor, 2.0 * factor])
    assert result.unit == "m/s^2"  # one spelling, by which an acceleration is known


def test_units_reach_the_fit(run: ac.Recording, fit: ac.Fit) -> None:
    other = ac.Recording(
        ac.Channel("accel", run.accel.t, run.accel.y / 9.80665, "g"),
        ac.Channel("position", run.position.t, 1e3 * run.position.y, "mm"),
        run.rig,
    )
    again = ac.fit(other)
    for e in fit.estimates:
        assert again[e.name].value == pytest.approx(e.value, abs=1e-3 * e.std)


def test_annotations_of_all_checked_functions_can_be_evaluated() -> None:
    import importlib

    count = 0
    for module, path in MODULES.items():
        if "checked" not in path.read_text(encoding="utf-8") or not module:
            continue
        for value in vars(importlib.import_module(f"accelcal.{module}")).values():
            if getattr(value, "__wrapped__", None) is not None and getattr(value, "__module__", "").endswith(module):
                count += bool(hints_of(value.__wrapped__))
    assert count >= 15


@pytest.mark.parametrize(
    ("hint", "right", "wrong"),
    [
        (float, np.float64(1.0), True),
        (int, np.int64(1), 1.5),
        (float, np.float32(1.0), np.timedelta64(1, "s")),
        (float | None, None, "1"),
        (tuple[str, ...], ("a",), "a"),
        (bool, np.bool_(True), 1),
        (Sequence[float], np.array([1.0, 2.0]), np.eye(2)),
        (Sequence[float], np.array([1, 2]), np.array(["a"])),
        (Sequence[int], np.array([1, 2]), np.array([1.0])),
        (float | Sequence[float], np.array([1.0]), np.array([True])),
        (Sequence[str], ["a"], np.array(["a"])),
    ],
)
def test_numbers_of_numpy_pass_and_truth_values_do_not(hint: Any, right: object, wrong: object) -> None:
    assert accepts(hint, right)
    assert not accepts(hint, wrong)


def test_what_is_like_an_array_passes() -> None:
    for value in ([1.0, 2.0], [[1.0]], np.eye(2), [np.float64(1.0)], ((1, 2), (3, 4))):
        assert accepts(ArrayLike | None, value)


def test_a_figure_that_does_not_exist_is_refused_with_those_that_do(run: ac.Recording, fit: ac.Fit) -> None:
    comparison, diagnosis = ac.compare(fit, run), ac.diagnose(fit, run, extra=())
    for result, expected in (
        (comparison, "error_reduction"),
        (comparison[0], "coasting"),
        (diagnosis, "added_variable"),
    ):
        with pytest.raises(ValueError, match=f'the text "nonsense".*{expected}'):
            result.plot("nonsense")  # type: ignore[attr-defined]
