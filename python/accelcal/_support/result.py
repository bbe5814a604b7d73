"""Base of all results: how an object shows itself in a terminal, a notebook, a data frame and a dataset.

What is shown lives in `accelcal.results`, which is imported when a result is shown and not before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from accelcal._support.faces import face

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset


class Result:
    """An object with one table, from which every face is made."""

    __slots__ = ()

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
        return face("results.tables").table(self, which)

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
