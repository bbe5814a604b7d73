"""Representation of results in a notebook: the HTML comes from `accelcal.notebook`, imported when a cell shows one."""

from __future__ import annotations

from importlib import import_module
from typing import TypeVar

Result = TypeVar("Result")
FACE = "accelcal.notebook"
"""Results lie below every face; the name is looked up when a cell shows one, so that nothing is imported before."""


def notebook_repr(result: type[Result]) -> type[Result]:
    """Give a class of results the method by which notebooks show an object."""

    def html(self: Result) -> str:
        return str(import_module(FACE).html(self))

    html.__doc__ = "Return the object as a small table in HTML, see `accelcal.notebook`."
    type.__setattr__(result, "_repr_html_", html)
    return result
