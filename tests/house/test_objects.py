"""Public objects as a notebook and another process meet them: short, copied, pickled, immutable, in HTML, completed."""

from __future__ import annotations

import ast
import copy
import dataclasses
import importlib
import inspect
import pickle
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import accelcal as ac
from accelcal._support.result import Result
from accelcal.data.rig import Uncertainty
from accelcal.effects import CATALOGUE, SizePrior, find, names
from accelcal.estimation.engines import ForwardFilter
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.tracks import track
from accelcal.simulation import CXL02_RIG

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "cubic": 1e-3}
LONGEST = 600
"""Letters of a representation."""


def simulated(seed: int) -> Any:
    rng = np.random.default_rng(seed)
    return ac.simulate("interleaved", seconds=15.0, rig=CXL02_RIG, parameters=TRUTH, rng=rng)


def tumble() -> ac.Dwells:
    angle, many = np.arange(8) * np.pi / 4.0, np.ones(8)
    return ac.Dwells(angle, 9.8 * np.sin(angle) + 0.05, 1e-3 * many, 60.0 * many, 6000.0 * many, ("0",) * 8, ac.Rig())


@pytest.fixture(scope="module")
def objects() -> dict[str, Any]:
    simulation, other, dwells = simulated(1), simulated(2).recording, tumble()
    run = simulation.recording
    fit = ac.fit(run)
    on_dwells = ac.fit(dwells)
    state = solve_runs(ac.Model.linear(), [run]).states[0]
    filtered = ForwardFilter(ac.FilterChoice()).over(fit, state)
    improvement = ac.improve(run, holdout=other, most=1)
    return {
        "Channel": run.accel,
        "Coast": ac.verbs.coast(fit, other, 2.0, 5.0),
        "Evaluation": ac.compare(fit, other)[0],
        "Diagnosis": ac.diagnose(fit, run),
        "DwellDiagnosis": ac.diagnose(on_dwells, dwells),
        "Dwells": dwells,
        "Effect": find("cubic"),
        "Effect of a process": find("quadratic_gauss_markov"),
        "Estimate": fit["bias"],
        "FilterChoice": ac.FilterChoice("cwpa", "cubic"),
        "FilterRun": filtered,
        "Fit": fit,
        "Improvement": improvement,
        "LowPass": ac.LowPass(159.0),
        "Model": ac.Model.cubic().add("hysteresis", shapes={"hysteresis": {"width": 1.0}}),
        "Names": names,
        "Comparison": ac.compare([fit, improvement.best], other),
        "Power": ac.power(fit, run),
        "Prior": ac.Prior(0.0, 1.0),
        "Recording": run,
        "RestNoise": ac.rest(run),
        "Rig": run.rig,
        "Sensor": run.rig.sensor,
        "Simulated": simulation,
        "Step": improvement.steps[-1],
        "Track": track(fit, run),
        "Truth": simulation.truth,
        "Uncertainty": Uncertainty(level=1e-3),
    }


KINDS = (
    *("Channel", "Coast", "Evaluation", "Diagnosis", "DwellDiagnosis", "Dwells", "Effect", "Effect of a process"),
    *("Estimate", "FilterChoice", "FilterRun", "Fit", "Improvement", "LowPass", "Model", "Names"),
    *(
        "Comparison",
        "Power",
        "Prior",
        "Recording",
        "RestNoise",
        "Rig",
        "Sensor",
        "Simulated",
        "Step",
        "Track",
        "Truth",
        "Uncertainty",
    ),
)


EQUAL = ("Comparison", "Diagnosis", "Evaluation", "Fit", "Recording")


def arrays_of(value: Any) -> Iterator[np.ndarray]:
    """Arrays of numbers anywhere in an object."""
    if isinstance(value, np.ndarray) and value.size and value.dtype == float:
        yield value
    if dataclasses.is_dataclass(value):
        value = [getattr(value, field.name) for field in dataclasses.fields(value) if field.compare]
    for part in value if isinstance(value, tuple | list) else ():
        yield from arrays_of(part)


def same(a: object, b: object) -> bool:
    """Whether two objects show the same: arrays have no equality of their own."""
    return type(a) is type(b) and repr(a) == repr(b)


def test_every_public_class_that_holds_data_is_tried(objects: dict[str, Any]) -> None:
    assert set(KINDS) == set(objects)
    running = {"LiveFilter", "LiveModel"}
    classes = {name for name in ac.__all__ if isinstance(getattr(ac, name), type)}
    errors = {name for name in classes if issubclass(getattr(ac, name), Exception)}
    assert classes - errors - running <= set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_an_object_is_pickled_and_copied(objects: dict[str, Any], kind: str) -> None:
    subject = objects[kind]
    for again in (pickle.loads(pickle.dumps(subject)), copy.copy(subject), copy.deepcopy(subject)):
        assert same(again, subject)
        assert kind not in EQUAL or again == subject


@pytest.mark.parametrize("kind", ["Comparison", "Diagnosis", "Evaluation", "Fit", "Power"])
def test_what_was_read_from_json_is_pickled_copied_and_compared_without_what_that_leaves_out(
    objects: dict[str, Any], kind: str
) -> None:
    whole = objects[kind]
    read = type(whole).from_json(whole.to_json())
    for again in (pickle.loads(pickle.dumps(read)), copy.copy(read), copy.deepcopy(read)):
        assert again == read
        assert again.to_json() == whole.to_json()
    assert (read == whole) is (kind in ("Fit", "Power"))


@pytest.mark.parametrize("kind", EQUAL)
def test_objects_with_arrays_are_equal_where_every_number_is(objects: dict[str, Any], kind: str) -> None:
    result = objects[kind]
    changed = copy.deepcopy(result)
    assert changed == result
    next(arrays_of(changed)).flat[0] += 1.0
    assert changed != result
    assert result not in ("text", 3, None)


@pytest.mark.parametrize("kind", KINDS)
def test_a_representation_is_one_short_line(objects: dict[str, Any], kind: str) -> None:
    shown = repr(objects[kind])
    assert "\n" not in shown
    assert len(shown) <= LONGEST, shown
    assert "array(" not in shown
    assert " object at 0x" not in shown


SHOWN = tuple(kind for kind in KINDS if issubclass(getattr(ac, kind.partition(" ")[0], object), Result))
"""Objects with a table."""


@pytest.mark.parametrize("kind", SHOWN)
def test_a_result_shows_itself_in_html_and_as_text(objects: dict[str, Any], kind: str) -> None:
    subject = objects[kind]
    assert "<p " in subject._repr_html_()
    assert len(str(subject).splitlines()) >= 2


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "Names"])
def test_a_field_cannot_be_set_and_the_error_says_what_to_do(objects: dict[str, Any], kind: str) -> None:
    subject = objects[kind]
    field = dataclasses.fields(subject)[0].name
    with pytest.raises(dataclasses.FrozenInstanceError, match=field):
        setattr(subject, field, None)
    with pytest.raises((dataclasses.FrozenInstanceError, AttributeError), match="nonsense"):
        subject.nonsense = 1


def test_an_effect_of_nobodys_catalogue_is_not_pickled(objects: dict[str, Any]) -> None:
    strange = dataclasses.replace(find("cubic"), prior=SizePrior(2.0))
    with pytest.raises(pickle.PicklingError, match="load_effects"):
        pickle.dumps(strange)


def test_a_running_filter_says_that_it_cannot_be_pickled() -> None:
    live = ac.filters.LiveFilter(ac.FilterChoice(), q=1e-6, r_position=1e-12, x0=np.zeros(4), P0=np.eye(4))
    with pytest.raises(TypeError, match="running"):
        pickle.dumps(live)
    with pytest.raises(TypeError, match="running"):
        copy.deepcopy(live)


def test_power_that_was_pickled_keeps_its_limits_and_says_what_it_lost(objects: dict[str, Any]) -> None:
    again = pickle.loads(pickle.dumps(objects["Power"]))
    assert again["cubic"] == objects["Power"]["cubic"]
    with pytest.raises(ValueError, match=r"accelcal\.power"):
        again.detection("cubic", 1e-3)


MODULES = (
    *("verbs", "effects", "io", "plots", "plots.interactive", "filters"),
    *("diagnosis.experiment", "model", "data.recording"),
)


@pytest.mark.parametrize("module", MODULES)
def test_a_module_lists_its_public_names_alone(module: str) -> None:
    result = importlib.import_module(f"accelcal.{module}")
    listed = dir(result)
    assert listed
    for name in listed:
        value = getattr(result, name)
        assert not name.startswith("_")
        assert str(getattr(value, "__module__", "accelcal")).startswith("accelcal"), name


def test_the_package_lists_few_public_names_and_reaches_its_packages() -> None:
    assert len(ac.__all__) <= 38
    assert dir(ac) == sorted({*ac.__all__, *ac.PACKAGES})  # what pages write as `ac.plots` is offered by completion
    for name in ac.PACKAGES:
        assert getattr(ac, name).__name__ == f"accelcal.{name}"
    imports = [node for node in ast.walk(ast.parse(inspect.getsource(ac))) if isinstance(node, ast.ImportFrom)]
    # Pyright takes what a typed package imports for private unless it is given its own name.
    assert {*ac.PACKAGES} <= {alias.asname for node in imports for alias in node.names} | {*ac.__all__}


def test_names_complete(objects: dict[str, Any]) -> None:
    assert set(CATALOGUE) == set(dir(names))
    assert names.cubic == "cubic"
    with pytest.raises(AttributeError, match="did you mean cubic"):
        _ = names.cubc
    assert objects["Fit"]._ipython_key_completions_() == ["bias", "scale_factor", "time_offset"]
    with pytest.raises(KeyError, match="did you mean 'bias'"):
        _ = objects["Fit"]["bais"]
