"""Files that were dropped: stored under names that fit the disk, then taken for what they are."""

from __future__ import annotations

import html
import shutil
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

from accelcal.app import mapping, session_file, widgets
from accelcal.app.page import Page
from accelcal.app.state import Refused
from accelcal.app.tasks import MOST_BYTES
from accelcal.app.workbench import Workbench
from accelcal.io.sidecar import has_sidecar, sidecar_of

MODEL = ".json"
"""Ending of a model file."""
HEADER = """<button type="button" class="choose" @click="props.pickFiles">
<span class="material-icons" aria-hidden="true">upload_file</span><span>LABEL</span></button>
<q-uploader-add-trigger />"""
"""The whole area is one button with a name; the input behind it is hidden from keyboard and screen readers."""


def drop(page: Page, label: str, *, more: bool = False, guest: bool = False) -> None:
    """An area to drop files on; recordings, dwells and sidecars may come together.

    Parameters
    ----------
    label : name of the area.
    more : whether recordings join those that are there, in place of beginning anew.
    guest : whether models are to stand beside those that are there.
    """

    async def take(event: Any) -> None:
        try:
            kept = await saved(page.bench, event.files)
        except OSError as error:
            page.bench.refuse(f"the file could not be stored ({error.strerror or error}); make room, and drop it again")
            return
        if guest:
            await beside_ours(page, kept)
        else:
            await used(page, kept, more)

    area(page.bench, label, take, "guest" if guest else "more" if more else "recording")


def area(bench: Workbench, label: str, take: Callable[[Any], Awaitable[None]], mark: str) -> None:
    """A button on which files can be dropped; `take` is told what came."""

    async def accept(event: Any) -> None:
        made.sends(False)
        await take(event)
        if not made.is_deleted:
            made.reset()  # what was taken is told by the page, and not listed once more

    most = f"{MOST_BYTES / 1e6:.0f} MB"
    too_large = f"the file is larger than {most}, the limit of the workbench"
    failed = (
        f"the upload has failed: the server did not take it. The limit is {most}, a few uploads "
        "at a time, and room on the disk; give the file a short name, and drop it again"
    )
    made = widgets.Uploader(
        multiple=True,
        auto_upload=True,
        max_file_size=MOST_BYTES,
        on_multi_upload=accept,
        on_rejected=lambda: bench.refuse(too_large),
    )
    made.on("start", lambda: made.sends(True), [])
    made.on("finish", lambda: made.sends(False), [])
    made.on("failed", lambda: bench.refuse(failed), [])
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
            if path.exists():
                path = bench.upload_path(file.name, bench.upload_folder())
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


async def used(page: Page, kept: Sequence[Path], more: bool) -> None:
    """Open a session, load recordings with their sidecars, or put a sidecar in the place of the present one."""
    bench = page.bench
    sessions = [p for p in kept if p.suffix.lower() == session_file.SUFFIX]
    sidecars = [p for p in kept if p.suffix.lower() == ".toml"]
    models = [p for p in kept if p.suffix.lower() == MODEL]
    recordings = [p for p in kept if p not in (*sessions, *sidecars, *models)]
    if models:
        bench.refuse(f"{models[0].name}: a model is put beside those of a session; drop it on the Model tab")
    elif sessions:
        await page.open(sessions[0], session=True)
    elif recordings and bench.state.opened is not None:
        await page.act(bench.give, recordings)
    elif recordings:
        unmatched = beside(recordings, sidecars)
        if unmatched:
            bench.refuse(f"{unmatched[0].name}: no file that was dropped with it has this name; give it that name")
        elif more:
            await page.act(bench.include, recordings)
        elif len(recordings) > 1:
            await page.act(bench.load_several, recordings)
        else:
            await page.act(bench.load, recordings[0])
    elif sidecars and bench.state.file is not None:
        await page.act(bench.declare, mapping.text_in(sidecars[0]))
    elif sidecars:
        bench.refuse(f"{sidecars[0].name}: drop it together with the recording that it belongs to")


async def beside_ours(page: Page, kept: Sequence[Path]) -> None:
    """Put models and sessions beside the models of this session."""
    for path in kept:
        if path.suffix.lower() not in (MODEL, session_file.SUFFIX):
            page.bench.refuse(f"{path.name}: drop a model (.json) or a session ({session_file.SUFFIX}) here")
            return
        await page.act(page.bench.invite, path)
    guests = page.bench.state.guests
    if guests and page.pair is not None:
        page.pair = (page.pair[0], guests[-1].name)
        page.rebuild()


def beside(recordings: Sequence[Path], sidecars: Sequence[Path]) -> list[Path]:
    """Put sidecars beside the files that they belong to, and return those that belong to none.

    A single sidecar of another name belongs to the single recording, or to all files that have none: one sensor.
    """
    known = {sidecar_of(path).name.lower(): path for path in recordings}
    unmatched = []
    for sidecar in sidecars:
        owner = known.get(sidecar.name.lower())
        if owner is None:
            unmatched.append(sidecar)
        elif sidecar != sidecar_of(owner):
            sidecar.rename(sidecar_of(owner))
    if len(unmatched) > 1:
        return unmatched
    for sidecar in unmatched:
        for path in [one for one in recordings if not has_sidecar(one)]:
            shutil.copyfile(sidecar, sidecar_of(path))
    return []
