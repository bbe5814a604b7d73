"""A public suite of records with hidden effects, on which any tool can be measured: written, answered, scored.

From the top of the repository:
    python -m benches.suite write FOLDER [--records 24] [--seed N] [--open FOLDER2]
    python -m benches.suite answer FOLDER > ANSWERS.csv
    python -m benches.suite score FOLDER ANSWERS.csv TRUTH.json
`write` makes data files, DATASHEET.md and sealed.json from the seed, bit for bit; with `--open` truth.json as well, in
another folder. `answer` gives accelcal's answers, by its public interface and from the data files alone. Without a seed
one of 128 bits is drawn and printed; with it the same command opens the truth later.
"""

from __future__ import annotations

import argparse
import ast
import csv
import hashlib
import inspect
import json
import math
import os
import secrets
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TextIO

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import accelcal as ac
from tests.hidden.trials import SHORT, UNLIKE, VISIBLE, Trial, at_output, draw
from tests.hidden.verdicts import DELAY_CLASS, injected
from tests.worlds import CATALOGUE, World

Truth = dict[str, Any]
"""What one record hides, by the keys that the data sheet explains."""
Answer = dict[str, tuple[float, float] | None]
"""Classes of one record in the order of their rows, with size and standard deviation where they are stated."""

RATES = World(accel_rate=700.03, encoder_rate=350.07, lateral_rate=100.03)
"""Of every record, Hz: 24 records stay below 20 MB, and half the rate is above the vibration of the bearings."""
SECONDS, STRENGTH, DIGITS, NULLS = 30.0, 20.0, 7, 4
"""Length of a record; d of what it hides; digits of its cells; one of so many records hides nothing."""
EXACT = {"lowpass_error": 0.0, "lowpass_tolerance": 0.0, "clock_offset": 0.0, "clock_tolerance": 0.0}
"""Nuisances that would differ between records with and without an effect, and thereby disclose it."""
HEADER = ["record", "class", "size", "std"]
NOTHING, OTHER = "nothing", "other"
SIZED = [name for name in VISIBLE if CATALOGUE[name].kind == "mean" and name not in ("saturation", *UNLIKE)]
"""Classes whose size is one number that the record determines."""


class SuiteError(ValueError):
    """A folder, or a file of the suite, of answers or of truths, that is not what it should be."""


def plan(seed: int, records: int) -> Iterator[tuple[str, Trial]]:
    """Names and trials of the records; the order, and the number from which a trial draws its motion, are random."""
    nulls = max(1, records // NULLS)
    if seed < 0 or not 2 <= records <= len(VISIBLE) + nulls:
        most = len(VISIBLE) * NULLS // (NULLS - 1)
        raise SuiteError(f"--seed {seed} --records {records}: expected a seed of 0 or more, and 2 to {most} records")
    rng = np.random.default_rng([seed, 9])
    hidden = [(name,) for name in rng.permutation(VISIBLE)[: records - nulls].tolist()] + [()] * nulls
    for n, index in enumerate(rng.permutation(records), start=1):
        names, number = hidden[index], int(rng.integers(10**6))
        yield f"r{n:02d}", Trial(2 if names else 1, number, seed, names, STRENGTH if names else 0.0, SECONDS)


def world_of(trial: Trial) -> World:
    """The world of a record; where its motion is too short, or shows too little of the effect, others are drawn."""
    why = ""
    for number in range(trial.number, trial.number + 20):
        try:
            world = draw(replace(trial, number=number), replace(RATES, seed=trial.seed << 31))
            return replace(world, nuisances=replace(world.nuisances, **EXACT)).settled()
        except ValueError as refused:
            why = str(refused)
    raise SuiteError(f"{why} on 20 drawn motions; expected another --seed")


def truth_of(record: str, world: World, seed: int) -> Truth:
    """What a record hides, with the salt of its seal; numbers have nine digits, so that they survive a rounding."""
    names = [hidden.name for hidden in world.hidden]
    k = float(world.scale_factor or 0.0)
    truth: Truth = {"record": record, "effect": NOTHING, "size": None, "unit": "", "shape": {}}
    for hidden in world.hidden:
        size, shape = at_output(hidden, k), {key: rounded(value) for key, value in hidden.shape.items()}
        if size < 0.0 and "phase" in shape:  # the amplitude of a wave is positive
            size, shape["phase"] = -size, rounded(shape["phase"] + np.pi)
        truth |= {"effect": hidden.name, "size": rounded(size), "unit": hidden.effect.unit, "shape": shape}
    beside = sorted(injected({"nuisances": asdict(world.nuisances), "names": names}) - set(names))
    salt = hashlib.sha256(f"{seed}/{record}".encode()).hexdigest()
    return truth | {"K0": rounded(world.bias or 0.0), "k": rounded(k), "beside": beside, "salt": salt}


def rounded(value: float) -> float:
    """A number to nine digits."""
    return float(f"{value:.9g}")


def seal(truth: Truth | None) -> str:
    """SHA-256 of a truth as JSON with sorted keys and no blanks, in UTF-8."""
    text = json.dumps(truth, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def write(folder: Path, seed: int, records: int, truth_folder: Path | None = None) -> None:
    """Write the suite of a seed, and its truth into a folder of its own where one is named.

    Raises
    ------
    SuiteError
        If a folder holds files, if both are one, or if no suite has this number of records.
    """
    if truth_folder is not None and folder.resolve() in (truth_folder.resolve(), *truth_folder.resolve().parents):
        raise SuiteError(f"--open {truth_folder}: expected a folder outside {folder}, which is handed out")
    for place in filter(None, (folder, truth_folder)):
        if place.exists() and (not place.is_dir() or any(place.iterdir())):
            raise SuiteError(f"{place}: expected a new or an empty folder; nothing was written")
    worlds = {record: world_of(trial) for record, trial in plan(seed, records)}
    for record, world in worlds.items():
        world.record().write(folder, record, DIGITS)
    (folder / "DATASHEET.md").write_text(data_sheet(records), encoding="utf-8")
    truths = {record: truth_of(record, world, seed) for record, world in worlds.items()}
    sums = {path.name: digest(path) for path in sorted(folder.iterdir())}
    write_json(folder / "sealed.json", {"files": sums, "seals": {record: seal(t) for record, t in truths.items()}})
    if truth_folder is not None:
        truth_folder.mkdir(parents=True, exist_ok=True)
        write_json(truth_folder / "truth.json", {"seed": str(seed), "truths": truths})


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write tables as JSON."""
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def tables(path: Path, *names: str) -> list[dict[str, Any]]:
    """Tables of a JSON file that `write` made."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return [dict(content[name].items()) for name in names]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        expected = " and ".join(f"`{name}`" for name in names)
        raise SuiteError(f"{path}: expected JSON with {expected}, as `write` made it ({error!r})") from None


def verified_seals(folder: Path) -> dict[str, str]:
    """Seals of a suite, by record, once every file has the sum that `sealed.json` states."""
    sums, seals = tables(folder / "sealed.json", "files", "seals")
    for name, expected in sums.items():
        path = folder / name
        if not path.is_file() or digest(path) != expected:
            raise SuiteError(f"{path}: missing or changed, expected SHA-256 {expected}; get this file anew")
    return seals


def answer(folder: Path, file: TextIO) -> None:
    """Write accelcal's answers on a suite: each record is searched whole, no part of it is held out."""
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(HEADER)
    for record in verified_seals(folder):
        rows: Mapping[str, tuple[str, str]] = {NOTHING: ("", "")}
        try:
            recording = ac.load(folder / f"{record}.csv")
            begin = recording.position.t[0]
            rows = rows_of(ac.improve(recording, holdout=recording.part(begin, begin + SHORT)))
        except ac.AccelcalError as error:
            print(f"{record}: answered by {NOTHING!r}: {error}", file=sys.stderr)
        writer.writerows([record, name, *size] for name, size in rows.items())


def rows_of(improvement: ac.Improvement) -> dict[str, tuple[str, str]]:
    """Classes, with size and std, in the order of their discovery; rivals follow the effect that is named."""
    rows: dict[str, tuple[str, str]] = {}
    for finding in improvement.detected:
        size = ("", "")
        if finding.effect in SIZED and finding.std and (finding.wave or len(finding.estimate) == 1):
            value = finding.estimate[0] if len(finding.estimate) == 1 else math.hypot(*finding.estimate)
            size = (f"{value:.6g}", f"{max(finding.std):.6g}")
        rows.setdefault(finding.effect if finding.effect in VISIBLE else OTHER, size)
        for rival in finding.rivals:
            rows.setdefault(rival if rival in VISIBLE else OTHER, ("", ""))
    return rows or {OTHER if improvement.verdict == "unexplained" else NOTHING: ("", "")}


def read_answers(path: Path, records: Sequence[str]) -> dict[str, Answer]:
    """Answers by record; each has at least one row."""
    try:
        lines = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, ValueError, csv.Error) as error:
        raise SuiteError(f"{path}: expected a CSV file of answers in UTF-8 ({error})") from None
    if not lines or lines[0] != HEADER:
        raise SuiteError(f"{path}, row 1: expected the header {','.join(HEADER)}")
    answers: dict[str, Answer] = {record: {} for record in records}
    for number, line in enumerate(lines[1:], start=2):
        record, name, *cells = (cell.strip() for cell in (*line, "", ""))
        before = answers.get(record, {})
        if len(line) != len(HEADER):
            wrong = f"{len(line)} cells; expected {len(HEADER)}, an empty one where there is no value"
        elif record not in answers:
            wrong = f"column record: {record!r}; expected one of {', '.join(answers)}"
        elif name not in (*VISIBLE, NOTHING, OTHER):
            wrong = f"column class: {name!r}; expected a class of DATASHEET.md, {NOTHING!r} or {OTHER!r}"
        elif name in before or (before and NOTHING in (name, *before)):
            wrong = f"column class: {name!r} beside {', '.join(before)}; expected each class once, or {NOTHING!r} alone"
        else:
            wrong, before[name] = size_in(cells[:2])
        if wrong:
            raise SuiteError(f"{path}, row {number}, {wrong}")
    for record, classes in answers.items():
        if not classes:
            raise SuiteError(f"{path}: record {record} has no row; expected {NOTHING!r} where nothing was found")
    return answers


def size_in(cells: Sequence[str]) -> tuple[str, tuple[float, float] | None]:
    """What is wrong with size and std of a row, and both; None where both cells are empty."""
    try:
        size, std = (float(cell) for cell in cells)
    except ValueError:
        size, std = math.nan, math.nan
    if math.isfinite(size) and 0.0 < std < math.inf:
        return "", (size, std)
    wrong = f"columns size and std: {', '.join(map(repr, cells))}; expected two numbers, std above 0, or both empty"
    return wrong if any(cells) else "", None


def score(folder: Path, answers_file: Path, truth_file: Path) -> dict[str, float]:
    """Figures of a file of answers.

    Returns
    -------
    Counts `hidden`, `in_class`, `first`, `answered`, `nulls`, `false` and `sized`; `class_size`, the mean number of
    classes in an answer to a record that hides one; `z`, the rms of (size − truth)/std. Both are nan without a count.

    Raises
    ------
    SuiteError
        If a file was changed since it was sealed, a truth does not open its seal, or a row of answers is wrong.
    """
    seals = verified_seals(folder)
    (truths,) = tables(truth_file, "truths")
    for record, expected in seals.items():
        if seal(truths.get(record)) != expected:
            raise SuiteError(f"{truth_file}: record {record}: does not open its seal; expected the truth of this suite")
    answers = read_answers(answers_file, list(seals))
    figures: dict[str, float] = dict.fromkeys(("hidden", "in_class", "first", "answered", "nulls", "false"), 0)
    sizes, errors = [], []
    for record, rows in answers.items():
        effect = truths[record]["effect"]
        names = [name for name in rows if name != NOTHING and name not in truths[record]["beside"]]
        if effect == NOTHING:
            figures["nulls"] += 1
            figures["false"] += bool(names)
            continue
        right = [name for name in names if name == effect or {name, effect} <= set(DELAY_CLASS)]
        figures["hidden"] += 1
        figures["answered"] += bool(names)
        figures["in_class"] += bool(right)
        figures["first"] += bool(right) and names[0] in right
        sizes += [len(names)] if names else []
        pairs = [pair for name in right if effect in SIZED and (pair := rows[name])]
        errors += [(size - truths[record]["size"]) / std for size, std in pairs[:1]]
    figures["class_size"] = float(np.mean(sizes)) if sizes else math.nan
    return figures | {"sized": len(errors), "z": math.sqrt(np.mean(np.square(errors))) if errors else math.nan}


REPORT = """data files and truths agree with their seals
right in class: {in_class} of {hidden}
first right: {first} of {hidden}
mean class size: {class_size:.2f} of {answered} answers
false names where nothing is hidden: {false} of {nulls}
sizes, rms of (size - truth)/std: {z:.2f} of {sized}, 1 is expected"""


def data_sheet(records: int) -> str:
    """The data sheet: what a record is, what may be hidden and by which formula, how answers are written and scored."""
    head = SHEET.format(records=records, seconds=SECONDS, rig=RATES, d=STRENGTH, nothing=NOTHING, other=OTHER)
    return head + "\n".join(map(section, VISIBLE))


def section(name: str) -> str:
    """A class of the data sheet: unit, words, and the lines of the simulator that add it."""
    effect = CATALOGUE[name]
    source = textwrap.dedent(inspect.getsource(effect.add))
    (function,) = ast.parse(source).body
    code = textwrap.dedent("\n".join(source.splitlines()[function.body[1].lineno - 1 :]))
    scored = "scored" if name in SIZED else "not scored"
    words = " ".join(f"Size in {effect.unit} ({scored}); enters at `{effect.place}`. {effect.source}".split())
    lines = f"```python\n# {function.args.args[1].arg} is the signal\n{code}\n```"
    return f"### `{name}`\n\n{textwrap.fill(words, 120)}\n\n{lines}\n"


SHEET = """# Accelerometers against an encoder: {records} records with hidden effects

Each record is {seconds:g} s of an accelerometer on a stage that moves along a level rail past a linear encoder. Most
records hide one effect of the classes below at a distance of about {d:g} standard deviations from zero, all else
estimated; about a quarter hides nothing. The task: name the effect, give its size, and name nothing where nothing is
hidden. Records are simulated by `tests/worlds` of accelcal, which shares no formula with its estimator; they are made
again bit for bit from the seed, so that no repository holds them. Data, seals and this sheet: CC0 1.0.

## A record

`rNN.csv` has one row for each sample of the fastest channel; each channel has a clock of its own, therefore two
columns. All stamps count from one instant, and the clocks agree unless a class that enters at `clock` is hidden. An
empty cell is a reading that is missing: the slower channels end earlier, and the encoder may lose a tenth at random.

| column | unit | rate, Hz | meaning |
|---|---|---|---|
| `t_accel` | s | {rig.accel_rate} | stamp of `accel` |
| `accel` | m/s² | | output along the rail, nominal scale factor 1 |
| `t_position` | s | {rig.encoder_rate} | stamp of `position` |
| `position` | m | | reading of the encoder |
| `t_temperature` | s | 10.003 | stamp of `temperature` |
| `temperature` | °C | | thermometer at the element: lag 0.3 s, noise 2 mK, resolution 1 mK |
| `t_a_y` | s | {rig.lateral_rate} | stamp of `a_y` |
| `a_y` | m/s² | | transverse acceleration, horizontal, noise 20 µg/√Hz |

A tool may assume: K0 within ±0.3 m/s², in some records all that the data sheet allows (±0.3 m/s² of CXL02, ±25 m/s² of
ADXL105); k within ±0.02; white noise of the density in the sidecar (ADXL105 225 µg/√Hz and ±5 g, CXL02 20 µg/√Hz and
±2 g) before an RC low-pass of exactly 159 Hz; a converter of 16 or 14 bits over the range; encoder noise of 1 µm,
standard deviation, then rounded to 1 µm; a rail level within 1 mrad (K0 takes this up). The sidecar `rNN.toml` says
this in accelcal's form; it holds nothing else, and a tool needs no accelcal to read the CSV.

Bearings may vibrate at 200 to 300 Hz with an amplitude that grows with v² (class `vibration`), and a converter of 14
bits is visible (class `quantisation`). Where the truth lists them under `beside`, their names count neither as right
nor as wrong and are left out of the size of a class.

## Answers

A CSV file with the header `record,class,size,std`. For each record one row for each class that explains it, the most
probable first; several rows are one class of confounded effects. `{nothing}` is the only row of a record in which
nothing was found; `{other}` says that an effect is there and none of the classes. Size and standard deviation are in
the unit of the class, or both cells are empty. `python -m benches.suite score FOLDER ANSWERS.csv TRUTH.json` prints:

- right in class: the hidden effect is among the rows; first right: it is the first of them;
- mean class size: rows of a record that hides an effect, on average of those answered. All three are read together;
- false names: records that hide nothing and are answered by any class;
- sizes: rms of (size - truth)/std over right rows of classes marked "scored"; 1 is expected, 0.7 is too careful.

`time_offset`, `sensor_lag` and `sensor_resonance` are the same delay on most motions and count as one class; the size
of each is its delay, s.

## Seals

`sealed.json` has the SHA-256 of every file and, for each record, that of its truth: effect, size, unit, shape
parameters, K0, k, `beside` and a salt, as JSON with sorted keys, no blanks, in UTF-8. `truth.json` opens them later,
and holds the seed, from which the same versions of NumPy and SciPy make every file again. The seals hide the truth as
long as the seed is secret: 128 random bits by default. A suite of a published seed is open.

## Classes

The output is, from the true acceleration a of the stage on,

    f0 = a + force        f = f0 + dynamics        y = K0 + (1 + k) f + response

then `clip`, `clock`, the low-pass, the noise, the converter and `sample`; the reading is p + noise + `scale` +
`encoder` + `reading`, rounded. Each class adds what its lines return where it "enters": `m` is its size (the truth
states (1 + k) m for `force` and `dynamics`), the signal is what arrives there, `shape` has its drawn parameters, `rng`
draws random numbers. Two differ: at `sample`, `timing_jitter` moves the instants of the samples by the times that it
returns, and the vibration that `vibration_rectification` lives on is felt as a force as well. `scene` holds the truth
at 10 kHz (STEP = 1e-4 s): t, p, v, a, jerk, temperature, a_y; `scene.bearing(m, n)` vibrates at 200 to 300 Hz with the
amplitude m (|v|/max |v|)^n. G0 = 9.80665 m/s², REFERENCE_TEMPERATURE = 24 °C. `lag(u, tau)` solves tau x' = u - x from
rest, `play(u, r)` is the play operator of half width r, `resonate(u, f0, Q)` a mass on a spring, `read_late(scene, y,
late)` y(t - late) - y(t), `lfilter` that of SciPy.

"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write, answer or score; 3 where a file is not what it should be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    writing = verbs.add_parser("write", help="write data files, data sheet and seals")
    answering = verbs.add_parser("answer", help="print accelcal's answers")
    scoring = verbs.add_parser("score", help="verify the seals and score a file of answers")
    for verb in (writing, answering, scoring):
        verb.add_argument("folder", type=Path)
    writing.add_argument("--records", type=int, default=24)
    writing.add_argument("--seed", type=int, default=secrets.randbits(128), help="by default 128 random bits")
    writing.add_argument("--open", type=Path, metavar="FOLDER2", help="write truth.json into this folder")
    scoring.add_argument("answers", type=Path)
    scoring.add_argument("truth", type=Path)
    options = parser.parse_args(arguments)
    try:
        if options.verb == "write":
            write(options.folder, options.seed, options.records, options.open)
            print(f"{options.folder}: written; --seed {options.seed} opens it: keep the seed secret until then")
        elif options.verb == "answer":
            answer(options.folder, sys.stdout)
        else:
            print(REPORT.format(**score(options.folder, options.answers, options.truth)))
    except SuiteError as refused:
        print(refused, file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
