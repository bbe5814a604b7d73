"""The lowest version that pyproject.toml allows of each package that accelcal needs, as constraints for pip."""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def main() -> None:
    """Print one line a package."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for requirement in project["dependencies"]:
        name, bound, lowest = requirement.partition(">=")
        if not bound:
            raise SystemExit(f"pyproject.toml: {requirement!r} has no lower bound")
        print(f"{name}=={lowest}")


if __name__ == "__main__":
    main()
