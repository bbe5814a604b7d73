"""Formulas of one session are neither seen by another nor stand in its way, and are tried where Cancel reaches them."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from accelcal.app import tasks
from accelcal.app.session_file import read
from accelcal.app.workbench import Workbench
from accelcal.app.workers import Workers, draw
from accelcal.effects import BUILT_IN, CATALOGUE, ExpressionError, find, from_expression
from accelcal.effects.own import probe

from . import workbench_tasks as work
from .workbench import has_ended, write

LAW = "law_of_one_session"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("run") / "run.csv", 1)


@pytest.fixture
def benches(run: Path, tmp_path: Path) -> tuple[Workbench, Workbench]:
    benches_here = Workbench(tmp_path / "one"), Workbench(tmp_path / "two")
    for bench in benches_here:
        bench.folder.mkdir()
        bench.load(run)
    return benches_here


def of(bench: Workbench) -> str:
    """What the formula means in the catalogue of a workbench."""
    with bench.catalogue():
        return find(LAW).card


def test_the_same_name_means_in_each_session_what_its_user_wrote(benches: tuple[Workbench, Workbench]) -> None:
    before = dict(CATALOGUE)
    first, two = benches
    first.own_effect(LAW, "a**3", "", "output")
    with two.catalogue():
        assert LAW not in CATALOGUE
    two.own_effect(LAW, "v * abs(v)", "1/m", "output")
    assert first.sentence == two.sentence == ""
    assert (of(first), of(two)) == ("Own effect: a ** 3.", "Own effect: v * abs(v).")
    assert before == CATALOGUE
    for bench in benches:
        bench.fit()
        bench.add(LAW)
        assert bench.sentence == ""
    assert (of(first), of(two)) == ("Own effect: a ** 3.", "Own effect: v * abs(v).")
    three = Workbench(first.folder / "three")
    three.folder.mkdir()
    remaining = three.folder / "work.accelcal"
    remaining.write_bytes(first.session())
    two.open(remaining)  # in the place of its own work
    assert two.sentence == ""
    assert of(two) == "Own effect: a ** 3."
    assert [formula.expression for formula in read(remaining)[0].own] == ["a ** 3"]
    assert before == CATALOGUE


def test_an_action_that_fails_or_is_undone_leaves_no_effect(benches: tuple[Workbench, Workbench]) -> None:
    bench, _ = benches
    bench.own_effect(LAW, "1 / a", "", "output")
    assert "not finite" in bench.sentence
    bench.own_effect(LAW, "a**3", "", "output")
    bench.undo()
    with bench.catalogue():
        assert LAW not in CATALOGUE
    bench.own_effect(LAW, "a**5", "", "output")
    assert of(bench) == "Own effect: a ** 5."
    bench.own_effect(LAW, "a**7", "", "output")
    assert "candidate already" in bench.sentence
    bench.own_effect("cubic", "a**7", "", "output")
    assert "there is an effect called so already" in bench.sentence


def test_figures_are_drawn_with_the_effects_of_their_session(benches: tuple[Workbench, Workbench]) -> None:
    expressions = {LAW: "a**3"}, {LAW: "a**5"}
    for bench, expression in zip(benches, expressions, strict=True):
        bench.own_effect(LAW, expression[LAW], "", "output")

    async def drawn(bench: Workbench) -> float:
        with bench.catalogue():
            await asyncio.sleep(0.01)
            return await draw(lambda: float(find(LAW).column(probe(()))[5]))

    async def both() -> list[float]:
        return await asyncio.gather(*(drawn(bench) for bench in benches * 8))

    a = float(probe(()).a[5])
    np.testing.assert_allclose(asyncio.run(both()), [a**3, a**5] * 8)


def test_a_catalogue_apart_forgets_what_went_on_inside() -> None:
    before = dict(CATALOGUE)
    with CATALOGUE.apart():
        from_expression(LAW, "a**3")
        del CATALOGUE["cubic"]
        with CATALOGUE.apart():
            assert before == CATALOGUE
        assert LAW in CATALOGUE
        entered: list[bool] = []
        thread = threading.Thread(target=lambda: entered.append(LAW in CATALOGUE))
        thread.start()
        thread.join()
        assert entered == [False]
        with pytest.raises(ExpressionError, match="already"):
            from_expression(LAW, "a**5")
    assert before == CATALOGUE
    assert tuple(CATALOGUE.values())[: len(BUILT_IN)] == BUILT_IN


@pytest.fixture
def workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Workers]:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]), prepend=":")
    workers_here = Workers(tmp_path, 1)
    yield workers_here
    workers_here.close()


def test_a_formula_is_tried_in_a_worker_that_cancel_ends(
    run: Path, tmp_path: Path, workers: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Workbench(tmp_path / "home", workers)
    bench.folder.mkdir()
    bench.load(run)
    monkeypatch.setattr(tasks, "tried", work.try_for_ever)
    note, before = tmp_path / "note", bench.state
    action = threading.Thread(target=bench.own_effect, args=(LAW, "a**3", "", "output"))
    action.start()
    while not note.exists():
        assert action.is_alive(), bench.sentence
        time.sleep(0.01)
    bench.cancel()
    action.join(30.0)
    assert not action.is_alive()
    assert has_ended(int(note.read_text()))
    assert bench.state is before
    assert bench.sentence == "Cancelled; nothing was changed."


def test_nothing_of_a_formula_is_evaluated_in_the_server(
    run: Path, tmp_path: Path, workers: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Workbench(tmp_path / "home", workers)
    bench.folder.mkdir()
    bench.load(run)

    def refuse(*args: object) -> None:
        raise AssertionError("evaluated in the server")

    monkeypatch.setattr("accelcal.effects.own._try_out", refuse)
    monkeypatch.setattr("accelcal.effects.guard.timed", refuse)
    bench.own_effect(LAW, "a**3", "", "output")
    assert bench.sentence == ""
    saved = tmp_path / "work.accelcal"
    saved.write_bytes(bench.session())
    bench.open(saved)
    assert bench.sentence == ""
    assert of(bench) == "Own effect: a ** 3."
    bench.own_effect("constant", "a*0 + 1", "1", "output")
    assert "constant on an ordinary motion" in bench.sentence
