"""The error for an optional package that is missing."""

from __future__ import annotations


class MissingExtra(ImportError):
    """An optional package is not installed. The text states how to install it."""
