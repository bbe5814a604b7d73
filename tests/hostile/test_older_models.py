"""Model files of schema 2 are read as what they stood for; older and newer ones are refused with a sentence."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accelcal._core import __version__
from accelcal.results import model_file
from accelcal.results.model_file import MODEL_SCHEMA, PRESENT, STEPS, ModelFileError

from .model_files import bases, enter_own_effect

STORED = ("cubic", "joint", "grown")
"""Files that schema 2 wrote: a cubic model, three runs with a bias of each, effects with shapes and noise."""


def older(name: str) -> dict[str, Any]:
    """Content of a file of schema 2."""
    path = Path(__file__).parent / "schema_2" / f"{name}.json"
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


@pytest.mark.parametrize("name", STORED)
def test_a_file_of_schema_2_is_read_as_what_it_stood_for(name):
    enter_own_effect()
    content = older(name)
    remaining = copy.deepcopy(content)
    fit = model_file.from_dict(content)
    assert content == remaining  # a content is not changed by being read
    for stored, estimate in zip(content["parameters"], fit.estimates, strict=True):
        assert (stored["name"], stored["value"], stored["std"]) == (estimate.name, estimate.value, estimate.std)
        assert fit.stands_for[estimate.name] == stored["stands_for"]
    assert np.array_equal(fit.covariance, content["covariance"]["matrix"])
    for stored, noise, run in zip(content["data"], content["noise"], fit.runs, strict=True):
        assert (stored["file"], stored["sha256"], stored["used_s"]) == (run.name, run.digest, [run.start, run.end])
        assert (noise["q"], noise["r"], noise["crossover_hz"]) == (
            run.noise.noise.q,
            run.noise.noise.r,
            run.noise.crossover,
        )
        assert noise["all"]["density_m_per_s2_rthz"] == run.noise.all.density
    assert [effect["name"] for effect in content["noise_effects"]] == [effect.name for effect in fit.noise_effects]
    assert [spread["name"] for spread in content["run_to_run"]] == [spread.name for spread in fit.spreads]
    assert model_file.to_dict(model_file.from_dict(model_file.to_dict(fit))) == model_file.to_dict(fit)


DAMAGED: tuple[dict[str, Any], ...] = (
    {},
    {"model": 3},
    {"rig": []},
    {"noise": 3},
    {"data": "x"},
    {"data": [3], "noise": [3]},
    {"covariance": None},
    {"run_to_run": [1]},
)


@pytest.mark.parametrize("damaged", DAMAGED)
def test_a_damaged_file_of_schema_2_is_refused(damaged):
    content = older("cubic") | damaged if damaged else {"schema": "accelcal/model/2", "version": __version__}
    with pytest.raises(ModelFileError, match=r"schema 2 without a part|is missing|found"):
        model_file.from_dict(content)


def test_remarks_of_schema_3_have_codes():
    content = copy.deepcopy(bases()[0]) | {"schema": "accelcal/model/3", "tilt": 2.0}
    fit = model_file.from_dict(content | {"remarks": ["A tilt of 2 degrees rms", "run.csv: a note."]})
    assert [(remark.code, remark.sentence) for remark in fit.remarks] == [
        ("slow_residual", "A tilt of 2 degrees rms"),
        ("noted", "run.csv: a note"),
    ]
    with pytest.raises(ModelFileError, match="schema 3"):
        model_file.from_dict(content | {"remarks": [1]})


def test_there_is_a_step_from_every_older_schema():
    assert set(STEPS) == set(range(2, PRESENT))


def test_a_file_of_schema_1_is_refused_with_what_to_do():
    with pytest.raises(ModelFileError, match="is no longer read; make one with: accelcal fit"):
        model_file.from_dict(older("cubic") | {"schema": "accelcal/model/1"})


@pytest.mark.parametrize(
    ("key", "value"),
    [("schema", f"accelcal/model/{PRESENT + 1}"), ("schema", "accelcal/model/999"), ("version", "99.0.0")],
)
def test_a_newer_file_is_refused_with_what_to_do(key, value):
    content = copy.deepcopy(bases()[0]) | {key: value}
    with pytest.raises(ModelFileError) as caught:
        model_file.from_dict(content)
    text = str(caught.value)
    assert value in text
    assert f'this is accelcal {__version__}, which reads "{MODEL_SCHEMA}" and older ones. Update accelcal, or' in text


def test_a_newer_patch_of_this_version_is_read():
    first, second, *_ = __version__.split(".")
    assert model_file.from_dict(copy.deepcopy(bases()[0]) | {"version": f"{first}.{second}.999"})
