"""Immutable values: errors when a field is set, short representations, what `dir()` shows, methods found by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, FrozenInstanceError, fields, is_dataclass
from importlib import import_module
from numbers import Number
from types import ModuleType
from typing import Any, TypeVar

Value = TypeVar("Value")


def immutable(value: type[Value]) -> type[Value]:
    """Give a frozen dataclass errors that name the class, the field, and what gives a changed copy; values that hold
    arrays are equal where every field is."""

    def refuse(self: Value, name: str, *_: object) -> None:
        kind = type(self).__name__
        fields = getattr(self, "__dataclass_fields__", {})
        if name in fields:
            raise FrozenInstanceError(
                f"a {kind} is immutable: {name} cannot be set or deleted; "
                f"dataclasses.replace(..., {name}=...) returns a copy with another one"
            )
        raise FrozenInstanceError(f"a {kind} is immutable and has no field {name}; its fields are {', '.join(fields)}")

    of_fields = value.__eq__

    def equal(self: Value, other: object) -> bool:
        try:
            return of_fields(self, other)
        except ValueError:  # of arrays, which have no truth value
            return alike(self, other)

    for method in ("__setattr__", "__delattr__"):
        type.__setattr__(value, method, refuse)
    if of_fields is not object.__eq__:
        type.__setattr__(value, "__eq__", equal)
    if getattr(value.__dict__.get("__getstate__"), "__module__", "") == "dataclasses":  # of slots
        type.__setattr__(value, "__getstate__", _state)
        type.__setattr__(value, "__setstate__", _restore)
    return value


def _state(value: Any) -> dict[str, Any]:
    """Fields that a value has, by name: one that was read may lack some."""
    return {f.name: getattr(value, f.name) for f in fields(value) if hasattr(value, f.name)}


def _restore(value: object, state: Mapping[str, Any]) -> None:
    for name, y in state.items():
        object.__setattr__(value, name, y)


def alike(a: Any, b: Any) -> bool:
    """Whether two values are equal in every field and element, NaN being equal to NaN."""
    if a is b:
        return True
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(alike(y, b[key]) for key, y in a.items())
    if isinstance(a, Number) and isinstance(b, Number):
        return bool(a == b or (a != a and b != b))
    if type(a) is not type(b):
        return False
    if hasattr(a, "dtype"):  # an array; to ask for its class would take numpy into every start
        return a.shape == b.shape and bool(((a == b) | ((a != a) & (b != b))).all())
    if is_dataclass(a):
        return all(alike(getattr(a, f.name, None), getattr(b, f.name, None)) for f in fields(a) if f.compare)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(alike, a, b))
    return bool(a == b)


def leaves(
    part: Any, where: str = "", rule: str = "", *, whole: tuple[type, ...] = ()
) -> Iterator[tuple[str, str, Any]]:
    """Numbers, texts and whatever else holds nothing further, in fields, mappings, sequences and arrays.

    Each comes with its path, such as runs[1].noise, and the path without numbers and keys, in which a key is a name;
    what is an instance of a class in `whole` is taken as it is.
    """
    below: list[tuple[str, str, Any]] = []
    if is_dataclass(part) and not isinstance(part, (type, *whole)):
        below += (
            (f"{where}.{f.name}".lstrip("."), f"{rule}.{f.name}".lstrip("."), getattr(part, f.name))
            for f in fields(part)
        )
    elif isinstance(part, Mapping):
        for key, value in part.items():
            below += ((where, f"{rule}.name", key), (f"{where}.{key}", rule, value))
    elif isinstance(part, tuple | list):
        below += ((f"{where}[{i}]", rule, value) for i, value in enumerate(part))
    elif hasattr(part, "dtype") and not isinstance(part, type):  # an array, or a number of one
        below.append((where, rule, part.tolist()))
    else:
        yield where, rule, part
    for place, kind, value in below:
        yield from leaves(value, place, kind, whole=whole)


def short_repr(value: type[Value]) -> type[Value]:
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


def listing(module: Mapping[str, object]) -> Callable[[], list[str]]:
    """Make the `__dir__` of a module from its `globals()`.

    It lists `__all__`; where there is none, what the module itself defines, of a package its own modules.
    """

    def names() -> list[str]:
        listed = module.get("__all__")
        if isinstance(listed, list | tuple):
            return sorted(map(str, listed))
        return sorted(name for name, value in module.items() if not name.startswith("_") and is_own(value))

    def is_own(value: object) -> bool:
        module_name = str(module["__name__"])
        if isinstance(value, ModuleType):
            return value.__name__.startswith(f"{module_name}.")
        return getattr(value, "__module__", "") == module_name

    return names


def amount_of(number: int, singular: str, plural: str) -> str:
    """A number with its noun, and verb, in singular or plural.

    Examples
    --------
    >>> amount_of(1, "sample was", "samples were"), amount_of(3, "gap", "gaps")
    ('1 sample was', '3 gaps')
    """
    return f"{number} {singular if number == 1 else plural}"


def face(name: str) -> ModuleType:
    """The module `accelcal.NAME`, imported now."""
    return import_module(f"accelcal.{name}")
