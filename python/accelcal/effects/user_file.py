"""Users' effects: functions with the decorator `effect`, in a file of the user's own, a script or a notebook."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import ParamSpec

import numpy as np

from accelcal._support.arguments import checked
from accelcal._support.plain_text import OBEYED
from accelcal._support.stopping import Stopped
from accelcal.data.arrays import Array
from accelcal.data.rig import Rig
from accelcal.effects import registry
from accelcal.effects.guard import EffectsFileError, line_of, place_of, text_of
from accelcal.effects.registry import CATALOGUE, Effect
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
            known = set(CATALOGUE)
            enter(function)
            if not _loading.get():
                (name,) = set(CATALOGUE) - known
                _accept(name)
            return function

        return tried

    return effect


effect = _looked_at(registry.effect)


def _accept(name: str) -> None:
    """Try an effect that a script or a notebook has entered, or remove it."""
    entered = CATALOGUE.pop(name)
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
    kept, loading = set(CATALOGUE), _loading.set(True)
    try:
        _run(path, text)
        names = [name for name in CATALOGUE if name not in kept]
        if not names:
            raise EffectsFileError(f"{path}: adds no effect; put @effect(...) before a function of Signals")
        for name in names:
            made = CATALOGUE[name]
            _try(str(path), made)
            CATALOGUE[name] = replace(made, text=text, digest=hashlib.sha256(raw).hexdigest())
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
