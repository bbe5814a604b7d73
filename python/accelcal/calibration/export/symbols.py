"""Arithmetic on symbols: functions of arrays traced into one graph of expressions, common ones shared.

A `Symbol` stands for a number, `Symbols` for an array of them; both take NumPy's functions. What a program of a device
has no library for (sine, exponential, ...) is written here in products and sums: its bits are those of any host.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from accelcal._support.errors import AccelcalError
from accelcal.calibration.export.approximate import horner


class NotTraceable(AccelcalError):
    """A function that cannot be traced. The text says what it asks of its arguments."""


@dataclass(eq=False, slots=True)
class Graph:
    """Every expression once, in the order of their making."""

    wide: bool
    """Whether what depends on time alone has its own, double precision."""
    table: dict[tuple[Any, ...], Symbol] = field(default_factory=dict)

    def leaf(self, text: str, *, wide: bool = False) -> Symbol:
        """What stands in the program as `text`."""
        return self.entry("leaf", (text,), wide)

    def entry(self, op: str, args: tuple[Any, ...], wide: bool) -> Symbol:
        """The expression, made where it is new."""
        key = (op, wide, *(id(x) if isinstance(x, Symbol) else x for x in args))
        if key not in self.table:
            self.table[key] = Symbol(self, op, args, wide and self.wide, len(self.table))
        return self.table[key]


class Symbol(NDArrayOperatorsMixin):
    """A number that is known when the program runs."""

    __slots__ = ("args", "graph", "index", "op", "wide")

    def __init__(self, graph: Graph, op: str, args: tuple[Any, ...], wide: bool, index: int) -> None:
        self.graph, self.op, self.args, self.wide, self.index = graph, op, args, wide, index

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **more: Any) -> Any:
        return applied(ufunc, method, inputs, more)

    def __bool__(self) -> bool:
        raise NotTraceable("decides by a value that only the running program knows")

    def __float__(self) -> float:
        raise NotTraceable("needs a value that only the running program knows")


class Symbols(np.ndarray[Any, Any]):
    """An array of symbols and numbers."""

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **more: Any) -> Any:
        return applied(ufunc, method, inputs, more)

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if func is np.where:
            return _symbols(np.frompyfunc(select, 3, 1)(*map(_plain, args)))
        return _symbols(super().__array_function__(func, types, args, kwargs))


def symbols(values: Iterable[Any]) -> Symbols:
    """An array (n,) of symbols and numbers."""
    listed = list(values)
    array = np.empty(len(listed), dtype=object)
    array[:] = listed
    return array.view(Symbols)


def _plain(x: Any) -> Any:
    return np.asarray(x, dtype=object)


def _symbols(y: Any) -> Any:
    return y.view(Symbols) if isinstance(y, np.ndarray) and y.dtype == object else y


def applied(ufunc: np.ufunc, method: str, inputs: Sequence[Any], more: dict[str, Any]) -> Any:
    """A function of NumPy's on symbols, element by element."""
    plain = [_plain(x) for x in inputs]
    if ufunc is np.matmul:
        return _symbols(np.matmul(*plain)) if plain[0].shape[-1] else np.zeros(plain[0].shape[:-1])
    if ufunc.__name__ not in OPERATIONS or method not in ("__call__", "reduce"):
        raise NotTraceable(f"uses {ufunc.__name__}, which exported code does not have")
    elementwise = np.frompyfunc(OPERATIONS[ufunc.__name__], ufunc.nin, 1)
    if method == "reduce":
        return _symbols(elementwise.reduce(plain[0], axis=more.get("axis", 0), keepdims=more.get("keepdims", False)))
    y = elementwise(*plain)
    if more.get("out"):
        more["out"][0][...] = y
        return more["out"][0]
    return _symbols(y)


def operation(op: str, compute: Callable[..., float], *args: Any) -> Any:
    """The expression of an operation: a number where all are, else what is simpler, else entered into the graph."""
    unknown = [x for x in args if isinstance(x, Symbol)]
    if not unknown:
        return compute(*args)
    simple = SIMPLER[op](*args) if op in SIMPLER else None
    if simple is not None:
        return simple
    graph = unknown[0].graph
    values = args[1:] if op == "select" else args
    wide = all(x.wide for x in values if isinstance(x, Symbol)) and any(isinstance(x, Symbol) for x in values)
    narrowed = tuple(x if wide else narrow(x) for x in values)
    return graph.entry(op, args[: len(args) - len(values)] + narrowed, wide)


def narrow(x: Any) -> Any:
    """In the precision of the filter."""
    return x.graph.entry("narrow", (x,), False) if isinstance(x, Symbol) and x.wide else x


def _offset(x: Any) -> tuple[Any, float]:
    """What a number is added to, and that number."""
    if isinstance(x, Symbol) and x.op == "add" and isinstance(x.args[0], float):
        return x.args[1], x.args[0]
    return x, 0.0


def plus(x: Any, y: Any) -> Any:
    return operation("add", lambda x, y: float(x + y), *_ordered(x, y))


def minus(x: Any, y: Any) -> Any:
    return operation("sub", lambda x, y: float(x - y), x, y)


def times(x: Any, y: Any) -> Any:
    return operation("mul", lambda x, y: float(x * y), *_ordered(x, y))


def over(x: Any, y: Any) -> Any:
    """A quotient; reciprocals are shared."""
    if not isinstance(y, Symbol):
        return times(x, 1.0 / y)
    return times(x, operation("div", lambda x, y: x / y, 1.0, y))


def minus_of(x: Any) -> Any:
    return operation("neg", lambda x: -float(x), x)


def less(x: Any, y: Any) -> Any:
    return operation("lt", lambda x, y: bool(x < y), x, y)


def at_most(x: Any, y: Any) -> Any:
    return operation("le", lambda x, y: bool(x <= y), x, y)


def select(condition: Any, x: Any, y: Any) -> Any:
    """x where the condition holds, else y."""
    if not isinstance(condition, Symbol):
        return x if condition else y
    if not isinstance(x, Symbol) and not isinstance(y, Symbol):
        return x if x == y else condition.graph.entry("select", (condition, float(x), float(y)), False)
    return operation("select", float, condition, x, y)


def _ordered(x: Any, y: Any) -> tuple[Any, Any]:
    """Operands of a sum or a product, numbers first, in one order."""
    place = [v.index if isinstance(v, Symbol) else -1 for v in (x, y)]
    return (float(x) if place[0] < 0 else x, y) if place[0] <= place[1] else (float(y) if place[1] < 0 else y, x)


def _sum(x: Any, y: Any) -> Any:
    if not isinstance(x, Symbol):
        return y if x == 0.0 else None
    if y.op == "neg":
        return minus(x, y.args[0])
    return minus(y, x.args[0]) if x.op == "neg" else None


def _difference(x: Any, y: Any) -> Any:
    if not isinstance(y, Symbol):
        return x if y == 0.0 else plus(x, -y)
    if not isinstance(x, Symbol) and x == 0.0:
        return minus_of(y)
    (base, offset), (other, less_offset) = _offset(x), _offset(y)
    if base is other:
        return offset - less_offset
    return plus(x, y.args[0]) if y.op == "neg" else None


def _product(x: Any, y: Any) -> Any:
    if not isinstance(x, Symbol):
        if abs(x) in (0.0, 1.0):
            return 0.0 if x == 0.0 else y if x > 0.0 else minus_of(y)
        if y.op == "neg":
            return times(-x, y.args[0])
        return times(x * y.args[0], y.args[1]) if y.op == "mul" and isinstance(y.args[0], float) else None
    if x.op == "neg" or y.op == "neg":
        flipped = (x.op == "neg") != (y.op == "neg")
        magnitude = times(*(v.args[0] if v.op == "neg" else v for v in (x, y)))
        return minus_of(magnitude) if flipped else magnitude
    return None


SIMPLER: dict[str, Callable[..., Any]] = {
    "add": _sum,
    "sub": _difference,
    "mul": _product,
    "neg": lambda x: x.args[0] if x.op == "neg" else None,
    "select": lambda condition, x, y: x if x is y else None,
}
"""What an operation comes to where that is simpler; None where it is not."""


def largest(x: Any, y: Any) -> Any:
    return select(less(x, y), y, x)


def least(x: Any, y: Any) -> Any:
    return select(less(y, x), y, x)


def magnitude(x: Any) -> Any:
    return select(less(x, 0.0), minus_of(x), x)


def power(x: Any, exponent: Any) -> Any:
    """Whole powers, by products."""
    if isinstance(exponent, Symbol) or exponent not in (0, 1, 2, 3, 4, 5, 6, 7, 8):
        raise NotTraceable("uses a power that is no small whole number")
    return functools.reduce(times, [x] * int(exponent), 1.0)


def function(name: str) -> Callable[[Any], Any]:
    """A function of one number that the program has of its own."""
    exact = {"root": math.sqrt}.get(name) or getattr(math, name)
    return lambda x: operation(name, lambda x: float(exact(x)), x)


sine, cosine, exponential, logarithm, root = map(function, ("sin", "cos", "exp", "log", "root"))


def hyperbolic_tangent(x: Any) -> Any:
    if not isinstance(x, Symbol):
        return math.tanh(x)
    e = exponential(times(-2.0, magnitude(x)))
    size = over(minus(1.0, e), plus(1.0, e))
    return select(less(x, 0.0), minus_of(size), size)


OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": plus,
    "subtract": minus,
    "multiply": times,
    "divide": over,
    "negative": minus_of,
    "positive": lambda x: x,
    "absolute": magnitude,
    "power": power,
    "square": lambda x: times(x, x),
    "sqrt": root,
    "sin": sine,
    "cos": cosine,
    "exp": exponential,
    "tanh": hyperbolic_tangent,
    "hypot": lambda x, y: root(plus(times(x, x), times(y, y))),
    "maximum": largest,
    "minimum": least,
    "clip": lambda x, low, high: least(largest(x, low), high),
    "less": less,
    "less_equal": at_most,
    "greater": lambda x, y: less(y, x),
    "greater_equal": lambda x, y: at_most(y, x),
}
"""NumPy's functions by name."""


@dataclass(frozen=True, slots=True)
class Format:
    """A number format: its name in C and Rust, bits of its fraction, and how many terms of a series it resolves."""

    c: str
    rust: str
    fraction: int
    exponent: int
    terms: int
    seed: int
    """From which half the bits of a number are subtracted for a first guess of its reciprocal root."""


FORMATS = {
    "f32": Format("float", "f32", 23, 8, 5, 0x5F3759DF),
    "f64": Format("double", "f64", 52, 11, 8, 0x5FE6EB50C7B537A9),
}
HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
"""A quarter turn in parts of 33 bits, as fdlibm has it."""
HALF_PI_SINGLE = (1.5703125, 4.837512969970703e-4, 7.54978995489188216e-8)
"""A quarter turn in parts of few bits, as Cephes has it."""
LOG_2, LOG_2_SINGLE = (6.93147180369123816490e-01, 1.90821492927058770002e-10), (0.693359375, -2.12194440e-4)
"""The same of the logarithm of 2."""


def nearest(x: Any, fmt: Format) -> Any:
    """The next whole number, by the rounding of a sum."""
    shift = 1.5 * 2.0**fmt.fraction
    return x.graph.entry("nearest", (x, shift), x.wide)


def body(name: str, x: Any, fmt: Format) -> Any:
    """What a function of the program's own computes, for a number x."""
    single = fmt.fraction == FORMATS["f32"].fraction
    if name == "root":
        guess = x.graph.entry("guess", (x,), x.wide)
        half = times(0.5, x)
        for _ in range(3 if single else 5):
            guess = times(guess, minus(1.5, times(times(half, guess), guess)))
        return times(x, guess)
    if name == "exp":
        limit = 87.0 if single else 708.0
        x = largest(least(x, limit), -limit)
        n = nearest(times(x, 1.0 / math.log(2.0)), fmt)
        r = functools.reduce(lambda rest, part: minus(rest, times(part, n)), LOG_2_SINGLE if single else LOG_2, x)
        series = [1.0 / math.factorial(k) for k in range(8 if single else 14)]
        return times(horner(series, r), x.graph.entry("two_to", (n,), x.wide))
    if name == "log":
        n = x.graph.entry("exponent", (x,), x.wide)
        x = times(x, x.graph.entry("two_to", (minus_of(n),), x.wide))  # 1 ... 2
        above = less(math.sqrt(2.0), x)
        x, n = select(above, times(0.5, x), x), select(above, plus(n, 1.0), n)
        r = over(minus(x, 1.0), plus(x, 1.0))
        series = [2.0 / (2 * k + 1) for k in range(6 if single else 12)]
        most, rest = LOG_2_SINGLE if single else LOG_2
        return plus(times(most, n), plus(times(rest, n), times(r, horner(series, times(r, r)))))
    n = nearest(times(x, 2.0 / math.pi), fmt)
    parts = HALF_PI_SINGLE if single else HALF_PI
    r = functools.reduce(lambda rest, part: minus(rest, times(part, n)), parts, x)
    turned = plus(n, 1.0 if name == "cos" else 0.0)
    quadrant = minus(turned, times(4.0, nearest(times(0.25, turned), fmt)))  # -2 ... 2
    square = times(r, r)
    odd = times(r, horner([(-1.0) ** k / math.factorial(2 * k + 1) for k in range(fmt.terms)], square))
    even = horner([(-1.0) ** k / math.factorial(2 * k) for k in range(fmt.terms + 1)], square)
    size = select(less(magnitude(minus(magnitude(quadrant), 1.0)), 0.5), even, odd)
    back = minus_of(size)
    return select(less(quadrant, -0.5), back, select(less(quadrant, 1.5), size, back))
