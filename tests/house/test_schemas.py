"""What commands write follows the schemas that the command line prints."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import accelcal
from accelcal.cli import app
from accelcal.estimation.triad import fit_triad
from accelcal.results import model_file
from accelcal.results.json import SCHEMAS, VERSION, content, kind_of, schema_name
from tests.estimation.test_triad import positions
from tests.hostile.model_files import DEAR, bases, exported
from tests.schemas import require_published, validator

PACKAGE = Path(accelcal.__file__).parent
NOT_JSON = {"campaign"}
"""Schema of an SQLite file."""


def test_the_command_lists_every_schema_and_prints_each() -> None:
    listed = CliRunner().invoke(app, ["schema"]).stdout.split()
    assert listed == [*SCHEMAS]
    for name in listed:
        validator(f"accelcal/{name}/{VERSION}")  # checked against its dialect
        assert json.loads(CliRunner().invoke(app, ["schema", name]).stdout)["$schema"].endswith("2020-12/schema")


def test_a_schema_that_does_not_exist_is_refused_with_those_that_do() -> None:
    refused = CliRunner().invoke(app, ["schema", "models"])
    assert refused.exit_code == 2
    assert "expected one of model, evaluation, comparison" in refused.stderr


def test_every_schema_that_the_code_names_is_printed() -> None:
    named = {
        name
        for path in PACKAGE.rglob("*.py")
        for name in re.findall(r'"accelcal/([a-z-]+)/\d+"', path.read_text(encoding="utf-8"))
    }
    assert named - NOT_JSON <= set(SCHEMAS)
    assert all(schema_name(kind_of(name)) == f"accelcal/{name}/{VERSION}" for name in SCHEMAS if name != "session")


@pytest.mark.parametrize("number", range(3))
def test_model_files_follow_their_schema(number):
    require_published(bases()[number])


@pytest.mark.parametrize("command", ["compare", "diagnose", "formula", "export"])
def test_results_follow_their_schema(command):
    fit = model_file.from_dict(bases()[0])
    texts = list(exported(fit) if command == "export" else DEAR[command](fit))
    require_published(json.loads(texts[-1]))


def test_a_triad_follows_its_schema():
    require_published(content(fit_triad(positions(np.random.default_rng(1)))))


def test_an_output_that_breaks_its_schema_is_caught():
    # The sister: the same validator on a content with a key too many, a leaf out of range, one that is missing, and a
    # word among many numbers.
    broken = json.loads(json.dumps(bases()[0]))
    for change in (
        lambda c: c.update(sed=1),
        lambda c: c["rig"].update(axis="sideways"),
        lambda c: c.pop("runs"),
        lambda c: c["covariance"].append([*np.arange(50.0), "x", *np.arange(50.0)]),
    ):
        content = json.loads(json.dumps(broken))
        change(content)
        with pytest.raises(AssertionError):
            require_published(content)
