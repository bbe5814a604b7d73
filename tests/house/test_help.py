"""`help()`: every public name has an example, and every example of the package gives what it says."""

from __future__ import annotations

import doctest
import importlib
import inspect

import pytest

import accelcal
from tests.house.test_layers import MODULES

PUBLIC = [name for name in accelcal.__all__ if callable(getattr(accelcal, name))]
WITH_EXAMPLES = [m for m, path in MODULES.items() if ">>> " in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_has_an_example(name: str) -> None:
    assert ">>> " in (inspect.getdoc(getattr(accelcal, name)) or ""), name


@pytest.mark.parametrize("module", WITH_EXAMPLES)
def test_examples_give_what_they_say(module: str) -> None:
    result = importlib.import_module(f"accelcal.{module}".rstrip("."))
    done = doctest.testmod(result, optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    assert done.failed == 0
    assert done.attempted > 0


def test_an_example_that_is_wrong_is_found() -> None:
    # The twin that must fail: the same run of an example that does not give what it says.
    test = doctest.DocTestParser().get_doctest(">>> 1 + 1\n3\n", {}, "wrong", None, 0)
    assert doctest.DocTestRunner(verbose=False).run(test, out=lambda text: None).failed == 1
