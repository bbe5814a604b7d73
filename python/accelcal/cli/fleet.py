"""The command on many sensors: each recording fitted once, resumable, then one summary."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from accelcal.cli.common import Json, Output, UsageError, app, print_json, print_status, progress, with_exit_codes

if TYPE_CHECKING:
    from concurrent.futures import Executor

MOST_WORKERS = 256


@app.command()
@with_exit_codes
def fleet(
    folders: Annotated[
        list[Path], typer.Argument(help="One folder of recordings for each sensor.", metavar="FOLDER...")
    ],
    model: Annotated[str, typer.Option("--model", help="linear or cubic.")] = "linear",
    store: Annotated[
        Path, typer.Option("--store", help="File that keeps what is done; a call goes on from it.")
    ] = Path("fleet.sqlite"),
    workers: Annotated[int, typer.Option("--workers", help="Processes on this machine.", min=1, max=MOST_WORKERS)] = 1,
    dask: Annotated[
        str | None, typer.Option("--dask", help="Address of a dask scheduler, in place of --workers.")
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Fit recordings again that could not be fitted.")] = False,
    output: Output = None,
    json: Json = False,
) -> None:
    """Fit every recording of many sensors once and compare the sensors: population, outliers, repeatability, ageing.

    A killed call loses nothing: the next one goes on. The page is written with -o fleet.html.

    Example: [bold]accelcal fleet sensors/*/ -o fleet.html[/bold]
    """
    from accelcal.cli.printing import show_fleet
    from accelcal.fleet import campaign
    from accelcal.fleet.summary import MODELS, fit_of, summarise
    from accelcal.results.json import content

    if model not in MODELS:
        raise UsageError(f"--model {model!r}: expected {' or '.join(MODELS)}")
    files = in_stored_order([str(file) for file in recordings_in(folders)], store, retry=retry)
    with executor(workers, dask) as pool, progress("fleet") as report:
        done = campaign.run(
            fit_of,
            files,
            store=store,
            parameters={"model": model},
            executor=pool,
            batch=1,
            progress=lambda count, total: report(count / total),
        )
    print_status(f"{done.computed} recordings fitted, {done.kept} found in {store}, {done.failed} refused")
    found = summarise(campaign.load(store))
    if output is not None:
        from accelcal.fleet.summary import html
        from accelcal.io import atomic_write

        atomic_write(output, html(found, output.parent))
        print_status(f"wrote {output}")
    if json:
        print_json(content(found))
    else:
        show_fleet(found)


def in_stored_order(files: list[str], store: Path, *, retry: bool) -> list[str]:
    """Recordings in the order in which a store knows them, new ones behind; with `retry` it forgets its failures."""
    from accelcal.fleet import campaign

    if not store.exists():
        return files
    places = {item: run for run, item in campaign.items(store).items()}
    if retry:
        campaign.forget_failures(store)
    if not set(places) <= set(files):
        return files  # of other folders: the campaign says so
    new = (file for file in files if file not in places)
    known = {run: item for item, run in places.items()}
    return [known[run] if run in known else next(new) for run in range(len(files))]


def recordings_in(folders: list[Path]) -> list[Path]:
    """Recordings of every folder, in order.

    Raises
    ------
    UsageError
        If a folder is none or holds no recording, or two have one name.
    """
    from accelcal.io.files import READABLE

    files: list[Path] = []
    names: dict[str, Path] = {}
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(f"{folder}: expected a folder with the recordings of one sensor")
        same = names.setdefault(folder.resolve().name, folder)
        if same is not folder:
            raise UsageError(f"{folder} and {same} have one name, which is that of the sensor; rename one of them")
        found = sorted(path for path in folder.iterdir() if path.suffix.lower() in READABLE and path.is_file())
        if not found:
            raise UsageError(f"{folder}: no recording in it ({', '.join(READABLE)})")
        files += found
    return files


def executor(workers: int, dask: str | None) -> AbstractContextManager[Executor | None]:
    """Processes of this machine, or a cluster; None computes in threads of this process."""
    if dask is not None:
        try:
            from distributed import Client  # type: ignore[import-untyped,unused-ignore]
        except ImportError as error:
            raise UsageError('--dask needs dask; install it with: pip install "accelcal[dask]"') from error
        client: Any = Client
        return nullcontext(client(dask).get_executor())
    from accelcal._support.process import processes

    return processes(workers)
