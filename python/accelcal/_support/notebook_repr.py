"""Results as text and in a notebook: both come from `accelcal.notebook`, imported when a result is shown."""

from __future__ import annotations

from typing import TypeVar

from accelcal._support.faces import face

Result = TypeVar("Result")


def notebook_repr(result: type[Result]) -> type[Result]:
    """Give a class of results the method by which notebooks show an object."""

    def html(self: Result) -> str:
        return str(face("notebook").html(self))

    html.__doc__ = "Return the object as a small table in HTML, see `accelcal.notebook`."
    type.__setattr__(result, "_repr_html_", html)
    return result


def summary(result: object) -> str:
    """A result as plain text: title, sentence, table and remarks, as a notebook shows them."""
    return str(face("notebook").text(result))
