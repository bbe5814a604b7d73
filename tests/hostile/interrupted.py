"""The command line with a signal to itself at one exact moment: interrupted.py KIND NUMBER SIGNAL FOLDER ARGUMENT...

KIND is `import` (the n-th module that is looked for once the command line has begun) or `file` (the n-th time that a
file below FOLDER is opened, linked, renamed or removed). With SIGNAL 0 nothing is sent, and the number of such moments
is the last line on stderr.
"""

from __future__ import annotations

import os
import signal
import sys
from typing import Any

EVENTS = ("open", "os.link", "os.rename", "os.remove", "os.mkdir", "os.chmod", "os.truncate")


class Moments:
    """Counts moments of one kind, and sends the signal at one of them."""

    def __init__(self, number: int, sent: int) -> None:
        self.number, self.sent, self.calls = number, sent, 0

    def pass_one(self) -> None:
        """One more."""
        self.calls += 1
        if self.sent and self.calls == self.number:
            signal.raise_signal(self.sent)

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        """A finder of modules that finds none."""
        self.pass_one()

    def audit(self, folder: str) -> None:
        """Count what happens to files below a folder."""

        def hook(event: str, arguments: tuple[Any, ...]) -> None:
            if event in EVENTS and any(
                isinstance(a, str | os.PathLike) and str(a).startswith(folder) for a in arguments
            ):
                self.pass_one()

        sys.addaudithook(hook)


def main() -> None:
    """Run the command line as it is installed."""
    kind, number, sent, folder = sys.argv[1:5]
    sys.argv[1:] = sys.argv[5:]
    moments = Moments(int(number), int(sent))
    from accelcal.cli import main as command_line

    if kind == "import":
        sys.meta_path.insert(0, moments)  # type: ignore[arg-type]
    else:
        moments.audit(folder)
    try:
        command_line()
    finally:
        if not moments.sent:
            print(moments.calls, file=sys.stderr)


if __name__ == "__main__":
    main()
