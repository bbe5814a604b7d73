"""Size of the package: statements, tokens, public names, tracked lines of generated JSON schema.

    python tools/size.py

Statements are `ast.stmt` without string expressions, tokens leave out comments, strings and layout; both are counted
over every Python file below `python` and `papers`.
"""

from __future__ import annotations

import ast
import io
import json
import subprocess
import sys
import tokenize
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("python", "papers")
"""Folders that hold the code of the package."""
LAYOUT = ("NL", "NEWLINE", "INDENT", "DEDENT", "ENCODING", "ENDMARKER", "COMMENT", "STRING")
"""Types of tokens that are not counted."""


def statements(source: str) -> int:
    """Statements of a source, without string expressions."""
    nodes = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.stmt))
    return sum(not (isinstance(node, ast.Expr) and is_text(node.value)) for node in nodes)


def is_text(node: ast.expr) -> bool:
    """Whether an expression is a string."""
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def tokens(source: str) -> int:
    """Tokens of a source, without comments, strings and layout; an f-string is a string, the code in it included."""
    count = inside = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        name = tokenize.tok_name[token.type]
        inside += name == "FSTRING_START"
        count += not inside and name not in LAYOUT
        inside -= name == "FSTRING_END"
    return count


def schema_lines() -> int:
    """Tracked lines of JSON schema."""
    listed = subprocess.run(["git", "ls-files", "-z", "*.json"], cwd=ROOT, capture_output=True, text=True, check=True)
    texts = [(ROOT / name).read_text(encoding="utf-8") for name in listed.stdout.split("\0") if (ROOT / name).is_file()]
    return sum(len(text.splitlines()) for text in texts if is_schema(text))


def is_schema(text: str) -> bool:
    """Whether a JSON text is a schema."""
    try:
        content = json.loads(text)
    except ValueError:
        return False
    return isinstance(content, dict) and "json-schema.org" in str(content.get("$schema", ""))


def public_names() -> int:
    """Names in `dir(accelcal)`, in a fresh process."""
    code = "import accelcal; print(len(dir(accelcal)))"
    return int(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)


def main() -> None:
    """Print the size."""
    sources = [path.read_text(encoding="utf-8") for name in FOLDERS for path in sorted((ROOT / name).rglob("*.py"))]
    print(f"{len(sources):6d} files")
    print(f"{sum(map(statements, sources)):6d} statements")
    print(f"{sum(map(tokens, sources)):6d} tokens")
    print(f"{public_names():6d} names in dir(accelcal)")
    print(f"{schema_lines():6d} tracked lines of JSON schema")


if __name__ == "__main__":
    main()
