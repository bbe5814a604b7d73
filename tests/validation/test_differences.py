"""Several models on the same recordings: the difference has an interval that holds, and all faces say the same."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import accelcal as ac
from accelcal.cli import app, write_recording
from accelcal.cli.printing import show_comparison
from accelcal.results import model_file
from accelcal.simulation import CXL02_RIG
from accelcal.validation import evaluation
from accelcal.validation.differences import (
    LEAST_STRETCHES,
    Comparison,
    HeldOutChange,
    ModelDifference,
    PairedStretches,
    headline_horizon,
    heldout_change,
    stretch_count,
    verdict_of,
)
from tests.schemas import require_published

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "cubic": 2e-3}


def record(seed: int, seconds: float) -> ac.Recording:
    rng = np.random.default_rng([41, seed])
    return ac.simulate("interleaved", seconds=seconds, rig=CXL02_RIG, parameters=TRUTH, rng=rng).recording


@pytest.fixture(scope="module")
def runs() -> list[ac.Recording]:
    return [record(2, 16.0), record(3, 18.0)]


@pytest.fixture(scope="module")
def fits() -> list[ac.Fit]:
    train = record(1, 16.0)
    return [ac.fit(train, model) for model in (ac.Model.linear(), ac.Model.cubic())]


@pytest.fixture(scope="module")
def paired(fits: list[ac.Fit], runs: list[ac.Recording]) -> Comparison:
    return ac.compare(fits, runs)


def test_the_interval_of_a_ratio_holds_the_truth() -> None:
    # Errors of two models that share half of their noise, correlated over a stretch; the true ratio is 0.8 or 1. With
    # 5 and with 15 stretches 95 % intervals hold it in 95 %; 93 to 97.5 % is 4 sigma of 1600 about that, and a little.
    rng = np.random.default_rng(7)
    for stretches in (5, 15):
        held, cases = 0, 1600
        for case in range(cases):
            ratio = (1.0, 0.8)[case % 2]
            shared, first, second = (np.repeat(rng.standard_normal(8 * stretches), 5) for _ in range(3))
            t = np.arange(len(shared)) * 0.025
            before, after = shared + first, ratio * (shared + second)
            change = PairedStretches.of("drift", t, before, after, 1.0).change()
            assert change is not None
            assert change.stretches == stretches
            low, high = change.percent_interval
            held += low <= 100.0 * (ratio - 1.0) <= high
        print(f"{stretches} stretches: {held} of {cases} intervals hold the true ratio")
        assert 0.93 < held / cases < 0.975


def test_an_interval_that_takes_every_error_for_its_own_is_too_short() -> None:
    # The twin: windows that overlap, each taken for independent.
    rng = np.random.default_rng(8)
    held = 0
    for _ in range(200):
        shared, first, second = (np.repeat(rng.standard_normal(40), 20) for _ in range(3))
        t = np.arange(len(shared)) * 0.025
        change = PairedStretches.of("drift", t, shared + first, shared + second, 0.025).change()
        assert change is not None
        low, high = change.percent_interval
        held += low <= 0.0 <= high
    assert held < 120


def test_the_right_model_is_better_and_by_how_much(paired: Comparison) -> None:
    (difference,) = paired.differences
    assert difference.verdict == "better"
    assert difference.pooled is not None
    low, high = difference.pooled.percent_interval
    assert low <= difference.pooled.percent < high < 0.0
    assert difference.sentence.startswith("base + quadratic + cubic is better than base: systematic error smaller by ")
    assert difference.pooled.measure == "systematic error"
    assert paired.paired_horizon == max(h for h in (1.0, 5.0, 10.0) if stretch_count(paired.evaluations[0][0], h) >= 5)
    assert len(difference.recordings) == 2
    assert all(change is not None for change in difference.recordings)


def test_pooled_stretches_are_those_of_all_recordings(paired: Comparison) -> None:
    (difference,) = paired.differences
    drift = next(change for change in difference.horizons if change.measure == "drift after 1 s")
    by_recording = [
        change for evaluations in paired.evaluations if (change := heldout_change(*evaluations, 1.0)) is not None
    ]
    assert drift.stretches == sum(change.stretches for change in by_recording)
    drifts = [len(evaluations[0].drifts[1.0][0]) for evaluations in paired.evaluations]
    samples = [evaluations[0].resolved[0].samples for evaluations in paired.evaluations]
    assert difference.pooled is not None
    for pooled, several, counts in ((drift, by_recording, drifts), (difference.pooled, difference.recordings, samples)):
        squares = [change.before**2 for change in several if change is not None]
        assert pooled.before == pytest.approx(np.sqrt(np.average(squares, weights=counts)))


def test_a_model_is_no_better_than_itself(fits: list[ac.Fit], runs: list[ac.Recording]) -> None:
    comparison = ac.compare([fits[1], fits[1]], runs[0])
    assert comparison.names == ("model 1 (base + quadratic + cubic)", "model 2 (base + quadratic + cubic)")
    (difference,) = comparison.differences
    assert difference.verdict == "undecided"
    assert "cannot be said" in difference.sentence


def test_too_few_stretches_and_recordings_that_disagree_are_said() -> None:
    better, worse = (HeldOutChange("drift after 1 s", 1.0, after, 0.1, 9, "m", 0.1) for after in (0.5, 2.0))
    assert [verdict_of(change) for change in (better, worse, None)] == ["better", "worse", "too_short"]
    both = ModelDifference("B", "A", HeldOutChange("drift after 1 s", 1.0, 1.0, 0.1, 18, "m", 0.1), (better, worse), ())
    assert both.disagree
    assert both.sentence.startswith("whether B is better than A cannot be said: drift after 1 s +0 % (95 % interval ")
    assert both.sentence.endswith("; the recordings disagree")
    alone = ModelDifference("B", "A", None, (None,), ())
    assert alone.sentence == "whether B is better than A cannot be said: the recordings are too short for an interval"


def test_the_headline_is_the_longest_horizon_with_enough_stretches(paired: Comparison) -> None:
    evaluation = paired.evaluations[0][0]
    counts = {h: stretch_count(evaluation, h) for h, drift in evaluation.coast_rms.items() if drift is not None}
    assert counts[1.0] >= LEAST_STRETCHES > counts[5.0]
    assert headline_horizon(evaluation) == 1.0
    assert max(counts) > 1.0  # the longest would have been another


def test_a_single_model_is_judged_as_by_itself(fits: list[ac.Fit], runs: list[ac.Recording]) -> None:
    alone, several = ac.compare(fits[0], runs[0]), ac.compare([fits[0]], runs)
    expected = evaluation.compare(fits[0], runs[0])  # with the filter of the fit itself
    for shown in (alone[0], alone.evaluations[0][0], several.evaluations[0][0]):
        assert (shown.coast_rms, shown.one_step_rms, shown.band) == (
            expected.coast_rms,
            expected.one_step_rms,
            expected.band,
        )
        assert np.array_equal(shown.accel_residual[1], expected.accel_residual[1])
    assert alone.differences == several.differences == ()
    rows = several.table().rows
    assert [row["recording"] for row in rows if row["model"] == "base"] == ["", *several.recordings]


def test_parts_of_each_recording_stand_in_the_table(paired: Comparison) -> None:
    rows = [row for row in paired.table().rows if row["model"] == paired.names[1]]
    assert [row["drift_1s"] for row in rows] == [paired[1].coast_rms[1.0]] + [
        s[1].coast_rms[1.0] for s in paired.evaluations
    ]
    (difference,) = paired.differences
    changes = [None if change is None else change.percent for change in (difference.pooled, *difference.recordings)]
    assert [row["change"] for row in rows] == changes
    models = {row["model"] for row in paired.table("regions").rows}
    assert models == set(paired.names)


def test_nested_models_are_fitted_to_the_recordings_of_the_fit() -> None:
    train, unseen = record(1, 16.0), record(2, 16.0)
    fit = ac.add(ac.fit(train), train, "cubic")
    nested = ac.nested(fit)
    assert [item.model.added for item in nested] == [(), ("cubic",)]
    assert nested[0]["bias"] == ac.nested(fit, train)[0]["bias"]
    comparison = ac.compare(nested, unseen)
    assert comparison.names == ("base", "base + cubic")
    assert comparison.errors[1] < comparison.errors[0]
    again = pickle.loads(pickle.dumps(fit))
    with pytest.raises(ac.RecordingError, match=r"no longer in memory; .*accelcal\.nested\(fit, recordings\)"):
        ac.nested(again)


def test_mistakes_are_said(fits: list[ac.Fit], runs: list[ac.Recording]) -> None:
    with pytest.raises(ValueError, match="at least one of each"):
        ac.compare([], runs)
    with pytest.raises(ValueError, match="a name of its own for each"):
        ac.compare(fits, runs, names=["a", "a"])


def test_frame_and_summary_have_the_numbers_of_the_difference(paired: Comparison) -> None:
    frame, (difference,) = paired.to_dataframe("changes"), paired.differences
    assert difference.pooled is not None
    assert frame.index.tolist() == [difference.name] * 4
    shown = frame[frame["measure"] == "systematic error"].iloc[-1]
    assert shown["percent"] == difference.pooled.percent
    assert (shown["low"], shown["high"]) == difference.pooled.percent_interval
    assert "is better than base" in str(paired)


def test_the_command_says_the_same(
    paired: Comparison,
    fits: list[ac.Fit],
    runs: list[ac.Recording],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, fit in zip("ab", fits, strict=True):
        model_file.save(fit, Path(f"{name}.json"))
    for number, run in enumerate(runs):
        write_recording(run, Path(f"{number}.csv"))

    def call(*words: str, code: int = 0) -> str:
        done = CliRunner().invoke(app, ["compare", *words])
        assert done.exit_code == code, done.output
        return done.stdout if code == 0 else done.stderr

    content = json.loads(call("a.json", "b.json", "0.csv", "1.csv", "--json", "-o", "seen.json", "--plots", "drawn"))
    require_published(content)
    again, expected = Comparison.from_json(json.dumps(content)), paired.differences[0].pooled
    assert expected is not None
    pooled = content["differences"][0]["pooled"]
    assert 100.0 * (pooled["after"] / pooled["before"] - 1.0) == pytest.approx(expected.percent, rel=1e-3)  # CSV rounds
    assert again.recordings == ("0.csv", "1.csv")
    assert json.loads(Path("seen.json").read_text()) == content
    assert {path.name for path in Path("drawn").iterdir()} == {
        f"{name}.{k}" for name in ("overlay-1", "overlay-2", "error_reduction") for k in ("png", "svg")
    }
    assert "found 1 files and no recording" in call("a.json", code=2)
    alone = json.loads(call("a.json", "0.csv", "1.csv", "--json"))
    assert (len(alone["names"]), len(alone["recordings"]), alone["differences"]) == (1, 2, [])
    assert "b.json comes after the recording 0.csv" in call("a.json", "0.csv", "b.json", code=2)
    assert "a.json is given twice" in call("a.json", "a.json", "0.csv", code=2)
    capsys.readouterr()
    show_comparison(paired)
    assert "is better than base: systematic error smaller by" in " ".join(capsys.readouterr().out.split())
