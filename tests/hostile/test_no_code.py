"""Nothing that stands in a file runs: code in names, units, formulas, models, sidecars and arrays is text, or refused.

Every piece of code tries to make a file; none may be there at the end, and the pieces are seen to make one when run.
"""

from __future__ import annotations

import copy
import json
import pickle
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from accelcal import io
from accelcal.calibration import export
from accelcal.data.recording import RecordingError
from accelcal.data.units import UnitError, conversion, quantity
from accelcal.effects import ExpressionError, from_expression
from accelcal.results import model_file

from .model_files import CHEAP, bases, paths, place, verdict

T = np.arange(60) / 100.0
C_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
RUST_COMMENT = re.compile(r"//[^\n]*")


def sentence_of(act: Callable[[], object]) -> str:
    """What an act is refused with; "" where it is not."""
    try:
        act()
    except RecordingError as error:
        return str(error)
    return ""


@pytest.fixture
def mark(tmp_path: Path) -> Path:
    """The file that code would make."""
    return tmp_path / "made"


def pieces(mark: Path) -> tuple[str, ...]:
    """Code that makes a file, as Python, as a template and as a shell would run it."""
    create = f"open({str(mark)!r}, 'w')"
    return (
        create,
        f"__import__('os').mkdir({str(mark)!r})",
        f"eval({create!r})",
        f"[{create}][0]",
        f"(lambda: {create})()",
        f"{{{{ {create} }}}}",
        f"{{%- set x = {create} -%}}",
        f"${{{create}}}",
        f"$(touch {mark})",
        f"`touch {mark}`",
        f"; touch {mark} #",
        f"!!python/object/apply:os.mkdir [{mark}]",
        f"cos\nmkdir\n(S'{mark}'\ntR.",
        "().__class__.__bases__[0].__subclasses__()",
        "{0.__class__.__init__.__globals__}",
        "%(x)s {x} {0} %n",
    )


def test_the_pieces_do_what_they_say(mark: Path) -> None:
    for piece in pieces(mark)[:5]:
        result = eval(piece)
        for file in [result, *(result if isinstance(result, list) else [])]:
            if hasattr(file, "close"):
                file.close()
        assert mark.exists(), piece
        mark.rmdir() if mark.is_dir() else mark.unlink()


@pytest.mark.parametrize("kind", [from_expression, conversion, quantity])
def test_formulas_and_units_run_nothing(mark: Path, kind: Callable[..., object]) -> None:
    for piece in pieces(mark):
        for text in (piece, f"a*{piece}", f"1 {piece}", f"m*({piece})", f"sin({piece})"):
            words = ("own_one", text) if kind is from_expression else (text,)
            with pytest.raises((ExpressionError, UnitError)):
                kind(*words, **({"kind": "length"} if kind is quantity else {}))
    assert not mark.exists()


def test_tables_and_sidecars_run_nothing(tmp_path: Path, mark: Path) -> None:
    path, loaded = tmp_path / "run.csv", 0
    rows = "".join(f"{t},{np.sin(t)},{np.cos(t)},{t}\n" for t in T)
    for piece in pieces(mark):
        quoted = piece.replace('"', '""')
        for header in (f't_s,accel_g,position_mm,"{quoted}"\n', f't_s,accel_g,position_mm,"x [{quoted}]"\n'):
            for key in (
                "sensor.model",
                "sensor.serial",
                "run.operator",
                "rig.axis",
                "channels.time",
                "judge.tolerance",
            ):
                path.write_text(header + rows)
                path.with_suffix(".toml").write_text(f"{key} = {json.dumps(piece)}\n")
                message = sentence_of(lambda: io.load(path))
                loaded += not message
                assert not message or str(path.with_suffix("")) in message
    assert loaded > 0
    assert not mark.exists()


def test_model_files_run_nothing(mark: Path, tmp_path: Path) -> None:
    base, accepted, tried = bases()[2], 0, 0
    places = [where for where in paths(base) if isinstance(place(base, where), str)]
    for number, where in enumerate(places):
        piece = pieces(mark)[number % len(pieces(mark))]
        content = copy.deepcopy(base)
        place(content, where[:-1])[where[-1]] = piece
        (tmp_path / "m.json").write_text(json.dumps(content))
        tried += 1
        try:
            fit = model_file.load(tmp_path / "m.json")
        except model_file.ModelFileError:
            continue
        accepted += 1
        assert [verdict(command, fit) for command in CHEAP.values()] == [""] * len(CHEAP)
    print(f"{tried} leaves of a model file hold code: {accepted} accepted as text, 0 run (none allowed)")
    assert tried > 20
    assert not mark.exists()


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, tuple[str]]:
        import os

        return os.mkdir, (str(self.mark),)


def test_pickles_in_arrays_run_nothing(tmp_path: Path, mark: Path) -> None:
    raw = pickle.dumps(Bomb(mark))
    objects = np.array([Bomb(mark)] * len(T), dtype=object)
    for suffix in (".npz", ".npy", ".mat", ".h5", ".parquet", ".csv", ".pkl", ".json"):
        path = tmp_path / f"run{suffix}"
        path.write_bytes(raw)
        with pytest.raises(RecordingError):
            io.load(path)
    path = tmp_path / "run.npz"
    for name in ("t_s", "accel_g", "position_mm", "other"):
        columns = {"t_s": T, "accel_g": np.sin(T), "position_mm": np.cos(T)} | {name: objects}
        np.savez(path, **columns)  # type: ignore[arg-type]
        assert bool(sentence_of(lambda: io.load(path))) == (name != "other"), name
    assert not mark.exists()
    pickle.loads(raw)
    assert mark.exists()


@pytest.mark.parametrize("name", ["*/ int x; /*", '\\" int x; //', "\\\\ int x;", "int x; */"])
def test_a_name_in_a_model_is_no_code_in_what_is_exported(name: str) -> None:
    content = copy.deepcopy(bases()[0])
    content["rig"]["sensor"].update(serial=name, model=name)
    calibration = export.calibrate(model_file.from_dict(content))
    for text, comment in ((export.header(calibration, "s.h"), C_COMMENT), (export.module(calibration), RUST_COMMENT)):
        assert "int x" in text
        assert "int x" not in comment.sub("", text)
