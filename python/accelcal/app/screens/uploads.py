"""Files that were dropped: stored under names that fit the disk, then taken for what they are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from accelcal.app import mapping, session_file
from accelcal.app.page import Page
from accelcal.app.workbench import MOST_BYTES, Refused, Workbench


async def saved(bench: Workbench, files: Sequence[Any]) -> list[Path]:
    """Store what was dropped together; a file that is refused is told and left out.

    Raises
    ------
    OSError
        If the disk does not take it.
    """
    kept: list[Path] = []
    folder = bench.upload_folder()
    for file in files:
        try:
            path = bench.upload_path(file.name, folder)
            bench.require_room()
            if file.size() > MOST_BYTES:
                size, most = file.size() / 1e6, MOST_BYTES / 1e6
                raise Refused(f"{path.name}: {size:.0f} MB; the limit of the workbench is {most:.0f} MB")
        except Refused as error:
            bench.refuse(str(error))
            continue
        await file.save(path)
        kept.append(path)
    return kept


async def used(page: Page, kept: Sequence[Path], other: bool) -> None:
    """Open a session, load a recording with its sidecar, or put a sidecar in the place of the present one."""
    bench = page.bench
    sessions = [p for p in kept if p.suffix.lower() == session_file.SUFFIX]
    sidecars = [p for p in kept if p.suffix.lower() == ".toml"]
    recordings = [p for p in kept if p not in (*sessions, *sidecars)]
    if sessions:
        await page.open(sessions[0], session=True)
    elif recordings and bench.state.opened is not None:
        await page.act(bench.give, recordings[0])
    elif recordings:
        for path in sidecars[:1]:
            path.rename(recordings[0].with_suffix(".toml"))
        await page.act(bench.load_other if other else bench.load, recordings[0])
    elif sidecars and bench.state.file is not None:
        await page.act(bench.load, bench.state.file, mapping.text_in(sidecars[0]))
    elif sidecars:
        bench.refuse(f"{sidecars[0].name}: drop it together with the recording that it belongs to")
