"""The command line: it parses options, calls the public functions and prints; it holds no physics.

Grammar everywhere: model first, recording second. Data go to stdout, messages to stderr.
Exit codes: 0 success, 2 usage, 3 bad data, 4 not identifiable, 130 interrupted.
"""

from accelcal.cli import data, dwells, models, diagnosis, fleet, export, demo  # noqa: F401, I001  (importing a file registers its commands, in this order)
from accelcal.cli.data import write_recording
from accelcal.cli.common import app, main

__all__ = ["app", "main", "write_recording"]
