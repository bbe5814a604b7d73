"""Results as JSON: back bit for bit, whatever their numbers, and as their schemas say."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import types
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import jsonschema
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings, strategies as st
from hypothesis.extra.numpy import arrays

import accelcal as ac
from accelcal._support.result import NotStored
from accelcal.cli import app
from accelcal.cli.common import name_of
from accelcal.data.rig import ChannelFilter, Rig
from accelcal.diagnosis.dwells import DwellDiagnosis
from accelcal.diagnosis.experiment.design import Limits, Plan
from accelcal.diagnosis.experiment.detectability import Power
from accelcal.diagnosis.select.improvement import Improvement
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import Effect, find
from accelcal.estimation.estimate import Fit
from accelcal.estimation.tracks import Track
from accelcal.filters.choice import FilterChoice
from accelcal.filters.record import FilterRun
from accelcal.model import Estimate, Model, Prior
from accelcal.results import json as results_json
from accelcal.simulation import ADXL105_RIG, CXL02_RIG
from accelcal.validation.comparison import Coast, Evaluation
from accelcal.validation.differences import Comparison
from tests.schemas import require_published

FLOATS = st.floats(allow_nan=False) | st.sampled_from([np.nan, np.inf, -np.inf, -0.0, 5e-324])
TEXTS = st.text(max_size=5).filter(lambda text: text not in results_json.WORDS)  # numbers, where one may stand
SHAPES = st.sampled_from([(0,), (3,), (0, 2), (2, 0), (2, 3), (1, 2, 2), (0, 2, 2)])
VALID: Mapping[Any, st.SearchStrategy[Any]] = {
    Model: st.sampled_from(
        [
            Model.linear(),
            Model.cubic().add("creep", shapes={"creep": {"start": 0.0, "tau": 2.0}}),
            Model.linear().add("quadratic", priors={"quadratic": Prior(0.0, 0.1)}),
        ]
    ),
    Rig: st.sampled_from([ADXL105_RIG, CXL02_RIG]),
    ChannelFilter: st.sampled_from(list(CXL02_RIG.output_filters) or [ChannelFilter("RC", cutoff=50.0)]),
    Limits: st.just(Limits(0.2, 0.1, 20.0)),
    FilterChoice: st.just(FilterChoice()),
    Effect: st.sampled_from([find("vibration"), find("encoder_outliers"), find("tone_2")]),
    float: FLOATS,
    int: st.integers(-(10**15), 10**15),
    str: TEXTS,
    bool: st.booleans(),
    type(None): st.none(),
}
"""Values of types that refuse some, and of leaves."""
RESULTS = (
    Fit, Model, Estimate, Evaluation, Comparison, Coast, Diagnosis, DwellDiagnosis, Improvement, Power, Plan, Track,
    FilterRun
)  # fmt: skip


@cache
def values(hint: Any) -> st.SearchStrategy[Any]:
    """Any value of a declared type."""
    if hint in VALID:
        return VALID[hint]
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return (
            st.none()
            if any(isinstance(mark, NotStored) and not mark.by_commands for mark in inside[1:])
            else values(inside[0])
        )
    if origin is Literal:
        return st.sampled_from(inside)
    if origin in (Union, types.UnionType):
        return st.one_of([values(strategy) for strategy in inside])
    if origin is np.ndarray:
        kind = get_args(inside[1])[0]
        return arrays(kind, SHAPES, elements=FLOATS if kind is np.float64 else None)
    if origin is tuple and inside[-1:] == (...,):
        return st.lists(values(inside[0]), max_size=2).map(tuple)
    if origin is tuple:
        return st.tuples(*map(values, inside))
    if origin in (Mapping, dict):
        keys = st.floats(allow_nan=False) if inside[0] is float else values(inside[0])
        return st.dictionaries(keys, values(inside[1]), max_size=2)
    assert dataclasses.is_dataclass(hint), hint
    hints = get_type_hints(hint, include_extras=True)
    return st.builds(
        hint, **{field.name: st.deferred(lambda h=hints[field.name]: values(h)) for field in dataclasses.fields(hint)}
    )


def require_same(before: Any, after: Any, path: str) -> None:
    """Compare two values bit by bit."""
    if isinstance(before, np.ndarray):
        assert (before.dtype, before.shape, before.tobytes()) == (after.dtype, after.shape, after.tobytes()), path
    elif isinstance(before, Effect):
        assert before is after
    elif dataclasses.is_dataclass(before):
        assert type(before) is type(after), path
        hints = get_type_hints(type(before), include_extras=True)
        for field in dataclasses.fields(before):
            marks = getattr(hints[field.name], "__metadata__", ())
            if any(isinstance(mark, NotStored) and not mark.by_commands for mark in marks):
                with pytest.raises(ValueError, match="is not stored in this JSON: accelcal"):
                    getattr(after, field.name)
            else:
                require_same(getattr(before, field.name), getattr(after, field.name), f"{path}.{field.name}")
    elif isinstance(before, Mapping):
        assert [*map(repr, before)] == [*map(repr, after)], path
        for key in before:
            require_same(before[key], after[key], f"{path}[{key!r}]")
    elif isinstance(before, Sequence) and not isinstance(before, str):
        assert (type(before), len(before)) == (type(after), len(after)), path
        for number, (first, other) in enumerate(zip(before, after, strict=True)):
            require_same(first, other, f"{path}[{number}]")
    else:
        assert repr(before) == repr(after), path


@pytest.fixture
def untold(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Results whose JSON holds fields alone: made-up numbers have no properties."""
    for kind in RESULTS:
        monkeypatch.setattr(kind, "derived", ())
    results_json.codec.cache_clear()
    yield
    results_json.codec.cache_clear()


@pytest.mark.parametrize("kind", RESULTS, ids=lambda kind: kind.__name__)
@pytest.mark.usefixtures("untold")
def test_a_result_comes_back_bit_for_bit(kind: Any) -> None:
    validator = jsonschema.Draft202012Validator(results_json.schema_of(kind))

    @settings(
        max_examples=25, phases=[Phase.generate], deadline=None, suppress_health_check=[*HealthCheck], derandomize=True
    )
    @given(values(kind))
    def holds(result: Any) -> None:
        text = result.to_json()
        require_same(result, kind.from_json(text), kind.__name__)
        assert validator.is_valid(json.loads(text)), next(validator.iter_errors(json.loads(text))).message

    holds()


TRUTHS: Mapping[str, tuple[float, Mapping[str, float]]] = {
    "adequate": (12.0, {"bias": 0.05}),
    "named": (20.0, {"quadratic": 1e-3}),
    "tied": (12.0, {"cubic": 1e-3}),
    "too_short": (1.0, {"bias": 0.05}),
}
"""Seconds and effects of a record by the verdict on it."""


@pytest.mark.parametrize("kind", TRUTHS)
def test_what_commands_write_follows_the_schema_and_is_read(kind: str) -> None:
    seconds, truth = TRUTHS[kind]
    rng = np.random.default_rng(8)
    recording = ac.simulate("interleaved", seconds=seconds, rig=CXL02_RIG, parameters=truth, rng=rng).recording
    fit = ac.fit(recording)
    several = (
        fit,
        ac.diagnose(fit, recording),
        ac.compare(fit, recording),
        ac.improve(recording, most=1),
        ac.power(fit, recording),
    )
    for result in several:
        content = results_json.content(result)
        require_published(content)
        require_published(json.loads(result.to_json()))
        again = type(result).from_json(json.dumps(content))
        assert repr(again) == repr(result)
    print(kind, several[1].verdict)


def test_a_series_that_commands_leave_out_says_how_it_is_made_again() -> None:
    simulation = ac.simulate("interleaved", seconds=5.0, rig=CXL02_RIG, parameters={}, rng=np.random.default_rng(1))
    evaluation = ac.compare(ac.fit(simulation.recording), simulation.recording)[0]
    content = results_json.content(evaluation)
    assert "residual" not in content
    short = Evaluation.from_json(json.dumps(content))
    with pytest.raises(ValueError, match=r"Evaluation\.residual is not stored in this JSON: accelcal\.compare"):
        short.residual  # noqa: B018
    assert not hasattr(short, "no_such_field")
    require_same(evaluation.residual, Evaluation.from_json(evaluation.to_json()).residual, "residual")


BIN = {"variable": "a", "unit": "m/s²", "edges": [0.0, 1.0], "mean": [1.0], "std": [1.0], "seen_at": [[0.0, 1.0]]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"more": 1}, "more is no key of this schema"),
        ({"band": "1.0"}, "band: found '1.0', expected a valid number"),
        ({"band": True}, "band: found True, expected a valid number"),
        ({"band": "nan"}, "band: found 'nan', expected a valid number"),
        ({"coast_starts": {"1.0": 1.5}}, "coast_starts.1.0: found 1.5, expected a valid integer"),
        ({"breaks": 3}, "breaks: found 3, expected a valid tuple"),
        ({"bins": [BIN | {"seen_at": {"shape": [10**9, 10**9]}}]}, "bins[0].seen_at: found {'shape'"),
        (
            {"bins": [BIN | {"seen_at": {"shape": [0, "x"]}}]},
            "{'shape': [0, 'x']}, expected ints in lists",
        ),
        ({"bins": [BIN | {"seen_at": [[1.0, 2.0], [3.0]]}]}, "expected rows of equal length"),
        ({"bins": [BIN | {"mean": [None]}]}, "mean: found [None], expected floats in lists, not null"),
    ],
)
def test_a_value_of_another_kind_is_refused_by_its_path(change: dict[str, Any], message: str) -> None:
    simulation = ac.simulate("interleaved", seconds=2.0, rig=CXL02_RIG, parameters={}, rng=np.random.default_rng(1))
    content = results_json.content(ac.compare(ac.fit(simulation.recording), simulation.recording)[0])
    with pytest.raises(ValueError, match=r"expected|no key") as caught:
        Evaluation.from_json(json.dumps(content | change))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"schema": "accelcal/evaluation/4"},
            "; an earlier version wrote it, accelcal compare",
        ),
        ({"schema": "accelcal/evaluation/6"}, "; a later version wrote it, accelcal compare"),
        ({"schema": "accelcal/model/5"}, "schema: found 'accelcal/model/5', expected 'accelcal/evaluation/5'"),
        ({"schema": "accelcal/evaluations/4"}, "expected 'accelcal/evaluation/5'"),
        (
            {"version": "0.0.9", "band": None},
            "band: found null, expected a valid number; accelcal 0.0.9 wrote it",
        ),
    ],
)
def test_a_file_of_another_version_says_which_command_writes_it_anew(change: dict[str, Any], message: str) -> None:
    simulation = ac.simulate("interleaved", seconds=2.0, rig=CXL02_RIG, parameters={}, rng=np.random.default_rng(1))
    content = results_json.content(ac.compare(ac.fit(simulation.recording), simulation.recording)[0])
    Evaluation.from_json(json.dumps(content))
    with pytest.raises(ValueError, match=r"expected") as caught:
        Evaluation.from_json(json.dumps(content | change))
    assert message in str(caught.value)
    assert ("accelcal compare" in str(caught.value)) == ("evaluation/" in change.get("schema", "evaluation/"))


def test_a_missing_key_says_so_too() -> None:
    simulation = ac.simulate("interleaved", seconds=2.0, rig=CXL02_RIG, parameters={}, rng=np.random.default_rng(1))
    content = results_json.content(ac.compare(ac.fit(simulation.recording), simulation.recording)[0])
    del content["coast_starts"]
    with pytest.raises(ValueError, match=r"coast_starts is missing; .*: accelcal compare of this version"):
        Evaluation.from_json(json.dumps(content))


def test_every_result_names_a_command_that_there_is() -> None:
    commands = {name_of(command) for command in app.registered_commands}
    assert {results_json.WRITTEN_BY.get(name, name) for name in results_json.SCHEMAS} <= commands
    assert "diagnosis" not in commands


def test_pydantic_is_imported_by_json_alone() -> None:
    lines = (
        "import sys, accelcal as ac",
        "ac.fit, ac.Fit, hasattr(ac.Model.linear(), 'x')",
        "print('pydantic' in sys.modules)",
    )
    probe = "; ".join(lines)
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
