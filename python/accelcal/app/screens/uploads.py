"""Files that were dropped: stored under names that fit the disk, then taken for what they are."""

from __future__ import annotations

import html
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

from nicegui import ui

from accelcal.app import mapping, session_file
from accelcal.app.page import Page
from accelcal.app.workbench import MOST_BYTES, Refused, Workbench

HEADER = """<button type="button" class="choose" @click="props.pickFiles">
<span class="material-icons" aria-hidden="true">upload_file</span><span>LABEL</span></button>
<q-uploader-add-trigger />"""
"""The whole area is one button with a name; the input behind it is hidden from keyboard and screen readers."""


def drop(page: Page, label: str, *, other: bool = False) -> None:
    """An area to drop files on; a recording and its sidecar may come together."""

    async def take(event: Any) -> None:
        try:
            kept = await saved(page.bench, event.files)
        except OSError as error:
            page.bench.refuse(f"the file could not be stored ({error.strerror or error}); make room, and drop it again")
            return
        await used(page, kept, other)

    area(page.bench, label, take, "other" if other else "recording")


def area(bench: Workbench, label: str, take: Callable[[Any], Awaitable[None]], mark: str) -> None:
    """A button on which files can be dropped; `take` is told what came."""

    async def accept(event: Any) -> None:
        await take(event)
        if not made.is_deleted:
            made.reset()  # what was taken is told by the page, and not listed once more

    def rejected() -> None:
        bench.refuse(f"the file is larger than {MOST_BYTES / 1e6:.0f} MB, the limit of the workbench")

    def failed() -> None:
        bench.refuse(
            f"the upload has failed: the server did not take it. The limit is {MOST_BYTES / 1e6:.0f} MB, a few uploads "
            "at a time, and room on the disk; give the file a short name, and drop it again"
        )

    made = ui.upload(
        multiple=True,
        auto_upload=True,
        max_file_size=MOST_BYTES,
        on_multi_upload=accept,
        on_rejected=rejected,
    )
    made.on("failed", failed, [])
    made.props("flat hide-upload-btn").classes("drop")
    made.add_slot("header", HEADER.replace("LABEL", html.escape(label)))
    made.mark(mark)


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
