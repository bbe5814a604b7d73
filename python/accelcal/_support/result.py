"""Base of all results: how an object shows itself in a terminal, a notebook, a data frame and a dataset.

What is shown lives in `accelcal.results`, which is imported when a result is shown and not before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self, get_type_hints

from accelcal._support.errors import AccelcalError
from accelcal._support.values import face

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset


@dataclass(frozen=True)
class NotStored:
    """Mark of a field that JSON leaves out, with the sentence on how to make it again."""

    again: str
    by_commands: bool = False
    """Whether the output of commands leaves it out, and `to_json` holds it: series as long as the recording."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return face("results.json").marked(self, source, handler)


class LeftOutError(AccelcalError, AttributeError):
    """A field that a JSON has left out is asked for: for `hasattr`, copies and comparisons the object has none."""


class Storable:
    """An object whose fields are its JSON."""

    __slots__ = ()
    derived: ClassVar[tuple[str, ...]] = ()
    """Properties that JSON holds beside the fields."""
    counterparts: ClassVar[Mapping[str, str]] = {}
    """What stands for an attribute that objects of other packages have, as code."""

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            kind = type(self)
            if name in kind.counterparts:
                raise AttributeError(f"{kind.__name__} has no {name!r}; its counterpart is {kind.counterparts[name]}")
            if name not in getattr(kind, "__dataclass_fields__", ()):
                return object.__getattribute__(self, name)  # raises what it raised
            mark = get_type_hints(kind, include_extras=True)[name].__metadata__[0]
            raise LeftOutError(f"{kind.__name__}.{name} is not stored in this JSON: {mark.again}")

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        return face("results.json").schema_of_result(cls, source, handler)

    def to_json(self) -> str:
        """JSON of the fields under their names; numbers that are not finite are 'NaN', 'Infinity' and '-Infinity'."""
        return str(face("results.json").to_json(self))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Object that `to_json` wrote; the schema is that of `accelcal schema`.

        Raises
        ------
        ValueError
            If the text does not follow the schema; the sentence names the path to the first wrong value.
        """
        result: Self = face("results.json").from_json(cls, text)
        return result


class Result(Storable):
    """An object with one table, from which every face is made."""

    __slots__ = ()
    tables_in: ClassVar[str] = "results.tables"
    """Module that defines them."""

    def table(self, which: str = "") -> Any:
        """Table of the object: title, sentence, columns, rows of plain values, notes.

        Parameters
        ----------
        which : name of a further table, such as "coefficients".

        Raises
        ------
        ValueError
            If there is no table of that name.
        """
        return face(self.tables_in).table(self, which)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.table().title})"

    def __str__(self) -> str:
        return str(face("results.table").as_text(self.table()))

    def _repr_html_(self) -> str:
        """HTML of the table, as notebooks show it."""
        return str(face("results.table").as_html(self.table()))

    def to_dataframe(self, which: str = "") -> DataFrame:
        """DataFrame of the values in SI units, with units in `attrs["units"]`.

        Time series become one row for each instant, everything else the rows of the table; the coefficients of a curve
        have one row each.

        Parameters
        ----------
        which : name of a further table, as in `table`.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        ValueError
            If there is no table of that name.
        """
        frame: DataFrame = face("results.frames").frame(self, which)
        return frame

    def to_xarray(self) -> Dataset:
        """Dataset of the arrays in SI units, with axes and units.

        Raises
        ------
        MissingExtra
            If xarray is not installed.
        TypeError
            If the object has no arrays.
        """
        dataset: Dataset = face("results.frames").dataset(self)
        return dataset
