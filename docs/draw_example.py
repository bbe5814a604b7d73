"""Run the README's example in `docs/static`, where its last line writes the figure that the README shows.

    .venv/bin/python docs/draw_example.py
"""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

DOCS = Path(__file__).parent


def main() -> None:
    """Run the first Python block of the README."""
    block = re.search(r"^```python\n(.*?)^```", (DOCS.parent / "README.md").read_text(), flags=re.M | re.S)
    assert block
    with contextlib.chdir(DOCS / "static"):
        exec(compile(block[1], "README.md", "exec"), {})


if __name__ == "__main__":
    main()
