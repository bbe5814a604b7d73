"""Errors whose text is for users: what was found, where, what was expected, the next step."""

from __future__ import annotations


class AccelcalError(ValueError):
    """Base of all errors of accelcal that speak to a user; any other exception is an error of accelcal itself.

    Examples
    --------
    >>> import accelcal as ac
    >>> try:
    ...     ac.load("absent.csv")
    ... except ac.AccelcalError as error:
    ...     print(str(error).partition(":")[0])
    absent.csv
    """


class AccessError(AccelcalError, OSError):
    """A file or a port cannot be used."""


class MissingExtra(AccelcalError, ImportError):
    """An optional package is not installed. The text states how to install it."""
