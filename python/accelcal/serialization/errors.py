"""The error of a file that is not a model file."""

from __future__ import annotations

from accelcal._support.errors import AccelcalError


class ModelFileError(AccelcalError):
    """A file that is not a model file. The text names it, the place in it, and states what was expected."""
