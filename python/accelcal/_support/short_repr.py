"""Short representations of values with many fields: what has its default is left out."""

from __future__ import annotations

from dataclasses import MISSING, Field, fields
from typing import Any, TypeVar

Value = TypeVar("Value")


def short_repr(value: type[Value]) -> type[Value]:
    """Give a dataclass a representation that leaves out fields with their default value."""

    def representation(self: Any) -> str:
        shown = ((f.name, getattr(self, f.name)) for f in fields(self) if f.repr)
        defaults = {f.name: default_of(f) for f in fields(self)}
        return f"{type(self).__name__}({', '.join(f'{k}={_short(v)}' for k, v in shown if not _is(v, defaults[k]))})"

    type.__setattr__(value, "__repr__", representation)
    return value


def default_of(declared: Field[Any]) -> object:
    """The default of a field; MISSING where it has none."""
    return declared.default if declared.default_factory is MISSING else declared.default_factory()


def _is(value: object, default: object) -> bool:
    return type(value) is type(default) and bool(value == default)


def _short(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else repr(value)
