"""The published schemas are those of the code, and what commands write follows them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from tests.estimation.test_triad import positions
from tests.hostile.model_files import DEAR, bases, exported
from tests.schemas import SCHEMAS, require_published

import accelcal
from accelcal.cli.dwells import triad_to_dict
from accelcal.estimation.triad import fit_triad
from accelcal.results import model_file
from accelcal.results.schema.publish import FILES, file_name, name_of, publish

PACKAGE = Path(accelcal.__file__).parent
NOT_JSON = {"accelcal/campaign/1"}
"""Schema of an SQLite file."""


def test_the_published_schemas_are_those_of_the_code(tmp_path):
    # Renewed by: python -m accelcal.results schemas
    made = {path.name: path.read_text() for path in publish(tmp_path)}
    assert made == {path.name: path.read_text() for path in SCHEMAS.iterdir()}


def test_every_schema_that_the_code_names_is_published():
    named = {
        name
        for path in PACKAGE.rglob("*.py")
        for name in re.findall(r'"(accelcal/[a-z-]+/\d+)"', path.read_text(encoding="utf-8"))
    }
    known = {name_of(schema) for schema in FILES}
    assert named - NOT_JSON <= known
    assert {file_name(schema) for schema in FILES} == {path.name for path in SCHEMAS.iterdir()}


@pytest.mark.parametrize("number", range(3))
def test_model_files_follow_their_schema(number):
    require_published(bases()[number])


@pytest.mark.parametrize("command", ["compare", "diagnose", "history", "formula", "export"])
def test_results_follow_their_schema(command):
    fit = model_file.from_dict(bases()[0])
    texts = list(exported(fit) if command == "export" else DEAR[command](fit))
    require_published(json.loads(texts[-1]))


def test_a_triad_follows_its_schema():
    content = triad_to_dict(fit_triad(positions(np.random.default_rng(1))))
    require_published(json.loads(model_file.dumps(content)))


def test_an_output_that_breaks_its_schema_is_caught():
    # The sister: the same validator on a content with a key too many, a leaf out of range and one that is missing.
    broken = json.loads(json.dumps(bases()[0]))
    for change in (lambda c: c.update(sed=1), lambda c: c["rig"].update(axis="sideways"), lambda c: c.pop("noise")):
        content = json.loads(json.dumps(broken))
        change(content)
        with pytest.raises(AssertionError):
            require_published(content)
