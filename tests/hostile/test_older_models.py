"""Model files of every older shape are read as what they stood for; newer ones are refused with a sentence."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from accelcal._core import __version__
from accelcal.results import model_file
from accelcal.results.migrations import MODEL_SCHEMA, PRESENT, STEPS
from accelcal.results.model_file import ModelFileError

from .model_files import bases

YOUNGER: dict[str, tuple[tuple[tuple[str, ...], ...], ...]] = {
    "first": (
        (("shapes",), ("run_to_run",), ("noise_effects",), ("dwells",), ("tilt_deg",), ("model", "per_run")),
        (("rig", "tolerance"), ("rig", "output_filters"), ("rig", "position_filters")),
        (("rig", "sensor", "bias_instability"), ("rig", "sensor", "random_walk")),
        (("data", "session_sha256"), ("noise", "growth")),
    ),
    "with a declared tolerance": (
        (("run_to_run",), ("noise_effects",), ("dwells",), ("tilt_deg",), ("model", "per_run")),
        (("rig", "output_filters"), ("rig", "position_filters"), ("rig", "sensor", "bias_instability")),
        (("rig", "sensor", "random_walk"), ("data", "session_sha256"), ("noise", "growth")),
    ),
    "with declared filters": (
        (("run_to_run",), ("noise_effects",), ("dwells",), ("tilt_deg",), ("model", "per_run")),
        (("rig", "sensor", "random_walk"), ("data", "session_sha256"), ("noise", "growth")),
    ),
    "with runs that differ": (
        (("noise_effects",), ("dwells",), ("rig", "sensor", "random_walk"), ("noise", "growth")),
    ),
    "with dwells": ((("noise_effects",), ("noise", "growth")),),
    "last": (),
}
"""Keys that files of schema 1 lack, from the first of them to the last."""


def older(shape: str) -> dict[str, Any]:
    """A model file of schema 1 as it was written at a time."""
    content = copy.deepcopy(bases()[0])
    content["schema"] = "accelcal/model/1"
    for path in (path for group in YOUNGER[shape] for path in group):
        *above, key = path
        parts = [content]
        for step in above:
            below = [part[step] for part in parts]
            parts = [inner for one in below for inner in (one if isinstance(one, list) else [one])]
        for part in parts:
            del part[key]
    return content


@pytest.mark.parametrize("shape", YOUNGER)
def test_a_file_of_schema_1_is_read_as_what_it_stood_for(shape):
    before = older(shape)
    kept = copy.deepcopy(before)
    fit = model_file.from_dict(before)
    assert before == kept  # a content is not changed by being read
    expected = copy.deepcopy(bases()[0])
    made = model_file.to_dict(fit)
    if shape == "first":
        assert made["rig"]["tolerance"] is None
    assert made == expected


def test_side_channels_of_schema_1_are_added_to_the_output():
    content = older("first")
    content["model"]["side_channels"] = {"supply": {"channel": "supply", "unit": "m/s²/V"}}
    assert "supply" not in model_file.from_dict(content).model.effects  # known, and not in the model
    content["model"]["side_channels"]["supply"] = 3
    with pytest.raises(ModelFileError, match=r"model\.side_channels\.supply: found 3"):
        model_file.from_dict(content)


DAMAGED: tuple[dict[str, Any], ...] = (
    {},
    {"model": 3},
    {"rig": []},
    {"noise": 3},
    {"data": "x"},
    {"data": [3], "noise": [3]},
)


@pytest.mark.parametrize("damaged", DAMAGED)
def test_a_damaged_file_of_schema_1_is_refused_by_the_schema(damaged):
    with pytest.raises(ModelFileError, match=r"is missing|found"):
        model_file.from_dict({"schema": "accelcal/model/1", **damaged})


def test_there_is_a_step_from_every_older_schema():
    assert set(STEPS) == set(range(1, PRESENT))


@pytest.mark.parametrize(
    ("key", "value"),
    [("schema", f"accelcal/model/{PRESENT + 1}"), ("schema", "accelcal/model/999"), ("version", "99.0.0")],
)
def test_a_newer_file_is_refused_with_what_to_do(key, value):
    content = copy.deepcopy(bases()[0]) | {key: value}
    with pytest.raises(ModelFileError) as caught:
        model_file.from_dict(content)
    said = str(caught.value)
    assert value in said
    assert f'this is accelcal {__version__}, which reads "{MODEL_SCHEMA}" and older ones. Update accelcal, or' in said


def test_a_newer_patch_of_this_version_is_read():
    first, second, *_ = __version__.split(".")
    assert model_file.from_dict(copy.deepcopy(bases()[0]) | {"version": f"{first}.{second}.999"})
