"""Effects of the user: a Python file that is run and tried, or a line of algebra that is parsed and never run."""

from __future__ import annotations

import ast
import hashlib
import keyword
import math
import re
import unicodedata
import warnings
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from types import MappingProxyType
from typing import Literal, ParamSpec, get_args

import numpy as np

from accelcal._support.arguments import checked
from accelcal._support.errors import OBEYED, AccelcalError
from accelcal._support.stopping import Stopped
from accelcal.data import Array, Rig, normalise
from accelcal.data.units import base_dimension, conversion, is_unit
from accelcal.effects import registry
from accelcal.effects.guard import EffectsFileError, Guarded, line_of, place_of, text_of
from accelcal.effects.registry import CATALOGUE, Effect, SizePrior
from accelcal.signals.signals import Signals

PROBE = 64
"""Samples on which an effect is evaluated before it is accepted."""
MANY = 8192
"""Samples on which its time is measured besides."""
MOST_BYTES = 2**20
"""Largest file of effects."""
_loading: ContextVar[bool] = ContextVar("loading", default=False)
"""Whether a file is being run whose effects are looked at when it has ended."""
_P = ParamSpec("_P")
_Enter = Callable[[Callable[..., Array]], Callable[..., Array]]


def _looked_at(declare: Callable[_P, _Enter]) -> Callable[_P, _Enter]:
    """The decorator of the catalogue for users: what it enters is tried once, and checked at every evaluation."""

    @wraps(declare)
    def effect(*args: _P.args, **declared: _P.kwargs) -> _Enter:
        enter = declare(*args, **declared)

        def tried(function: Callable[..., Array]) -> Callable[..., Array]:
            before = dict(CATALOGUE)
            enter(function)
            if not _loading.get():
                (name,) = (name for name, entered in CATALOGUE.items() if entered is not before.get(name))
                _accept(name, before.get(name))
            return function

        return tried

    return effect


effect = _looked_at(registry.effect)


def _accept(name: str, before: Effect | None) -> None:
    """Try an effect that a script or a notebook has entered, or leave what was there."""
    entered = CATALOGUE.pop(name)
    if before is not None:
        CATALOGUE[name] = before
    _try(place_of(entered.function)[0] or name, entered)
    CATALOGUE[name] = entered


@checked
def load_effects(path: str | Path) -> tuple[Effect, ...]:
    """Run a user's file and enter its effects into the catalogue.

    Parameters
    ----------
    path : a Python file whose functions have the decorator :func:`accelcal.effects.effect`.

    Returns
    -------
    The effects in the order of the file, each with its source text and SHA-256. Loading a file again replaces them.

    Raises
    ------
    EffectsFileError
        If the file is missing, does not run, takes a name that is taken, or returns something other than one finite
        value per time. The catalogue is then as it was.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> file = pathlib.Path(tempfile.mkdtemp(), "mine.py")
    >>> _ = file.write_text(
    ...     "from accelcal.effects import effect\\n"
    ...     "@effect('my_quartic', unit='(m/s^2)^-3', symbol='K4', scale=1e-6)\\n"
    ...     "def my_quartic(s):\\n"
    ...     "    return s.a**4\\n"
    ... )
    >>> load_effects(file)[0].name
    'my_quartic'
    """
    path = Path(path)
    raw, text = _read(path)
    before = dict(CATALOGUE)
    for name in [n for n, e in before.items() if e.text and place_of(e.function)[0] == str(path)]:
        del CATALOGUE[name]
    before_names, loading = set(CATALOGUE), _loading.set(True)
    try:
        _run(path, text)
        names = [name for name in CATALOGUE if name not in before_names]
        if not names:
            raise EffectsFileError(f"{path}: adds no effect; put @effect(...) before a function of Signals")
        for name in names:
            effect = CATALOGUE[name]
            _try(str(path), effect)
            CATALOGUE[name] = replace(effect, text=text, digest=hashlib.sha256(raw).hexdigest())
    except BaseException:
        CATALOGUE.clear()
        CATALOGUE.update(before)
        raise
    finally:
        _loading.reset(loading)
    return tuple(CATALOGUE[name] for name in names)


def _read(path: Path) -> tuple[bytes, str]:
    """Bytes and text of a user's file."""
    try:
        if path.exists() and not path.is_file():
            raise EffectsFileError(f"{path}: not a regular file; give a Python file")
        if path.exists() and path.stat().st_size > MOST_BYTES:
            raise EffectsFileError(f"{path}: larger than {MOST_BYTES // 2**20} MB; give a Python file with the effects")
        raw = path.read_bytes()
        text = raw.decode()
    except OSError as error:
        raise EffectsFileError(f"{path}: {(error.strerror or 'cannot be read').lower()}; give a Python file") from None
    except UnicodeDecodeError as error:
        raise EffectsFileError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8 text") from None
    if OBEYED.search(text.replace("\r\n", "\n").replace("\f", "")):
        raise EffectsFileError(f"{path}: the text holds control characters; save the file as plain text")
    return raw, text


def _run(path: Path, text: str) -> None:
    """Run the file; whatever it raises becomes one sentence with its line."""
    try:
        exec(compile(text, str(path), "exec"), {"__name__": path.stem, "__file__": str(path)})
    except SyntaxError as error:
        raise EffectsFileError(f"{path}, line {error.lineno}: {error.msg}") from None
    except (Stopped, EffectsFileError):
        raise
    except (Exception, SystemExit) as error:  # a file that exits must not end the program that reads it
        raise EffectsFileError(f"{path}, line {line_of(str(path), error)}: {text_of(error)}") from None


def _try(path: str, effect: Effect) -> None:
    """Evaluate an effect on a small motion, and on a longer one for its time; the guard looks at what comes back."""
    for samples in (PROBE, MANY):
        s = probe(effect.needs, samples)
        try:
            shape = {name: float(shape.grid(s)[0]) for name, shape in effect.shapes.items()}
        except EffectsFileError:
            raise
        except Exception as error:
            line = line_of(path, error, place_of(effect.function)[1])
            raise EffectsFileError(
                f"{path}, line {line}: effect {effect.name!r} has a shape parameter that cannot be tried: "
                f"{text_of(error)}"
            ) from None
        effect.function(s, **shape)


def probe(needs: tuple[str, ...], samples: int = PROBE) -> Signals:
    """A motion of 1 s with the side channels that an effect needs."""
    t = np.linspace(0.0, 1.0, samples)
    w = 2.0 * np.pi * 2.0
    return Signals(
        t=t,
        p=np.sin(w * t) / w**2,
        v=np.cos(w * t) / w,
        a=-np.sin(w * t),
        jerk=-w * np.cos(w * t),
        scale=1.0,
        rig=Rig(),
        cutoff=4.0,
        side={name: 0.5 + t for name in needs},
    )


LONGEST = 200
"""Characters of an expression."""
DEEPEST = 20
"""Operations inside each other."""
LARGEST_POWER = 8.0
"""Largest exponent, either sign; exponents are plain numbers."""
MOTION = ("a", "v", "p", "jerk", "t")
"""Variables that every recording has; every side channel is one more, by its name."""
FUNCTIONS: Mapping[str, Callable[[Array], Array]] = MappingProxyType(
    {
        "abs": np.abs,
        "sign": np.sign,
        "sqrt": np.sqrt,
        "exp": np.exp,
        "log": np.log,
        "sin": np.sin,
        "cos": np.cos,
        "tan": np.tan,
        "tanh": np.tanh,
        "arctan": np.arctan,
    }
)
RESERVED = frozenset((*MOTION, *FUNCTIONS, "np", "s", "effect"))
"""Names with a meaning in an expression, or in the file that it is written to."""
DECADES = 9.0
"""Motions on which an expression is constant if it is so at all reach over this many decades, both ways."""
DRAWS = 512
FormulaPort = Literal["output", "position"]
FormulaOwner = Literal["sensor", "mounting", "rig", "encoder"]
_BINARY: Mapping[type[ast.operator], tuple[str, Callable[[Array, Array], Array]]] = MappingProxyType(
    {
        ast.Add: ("+", np.add),
        ast.Sub: ("-", np.subtract),
        ast.Mult: ("*", np.multiply),
        ast.Div: ("/", np.divide),
        ast.Pow: ("**", np.power),
    }
)
_UNARY: Mapping[type[ast.unaryop], tuple[str, Callable[[Array], Array]]] = MappingProxyType(
    {ast.UAdd: ("+", np.positive), ast.USub: ("-", np.negative)}
)
_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
_UNIT = re.compile(r"[\w²³⁴⁵⁻¹·./()^* µ°%-]{1,40}")


class ExpressionError(AccelcalError):
    """An expression or its name cannot be used. The text states what was found and what is allowed."""


@dataclass(frozen=True, slots=True)
class Own:
    """A user's own effect that is one line of algebra."""

    effect: Effect
    expression: str
    """As it was parsed."""

    @property
    def file(self) -> str:
        """The effect as a file for `load_effects` and `--effects-file`."""
        return self.effect.text


@checked
def from_expression(
    name: str,
    text: str,
    *,
    unit: str = "",
    port: FormulaPort = "output",
    owner: FormulaOwner = "sensor",
    channels: tuple[str, ...] = (),
) -> Own:
    """Enter an effect that is given as an expression into the catalogue.

    Parameters
    ----------
    name : its identifier: small letters, digits, underscores.
    text : such as ``"v * abs(v)"``: numbers, ``+ - * / **``, brackets, `FUNCTIONS`, `MOTION` and side channels. Nothing
        else is read, and nothing is executed.
    unit : unit of the coefficient; by default the one that the formula leaves, "1" where a variable has no known unit.
    port : whether it adds to the output (m/s²) or to the encoder's position (m).
    owner : the part of the set-up that carries it.
    channels : names of the side channels that the expression may use.

    Returns
    -------
    The effect, whose `text` is an equivalent file. Entering it a second time changes nothing.

    Raises
    ------
    ExpressionError
        If the name is taken or unfit, the expression holds anything else, it is not finite on an ordinary motion, or
        unit times formula is no m/s², at the encoder no m.

    Notes
    -----
    A number may carry a unit, in SI: in ``tanh(v/0.01)`` 0.01 is a speed. So a function takes any unit and has none
    (but abs, sqrt), a sum with a number, or with a part that has one as factor, has the unit of its other part, and
    a formula with a number as factor, or with a sum of different units, is not checked.

    Examples
    --------
    >>> from_expression("air_drag", "v*abs(v)", unit="1/m").expression
    'v * abs(v)'
    >>> from_expression("fifth_power", "a**5").effect.unit
    's^8/m^4'
    """
    effect, understood = _made(name, text, unit, port, owner, channels)
    _try_out(effect, understood)
    return _entered(effect, understood)


def from_tried_expression(name: str, text: str, *, unit: str, port: FormulaPort, channels: tuple[str, ...] = ()) -> Own:
    """The same of an expression that was tried before, by another process perhaps; it is not evaluated here.

    Raises
    ------
    ExpressionError
        If the name is taken or unfit, or the expression holds anything that is not allowed.
    """
    return _entered(*_made(name, text, unit, port, "sensor", channels))


def _made(
    name: str, text: str, unit: str, port: FormulaPort, owner: FormulaOwner, channels: tuple[str, ...]
) -> tuple[Effect, str]:
    """The effect of an expression, and the expression as it was understood."""
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise ExpressionError(f"name {name!r}: expected small letters, digits and underscores, such as air_drag")
    if name in RESERVED:
        raise ExpressionError(f"name {name!r}: it has a meaning in expressions and their files; choose another name")
    if unit and not _UNIT.fullmatch(unit):
        raise ExpressionError(f"unit {unit!r}: expected a short unit such as 1/m")
    unknown = [word for word in re.findall(r"[A-Za-z]+", normalise(unit)) if not is_unit(word)]
    if unknown:
        raise ExpressionError(f"unit {unit!r}: {unknown[0]} is no known unit; expected one such as 1/m or (m/s^2)^-3")
    others = [word for word in re.findall(r"[A-Za-z]+", normalise(unit)) if conversion(word).factor != 1.0]
    if others:
        raise ExpressionError(f"unit {unit!r}: variables are in SI, and {others[0]} is not; expected one such as m/s^2")
    if port not in get_args(FormulaPort) or owner not in get_args(FormulaOwner):
        raise ExpressionError(f"an own effect adds to output or position and belongs to a part; found {port}, {owner}")
    usable = tuple(dict.fromkeys(c for c in channels if is_usable(c)))
    tree = parse(text, (*MOTION, *usable))
    understood = ast.unparse(tree)
    _require_finite_constants(tree)
    needs = tuple(c for c in usable if c in _names(tree))
    unit = _unit_left(understood, tree, port, unit)

    def function(s: Signals) -> Array:
        channels_read = {channel: s.side[channel] for channel in needs} | {
            channel: getattr(s, channel) for channel in MOTION
        }
        return _value(tree, channels_read)

    function.__doc__ = f"Own effect: {understood}."
    file = (  # every part of it has been checked
        f'"""Own effect {name}."""\n\n'
        "import numpy as np\n\nfrom accelcal.effects import effect\n\n\n"
        f'@effect("{name}", unit="{unit}", port="{port}", owner="{owner}", symbol="{name}", scale=1.0, '
        f'source="own expression", needs={needs!r})\n'
        f"def {name}(s):\n"
        f'    """Own effect: {understood}."""\n'
        f"    return {_python(tree)} + 0.0 * s.t\n"
    )
    effect = Effect(
        name=name,
        unit=unit,
        port=port,
        owner=owner,
        symbol=name,
        prior=SizePrior(1.0, "own expression"),
        function=function,
        shapes=MappingProxyType({}),
        needs=needs,
        text=file,
        digest=hashlib.sha256(file.encode()).hexdigest(),
    )
    return effect, understood


UNITS_OF: Mapping[str, str] = MappingProxyType(
    {
        **{"a": "m/s^2", "v": "m/s", "p": "m", "jerk": "m/s^3", "t": "s"},
        **{"temperature": "K", "a_y": "m/s^2", "a_z": "m/s^2"},
    }
)
"""Units of variables; a side channel of another name has any."""
Dimension = Mapping[str, float]
"""Exponents of base units, none of them zero."""


def _unit_left(understood: str, tree: ast.expr, port: FormulaPort, unit: str) -> str:
    """Unit of the coefficient of a formula, the given one where that is right.

    Raises
    ------
    ExpressionError
        If unit times formula has another dimension than what it adds to.
    """
    variables = {name: _dimension_of_unit(text) or {} for name, text in UNITS_OF.items()}
    formula = _dimension(tree, variables)
    total = "m/s^2" if port == "output" else "m"
    if formula is None:
        return unit or "1"
    left = _product(_dimension_of_unit(total) or {}, formula, -1.0)
    stated = _dimension_of_unit(unit) if unit and not _scaled(tree) else left
    if stated is not None and stated != left:
        raise ExpressionError(
            f"unit {unit!r}: {understood} is in {_text_of(formula)} and adds to {total}, so that its coefficient is in "
            f"{_text_of(left)}; write that, or leave the unit out"
        )
    return unit or _text_of(left)


def _dimension(node: ast.expr, variables: Mapping[str, Dimension]) -> Dimension | None:
    """Exponents of base units of a checked tree, numbers pure; None where a variable, or a sum of units, leaves them
    open."""
    match node:
        case ast.Name(id=name):
            return variables.get(name)
        case ast.UnaryOp(operand=operand):
            return _dimension(operand, variables)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            power, base = _number(right) or 0.0, _dimension(left, variables)
            return None if base is None else _product({}, base, power)
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
            if _scaled(left) != _scaled(right):  # a number carries the unit that the other part has
                return _dimension(right if _scaled(left) else left, variables)
            first, second = _dimension(left, variables), _dimension(right, variables)
            return first if first == second else None
        case ast.BinOp(left=left, op=op, right=right):
            first, second = _dimension(left, variables), _dimension(right, variables)
            sign = 1.0 if isinstance(op, ast.Mult) else -1.0
            return None if first is None or second is None else _product(first, second, sign)
        case ast.Call(func=ast.Name(id="abs"), args=[argument]):
            return _dimension(argument, variables)
        case ast.Call(func=ast.Name(id="sqrt"), args=[argument]):
            inside = _dimension(argument, variables)
            return None if inside is None else _product({}, inside, 0.5)
    return {}


def _scaled(node: ast.expr) -> bool:
    """Whether a number is a factor in a checked tree, which may carry any unit: a width, a slope."""
    match node:
        case ast.Constant():
            return True
        case ast.UnaryOp(operand=operand) | ast.BinOp(left=operand, op=ast.Pow()):
            return _scaled(operand)
        case ast.BinOp(left=left, op=ast.Mult() | ast.Div(), right=right):
            return _scaled(left) or _scaled(right)
        case ast.BinOp(left=left, right=right):
            return _scaled(left) and _scaled(right)
        case ast.Call(func=ast.Name(id="abs" | "sqrt"), args=[argument]):
            return _scaled(argument)
    return False


def _product(first: Dimension, second: Dimension, power: float) -> Dimension:
    """Exponents of a product, the second factor raised to a power."""
    exponents = {base: first.get(base, 0.0) + power * second.get(base, 0.0) for base in (*first, *second)}
    return {base: exponent for base, exponent in sorted(exponents.items()) if abs(exponent) > 1e-9}


def _dimension_of_unit(unit: str) -> Dimension | None:
    """Exponents of the base units of a unit; None where it is no product of powers."""
    text = re.sub(r"(?<=[\w)])\s+(?=[A-Za-z(])", "*", normalise(unit)).replace("^", "**")
    try:
        tree = ast.parse(text, mode="eval").body
        return _dimension(tree, {name: base_dimension(name) for name in _names(tree)})
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        return None


def _text_of(dimension: Dimension) -> str:
    """A unit in base units, as people write it."""
    above, below = (
        " ".join(f"{base}^{size:g}" if size != 1.0 else base for base, size in part)
        for part in (
            [(base, size) for base, size in dimension.items() if size > 0.0],
            [(base, -size) for base, size in dimension.items() if size < 0.0],
        )
    )
    return f"{above or '1'}/{f'({below})' if ' ' in below else below}" if below else above or "1"


MOST_WRITTEN = 4000
"""Characters of a file that `from_expression` wrote, at most."""
_WRITTEN = re.compile(
    r'.*\n@effect\("(?P<name>\w+)", unit="(?P<unit>[^"\n]+)", port="(?P<port>\w+)", owner="(?P<owner>\w+)", '
    r"[^\n]*needs=\((?P<needs>[^)\n]*)\)\)\n[^\n]*\n    \"\"\"Own effect: (?P<text>[^\n]*)\.\"\"\"\n[^\n]*\n",
    re.DOTALL,
)


def from_written(name: str, source: str) -> Own | None:
    """Enter an effect of a file that `from_expression` wrote, by its formula: the file is compared and never run.

    Returns
    -------
    The effect; None where the file is of another maker, or was changed.

    Raises
    ------
    ExpressionError
        If its name is taken.
    """
    # what an expression of the greatest length makes is shorter; a pattern takes a time of the square of the length
    written = _WRITTEN.fullmatch(source) if len(source) <= MOST_WRITTEN else None
    if written is None or written["name"] != name:
        return None
    channels = tuple(re.findall(r"'(\w+)'", written["needs"]))
    try:
        effect, understood = _made(name, written["text"], written["unit"], written["port"], written["owner"], channels)  # type: ignore[arg-type]
        _try_out(effect, understood)
    except ExpressionError:
        return None
    return _entered(effect, understood) if effect.text == source else None


def _entered(effect: Effect, understood: str) -> Own:
    """An effect in the catalogue, looked at each time it is evaluated."""
    name, subject = effect.name, f"effect {effect.name!r}, {understood},"
    function = Guarded(
        effect.function, 1, lambda wrong: f"{subject} {wrong}", lambda error: f"{subject} does not evaluate: {error}"
    )
    effect = replace(effect, function=function)
    old = CATALOGUE.setdefault(name, effect)
    if old.digest != effect.digest:
        raise ExpressionError(f"name {name!r}: there is an effect called so already; choose another name")
    return Own(old, understood)


def is_usable(channel: str) -> bool:
    """Whether an expression may use a side channel by its name.

    A name that means something else in an expression, or that is none, cannot be told from it.
    """
    plain = channel.isidentifier() and unicodedata.normalize("NFKC", channel) == channel
    return plain and not keyword.iskeyword(channel) and channel not in RESERVED


def parse(text: str, names: tuple[str, ...]) -> ast.expr:
    """Read an expression; only the grammar of `from_expression` passes.

    Raises
    ------
    ExpressionError
        Naming what was found and what is allowed.
    """
    if len(text) > LONGEST:
        raise ExpressionError(f"the expression has {len(text)} characters; at most {LONGEST} are read")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)
            tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ExpressionError(f"{text[:40]!r} is not a formula; write one like v * abs(v)") from None
    _check(tree, names, 0)
    return tree


def _check(node: ast.expr, names: tuple[str, ...], depth: int) -> None:
    """Refuse everything that is not arithmetic on known names."""
    if depth > DEEPEST:
        raise ExpressionError(f"the expression nests more than {DEEPEST} operations; make it simpler")
    match node:
        case ast.Constant(value=bool() | complex() | str() | bytes() | None):
            pass
        case ast.Constant(value=int() | float() as value) if abs(value) <= 1e30:
            return
        case ast.Name(id=name) if name in names:
            return
        case ast.Name(id=name):
            functions = ", ".join(FUNCTIONS)
            raise ExpressionError(
                f"there is no variable {name!r} here; there are {', '.join(names)}, and the functions {functions}. "
                f'Name a side channel: channels=("{name[:40]}",)'
            )
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
            return _check(operand, names, depth + 1)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            if not isinstance(power := _number(right), float) or abs(power) > LARGEST_POWER:
                raise ExpressionError(
                    f'found "{ast.unparse(node)[:40]}"; an exponent is a number from '
                    f"{-LARGEST_POWER:g} to {LARGEST_POWER:g}"
                )
            return _check(left, names, depth + 1)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            _check(left, names, depth + 1)
            return _check(right, names, depth + 1)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
            return _check(argument, names, depth + 1)
    raise ExpressionError(
        f'found "{ast.unparse(node)[:40]}" in the expression; allowed are numbers, + - * / **, brackets, '
        f"{', '.join(names)}, and {', '.join(FUNCTIONS)} of one argument"
    )


def _number(node: ast.expr) -> float | None:
    """A plain number, with or without a sign."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool) and abs(value) <= 1e30:
            return float(value)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            inner = _number(operand)
            return None if inner is None else -inner
    return None


def _names(tree: ast.expr) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def _value(node: ast.expr, names: Mapping[str, Array]) -> Array:
    """Evaluate a tree that `_check` has passed."""
    match node:
        case ast.Constant(value=int() | float() as value):
            return np.asarray(float(value))
        case ast.Name(id=name):
            return names[name]
        case ast.UnaryOp(op=op, operand=operand):
            return _UNARY[type(op)][1](_value(operand, names))
        case ast.BinOp(left=left, op=op, right=right):
            return _BINARY[type(op)][1](_value(left, names), _value(right, names))
        case ast.Call(func=ast.Name(id=name), args=[argument]):
            return FUNCTIONS[name](_value(argument, names))
    raise AssertionError(f"unchecked expression: {ast.dump(node)}")


@np.errstate(all="ignore")
def _try_out(effect: Effect, understood: str) -> None:
    """Evaluate an effect on an ordinary motion, which passes through zero, as its file will be."""
    moving, fine, nothing = probe(effect.needs), probe(effect.needs, MANY), np.zeros(PROBE)
    still = replace(moving, p=nothing, v=nothing, a=nothing, jerk=nothing)
    y = np.concatenate([effect.column(motion) for motion in (moving, still, fine)])
    if not np.all(np.isfinite(y)):
        raise ExpressionError(
            f"{understood}: not finite at {len(y) - int(np.isfinite(y).sum())} of {len(y)} instants of an ordinary "
            "motion, where a, v and p pass through zero; guard divisions, roots and logarithms with abs and a constant"
        )
    if not _varies(effect, moving) and not _varies(effect, _wide(moving)):
        raise ExpressionError(f"{understood}: constant on an ordinary motion; that is what bias is for")


@np.errstate(all="ignore")
def _varies(effect: Effect, s: Signals) -> bool:
    """Whether an effect has more than one finite value on a motion."""
    y = effect.column(s)
    y = y[np.isfinite(y)]
    return len(y) > 1 and float(np.ptp(y)) > 1e-12 * float(np.max(np.abs(y)))


def _wide(s: Signals) -> Signals:
    """Times and side channels of any size and sign beside one instant: an effect may set in late, or in any unit."""
    rng = np.random.default_rng(0)

    def any_size() -> Array:
        return np.asarray(10.0 ** rng.uniform(-DECADES, DECADES, DRAWS) * rng.choice([-1.0, 1.0], DRAWS))

    return replace(s.at(np.full(DRAWS, 1)), t=np.sort(any_size()), side={name: any_size() for name in s.side})


@np.errstate(all="ignore")
def _require_finite_constants(tree: ast.expr) -> None:
    """Refuse a part without variables that is no finite number: Python would stop where an array goes on."""
    for node in ast.walk(tree):
        if isinstance(node, ast.expr) and not _names(node) - set(FUNCTIONS) and not isinstance(node, ast.Name):
            value = float(_value(node, {}))
            if not math.isfinite(value):
                raise ExpressionError(f"{ast.unparse(node)[:40]}: this part is not finite whatever the motion is")


def _python(node: ast.expr) -> str:
    """A checked tree as Python on signals."""
    match node:
        case ast.Name(id=name):
            return f"s.{name}" if name in MOTION else f"s.side[{name!r}]"
        case ast.UnaryOp(op=op, operand=operand):
            return f"({_UNARY[type(op)][0]}{_python(operand)})"
        case ast.BinOp(left=left, op=op, right=right):
            return f"({_python(left)} {_BINARY[type(op)][0]} {_python(right)})"
        case ast.Call(func=ast.Name(id=name), args=[argument]):
            return f"np.{name}({_python(argument)})"
        case ast.Constant(value=int() | float() as value):
            return repr(float(value))
    raise AssertionError(f"unchecked expression: {ast.dump(node)}")
