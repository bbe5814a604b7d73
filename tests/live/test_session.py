"""A live view without a face: what it writes and when, whatever its source does."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from accelcal.cli.live import line_of
from accelcal.filters.stream import Readings
from accelcal.io import load, read_sidecar, write
from accelcal.io.stream import ByteSource, Rows
from accelcal.live import LiveSession, session, settings_of
from accelcal.live.session import LiveEvent, LiveHistory, LiveState
from accelcal.model import Estimate
from accelcal.plots.timeline import live_tracks
from tests.live.streams import RIG, stream

MOST = 60.0
"""Longest that a test waits, s."""


def opened(folder: Path, chunks: Iterator[bytes | None]) -> LiveSession:
    """On a source of these chunks, recorded in `got.parquet`."""
    (folder / "rig.toml").write_text(RIG)
    declared = read_sidecar(folder / "rig.toml")

    def read() -> bytes | None:
        chunk = next(chunks, b"")
        if chunk is None:
            time.sleep(0.01)
        return chunk

    source = ByteSource("made", read, lambda: None, waits=True, from_its_start=True, ends_lines=True)
    return LiveSession(source, declared, settings_of(declared.rig), folder / "got.parquet")


def followed(view: LiveSession, ends: Callable[[], bool] = lambda: False) -> None:
    view.run(ends=ends, on_alarm=lambda alarm: None, show=lambda: None)


def test_rows_are_written_although_none_follow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "GROUP_TIME", 0.2)
    samples = stream(0.5)

    def burst() -> Iterator[bytes | None]:
        yield samples.lines()
        while True:
            yield None

    began, path = time.monotonic(), tmp_path / "got.parquet"
    with opened(tmp_path, burst()) as view:
        # The last row may wait for one that confirms its stamp.
        followed(view, ends=lambda: path.exists() or time.monotonic() > began + MOST)
        assert path.exists()
        assert view.ended == "stopped"
    assert len(load(path).accel) == len(samples.t)


def test_a_damaged_stamp_at_the_end_costs_its_row(tmp_path: Path) -> None:
    samples = stream(0.5)
    with opened(tmp_path, iter([samples.lines(), b"1e200,,5"])) as view:
        followed(view)
        assert view.state.broken == 1
        assert view.state.used == len(samples.t)
    assert len(load(tmp_path / "got.parquet").accel) == len(samples.t)


def test_a_stop_in_the_middle_of_a_write_stays_what_ended_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object) -> None:
        raise SystemExit(130)

    monkeypatch.setattr(write._Copy, "take", stopped)
    with pytest.raises(SystemExit), opened(tmp_path, iter([stream(0.5).lines()])) as view:
        followed(view)
    assert {path.name for path in tmp_path.iterdir()} == {"rig.toml"}


def test_a_defect_on_the_way_keeps_the_rows_that_came(tmp_path: Path) -> None:
    def broken() -> Iterator[bytes | None]:
        yield stream(0.5).lines()
        while True:
            yield None

    def show() -> None:
        if view.state.used:
            raise RuntimeError("a defect")

    with pytest.raises(RuntimeError, match="a defect"), opened(tmp_path, broken()) as view:
        view.run(ends=lambda: False, on_alarm=lambda alarm: None, show=show)
    assert len(load(tmp_path / "got.parquet").accel) == view.state.used > 0


CHANGING = (("bias",), ("scale_factor", "bias"), ("bias",))
"""Names of the estimates from moment to moment."""


def at_time(names: tuple[str, ...], t: float) -> LiveState:
    return LiveState(t, tuple(Estimate(name, name, "1", 0.1 + t, 0.01, "sensor") for name in names))


def test_an_estimate_may_come_and_go() -> None:
    history = LiveHistory()
    for t, names in enumerate(CHANGING):
        history.add(LiveEvent("state", "lines", at_time(names, float(t))))
    assert [p.name for p in history.parameters] == ["bias", "scale_factor"]
    none = np.nan
    np.testing.assert_allclose(history.columns.values.T, [[0.1, 1.1, 2.1], [none, 1.1, none]])
    np.testing.assert_allclose(history.columns.stds.T, [[0.01] * 3, [none, 0.01, none]])
    assert [panel.title for panel in live_tracks(history).panels][:2] == ["bias", "scale factor"]


def test_the_page_shows_the_estimates_that_there_are() -> None:
    nicegui = pytest.importorskip("nicegui")
    live_page = pytest.importorskip("accelcal.app.live_page")
    with nicegui.Client(nicegui.ui.page("")) as client:
        follower = SimpleNamespace(asked=SimpleNamespace(address="lines", recording="got.parquet"))
        readout = live_page.Readout(follower)
        for t, names in enumerate(CHANGING):
            readout._show_parameters(at_time(names, float(t)).estimates)
            shown = [x for x in readout.parameters.descendants() if "data-parameter" in x.props]
            assert [x.props["data-parameter"] for x in shown] == list(names)
            assert {x.text for x in shown} == {f"{0.1 + t:.6g}"}
    client.delete()


@pytest.mark.parametrize(("spent", "late"), [(5.0, True), (0.0, False)])
def test_lines_that_wait_longer_than_they_took_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spent: float, late: bool
) -> None:
    """Half a second of lines at once, of which the filter takes five seconds, or none."""
    clock, states = [100.0], list[LiveState]()
    monkeypatch.setattr(session, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    with opened(tmp_path, iter([stream(0.5).lines()])) as view:
        feed = view.tracker.feed

        def slow(rows: Rows) -> Readings:
            clock[0] += spent
            return feed(rows)

        monkeypatch.setattr(view.tracker, "feed", slow)
        view.run(ends=lambda: False, on_alarm=lambda alarm: None, show=lambda: states.append(view.state))
        assert view.state.used > 100
        assert view.state.behind == 0.0  # nothing waits any more
    behind = max(states, key=lambda state: state.behind)
    assert behind.is_late is late
    assert any("behind" in sentence for sentence in behind.sentences) is late
    assert ("s behind" in line_of(behind)) is late
    assert behind.behind == pytest.approx(4.5 if late else 0.0, abs=0.1)
