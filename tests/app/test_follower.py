"""What follows a running measurement for a page: it ends in order with its page, and says why it cannot go on."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from accelcal import io
from accelcal.app.sessions import Asked, Follower, Followers, recording_path
from accelcal.live.session import LiveEvent, LiveHistory, LiveState
from tests.live.streams import RATE, RIG, stream

PATIENCE = 30.0
"""s; a loaded machine takes its time."""
LINES = stream(1.5).lines().splitlines(keepends=True)


def until(holds: Callable[[], bool]) -> None:
    """Wait until something holds."""
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.fixture
def asked(tmp_path: Path) -> Asked:
    (tmp_path / "rig.toml").write_text(RIG)
    (tmp_path / "growing.csv").write_bytes(b"".join(LINES[: int(RATE)]))
    return Asked("file", str(tmp_path / "growing.csv"), tmp_path / "rig.toml", tmp_path / "seen.parquet")


def rows(follower: Follower) -> int:
    newest = follower.history.newest
    return 0 if newest is None else newest.state.used


def test_a_file_is_followed_while_it_grows_and_until_its_last_page_is_closed(asked: Asked, tmp_path: Path) -> None:
    follower = Follower(asked, tmp_path)
    follower.show("one")
    until(lambda: rows(follower) == RATE)
    follower.show("reloaded")
    follower.forget("one")
    with open(asked.address, "ab") as file:
        file.write(b"".join(LINES[int(RATE) :]) + b"1.6,0.1")  # the last line is not whole yet
    until(lambda: rows(follower) == 1.5 * RATE)
    follower.forget("reloaded")
    until(lambda: follower.ended)
    assert follower.sentence == ""
    assert follower.history.newest is not None
    assert follower.history.newest.ended == "stopped"
    assert len(io.load(asked.recording).accel) == 1.5 * RATE
    assert [p.name for p in follower.history.parameters] == ["scale_factor", "bias"]


def test_a_file_that_is_replaced_ends_it(asked: Asked, tmp_path: Path) -> None:
    followers = Followers(tmp_path)
    follower = followers.start("session", asked)
    until(lambda: rows(follower) == RATE)
    Path(asked.address).unlink()
    until(lambda: follower.ended)
    assert "was removed or replaced" in follower.sentence
    assert follower.has_recording
    followers.close()


def test_what_cannot_be_followed_is_said(asked: Asked, tmp_path: Path) -> None:
    asked.rig.write_text("[channels]\n")
    followers = Followers(tmp_path)
    follower = followers.start("session", asked)
    until(lambda: follower.ended)
    assert follower.sentence.startswith("the sidecar declares no noise of the sensor")
    assert "--" not in follower.sentence
    assert not follower.has_recording


@pytest.mark.parametrize("name", ["seen", "seen.parquet", "../../seen", " seen "])
def test_a_recording_stays_in_its_folder(tmp_path: Path, name: str) -> None:
    assert recording_path(tmp_path, name, tmp_path).name == "seen.parquet"
    assert recording_path(tmp_path, name, tmp_path).parent == tmp_path


def test_moments_stay_few_and_spread_over_the_whole_run() -> None:
    history = LiveHistory(most=64)
    for t in range(10_000):
        history.add(LiveEvent("state", "lines", LiveState(float(t))))
    steps = np.diff([moment.t for moment in history.moments[:-1]])
    assert len(history.moments) <= 65
    assert len(set(steps.tolist())) == 1
    assert history.moments[-1].t == 9999.0
