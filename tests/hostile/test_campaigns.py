"""The file of a campaign under kills, a second writer, hostile content and a full disk: what was stored stays."""

from __future__ import annotations

import os
import resource
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from accelcal.fleet import campaign
from accelcal.fleet.campaign import CampaignError
from tests.campaign.child import SEED
from tests.campaign.contents import contents, counted, killed
from tests.campaign.tasks import CALLS, w2

from .case import case_rng, cases

RUNS, SECONDS = 300, 1.0
FILE_LIMIT = 24_000
"""Bytes that the file of a campaign may have where the disk is full; some runs fit in."""


def whole(store: Path) -> campaign.Count:
    """The campaign to its end, here."""
    return campaign.run(w2, campaign.seeds(SEED, RUNS), store=store, parameters={"seconds": SECONDS})


def child(store: Path, **environment: str) -> subprocess.Popen[str]:
    """The same campaign in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "tests.campaign.child", str(store), str(RUNS), str(SECONDS)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Contents that one undisturbed process writes."""
    store = tmp_path_factory.mktemp("reference") / "c.sqlite"
    assert whole(store).computed == RUNS
    return contents(store)


def test_kills_one_after_another_lose_nothing(tmp_path: Path, reference: str, monkeypatch: pytest.MonkeyPatch) -> None:
    kills = 0
    for number in cases(1, 12):
        store, calls = tmp_path / f"{number}.sqlite", tmp_path / f"{number}.calls"
        after, remaining = 0, dict[str, int]()
        for step in case_rng("campaigns", number).integers(20, RUNS // 3, 2):
            after += int(step)
            killed(store, calls, runs=RUNS, seconds=SECONDS, after=after)
            kills, times, stored = kills + 1, counted(calls), campaign.load(store).items
            assert {item: times[item] for item in remaining} == remaining
            remaining, after = {item: times[item] for item in stored}, len(stored)
        monkeypatch.setenv(CALLS, str(calls))
        assert whole(store) == campaign.Count(computed=RUNS - len(remaining), stored=len(remaining), failed=0)
        monkeypatch.delenv(CALLS)
        assert contents(store) == reference
        assert {item: counted(calls)[item] for item in remaining} == remaining
    print(f"{kills} kills of campaigns of {RUNS} runs: 0 lost, 0 stored ones computed again (none allowed)")


def test_two_processes_on_one_file_refuse_in_a_sentence_and_spoil_nothing(tmp_path: Path, reference: str) -> None:
    """The second process runs to its end between two transactions of the first."""
    store, message = tmp_path / "c.sqlite", []

    def meanwhile(done: int, total: int) -> None:
        assert 0 < done < total
        process = child(store)
        message.append(process.communicate(timeout=600)[1].strip())
        assert process.returncode == 0, message

    with pytest.raises(CampaignError, match="another process has written run"):
        campaign.run(w2, campaign.seeds(SEED, RUNS), store=store, parameters={"seconds": SECONDS}, progress=meanwhile)
    assert message == [""]
    assert whole(store) == campaign.Count(computed=0, stored=RUNS, failed=0)
    assert contents(store) == reference


def test_two_processes_at_once_spoil_nothing(tmp_path: Path, reference: str) -> None:
    """Whether they meet is a matter of the machine's pace; each ends, or is refused in a sentence."""
    store = tmp_path / "c.sqlite"
    both = [child(store), child(store)]
    for process in both:
        text = process.communicate(timeout=600)[1].strip()
        assert process.returncode == 0 or "CampaignError: " in text.rpartition("\n")[2], text
    whole(store)
    assert contents(store) == reference


def of_another_program(path: Path) -> None:
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("CREATE TABLE campaign (key TEXT, value BLOB)")
        connection.execute("INSERT INTO campaign VALUES ('source', zeroblob(1000))")


def of_bytes(path: Path) -> None:
    path.write_bytes(case_rng("campaign of bytes", 0).bytes(50_000))


def of_a_header_alone(path: Path) -> None:
    path.write_bytes(b"SQLite format 3\0" + case_rng("campaign of bytes", 1).bytes(50_000))


def cut_in_half(path: Path) -> None:
    whole(path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


HOSTILE: dict[str, Callable[[Path], None]] = {
    "a folder": Path.mkdir,
    "a pipe": os.mkfifo,
    "bytes": of_bytes,
    "a header alone": of_a_header_alone,
    "another program": of_another_program,
    "cut in half": cut_in_half,
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_is_refused_in_one_sentence(tmp_path: Path, kind: str) -> None:
    store = tmp_path / "c.sqlite"
    HOSTILE[kind](store)
    before = store.read_bytes() if store.is_file() else None
    for act in (lambda: campaign.load(store), lambda: whole(store)):
        with pytest.raises(CampaignError) as caught:
            act()
        assert "c.sqlite" in str(caught.value)
        assert "\n" not in str(caught.value)
    assert (store.read_bytes() if store.is_file() else None) == before


def limited() -> None:
    """No file above some bytes from here on: what a full disk does, without one."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_LIMIT, FILE_LIMIT))


def test_a_full_disk_is_said_and_the_campaign_goes_on_later(tmp_path: Path, reference: str) -> None:
    store = tmp_path / "c.sqlite"
    words = [sys.executable, "-m", "tests.campaign.child", str(store), str(RUNS), str(SECONDS)]
    done = subprocess.run(words, capture_output=True, text=True, preexec_fn=limited, timeout=600, check=False)
    assert done.returncode == 1
    last = done.stderr.strip().rpartition("\n")[2]
    assert "CampaignError" in last, done.stderr
    assert "c.sqlite" in last
    assert whole(store).computed > 0
    assert contents(store) == reference


def test_a_changed_value_is_seen(tmp_path: Path, reference: str) -> None:
    store = tmp_path / "c.sqlite"
    whole(store)
    with closing(sqlite3.connect(store)) as connection, connection:
        connection.execute("UPDATE value SET value = 0.0 WHERE run = 7")
    assert contents(store) != reference
