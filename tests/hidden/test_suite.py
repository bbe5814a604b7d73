"""The public suite of hidden effects: the same seed gives the same bytes, seals hold, and a score counts what is right.

Records are shorter and fewer than those of `python -m benches.suite write`.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import pytest

from benches import suite

SEED, RECORDS, SECONDS = 24, 3, 12.0
"""Nothing is hidden in r01, an effect with a size in r02 and in r03, beside which the bearings vibrate."""
EDITS: list[tuple[str, Callable[[str], str], str]] = [
    ("r01.csv", lambda text: text.replace("1", "2", 1), "r01.csv: missing or changed, expected SHA-256"),
    ("DATASHEET.md", lambda text: text + " ", "DATASHEET.md: missing or changed"),
    ("sealed.json", lambda text: "{}", "sealed.json: expected JSON with `files` and `seals`"),
    ("truth.json", lambda text: text.replace('"r01",', '"r01 ",', 1), "record r01: does not open its seal"),
    ("truth.json", lambda text: "[]", "truth.json: expected JSON with `truths`"),
    ("answers.csv", lambda text: "record,name\n", "row 1: expected the header record,class,size,std"),
    ("answers.csv", lambda text: text + "r99,cubic,,\n", "column record: 'r99'; expected one of r01, r02"),
    ("answers.csv", lambda text: text + "r01,qubic,,\n", "column class: 'qubic'; expected a class of DATASHEET.md"),
    ("answers.csv", lambda text: text + "r01,nothing,,\n", "expected each class once, or 'nothing' alone"),
    (
        "answers.csv",
        lambda text: text.replace("r01,nothing,,", "r01,other,1,0"),
        "columns size and std: '1', '0'; expected two numbers",
    ),
    ("answers.csv", lambda text: text + "r01,other\n", "2 cells; expected 4"),
    ("answers.csv", lambda text: "record,class,size,std\n", "record r01 has no row; expected 'nothing'"),
]


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A small suite, and the folder of its truth."""
    folder, opened = tmp_path_factory.mktemp("suite"), tmp_path_factory.mktemp("truth")
    with patch.object(suite, "SECONDS", SECONDS):
        suite.write(folder, SEED, RECORDS, opened)
    return folder, opened


@pytest.fixture
def copies(places: tuple[Path, Path], tmp_path: Path) -> Path:
    """All files of the suite in one folder, with perfect answers, to be edited."""
    for path in (*places[0].iterdir(), *places[1].iterdir()):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    answers(tmp_path, 1.0)
    return tmp_path


def truths(folder: Path) -> list[suite.Truth]:
    return list(json.loads((folder / "truth.json").read_text(encoding="utf-8"))["truths"].values())


def answers(folder: Path, sigmas: float, swap: dict[str, str] | None = None) -> Path:
    """Write the truth as answers, each size off by so many standard deviations, and classes replaced."""
    path = folder / "answers.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(suite.HEADER)
        for truth in truths(folder):
            size = [truth["size"] + 0.05 * sigmas, 0.05] if truth["effect"] != "nothing" else ["", ""]
            writer.writerow([truth["record"], (swap or {}).get(truth["effect"], truth["effect"]), *size])
    return path


def figures(folder: Path) -> dict[str, float]:
    return suite.score(folder, folder / "answers.csv", folder / "truth.json")


def test_the_same_seed_gives_the_same_bytes_and_another_seed_other_ones(
    places: tuple[Path, Path], tmp_path: Path
) -> None:
    with patch.object(suite, "SECONDS", SECONDS):
        suite.write(tmp_path / "again", SEED, RECORDS, tmp_path / "truth")
    for first, second in zip(places, (tmp_path / "again", tmp_path / "truth"), strict=True):
        names = sorted(path.name for path in first.iterdir())
        assert names == sorted(path.name for path in second.iterdir())
        assert all((first / name).read_bytes() == (second / name).read_bytes() for name in names)
    assert list(suite.plan(SEED, RECORDS)) != list(suite.plan(SEED + 1, RECORDS))


def test_a_perfect_answer_scores_all_and_a_wrong_one_nothing(copies: Path) -> None:
    perfect = figures(copies)
    assert perfect["in_class"] == perfect["first"] == perfect["hidden"] == RECORDS - 1
    assert (perfect["nulls"], perfect["false"], perfect["class_size"]) == (1, 0, 1.0)
    assert perfect["sized"] == 2
    assert perfect["z"] == pytest.approx(1.0, rel=1e-9)  # every size was moved by one standard deviation
    answers(copies, 0.0, {truth["effect"]: "other" for truth in truths(copies)})
    wrong = figures(copies)
    assert (wrong["in_class"], wrong["first"], wrong["false"], wrong["sized"]) == (0, 0, 1, 0)
    answers(copies, 0.0, {truth["effect"]: "nothing" for truth in truths(copies)})
    assert [figures(copies)[key] for key in ("in_class", "answered", "false")] == [0, 0, 0]


def test_a_nuisance_of_a_record_counts_neither_way(copies: Path) -> None:
    noisy = next(truth for truth in truths(copies) if truth["beside"] and truth["effect"] != "nothing")
    path = copies / "answers.csv"
    header, _, rows = path.read_text(encoding="utf-8").partition("\n")
    path.write_text(f"{header}\n{noisy['record']},{noisy['beside'][0]},,\n{rows}", encoding="utf-8")
    beside = figures(copies)
    assert (beside["first"], beside["class_size"]) == (beside["hidden"], 1.0)


@pytest.mark.parametrize(("name", "edit", "sentence"), EDITS, ids=[sentence for _, _, sentence in EDITS])
def test_a_changed_file_or_a_wrong_row_ends_in_a_sentence(
    copies: Path, capsys: pytest.CaptureFixture[str], name: str, edit: Callable[[str], str], sentence: str
) -> None:
    path = copies / name
    path.write_text(edit(path.read_text(encoding="utf-8")), encoding="utf-8")
    assert suite.main(["score", str(copies), str(copies / "answers.csv"), str(copies / "truth.json")]) == 3
    assert sentence in capsys.readouterr().err


def test_a_seal_hides_the_class_and_the_sidecars_differ_by_the_sensor_alone(places: tuple[Path, Path]) -> None:
    text = (places[0] / "sealed.json").read_text(encoding="utf-8")
    assert not any(truth["effect"] in text or truth["salt"] in text for truth in truths(places[1]))
    sidecars = [path.read_text(encoding="utf-8").partition("[rig]") for path in places[0].glob("*.toml")]
    assert len({rest for _, _, rest in sidecars}) == 1


def test_the_data_sheet_names_every_column_and_every_class(places: tuple[Path, Path]) -> None:
    sheet = (places[0] / "DATASHEET.md").read_text(encoding="utf-8")
    columns = {name for path in places[0].glob("*.csv") for name in path.open(encoding="utf-8").readline().split(",")}
    assert len(columns) == 8
    assert [name for name in columns if f"| `{name.strip()}` |" not in sheet] == []
    assert [name for name in suite.VISIBLE if f"### `{name}`\n" not in sheet] == []


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--records", "1"], "expected a seed of 0 or more, and 2 to"),
        (["--seed", "-1"], "expected a seed of 0 or more"),
        (["--open", "suite/truth"], "expected a folder outside suite"),
        (["--open", "full"], "full: expected a new or an empty folder"),
    ],
)
def test_what_cannot_be_written_ends_in_a_sentence(
    arguments: list[str],
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("kept", encoding="utf-8")
    assert suite.main(["write", "suite", *arguments]) == 3
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "suite").exists()


def test_rivals_follow_the_effect_and_a_wave_has_one_amplitude() -> None:
    findings = [
        finding("tone", (3e-3, 4e-3), (1e-4, 2e-4), ("shape_of_time", "cubic"), {"frequency": 50.0}),
        finding("cubic", (1e-3,), (1e-5,), ()),
        finding("encoder_nonlinearity", (1.0, 2.0), (0.1, 0.1), ()),
    ]
    rows = suite.rows_of(SimpleNamespace(detected=findings, verdict="tied"))
    assert rows == {"tone": ("0.005", "0.0002"), "other": ("", ""), "cubic": ("", ""), "encoder_nonlinearity": ("", "")}
    assert next(iter(rows)) == "tone"
    for verdict, name in (("adequate", "nothing"), ("unexplained", "other")):
        assert suite.rows_of(SimpleNamespace(detected=[], verdict=verdict)) == {name: ("", "")}


def finding(
    effect: str,
    estimate: tuple[float, ...],
    std: tuple[float, ...],
    rivals: tuple[str, ...],
    wave: dict[str, float] | None = None,
) -> SimpleNamespace:
    return SimpleNamespace(effect=effect, estimate=estimate, std=std, rivals=rivals, wave=wave)


def test_accelcal_answers_from_the_data_files(places: tuple[Path, Path], tmp_path: Path) -> None:
    path = tmp_path / "answers.csv"
    with path.open("w", encoding="utf-8") as file:
        suite.answer(places[0], file)
    figures = suite.score(places[0], path, places[1] / "truth.json")
    assert (figures["in_class"], figures["false"]) == (2, 0)  # 1 % each outside its class, 0.5 % falsely named
