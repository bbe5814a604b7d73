"""The command line: it parses options, calls the public functions and prints; it holds no physics.

Grammar everywhere: model first, recording second. Data go to stdout, messages to stderr.
Exit codes: 0 success, 2 usage, 3 bad data, 4 not identifiable, 70 an error of accelcal; 130 interrupted (Ctrl-C), 143
terminated, 129 terminal closed, 141 nobody reads the output.

Nothing is imported before `main` runs: a Ctrl-C while the commands are being imported is one of theirs.
"""

from __future__ import annotations

import os
import sys
import warnings

TYPE_CHECKING = False
if TYPE_CHECKING:  # typing itself takes as long to import as all the rest until `main` runs
    from typing import Any, NoReturn

    from accelcal.cli.common import app
    from accelcal.cli.data import write_recording

__all__ = ["app", "main", "write_recording"]


def main() -> NoReturn:
    """Run the command line and exit with its code."""
    try:
        from accelcal._support import stopping
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    raise SystemExit(stopping.run(_command_line))


def _command_line() -> None:
    if not sys.warnoptions:  # what NumPy says of its divisions is for whoever mends accelcal, not for its user
        warnings.simplefilter("ignore", RuntimeWarning)
        os.environ["PYTHONWARNINGS"] = "ignore::RuntimeWarning"  # in the processes that this one starts
    from copy import copy

    application = copy(__getattr__("app"))
    asked = next((word for word in sys.argv[1:] if not word.startswith("-")), "").replace("-", "_")
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
