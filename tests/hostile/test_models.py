"""Hostile model files through every command: a sentence or an output without NaN, never a traceback."""

from __future__ import annotations

import copy
import json
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import accelcal as ac
from accelcal._support.errors import OBEYED
from accelcal.cli import write_recording
from accelcal.effects import CATALOGUE
from accelcal.results import model_file
from accelcal.results.model_file import ModelFileError
from tests.commands import accelcal

from .case import LONG, case_rng, cases
from .model_files import CHEAP, DEAR, NO_NUMBER, bases, enter_own_effect, mutated, place, record, verdict, wrong

SECTION = "models"
SLICE = 225
"""Mutated files in a slice."""


@pytest.fixture(autouse=True)
def _catalogue():
    before = dict(CATALOGUE)
    enter_own_effect()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
    CATALOGUE.clear()
    CATALOGUE.update(before)


def loaded(path: Path, text: str) -> tuple[ac.Fit | None, str]:
    """The fit of a text as a model file, and what is wrong with the way in which it is refused."""
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        return model_file.load(path), ""
    except ModelFileError as error:
        message = str(error)
        pages = message.startswith(f"{path}: ") and not OBEYED.search(message) and len(message) < 2000
        return None, "" if pages else f"says {message[:300]!r}"
    except Exception as error:
        return None, wrong(error) or f"not an error of a model file: {error!r}"


def commands_for(accepted: int) -> list[str]:
    """Commands on a record that an accepted file meets: one in a slice, all in the long run, but for the report, which
    takes seconds: it meets the fourth in a slice, and every eighth in the long run."""
    quick = [name for name in DEAR if name != "report"]
    if not LONG:
        return ["report"] if accepted == 4 else [quick[accepted // 2 % len(quick)]] if accepted % 2 == 0 else []
    return quick if accepted % 8 else list(DEAR)


def test_mutated_model_files_end_in_a_sentence_or_in_finite_outputs(tmp_path):
    numbers, result = cases(SLICE, 10_000), Counter[str]()
    began, accepted, dear, met = time.process_time(), 0, 0, set[str]()
    for number in numbers:
        rng = case_rng(SECTION, number)
        fit, message = loaded(tmp_path / "m.json", mutated(bases()[number % len(bases())], rng))
        if message:
            result[f"case {number}: {message}"] += 1
        if fit is None:
            continue
        accepted += 1
        chosen = commands_for(accepted)
        dear += len(chosen)
        met |= {*chosen}
        for name in (*CHEAP, *chosen):
            if message := verdict((CHEAP | DEAR)[name], fit):
                result[f"case {number}, {name}: {message}"] += 1
    seconds = time.process_time() - began
    print(
        f"model files: {len(numbers)} mutated, {accepted} accepted and exported, applied, printed; {dear} commands on "
        f"a record; {len(result)} wrong (threshold 0); {seconds:.0f} s of processor time"
    )
    assert not result, "\n".join(result)
    assert accepted > len(numbers) // 50
    assert met == set(DEAR) or len(numbers) < SLICE  # a run that is resumed near its end meets only some


Path_ = tuple[Any, ...]
MATRIX: Path_ = ("covariance",)
NOISE: Path_ = ("runs", 0, "noise", "noise")
SENSOR: Path_ = ("rig", "sensor")


def put(content: dict[str, Any], at: Path_, value: Any) -> None:
    """Replace what stands at a path."""
    place(content, at[:-1])[at[-1]] = value


def growth(effect: str) -> dict[str, Any]:
    """What an effect adds to the noise."""
    return {"effect": effect, "q": 1.0, "r": 1.0, "mean": 1.0}


NOT_NUMBERS: tuple[Any, ...] = (None, True, "1.0", [], {}, [1.0], "NaN")
NOT_TEXTS: tuple[Any, ...] = (None, True, 1, [], {}, "\x1b[2J", "a\nb", "\u202ex", "\x9b1m", "x" * 5000)
NOT_LISTS: tuple[Any, ...] = (None, True, 1.0, "x", {}, {"0": 1})
NOTED = {"code": "noted", "sentence": "a remark", "values": {}}
REPLACED: tuple[tuple[Path_, str, tuple[Any, ...]], ...] = (
    (
        ("schema",),
        "schema",
        (*NOT_TEXTS[:5], *(f"accelcal/model/{n}" for n in ("0", "1", "6", "1e9")), "", "x"),
    ),
    (("version",), "", (*NOT_TEXTS, "99.0", "99.0.0", "0.2.0", "1", "x", "")),
    (("method",), "method", NOT_TEXTS),
    (("model", "effects"), "", (*NOT_LISTS, [], ["bias"], ["scale_factor", "bias", "time_offset"], ["bias"] * 3)),
    (("model", "effects", 3), "", ("no_such_effect", "bias", "", None, "__class__", "../x")),
    (("model", "fixed"), "model", (*NOT_LISTS[:4], {"bias": None}, {"bias": 1e300}, {"other": 1.0}, [])),
    (("model", "priors"), "model", ({"bias": {"mean": 0.0, "std": 0.0}}, {"bias": {}}, {"x": None}, [], 1)),
    (("model", "shapes"), "model.shapes", ({"creep": {"tau": 1.0}}, {"bias": {"x": 1.0}}, {"bias": 1.0}, [], None)),
    (("model", "per_run"), "", (["bias", "bias"], ["other"], [1], None, "bias")),
    (("estimates", 1, "value"), "estimates", (*NOT_NUMBERS, -1.0, -1.0 + 1e-9, 1e300, -1e300, 1e16, 10**17)),
    (("estimates", 1, "std"), "", (*NOT_NUMBERS, -1.0, -0.0, 0.0, 1.0, 1e300)),
    (("estimates", 1, "unit"), "estimates[1].unit", (*NOT_TEXTS, "m", "K", "")),
    (("estimates", 1, "run"), "estimates", (0.5, -1, 7, "0", True, [], 10**17)),
    (("estimates", 1, "owner"), "estimates[1].owner", ("nobody", None, 1, "")),
    (("estimates", 1, "name"), "", ("bias", "", "cubic", None, "other")),
    (MATRIX, "covariance", (None, [], [[]], [[1.0]], [[1.0] * 5] * 4, [[1.0] * 4] * 5, "x", {}, [1.0] * 5)),
    ((*MATRIX, 0, 0), "covariance", (*NOT_NUMBERS, -1.0, 0.0, 1.0, 1e300)),
    ((*MATRIX, 0, 1), "covariance", (*NOT_NUMBERS, 1e-3, 1.0, 1e300)),
    ((*NOISE, "q"), "runs[0].noise.noise.q", (*NOT_NUMBERS, -1.0, 0.0, 5e-324, 1e300)),
    ((*NOISE, "r"), "runs[0].noise.noise.r", (*NOT_NUMBERS, -1.0, 0.0)),
    ((*NOISE[:3], "all"), "runs[0].noise.all", (None, {}, [], 1.0)),
    ((*NOISE[:3], "crossover"), "runs[0].noise.crossover", (*NOT_NUMBERS, -1.0, 0.0)),
    (
        (*NOISE, "growth"),
        "runs[0].noise.noise.growth",
        ([{"effect": "vibration", "q": 1.0, "r": 1.0, "mean": 1.0}], [1], None),
    ),
    ((*NOISE, "growth"), "runs[0].noise", ([{"effect": "no_such", "q": 1.0, "r": 1.0, "mean": 1.0}],)),
    (("rig", "axis"), "rig.axis", (*NOT_TEXTS, "sideways", "Level", "")),
    (("rig", "mount"), "rig.mount", ("backwards", None, 1, "")),
    (
        ("rig", "lowpass"),
        "rig.lowpass",
        ({"cutoff": -5.0, "tolerance": None}, {"cutoff": 0.0}, 1.0, {}),
    ),
    (("rig", "gravity_along_axis"), "rig.gravity_along_axis", ("9.8", 1e9, True)),
    (("rig", "assumptions"), "rig.assumptions", (*NOT_LISTS, [1], ["\x1b[2J"], [None])),
    ((*SENSOR, "serial"), "rig.sensor.serial", NOT_TEXTS),
    ((*SENSOR, "scale"), "rig.sensor.scale", (*NOT_NUMBERS[1:], 0.0, 1e300, 5e-324)),
    ((*SENSOR, "noise"), "rig.sensor.noise", (-1.0, 0.0, "x")),
    (("runs",), "runs", NOT_LISTS),
    (("runs", 0, "name"), "runs[0].name", NOT_TEXTS),
    (("runs", 0, "start"), "runs[0]", (*NOT_NUMBERS, 1e3, -1e300)),
    (("runs", 0, "readings"), "runs[0].readings", (-1, 1.5, "9", None, 10**17)),
    (("validity",), "validity", (None, {}, [], {"a": [0.0, 1.0]}, {"a": None})),
    (("validity", "a"), "validity.a", (None, [], [1.0], [1.0, -1.0], [0.0, 1e300], "x")),
    (("validity", "frequency"), "validity.frequency", ([0.0, 0.0], [1.0, 0.0], None)),
    (("origins", "t"), "origins.t", (*NOT_NUMBERS, 1e300)),
    (
        ("remarks",),
        "remarks",
        (*NOT_LISTS, ["noted"], [1], *([NOTED | {"sentence": s}] for s in ("\x1b]0;", 1, "x" * 5000))),
    ),
    (("tilt",), "tilt", (*NOT_NUMBERS, -1.0, 1e3)),
    (("dwells",), "dwells", (1, "x", [], {"name": "x"})),
)
"""Place, beginning of the path that the sentence names, and what is put there."""


@pytest.mark.parametrize("number", range(len(REPLACED)), ids=lambda k: ".".join(map(str, REPLACED[k][0])))
def test_a_leaf_that_no_fit_has_is_refused_by_its_path(tmp_path, number):
    at, named, values = REPLACED[number]
    for value in values:
        content = copy.deepcopy(bases()[0])
        put(content, at, value)
        fit, message = loaded(tmp_path / "m.json", json.dumps(content))
        assert fit is None, f"{at} = {value!r} is accepted"
        assert not message
        with pytest.raises(ModelFileError) as caught:
            model_file.load(tmp_path / "m.json")
        assert named in str(caught.value), f"{at} = {value!r}: {caught.value}"


def test_there_are_200_directed_cases() -> None:
    count = sum(len(values) for _, _, values in REPLACED) + len(TEXTS_OF_FILES) + 2 * len(COVARIANCES)
    print(f"directed cases of model files: {count} (at least 200)")
    assert count >= 200


def whole() -> str:
    """An ordinary model file."""
    return model_file.dumps(bases()[0])


TEXTS_OF_FILES: dict[str, tuple[Callable[[], str], str]] = {
    "empty": (lambda: "", "line 1, column 1: not JSON"),
    "list": (lambda: "[]", "expected a model file with the schema"),
    "deep": (lambda: "[" * 100_000, "brackets stand in brackets without end"),
    "deep objects": (lambda: '{"a":' * 100_000, "brackets stand in brackets without end"),
    "deep leaf": (lambda: whole().replace('"dwells": null', '"dwells": ' + "[" * 900 + "]" * 900), "dwells"),
    "cut": (lambda: whole()[:2000], "not JSON"),
    "twice": (lambda: whole().replace('"dwells": null', '"dwells": null, "dwells": 1'), "'dwells' stands twice"),
    "NaN": (lambda: whole().replace('"dwells": null', '"dwells": NaN'), "found NaN, which is no JSON"),
    "Infinity": (lambda: whole().replace('"dwells": null', '"dwells": -Infinity'), "found -Infinity, which is no JSON"),
    "beyond": (lambda: whole().replace('"dwells": null', '"dwells": 1e999'), "beyond every range"),
    "digits": (lambda: whole().replace('"dwells": null', '"dwells": ' + "9" * 400), "whole number of 400 digits"),
    "many digits": (lambda: whole().replace('"dwells": null', '"dwells": ' + "9" * 10_000), "of 10000 digits"),
    "BOM": (lambda: "\ufeff" + whole(), "begins with a byte-order mark"),
    "surrogate": (lambda: whole().replace('"method": "replay"', '"method": "\\ud800"'), "method"),
    "NUL": (lambda: whole().replace('"method": "replay"', '"method": "\\u0000"'), "method"),
    "trailing": (lambda: whole() + "x", "not JSON"),
    "python": (lambda: "{'schema': 1}", "not JSON"),
    "foreign key": (lambda: whole().replace('"dwells": null', '"dwells": null, "sed": 1'), "sed is no key"),
}


@pytest.mark.parametrize("kind", TEXTS_OF_FILES)
def test_what_is_no_strict_json_is_said(tmp_path, kind):
    make, message = TEXTS_OF_FILES[kind]
    fit, pages = loaded(tmp_path / "m.json", make())
    assert (fit, pages) == (None, "")
    with pytest.raises(ModelFileError) as caught:
        model_file.load(tmp_path / "m.json")
    assert message in str(caught.value)


def test_what_is_no_file_is_said(tmp_path, monkeypatch):
    import os

    os.mkfifo(tmp_path / "fifo.json")
    (tmp_path / "latin.json").write_bytes(b'{"method": "r\xe8play"}')
    (tmp_path / "wide.json").write_bytes(whole().encode("utf-16"))
    with (tmp_path / "large.json").open("wb") as file:
        file.truncate(2**26 + 1)
    for name, message in (
        ("fifo.json", "this is a pipe"),
        ("", "this is a directory"),
        ("absent.json", "no such file"),
        ("latin.json", "is not UTF-8"),
        ("wide.json", "byte-order mark"),
        ("large.json", "expected at most 64000000"),
        ("a\0b", "cannot be read"),
        ("x" * 5000, "cannot be read"),
    ):
        with pytest.raises(ModelFileError, match=message):
            model_file.load(f"{tmp_path}/{name}")
    with pytest.raises(ModelFileError, match="this is a device"):
        model_file.load("/dev/zero")


def negative(n: int) -> np.ndarray:
    """-1 times the identity."""
    return -np.eye(n)


def correlated(rho: float) -> Callable[[int], np.ndarray]:
    """Every pair of parameters with one correlation."""
    return lambda n: (1.0 - rho) * np.eye(n) + rho


def lopsided(n: int) -> np.ndarray:
    """Not symmetric."""
    C = np.eye(n)
    C[0, 1] = 0.5
    return C


COVARIANCES: dict[str, tuple[Callable[[int], np.ndarray], str]] = {
    "negative": (negative, "covariance[0][0]: found -"),
    "correlation of 5": (correlated(5.0), "expected a correlation within 1"),
    "correlation of -1": (correlated(-1.0), "expected a positive semi-definite matrix"),
    "correlation of -0.5": (correlated(-0.5), "expected a positive semi-definite matrix"),
    "not symmetric": (lopsided, "expected a symmetric matrix"),
    "twice as large": (lambda n: 2.0 * np.eye(n), "the square of the std of"),
}


@pytest.mark.parametrize("kind", COVARIANCES)
def test_a_covariance_that_none_is_is_refused_on_the_way_in_and_out(tmp_path, kind):
    from dataclasses import replace

    from accelcal.calibration.export import NotExportable, calibrate

    make, message = COVARIANCES[kind]
    content = copy.deepcopy(bases()[0])
    std = np.array([p["std"] for p in content["estimates"]])
    P = make(len(std)) * np.outer(std, std)
    content["covariance"] = P.tolist()
    (tmp_path / "m.json").write_text(json.dumps(content))
    with pytest.raises(ModelFileError) as caught:
        model_file.load(tmp_path / "m.json")
    assert message in str(caught.value)
    if kind in ("negative", "correlation of 5", "correlation of -1", "correlation of -0.5"):
        with pytest.raises(NotExportable, match="not positive semi-definite"):
            calibrate(replace(model_file.from_dict(bases()[0]), covariance=P))


def test_rounding_of_a_covariance_is_let_pass():
    content = copy.deepcopy(bases()[0])
    P = np.array(content["covariance"]) * (1.0 + 1e-12 * case_rng("rounding", 0).normal(size=(5, 5)))
    content["covariance"] = P.tolist()
    assert model_file.from_dict(content).covariance.shape == (5, 5)


@pytest.mark.parametrize("number", range(3))
def test_the_files_that_are_mutated_are_accepted_by_every_command(number):
    fit = model_file.from_dict(bases()[number])
    for name, command in (CHEAP | (DEAR if LONG else {"compare": DEAR["compare"]})).items():
        assert not verdict(command, fit), name


def test_a_fit_that_is_not_finite_writes_no_nan(tmp_path):
    from dataclasses import replace

    from accelcal.calibration.export import NotExportable, calibrate

    fit = model_file.from_dict(bases()[0])
    for broken in (
        replace(fit, estimates=(replace(fit.estimates[0], value=np.nan), *fit.estimates[1:])),
        replace(fit, covariance=np.full((5, 5), np.inf)),
        replace(fit, validity={**fit.validity, "a": (-np.inf, np.inf)}),
    ):
        with pytest.raises(NotExportable, match=r"is (not a number|infinite), so nothing is exported"):
            calibrate(broken)
        assert not NO_NUMBER.search(model_file.dumps(model_file.to_dict(broken)))


COMMANDS = (
    "export m.json --json --c s.h --rust s.rs --dcc d.xml",
    "compare m.json run.csv --json",
    "add m.json run.csv --effect odd_quadratic",
    "diagnose m.json run.csv",
    "history m.json m.json --on run.csv",
    "drop m.json run.csv --effect cubic",
    "freeze m.json run.csv --at bias=0.05 --json",
    "formula m.json run.csv --curve shape_of_velocity",
    "report m.json run.csv -o r.html",
)


def test_processes_on_mutated_files_end_in_a_sentence(tmp_path):
    rows = record()
    write_recording(rows, tmp_path / "run.csv")
    effects = tmp_path / "own.py"
    effects.write_text(CATALOGUE["own_drag"].text)
    numbers, results = cases(4, 200), []
    for number in numbers:
        text = mutated(bases()[number % 3], case_rng("models as processes", number))
        (tmp_path / "m.json").write_bytes(text.encode("utf-8", "surrogatepass"))
        words = COMMANDS[number % len(COMMANDS)].split()
        done = accelcal(*words, "--effects-file", "own.py", cwd=tmp_path, text=False)
        message = done.stdout.decode() + done.stderr.decode()
        clean = not OBEYED.search(message) and "Traceback" not in message
        if done.returncode not in (0, 3, 4) or not clean or (done.returncode and not done.stderr):
            results.append(f"case {number}: {done.returncode} {message[-400:]!r}")
        written = [path for path in tmp_path.iterdir() if path.name in ("s.h", "s.rs", "d.xml")]
        results += [f"case {number}: NaN in {path.name}" for path in written if NO_NUMBER.search(path.read_text())]
        for path in written:
            path.unlink()
    print(f"model files as processes: {len(numbers)}, {len(results)} wrong (threshold 0)")
    assert not results, "\n".join(results)


def test_a_negative_electrical_scale_has_positive_uncertainties():
    content = copy.deepcopy(bases()[0])
    content["rig"]["sensor"].update(scale=-0.25, scale_unit="V")
    fit = model_file.from_dict(content)
    assert fit.electrical["sensitivity"].std > 0.0
    assert [verdict(command, fit) for command in CHEAP.values()] == ["", "", ""]
