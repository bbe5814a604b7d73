"""The command line: it parses options, calls the public functions and prints; it holds no physics.

Grammar everywhere: model first, recording second. Data go to stdout, messages to stderr.
Exit codes: 0 success, 2 usage, 3 bad data, 4 not identifiable, 70 an error of accelcal; 130 interrupted (Ctrl-C), 143
terminated, 129 terminal closed, 141 nobody reads the output.

Nothing is imported before `main` runs: a Ctrl-C while the commands are being imported is one of theirs.
"""

from __future__ import annotations

import gc
import os
import sys
import warnings

TYPE_CHECKING = False
if TYPE_CHECKING:  # typing itself takes as long to import as all the rest until `main` runs
    from typing import Any, NoReturn

    from accelcal.cli.common import app
    from accelcal.cli.data import write_recording

__all__ = ["app", "main", "write_recording"]
LASTING = ("app", "fleet", "live")
"""Commands that last as long as their user wants, or as there are recordings."""
OBJECTS = 200_000
"""New objects after which Python searches for rings of them: more than a command leaves behind when it starts and ends.
Searching earlier, and once more at the end, takes a tenth of the time of a short command and finds nothing."""


def main() -> NoReturn:
    """Run the command line and exit with its code."""
    try:
        from accelcal._support import stopping
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    code = stopping.run(_command_line)
    gc.freeze()
    raise SystemExit(code)


def _command_line() -> None:
    if not sys.warnoptions:  # what NumPy says of its divisions is for whoever mends accelcal, not for its user
        warnings.simplefilter("ignore", RuntimeWarning)
        os.environ["PYTHONWARNINGS"] = "ignore::RuntimeWarning"  # in the processes that this one starts
    asked = next((word for word in sys.argv[1:] if not word.startswith("-")), "").replace("-", "_")
    if asked not in LASTING:
        gc.set_threshold(OBJECTS)
    from copy import copy

    application = copy(__getattr__("app"))
    alone = [c for c in application.registered_commands if (c.name or getattr(c.callback, "__name__", "")) == asked]
    application.registered_commands = alone or application.registered_commands  # the options of each take their time
    application()


def __getattr__(name: str) -> Any:
    """Import the commands on first use; importing a file registers its commands, in this order."""
    if name not in __all__:
        raise AttributeError(f"module 'accelcal.cli' has no attribute {name!r}")
    from accelcal.cli import data, models, diagnosis, calibration, live, demo  # noqa: F401, I001
    from accelcal.cli.common import app
    from accelcal.cli.data import write_recording

    globals().update(app=app, write_recording=write_recording)
    return globals()[name]
