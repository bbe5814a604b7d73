"""Arguments of public functions and fields of public values, checked against their annotations.

A wrong one is refused before any work, in a sentence with what was found, what was expected and how to come by it.
"""

from __future__ import annotations

import functools
import inspect
import numbers
import os
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from contextlib import suppress
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from accelcal._support.errors import AccelcalError, FieldError

P = ParamSpec("P")
T = TypeVar("T")

HOW_TO = {
    "Recording": "accelcal.load(PATH) reads one; Recording.from_arrays and Recording.from_dataframe make one",
    "Fit": "accelcal.fit(recording) makes one; accelcal.load_model(PATH) reads one",
    "Model": 'Model.linear(), Model.cubic() or Model.linear().add("cubic") makes one',
    "Channel": "Channel(name, t, y, unit) makes one; Recording.from_arrays makes a recording of arrays",
    "Rig": 'Rig(axis="level") makes one; Recording.rig is that of a recording',
    "Prior": "Prior(0.0, 1e-4) makes one: mean and standard deviation of a coefficient, in SI units",
    "Effect": "accelcal.effects.find(NAME) is one",
    "Positions": "accelcal.io.load_positions(PATH) reads some",
    "Comparison": "accelcal.compare(fit, recording) makes one",
    "Diagnosis": "accelcal.diagnose(fit, recording) makes one",
}
"""Where an object of a class comes from, by its name."""
SEVERAL = {"float": "numbers", "int": "whole numbers", "str": "texts"}
"""Elements of a list, in words."""
HOW_TO_CONVERT = (
    'accelcal.data.units.quantity("0.5 mg", "acceleration") reads a text, '
    'accelcal.data.units.sensitivity("0.1 V/g", "acceleration") an electrical scale factor and what it counts in'
)
RANGES: Mapping[str, tuple[str, Callable[[Any], bool]]] = {
    **dict.fromkeys(("start", "end"), ("a time", lambda time: time is None or time == time)),
    "alpha": ("a number between 0 and 1", lambda rate: 0.0 < rate < 1.0),
    "most": ("a whole number that is not negative", lambda count: count is None or count >= 0),
    "horizons": ("positive numbers", lambda times: all(time > 0.0 for time in times)),
}
"""What a number must be wherever an argument has the name; each of them refuses NaN."""
NAMES_OF_EFFECTS = "enter a function with @accelcal.effect(...), then give the name of the effect as text"


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """Let a function refuse arguments of the wrong type, and numbers out of their range.

    Raises
    ------
    TypeError, ValueError
        From the function, naming the argument, what was found and what was expected.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        arguments: Mapping[str, Any] = {}  # of a wrong number: Python's own sentence names the function
        with suppress(TypeError):
            arguments = signature.bind(*args, **kwargs).arguments
        for name, value in arguments.items():
            hint = hints_of(function).get(name, Any)
            for label, item in labelled(name, value, signature.parameters[name].kind):
                if name not in ("self", "cls") and not accepts(hint, item):
                    raise error_of(hint, item)(refusal(function.__qualname__, order(signature), label, hint, item))
            if name in RANGES and not RANGES[name][1](value):
                owner = f"{function.__qualname__}({order(signature)})"
                raise AccelcalError(f"{owner}: {name} is {kind_of(value)}; expected {RANGES[name][0]}")
        return function(*args, **kwargs)

    return call


def labelled(name: str, value: Any, kind: Any) -> list[tuple[str, object]]:
    """What was given for one parameter, each with the name that a message has for it."""
    if kind is inspect.Parameter.VAR_POSITIONAL:
        return [(name, item) for item in value]
    return list(value.items()) if kind is inspect.Parameter.VAR_KEYWORD else [(name, value)]


def check_fields(value: Any, signed: Collection[str] | None = None) -> None:
    """Refuse a value of a dataclass, one of whose fields is of the wrong type, or negative where only those `signed`
    may be.

    Raises
    ------
    TypeError, ValueError
        Naming the field, what was found and what was expected.
    """
    kind: Any = type(value)
    for name, hint in hints_of(kind).items():
        if name in kind.__dataclass_fields__ and not accepts(hint, getattr(value, name)):
            names = ", ".join(kind.__dataclass_fields__)
            wrong = getattr(value, name)
            raise error_of(hint, wrong)(refusal(kind.__name__, names, name, hint, wrong))
    for name in set(kind.__dataclass_fields__) - set(signed) if signed is not None else ():
        amount = getattr(value, name)
        if isinstance(amount, int | float) and not amount >= 0.0:
            raise FieldError(kind.__name__, name, amount, "a number that is not negative")


@functools.cache
def hints_of(declared: Hashable) -> Mapping[str, Any]:
    """Annotations of a class, or of the arguments of a function, evaluated."""
    if not inspect.isfunction(declared):
        return get_type_hints(declared)
    arguments = {name: hint for name, hint in declared.__annotations__.items() if name != "return"}
    return get_type_hints(SimpleNamespace(__annotations__=arguments), inspect.unwrap(declared).__globals__)


def accepts(hint: Any, value: object) -> bool:
    """Whether a value is of a declared type; elements of lists, tuples and mappings are looked at."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(accepts(option, value) for option in inside)
    if origin is Literal:
        return isinstance(value, str | int | float | NoneType) and value in inside
    if hint is Any or isinstance(hint, TypeVar | str) or getattr(origin or hint, "_is_protocol", False):
        return True  # what is like an array is judged by numpy
    if hint is float:
        return isinstance(value, numbers.Real) and not isinstance(value, bool | np.timedelta64)
    if hint is int:
        return isinstance(value, numbers.Integral) and not isinstance(value, bool | np.timedelta64)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if hint is None:
        return value is None
    if origin is Sequence and isinstance(value, np.ndarray):
        return value.ndim == 1 and set(classes(inside[0])) <= {"float", "int"} and accepts(hint, value.tolist())
    if origin is not None and isinstance(origin, type):
        if issubclass(origin, np.ndarray):
            return isinstance(value, np.ndarray)
        if not isinstance(value, origin):
            return False
        if isinstance(value, Mapping) and inside:
            return all(accepts(inside[0], key) and accepts(inside[1], item) for key, item in value.items())
        if origin is tuple or not issubclass(origin, Iterable):
            return True
        return not isinstance(value, str | bytes) and (
            not isinstance(value, Sequence) or all(accepts(inside[0], item) for item in value)
        )
    return isinstance(value, hint) if isinstance(hint, type) else True


def error_of(hint: Any, value: object) -> type[TypeError | AccelcalError]:
    """AccelcalError for a word that is none of those allowed, else TypeError."""
    return AccelcalError if get_origin(hint) is Literal and isinstance(value, str | int) else TypeError


def order(signature: inspect.Signature) -> str:
    """Arguments that are given by place, in their order."""
    by_name = inspect.Parameter.KEYWORD_ONLY
    marks: dict[Any, str] = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}
    shown = (p for p in signature.parameters.values() if p.kind is not by_name and p.name != "self")
    return ", ".join(f"{marks.get(p.kind, '')}{p.name}" for p in shown)


def refusal(owner: str, names: str, name: str, hint: Any, value: object) -> str:
    """The sentence on one wrong argument."""
    text = f"{owner}({names}): {name} is {kind_of(value)}; expected {expected(hint)}"
    if callable(value) and "str" in classes(hint):
        return f"{text}. To use a function, {NAMES_OF_EFFECTS}"
    effect = getattr(value, "effect", value)  # of a formula
    if type(effect).__name__ == "Effect" and "str" in classes(hint):
        return f'{text}. Give its name, "{getattr(effect, "name", "")}"'
    if isinstance(value, str) and "float" in classes(hint):
        return f"{text}, in SI units. {HOW_TO_CONVERT}"
    return ". ".join([text, *[HOW_TO[kind] for kind in classes(hint) if kind in HOW_TO][:1]])


def kind_of(value: object) -> str:
    """What a value is, in words."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if isinstance(value, str | os.PathLike):
        shown = str(value)
        return f'the text "{shown[:60]}{"..." if len(shown) > 60 else ""}"'
    if value is None or isinstance(value, bool | numbers.Real):
        return repr(value)
    if inspect.isroutine(value):
        return "a function"
    if isinstance(value, list | tuple) and value:
        return f"a {type(value).__name__} with {kind_of(value[0])}"
    if isinstance(value, Mapping) and value:
        kinds = (" and ".join(dict.fromkeys(type(x).__name__ for x in xs)) for xs in (value, value.values()))
        return f"a {type(value).__name__} of {' to '.join(kinds)}"
    kind = type(value).__name__
    return f"{'an' if kind[0] in 'AEIOUaeiou' else 'a'} {kind}"


def expected(hint: Any) -> str:
    """A declared type, in words."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        several = [expected(option) for option in inside if option is not NoneType]
        return " or ".join(dict.fromkeys(several)) + (" or None" if NoneType in inside else "")
    if origin is Literal:
        return " or ".join(repr(literal) for literal in inside)
    if hint in (float, int, str):
        return {float: "a number", int: "a whole number", str: "text"}[hint]
    if isinstance(origin, type) and issubclass(origin, np.ndarray):
        return "an array"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return f"a mapping of {expected(inside[0])} to {expected(inside[1])}"
    if isinstance(origin, type) and issubclass(origin, Sequence) and inside:
        return f"a list of {' or '.join(dict.fromkeys(SEVERAL.get(name, name) for name in classes(inside[0])))}"
    if origin is not None:
        return "a function" if "Callable" in str(origin) else getattr(origin, "__name__", str(origin))
    kind = getattr(hint, "__name__", str(hint))
    return f"{'an' if kind[:1] in 'AEIOUaeiou' else 'a'} {kind}"


def classes(hint: Any) -> list[str]:
    """Names of all classes in a declared type."""
    if get_args(hint):
        return [name for option in get_args(hint) for name in classes(option)]
    return [getattr(hint, "__name__", "")]
