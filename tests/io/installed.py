"""What a process that opens containers can import."""

import sys
from pathlib import Path

import numpy as np
import pytest


def leave_numpy_alone(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a new folder with NumPy alone in place of the one with every installed package."""
    installed = Path(np.__file__).parents[1]
    folder.mkdir()
    for name in ("numpy", "numpy.libs"):
        if (installed / name).exists():
            (folder / name).symlink_to(installed / name)
    monkeypatch.setattr("sys.path", [str(folder) if Path(p) == installed else p for p in sys.path])
