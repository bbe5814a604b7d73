"""What is raised where an optional package is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass


class MissingExtra(ImportError):
    """An optional package is not installed. The text says how to get it."""
