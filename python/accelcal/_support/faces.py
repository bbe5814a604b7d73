"""Faces of the package that results reach by name: `fit.plot()` calls a module that lies above the result.

The module is looked up when a method is used, so that nothing is imported before.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


def face(name: str) -> ModuleType:
    """The module `accelcal.NAME`, imported now."""
    return import_module(f"accelcal.{name}")
