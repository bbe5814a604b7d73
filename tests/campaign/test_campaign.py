"""A campaign: what its file holds, how it goes on, what it refuses."""

from __future__ import annotations

import dataclasses
import sqlite3
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from accelcal.fleet import campaign
from accelcal.fleet.campaign import CampaignError, Task, compute
from tests.campaign import tasks
from tests.campaign.contents import contents, counted


class Here(Executor):
    """Does the work at once, in the calling thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future that is done."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def draws(store: Path, count: int, **others: Any) -> campaign.Count:
    return campaign.run(tasks.draw, campaign.seeds(1, count), store=store, **{"executor": Here(), **others})


def test_values_are_those_of_the_spawned_seeds(tmp_path):
    assert draws(tmp_path / "c.sqlite", 5, parameters={"scale": 2.0}) == campaign.Count(computed=5, stored=0, failed=0)
    recording = campaign.load(tmp_path / "c.sqlite")
    expected = [2.0 * np.random.default_rng(s).standard_normal() for s in np.random.SeedSequence(1).spawn(5)]
    assert recording.values["x"].tolist() == expected
    assert recording.items == ("1:0", "1:1", "1:2", "1:3", "1:4")
    assert recording.runs.tolist() == [0, 1, 2, 3, 4]
    assert not recording.errors


@settings(max_examples=20, deadline=None)
@given(batch=st.integers(1, 60), cut=st.integers(0, 40))
def test_contents_depend_neither_on_batches_nor_on_where_it_was_cut(tmp_path_factory, batch, cut):
    folder = tmp_path_factory.mktemp("c")
    draws(folder / "whole.sqlite", 40)
    draws(folder / "parts.sqlite", cut, batch=batch)
    assert draws(folder / "parts.sqlite", 40, batch=batch).stored == cut
    assert contents(folder / "parts.sqlite") == contents(folder / "whole.sqlite")


def test_another_seed_gives_other_contents(tmp_path):
    for entropy in (1, 2):
        campaign.run(tasks.draw, campaign.seeds(entropy, 3), store=tmp_path / f"{entropy}.sqlite")
    assert contents(tmp_path / "1.sqlite") != contents(tmp_path / "2.sqlite")


def test_a_complete_campaign_computes_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv(tasks.CALLS, str(tmp_path / "calls"))
    draws(tmp_path / "c.sqlite", 7)
    assert draws(tmp_path / "c.sqlite", 7) == campaign.Count(computed=0, stored=7, failed=0)
    assert counted(tmp_path / "calls") == {f"1:{i}": 1 for i in range(7)}


def test_a_failing_run_is_kept_with_its_error_and_the_others_go_on(tmp_path, monkeypatch):
    monkeypatch.setenv(tasks.CALLS, str(tmp_path / "calls"))
    store = tmp_path / "c.sqlite"
    for _ in range(2):
        count = campaign.run(tasks.sometimes, campaign.seeds(1, 7), store=store)
    assert (count.stored, count.failed) == (7, 2)
    recording = campaign.load(store)
    assert recording.errors == {f"1:{i}": f"ValueError: run {i} has had enough" for i in (2, 5)}
    np.testing.assert_array_equal(recording.values["x"], [0, 1, np.nan, 3, 4, np.nan, 6])
    np.testing.assert_array_equal(recording.values["y"], [np.nan, np.inf, np.nan, np.nan, np.inf, np.nan, np.nan])
    assert set(counted(tmp_path / "calls").values()) == {1}  # failures are results, too


def test_a_task_that_returns_no_dict_fails_by_name(tmp_path):
    campaign.run(tasks.wrong, campaign.seeds(1, 1), store=tmp_path / "c.sqlite")
    assert "'list' object has no attribute 'items'" in campaign.load(tmp_path / "c.sqlite").errors["1:0"]


def test_files_travel_by_path(tmp_path):
    paths = [tmp_path / f"{i}.txt" for i in range(3)]
    for i, path in enumerate(paths[:2]):
        path.write_text(str(i + 1))
    count = campaign.run(tasks.read, paths, store=tmp_path / "c.sqlite", parameters={"factor": 10.0})
    assert count == campaign.Count(computed=3, stored=0, failed=1)
    recording = campaign.load(tmp_path / "c.sqlite")
    np.testing.assert_array_equal(recording.values["number"], [10.0, 20.0, np.nan])
    assert "FileNotFoundError" in recording.errors[str(paths[2])]


def test_progress_rises_to_the_end_and_the_file_can_be_read_meanwhile(tmp_path):
    store, calls = tmp_path / "c.sqlite", []
    draws(store, 5)
    draws(store, 55, batch=10, progress=lambda done, total: calls.append((done, total, len(campaign.load(store).runs))))
    assert calls == [(done, 55, done) for done in (15, 25, 35, 45, 55)]


def test_an_interrupt_leaves_what_was_stored(tmp_path):
    def interrupt(done: int, total: int) -> None:
        if done >= 20:
            raise KeyboardInterrupt

    store = tmp_path / "c.sqlite"
    with pytest.raises(KeyboardInterrupt):
        draws(store, 50, batch=10, progress=interrupt, executor=None)
    assert len(campaign.load(store).runs) == 20
    assert draws(store, 50) == campaign.Count(computed=30, stored=20, failed=0)


def test_another_campaign_in_the_same_file_is_refused_by_what_differs(tmp_path):
    store = tmp_path / "c.sqlite"
    draws(store, 5, parameters={"scale": 2.0})
    before = store.read_bytes()
    with pytest.raises(CampaignError, match=r"its parameters is '{\"scale\": 2.0}', requested is '{\"scale\": 3.0}'"):
        draws(store, 5, parameters={"scale": 3.0})
    with pytest.raises(CampaignError, match=r"its function is 'tests\.campaign\.tasks:draw'"):
        campaign.run(tasks.sometimes, campaign.seeds(1, 5), store=store, parameters={"scale": 2.0})
    with pytest.raises(CampaignError, match="its run 0 is '1:0', requested is '9:0'"):
        campaign.run(tasks.draw, campaign.seeds(9, 5), store=store, parameters={"scale": 2.0})
    with pytest.raises(CampaignError, match="its run 4 is '1:4', requested is None"):
        draws(store, 4, parameters={"scale": 2.0})
    assert store.read_bytes() == before


def test_a_task_whose_source_has_changed_is_refused(tmp_path, monkeypatch):
    store = tmp_path / "c.sqlite"
    (tmp_path / "mine.py").write_text("def draw(rng):\n    return {'x': rng.standard_normal()}\n")
    monkeypatch.syspath_prepend(tmp_path)
    import mine

    campaign.run(mine.draw, campaign.seeds(1, 2), store=store)
    with closing(sqlite3.connect(store)) as connection, connection:
        connection.execute("UPDATE campaign SET value = 'older' WHERE key = 'source'")
    with pytest.raises(CampaignError, match="its source is 'older'"):
        campaign.run(mine.draw, campaign.seeds(1, 2), store=store)


def test_a_worker_with_another_source_refuses_to_compute():
    task = Task.of(tasks.draw, {})
    assert compute(task, [(0, campaign.seeds(1, 1)[0])])[0].error is None
    with pytest.raises(CampaignError, match="Start the workers again"):
        compute(dataclasses.replace(task, source="older"), [])


def test_a_second_writer_is_noticed(tmp_path):
    store = tmp_path / "c.sqlite"

    def intrude(done: int, total: int) -> None:
        draws(store, 40)

    with pytest.raises(CampaignError, match="another process has written run"):
        draws(store, 40, batch=10, progress=intrude)
    draws(tmp_path / "whole.sqlite", 40)
    assert contents(store) == contents(tmp_path / "whole.sqlite")


def nested() -> Callable[..., dict[str, float]]:
    def inside(rng: np.random.Generator) -> dict[str, float]:
        return {}

    return inside


@pytest.mark.parametrize("task", [lambda rng: {}, nested(), type("F", (), {"__call__": dict})()])
def test_a_task_that_no_worker_could_import_is_refused(tmp_path, task):
    with pytest.raises(CampaignError, match="at the top of a file of its own"):
        campaign.run(task, campaign.seeds(1, 2), store=tmp_path / "c.sqlite")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("scale", [np.zeros(3), "x" * 100_000, [np.nan]], ids=["array", "long", "NaN"])
def test_data_among_the_parameters_are_refused(tmp_path, scale):
    with pytest.raises(CampaignError, match="pass its path"):
        draws(tmp_path / "c.sqlite", 2, parameters={"scale": scale})
    assert not list(tmp_path.iterdir())


def test_items_must_differ_and_a_batch_holds_something(tmp_path):
    with pytest.raises(CampaignError, match=r"'a\.csv' is given more than once"):
        campaign.run(tasks.read, ["b.csv", "a.csv", "a.csv"], store=tmp_path / "c.sqlite")
    with pytest.raises(CampaignError, match="batch = 0"):
        draws(tmp_path / "c.sqlite", 2, batch=0)


def test_files_that_hold_no_campaign_are_named(tmp_path):
    text, other = tmp_path / "text.sqlite", tmp_path / "other.sqlite"
    text.write_text("not a database, though long enough to be looked at as one\n" * 20)
    with closing(sqlite3.connect(other)) as connection, connection:
        connection.execute("CREATE TABLE mine (x REAL)")
    for path in (text, other):
        before = path.read_bytes()
        for call in (campaign.load, lambda store: draws(store, 2)):
            with pytest.raises(CampaignError, match=path.name):
                call(path)
        assert path.read_bytes() == before
    with pytest.raises(CampaignError, match=r"absent\.sqlite: no such file"):
        campaign.load(tmp_path / "absent.sqlite")
    with pytest.raises(CampaignError, match="Check that the folder exists"):
        draws(tmp_path / "no" / "c.sqlite", 2)
