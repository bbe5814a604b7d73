"""Short representations of values with many fields: what has its default is left out."""

from __future__ import annotations

from dataclasses import MISSING, Field, fields
from typing import Any, TypeVar

Kind = TypeVar("Kind")


def short_repr(value: type[Kind]) -> type[Kind]:
    """Give a dataclass a representation that leaves out fields with their default value."""

    def representation(self: Any) -> str:
        shown = (_short(getattr(self, f.name), f) for f in fields(self) if f.repr)
        return f"{type(self).__name__}({', '.join(filter(None, shown))})"

    type.__setattr__(value, "__repr__", representation)
    return value


def _short(value: object, declared: Field[Any]) -> str:
    """A value in a few digits; empty where it is the default."""
    default = declared.default if declared.default_factory is MISSING else declared.default_factory()
    if type(value) is type(default) and bool(value == default):
        return ""
    return f"{declared.name}={value:.6g}" if isinstance(value, float) else f"{declared.name}={value!r}"
