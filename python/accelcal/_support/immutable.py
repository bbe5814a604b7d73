"""Immutable values that say so: what happens when a field of a public object is set."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import TypeVar

Value = TypeVar("Value")


def immutable(value: type[Value]) -> type[Value]:
    """Give a frozen dataclass errors that name the class, the field, and what gives a changed copy."""

    def refuse(self: Value, name: str, *_: object) -> None:
        kind = type(self).__name__
        fields = getattr(self, "__dataclass_fields__", {})
        if name in fields:
            raise FrozenInstanceError(
                f"a {kind} is immutable: {name} cannot be set or deleted; "
                f"dataclasses.replace(..., {name}=...) returns a copy with another one"
            )
        raise FrozenInstanceError(f"a {kind} is immutable and has no field {name}; its fields are {', '.join(fields)}")

    for method in ("__setattr__", "__delattr__"):
        type.__setattr__(value, method, refuse)
    return value
