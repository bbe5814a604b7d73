"""Licences of the crates that are compiled into the extension module, as one text for the wheel.

    python tools/licences.py > LICENSES-THIRD-PARTY.txt

`make wheel` does so; the file is not kept in the repository.

Reads `cargo metadata`: the packages that `cargo tree -e normal` shows for accelcal-py, and the licence files that each
brings. A test compares the list with Cargo.lock.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
FILES = ("LICEN[CS]E*", "COPYING*", "NOTICE*", "UNLICENSE*", "license*")


def compiled_in() -> list[dict[str, Any]]:
    """Packages from the registry that become part of the extension module, by name."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked"]
    answer = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout)
    packages = {item["id"]: item for item in answer["packages"]}
    nodes = {item["id"]: item for item in answer["resolve"]["nodes"]}
    (root,) = (name for name, item in packages.items() if item["name"] == "accelcal-py")
    reached, open_ = {root}, [root]
    while open_:
        for edge in nodes[open_.pop()]["deps"]:
            normal = any(kind["kind"] is None for kind in edge["dep_kinds"])
            macro = any("proc-macro" in target["kind"] for target in packages[edge["pkg"]]["targets"])
            if normal and not macro and edge["pkg"] not in reached:
                reached.add(edge["pkg"])
                open_.append(edge["pkg"])
    return sorted(
        (packages[item] for item in reached if packages[item]["source"]),
        key=lambda item: (item["name"], item["version"]),
    )


def text() -> str:
    """Name, version, licence and licence files of each; files that several share stand once."""
    packages = compiled_in()
    shared: dict[str, list[str]] = {}
    lines = ["The extension module accelcal._core contains the following crates.", ""]
    for package in packages:
        title = f"{package['name']} {package['version']}"
        lines.append(f"{title}: {package['license']}")
        folder = Path(package["manifest_path"]).parent
        files = sorted({path for pattern in FILES for path in folder.glob(pattern) if path.is_file()})
        if not files:
            lines[-1] += f" (no licence file in the package; {package['repository']})"
        for path in files:
            shared.setdefault(path.read_text(encoding="utf-8").strip(), []).append(f"{title}, {path.name}")
    for content, names in shared.items():
        lines += ["", "-" * 100, *names, "-" * 100, content]
    return "\n".join(line.rstrip() for line in "\n".join(lines).splitlines()) + "\n"


if __name__ == "__main__":
    print(text(), end="")
