"""Where `unsafe` may stand: in no crate of the extension, in the allocator of one test, and on the device."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SAFE = ("crates/ekf-core/src/lib.rs", "crates/ekf-simd/src/lib.rs", "crates/accelcal-py/src/lib.rs")
"""Roots of the crates that are compiled into the extension."""
ALLOWED = {
    "crates/ekf-simd/tests/allocation.rs": 5,
    "firmware/src/device.rs": 6,
    "firmware/src/outcome.rs": 1,
    "firmware/src/panic.rs": 2,
}
"""How often the word stands: a counting allocator that forwards; registers, stack watermark, names for the linker."""
COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
UNSAFE = re.compile(r"\bunsafe\b")
FORBIDDEN = re.compile(r"^#!\[forbid\(unsafe_code\)\]$", re.MULTILINE)
NEEDS_REASON = re.compile(r"\bunsafe\s*(\{|impl\b|extern\b|\()")
"""A block, an implementation, a list of foreign functions, an attribute: what somebody vouches for."""
BUILT = {"target", "build", "dist", ".venv"}


def unsafe_places(root: Path) -> dict[str, int]:
    """How often `unsafe` stands in each Rust file, but for comments and what was built."""
    results = {}
    for path in sorted(root.rglob("*.rs")):
        place = path.relative_to(root)
        count = len(UNSAFE.findall(COMMENT.sub("", path.read_text(encoding="utf-8"))))
        if count and not BUILT & set(place.parts):
            results[place.as_posix()] = count
    return results


@pytest.mark.parametrize("path", SAFE)
def test_the_crates_of_the_extension_forbid_unsafe_code(path: str) -> None:
    assert FORBIDDEN.search((ROOT / path).read_text(encoding="utf-8"))


def test_every_crate_of_the_extension_is_listed() -> None:
    assert {path.as_posix() for path in (p.relative_to(ROOT) for p in ROOT.glob("crates/*/src/lib.rs"))} == set(SAFE)


def test_unsafe_stands_where_it_is_allowed_and_nowhere_else() -> None:
    assert unsafe_places(ROOT) == ALLOWED


def without_reason(source: str) -> list[int]:
    """Lines, from 1, with `unsafe` code that no line `// SAFETY:` above it argues."""
    lines, argued, places = source.splitlines(), False, []
    for number, line in enumerate(lines, start=1):
        code = COMMENT.sub("", line)
        if NEEDS_REASON.search(code) and not argued:
            places.append(number)
        argued = "// SAFETY:" in line or (argued and not code.strip())
    return places


def test_every_unsafe_block_is_argued() -> None:
    lines = {path: without_reason((ROOT / path).read_text(encoding="utf-8")) for path in ALLOWED}
    print(f"{sum(ALLOWED.values())} times unsafe in {len(ALLOWED)} files")
    assert not {path: numbers for path, numbers in lines.items() if numbers}


def test_a_block_without_a_reason_is_noticed() -> None:
    assert without_reason("// SAFETY: a\nunsafe { f() }\nunsafe { g() }\n// other\n#[unsafe(no_mangle)]\n") == [3, 5]
    assert without_reason("// SAFETY: a\n// more of it\nunsafe impl A for B {\n    unsafe fn f() {}\n") == []


def test_the_search_sees_code_and_no_comments(tmp_path: Path) -> None:
    (tmp_path / "one.rs").write_text("// unsafe\n/* unsafe\n*/\nunsafe fn f() {}\n#[unsafe(no_mangle)]\nunsafety")
    (tmp_path / "target").mkdir()
    (tmp_path / "target" / "made.rs").write_text("unsafe {}")
    assert unsafe_places(tmp_path) == {"one.rs": 2}
    assert not FORBIDDEN.search("// #![forbid(unsafe_code)]\n#![deny(unsafe_code)]")
