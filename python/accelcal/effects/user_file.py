"""Users' effects: functions with the decorator `effect` in a file of the user's own."""

from __future__ import annotations

import hashlib
import inspect
import traceback
from dataclasses import replace
from pathlib import Path

import numpy as np

from accelcal._support.stopping import Stopped
from accelcal.data.rig import Rig
from accelcal.effects.registry import CATALOGUE, Effect
from accelcal.signals.signals import Signals

PROBE = 64
"""Samples on which an effect is evaluated before it is accepted."""


class EffectsFileError(ValueError):
    """A file of effects cannot be used. The text names file and line and states what to change."""


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
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
        text = raw.decode()
    except OSError as error:
        raise EffectsFileError(f"{path}: {(error.strerror or 'cannot be read').lower()}; give a Python file") from None
    except UnicodeDecodeError as error:
        raise EffectsFileError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8 text") from None
    before = dict(CATALOGUE)
    for name in [n for n, e in before.items() if e.text and _home(e) == str(path)]:
        del CATALOGUE[name]
    kept = set(CATALOGUE)
    try:
        _run(path, text)
        names = [name for name in CATALOGUE if name not in kept]
        if not names:
            raise EffectsFileError(f"{path}: adds no effect; put @effect(...) before a function of Signals")
        for name in names:
            _try(path, CATALOGUE[name])
            CATALOGUE[name] = replace(CATALOGUE[name], text=text, digest=hashlib.sha256(raw).hexdigest())
    except BaseException:
        CATALOGUE.clear()
        CATALOGUE.update(before)
        raise
    return tuple(CATALOGUE[name] for name in names)


def _home(effect: Effect) -> str:
    """The file that an effect's function was compiled from."""
    return effect.function.__code__.co_filename if inspect.isfunction(effect.function) else ""


def _first(effect: Effect) -> int:
    """The line on which an effect's function begins."""
    return effect.function.__code__.co_firstlineno if inspect.isfunction(effect.function) else 1


def _run(path: Path, text: str) -> None:
    """Run the file; whatever it raises becomes one sentence with its line."""
    try:
        exec(compile(text, str(path), "exec"), {"__name__": path.stem, "__file__": str(path)})
    except SyntaxError as error:
        raise EffectsFileError(f"{path}, line {error.lineno}: {error.msg}") from None
    except Stopped:
        raise
    except (Exception, SystemExit) as error:  # a file that exits must not end the program that reads it
        raise EffectsFileError(f"{path}, line {_line(path, error)}: {_text_of(error)}") from None


def _try(path: Path, effect: Effect) -> None:
    """Evaluate an effect on a small motion and look at what comes back."""
    where = f"{path}, line {_first(effect)}: effect {effect.name!r}"
    s = probe(effect.needs)
    try:
        shape = {name: float(shape.grid(s)[0]) for name, shape in effect.shapes.items()}
        y = np.asarray(effect.function(s, **shape), dtype=np.float64)
    except Exception as error:
        raise EffectsFileError(
            f"{path}, line {_line(path, error, _first(effect))}: "
            f"effect {effect.name!r} does not evaluate: {_text_of(error)}"
        ) from None
    wanted = (PROBE,) if effect.width == 1 else (PROBE, effect.width)
    if y.shape != wanted:
        raise EffectsFileError(f"{where} returns shape {y.shape} at {PROBE} times; return {wanted}")
    if not np.all(np.isfinite(y)):
        raise EffectsFileError(f"{where} returns values that are not finite; guard divisions and roots")


def _text_of(error: BaseException) -> str:
    """Text of an exception, on one line."""
    if isinstance(error, KeyError):
        return f"there is no {error.args[0]!r} here; a side channel must be named in needs=(...)"
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _line(path: Path, error: BaseException, otherwise: int = 1) -> int:
    """The last line of the file that was being run."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    return lines[-1] or otherwise if lines else otherwise


def probe(needs: tuple[str, ...]) -> Signals:
    """A short motion with the side channels that an effect needs."""
    t = np.linspace(0.0, 1.0, PROBE)
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
