"""Mutated orientations, angles, dwells and three outputs: a right answer, a finding, or one sentence and its exit code.

`make test-hostile` runs every case of `orientations.CHANGES`.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from tests.commands import accelcal

from .case import cases
from .orientations import CHANGES, Record, case_of, simulated

FEW = {"attitude": 5, "angle": 5, "dwells": 5, "faces": 5, "guide": 4, "outputs": 4}
"""Cases of a slice."""
MOST_OFF = 6.0
"""Standard deviations by which a parameter may differ from the truth; beyond 6 lies one of 5e8."""
FLAGGED = "warning: |suspect data: |implausible|fitted noise density|had not settled|dwells scatter|positions scatter"
"""What a check or a fit notices of a record without an answer."""
REFUSED = "not one axis of one body|as good as zero beside|acceleration was not excited"
"""Refusals of an answer that no sensor gives."""
NEXT = (
    "expected|send|[Cc]heck|[Gg]ive|[Ww]rite|[Cc]orrect|[Dd]rop|[Rr]ecord|[Aa]dd|[Cc]omplete|[Ll]eave|[Mm]ap|[Ll]ook|"
    "[Oo]pen|each as"
)
"""Words of a next step."""
LONGEST = 1500
"""Characters of a refusal, with the lines to write."""


@dataclass(frozen=True)
class Answer:
    """What the commands on a record ended with."""

    refusal: str
    """Of the last; empty where there was none."""
    code: int
    off: float
    """Largest distance of a parameter from the truth, standard deviations."""
    noticed: str
    """What check and fit print beside the numbers."""


def commands(section: str, number: int) -> list[tuple[str, ...]]:
    """Commands on the record of a case, the one that estimates last; the diagnosis of every sixteenth motion, too."""
    if section == "faces":
        return [("dwells", "run.csv", "--yes", "--json")]
    if section == "guide":
        return [("dwells", "run.csv", "--guide", "--rig", "run.toml", "--json")]
    diagnosed = [("diagnose", "m.json", "run.csv")] if section == "dwells" or number % 16 == 0 else []
    return [("check", "run.csv"), ("fit", "run.csv", "-o", "m.json", "--json"), *diagnosed]


def answer(section: str, number: int, record: Record, folder: Path) -> Answer:
    """Run the commands of a case, to the first that refuses it."""
    record.write(folder / "run.csv")
    noticed, off = "", 0.0
    for words in commands(section, number):
        ended = accelcal(*words, cwd=folder)
        if ended.returncode:
            return Answer(ended.stderr[ended.stderr.find("accelcal: ") :], ended.returncode, off, noticed)
        if words[0] in ("check", "diagnose"):
            noticed += ended.stdout
        else:
            off, remarks = estimated(ended, record)
            noticed += remarks
    return Answer("", 0, off, noticed)


def estimated(ended: CompletedProcess[str], record: Record) -> tuple[float, str]:
    """Largest distance from the truth, standard deviations, and the remarks of a fit."""
    content = json.loads(ended.stdout)
    if "values" in content:
        std = dict(content["std"])
        pairs = {tuple(name.split("_")): (y, std[name]) for name, y in content["values"].items()}
        remarks = content["remarks"]
    else:
        pairs = {(e["name"], e["axis"]): (e["value"], e["std"]) for e in content["estimates"]}
        several = [*content["remarks"], *(content["dwells"] or {"remarks": []})["remarks"]]
        remarks = [remark["sentence"] for remark in several]
    off = [abs(pairs[key][0] - y) / pairs[key][1] for key, y in record.truth.items() if key in pairs and pairs[key][1]]
    assert off, "no parameter is compared"
    return max(off), "\n".join(remarks)


def wrong(result: Answer, record: Record, names: str) -> str:
    """What is wrong with an answer; empty where nothing is."""
    if result.code:
        sentence = result.refusal.startswith("accelcal: ") and "Traceback" not in result.refusal
        if result.code not in (2, 3, 4) or not sentence or len(result.refusal) > LONGEST:
            return f"exit {result.code}: {result.refusal[:300]}"
        if not re.search(r"run\.(csv|toml)", result.refusal) or not re.search(NEXT, result.refusal):
            return f"no file or no next step: {result.refusal}"
        if not names or not re.search(f"{names}|{REFUSED}", result.refusal):
            return f"expected {names!r}: {result.refusal}"
        (column, at), *more = [*record.spoilt.items(), ("", [])] if record.spoilt else [("", [])]
        placed = re.search(rf"row {at[0] + 2}\b|t = ", result.refusal) if len(at) == 1 and len(more) == 1 else True
        return "" if placed else f"row {at[0] + 2} of {column} is not named: {result.refusal}"
    flags = f"{names}|{FLAGGED}" if names else FLAGGED
    if result.off > MOST_OFF and not re.search(flags, result.noticed):
        return f"{result.off:.1f} standard deviations from the truth, and nothing is noticed: {result.noticed[-600:]}"
    return ""


@pytest.mark.parametrize("section", CHANGES)
def test_a_mutated_record_is_answered_right_noticed_or_refused_in_a_sentence(section: str, tmp_path: Path) -> None:
    failures, refused = [], 0
    numbers = cases(FEW[section], len(CHANGES[section]))
    for number in numbers:
        record, name, names = case_of(section, number)
        folder = tmp_path / str(number)
        folder.mkdir()
        result = answer(section, number, record, folder)
        refused += result.code != 0
        if failure := wrong(result, record, names):
            failures.append(f"{section} {number}, {name}: {failure}")
    print(f"{section}: {len(numbers)} mutated, {refused} refused, {len(failures)} wrong (threshold 0)")
    assert not failures, "\n".join(failures)


def test_there_are_300_changes_and_a_slice_reaches_several_of_each_kind() -> None:
    assert sum(map(len, CHANGES.values())) >= 300
    for section, few in FEW.items():
        count = len(CHANGES[section])
        assert len({number * 37 % count for number in range(count)}) == count
        assert few <= count


@pytest.mark.parametrize(
    ("result", "text"),
    [
        (Answer("", 0, 10.0, "nothing"), "10.0 standard deviations"),
        (Answer("accelcal: Traceback", 1, 0.0, ""), "exit 1"),
        (Answer("accelcal: run.csv: row 7, column q_w is wrong; correct it", 70, 0.0, ""), "exit 70"),
        (Answer("accelcal: row 7, column q_w is wrong; correct it", 3, 0.0, ""), "no file"),
        (Answer("accelcal: run.csv: row 7, column q_w is wrong", 3, 0.0, ""), "no next step"),
        (Answer("accelcal: run.csv: row 7 is wrong; correct it", 3, 0.0, ""), "expected 'q_w'"),
        (Answer("accelcal: run.csv: row 8, column q_w is wrong; correct it", 3, 0.0, ""), "row 7 of q_w"),
    ],
)
def test_a_planted_wrong_answer_is_noticed(result: Answer, text: str) -> None:
    # The sister that must fail: each answer is wrong in one way.
    record = Record({"q_w": ["1"] * 9}, "", {}, {"q_w": [5]})
    assert text in wrong(result, record, "q_w")
    assert not wrong(Answer("accelcal: run.csv: row 7, column q_w is wrong; correct it", 3, 0.0, ""), record, "q_w")


def test_a_wrong_truth_of_an_untouched_record_is_noticed(tmp_path: Path) -> None:
    # The sister that must fail: the right answer beside a bias that the simulation did not have.
    record = simulated("dwells")
    right = answer("dwells", 0, record, tmp_path)
    assert not wrong(right, record, "")
    shifted = Record(record.columns, record.sidecar, {**record.truth, ("bias", ""): 0.051})
    (tmp_path / "again").mkdir()
    assert "standard deviations from the truth" in wrong(answer("dwells", 0, shifted, tmp_path / "again"), shifted, "")
