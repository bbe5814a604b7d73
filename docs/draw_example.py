"""Run the README's example, and copy the figure that it writes to `docs/static`.

.venv/bin/python docs/draw_example.py
"""

from __future__ import annotations

import contextlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).parent


def main() -> None:
    """Simulate the recordings of the README, then run its Python block."""
    text = (DOCS.parent / "README.md").read_text()
    recordings, example = (
        re.search(rf"^```{language}\n(.*?)^```", text, flags=re.M | re.S) for language in ("sh", "python")
    )
    assert recordings
    assert example
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for line in recordings[1].splitlines():
            subprocess.run([sys.executable, "-m", *shlex.split(line)], check=True)
        exec(compile(example[1], "README.md", "exec"), {})
        shutil.copy("loop.png", DOCS / "static")


if __name__ == "__main__":
    main()
