"""The examples of the first screen: the product finds what each of them hides."""

from __future__ import annotations

from pathlib import Path

import pytest

from accelcal.app.tasks import EXAMPLES, example_of
from accelcal.app.workbench import Workbench
from accelcal.effects import spelled


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_hidden_effect_is_found_and_the_error_falls(name: str, tmp_path: Path) -> None:
    bench, hidden = Workbench(tmp_path), EXAMPLES[name]
    bench.example(name)
    assert example_of(bench.state.file) is hidden
    bench.fit("linear")
    bench.diagnose()
    assert bench.diagnosis is not None
    assert [result.effect for result in bench.diagnosis.scan.detected][:1] == [hidden.effect]
    bench.add(hidden.effect)
    before, after = (step.heldout.coast_rms[1.0] for step in bench.state.path)
    assert before is not None
    assert after is not None
    assert after < 0.5 * before
    assert bench.state.step is not None
    estimate = bench.state.step.fit[hidden.effect]
    assert abs(estimate.value - hidden.size) < 4.0 * estimate.std


def test_examples_differ_and_none_gives_its_answer_away() -> None:
    assert len({e.effect for e in EXAMPLES.values()}) == len({e.motion for e in EXAMPLES.values()}) == 3
    for example in EXAMPLES.values():
        assert spelled(example.effect) in example.answer
        assert spelled(example.effect) not in f"{example.title} {example.about}"
    assert example_of(Path("run.csv")) is None
    assert example_of(Path("example_of_mine.csv")) is None
