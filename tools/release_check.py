"""Whether a release can be made: one page, an item a line, held or not, with its figure.

    make release-check                               # every item, an hour
    make release-check ITEMS="versions changelog"    # some

What an item prints goes into build/release. The exit code is 1 where one does not hold. An item is open where a program
that it needs is not installed.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
import time
import tomllib
import zipfile
from collections.abc import Callable, Iterable
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOGS = ROOT / "build" / "release"
MOST_CHANGELOG_LINES = 60
PERMISSIVE = {"MIT", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "Zlib", "Unlicense", "0BSD", "Unicode-3.0"}
"""Licences of crates that a wheel under MIT or Apache-2.0 may contain, with their texts."""


class NotHeld(Exception):
    """An item does not hold; the text says why."""


class Open(Exception):
    """An item cannot be looked into here; the text says what would do so."""


def require(condition: object, text: str) -> None:
    """Raise `NotHeld` unless a condition is true."""
    if not condition:
        raise NotHeld(text)


def output_of(item: str, *command: str, root: Path = ROOT) -> str:
    """Output of a command, which is stored under the name of the item; an exit code other than 0 is `NotHeld`."""
    done = subprocess.run(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8")
    LOGS.mkdir(parents=True, exist_ok=True)
    log = LOGS / f"{item}.txt"
    log.write_text(done.stdout, encoding="utf-8")
    require(done.returncode == 0, f"{' '.join(command)} ended with {done.returncode}, see {log.relative_to(ROOT)}")
    return done.stdout


def tracked(*places: str) -> list[str]:
    """Files of the repository in some places."""
    command = ["git", "ls-files", "-z", *places]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, encoding="utf-8").stdout
    return [name for name in listed.split("\0") if name]


def archive(pattern: str) -> tuple[Path, float]:
    """The one file of a pattern in the repository, and its size, MB."""
    paths = list(ROOT.glob(pattern))
    require(len(paths) == 1, f"{pattern}: {len(paths)} files, expected one")
    return paths[0], paths[0].stat().st_size / 1e6


def require_all(names: Iterable[str], contents: Iterable[str], where: str) -> None:
    """Require files of an archive."""
    missing = sorted(set(names) - set(contents))
    require(not missing, f"{where} lacks {len(missing)} files, first {missing[:1]}")


def tree() -> str:
    """The working tree is clean."""
    changed = output_of("tree", "git", "status", "--porcelain").splitlines()
    require(not changed, f"{len(changed)} files are changed or new, first {changed[:1]}")
    return "clean at " + output_of("tree", "git", "rev-parse", "--short", "HEAD").strip()


def versions(root: Path = ROOT) -> str:
    """One version everywhere."""
    manifest = tomllib.loads((root / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["package"]["version"]
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    locked = tomllib.loads((root / "Cargo.lock").read_text(encoding="utf-8"))["package"]
    sections = re.findall(r"^## (\S+)", (root / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    places = {
        "pyproject.toml": manifest if project.get("dynamic") == ["version"] else project.get("version"),
        "CHANGELOG.md": sections[0] if sections else None,
        "the installed package": version("accelcal"),
    } | {
        f"{row['name']} in Cargo.lock": row["version"] for row in locked if row["name"].startswith(("ekf-", "accelcal"))
    }
    for place, number in places.items():
        require(number == manifest, f"{place} has {number}, Cargo.toml {manifest}")
    return f"{manifest} in {len(places) + 1} places"


def changelog(root: Path = ROOT) -> str:
    """The changelog is short enough to be read, and its section is that of a release."""
    text = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    count = len(text.splitlines())
    require(count <= MOST_CHANGELOG_LINES, f"{count} lines, at most {MOST_CHANGELOG_LINES}")
    require(not re.search("not yet released|unreleased", text, flags=re.IGNORECASE), "says that it is not released")
    return f"{count} lines (at most {MOST_CHANGELOG_LINES})"


def check() -> str:
    """Format, lints, types, stubs."""
    output_of("check", "make", "check")
    return "format, clippy, ruff, mypy, stubs"


def tests() -> str:
    """Fast tests of Rust and Python; `make test-all` has the slow ones."""
    text = output_of("test", "make", "test")
    rust = sum(map(int, re.findall(r"test result: ok\. (\d+) passed", text)))
    (python,) = re.findall(r"^=*\s*(\d+ passed[^\n=]*?) in ", text, flags=re.MULTILINE)[-1:] or ["?"]
    return f"Rust {rust} passed, Python {python}"


def wheel() -> str:
    """The wheel holds the whole package and runs where there is no compiler, newest and lowest versions."""
    text = output_of("wheel", "make", "try-wheel")
    path, size = archive("dist/*.whl")
    require("-cp311-abi3-" in path.name, f"{path.name} is not for Python 3.11 and later")
    names = zipfile.ZipFile(path).namelist()
    package = [name.removeprefix("python/") for name in tracked("python/accelcal")]
    require_all([name for name in package if not name.endswith(".pyi")], names, path.name)
    return f"{path.name}, {size:.1f} MB, {len(names)} files, tried {text.count('ran the main commands')} times"


def sdist() -> str:
    """The source distribution, made with the wheel, holds what builds it."""
    path, size = archive("dist/*.tar.gz")
    with tarfile.open(path) as contents:
        names = [name.partition("/")[2] for name in contents.getnames()]
    crates = ("crates/ekf-core/src", "crates/ekf-simd/src", "crates/accelcal-py/src", "python/accelcal")
    require_all([*tracked(*crates), "Cargo.lock", "pyproject.toml", "LICENSE-MIT", "LICENSE-APACHE"], names, path.name)
    return f"{path.name}, {size:.1f} MB, {len(names)} files"


def crate() -> str:
    """`ekf-core` is packaged, and builds from its package."""
    text = output_of("crate", "cargo", "package", "-p", "ekf-core", "--allow-dirty")  # `tree` asks for changes
    (count,) = re.findall(r"Packaged (\d+) files", text)
    path, size = archive(f"target/package/ekf-core-{versions().partition(' ')[0]}.crate")
    return f"{path.name}, {1e3 * size:.0f} kB, {count} files"


def site() -> str:
    """The site is built without a warning."""
    output_of("site", "make", "docs")
    return f"{len(list((ROOT / 'build' / 'docs').rglob('*.html')))} pages without a warning"


def allowed(terms: str) -> bool:
    """Whether an expression such as `MIT OR Apache-2.0` has a choice all of whose licences are permissive."""
    choices = re.split(r" OR |/", terms.replace("(", "").replace(")", ""))
    return any(set(choice.split(" AND ")) <= PERMISSIVE for choice in choices)


def licences() -> str:
    """Every crate of the wheel has a licence that allows it."""
    text = output_of("licences", sys.executable, "tools/licences.py")
    rows = re.findall(r"^([\w-]+) \d\S+: (.+?)(?: \(no licence file.*)?$", text, flags=re.MULTILINE)
    refused = [f"{name}: {terms}" for name, terms in rows if not allowed(terms)]
    require(rows and not refused, f"licences that are not in the list: {refused}")
    return f"{len(rows)} crates, all permissive"


def advisories() -> str:
    """No known advisory against what is installed or compiled in."""
    commands = {
        "pip-audit": ["pip-audit", "--strict", "-r", "constraints.txt", "--no-deps", "--disable-pip"],
        "cargo-audit": ["cargo", "audit"],
    }
    absent = [name for name in commands if not shutil.which(name)]
    if absent:
        raise Open(f"not looked up, {' and '.join(absent)} not installed; docs/security.md has the commands")
    for name, command in commands.items():
        output_of(name, *command)
    return "none known to PyPI and RustSec"


ITEMS: dict[str, Callable[[], str]] = {
    "tree": tree,
    "versions": versions,
    "changelog": changelog,
    "licences": licences,
    "advisories": advisories,
    "check": check,
    "test": tests,
    "wheel": wheel,
    "sdist": sdist,
    "crate": crate,
    "site": site,
}
"""In this order; what is quick comes first, and the source distribution after the wheel, which it is made with."""


def line_of(name: str) -> tuple[str, str]:
    """Whether an item holds, and its figure or what is in the way."""
    began = time.monotonic()
    try:
        state, text = "held", ITEMS[name]()
    except NotHeld as error:
        state, text = "NOT HELD", str(error)
    except Open as error:
        state, text = "open", str(error)
    seconds = time.monotonic() - began
    return state, text if seconds < 1.0 else f"{text} ({seconds:.0f} s)"


def main(names: list[str]) -> int:
    """Look into items, print the page; 1 where one does not hold."""
    unknown = set(names) - set(ITEMS)
    if unknown:
        print(f"no item is called {', '.join(sorted(unknown))}; items: {', '.join(ITEMS)}", file=sys.stderr)
        return 2
    rows = []
    for name in names or ITEMS:
        print(f"{name} ...", file=sys.stderr, flush=True)
        rows.append((name, *line_of(name)))
    print("\n".join(f"{state:9} {name:11} {text}" for name, state, text in rows))
    counts = {state: sum(row[1] == state for row in rows) for state in ("held", "NOT HELD", "open")}
    print(f"{counts['held']} of {len(rows)} items held, {counts['NOT HELD']} not, {counts['open']} open")
    return 1 if counts["NOT HELD"] else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
