"""The optional libraries of tables: imported when a table is made, with a sentence where one is missing."""

from __future__ import annotations

from typing import Any

from accelcal._support.extras import MissingExtra


def pandas() -> Any:
    """The module pandas.

    Raises
    ------
    MissingExtra
        If it is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise MissingExtra('DataFrames need pandas; install it with: pip install "accelcal[pandas]"') from error
    return pandas


def xarray() -> Any:
    """The module xarray.

    Raises
    ------
    MissingExtra
        If it is not installed.
    """
    try:
        import xarray
    except ImportError as error:
        raise MissingExtra('Datasets need xarray; install it with: pip install "accelcal[xarray]"') from error
    return xarray
