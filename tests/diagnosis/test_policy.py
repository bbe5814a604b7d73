"""The policy of diagnosis: one page, every threshold used, finite, and guarded by a file that exists."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import pytest

import accelcal
from accelcal.diagnosis import policy
from accelcal.diagnosis.policy import thresholds

from ..docs.printed import with_printed

ROOT = Path(__file__).parents[2]
PACKAGE = Path(accelcal.__file__).parent
PAGE = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")


def names_read(paths: list[Path]) -> set[str]:
    """Names that are read in some files."""
    nodes = (node for path in paths for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    return {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}


def unused(names: set[str]) -> set[str]:
    """Those of some names that no file of the package but the policy reads."""
    return names - names_read([path for path in PACKAGE.rglob("*.py") if path.name != "policy.py"])


def test_the_page_is_what_the_module_prints():
    assert with_printed("method.md", PAGE) == PAGE, "run make pages"


def test_a_page_with_another_value_is_noticed():
    changed = PAGE.replace("| 0.99 probability |", "| 0.98 probability |")
    assert changed != PAGE
    assert with_printed("method.md", changed) == PAGE


def test_every_threshold_decides_something():
    assert not unused({threshold.name for threshold in thresholds()})


def test_a_threshold_that_decides_nothing_is_noticed():
    assert unused({"FAMILYWISE_ALPHA", "NEVER_READ"}) == {"NEVER_READ"}


@pytest.mark.parametrize("threshold", thresholds(), ids=lambda threshold: threshold.name)
def test_a_threshold_is_positive_and_finite_and_has_a_guard(threshold: policy.Threshold):
    assert math.isfinite(threshold.value)
    assert threshold.value > 0.0
    assert (ROOT / threshold.guard).is_file()
    assert threshold.value == getattr(policy, threshold.name)


def test_every_constant_of_the_module_is_on_the_page():
    constants = {name for name, value in vars(policy).items() if name.isupper() and isinstance(value, (int, float))}
    assert constants == {threshold.name for threshold in thresholds()}


def test_the_policy_imports_nothing_of_the_package():
    source = ast.parse(Path(policy.__file__).read_text(encoding="utf-8"))
    modules = {node.module for node in ast.walk(source) if isinstance(node, ast.ImportFrom)}
    modules |= {name.name for node in ast.walk(source) if isinstance(node, ast.Import) for name in node.names}
    assert not {module for module in modules if module and module.startswith("accelcal")}
