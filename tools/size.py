"""Size of the package: statements, tokens, public names, tracked lines of generated JSON schema.

    python tools/size.py                 the counts
    python tools/size.py --constants     every numeric constant of the package with the first line of its docstring

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
    """Names in `accelcal.__all__`, in a fresh process."""
    code = "import accelcal; print(len(accelcal.__all__))"
    return int(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)


def constants(source: str) -> list[tuple[int, str, str, str]]:
    """Constants of a module whose value is a number: line, name, value as it is written, first line of docstring.

    Several that are assigned at once have a row each.
    """
    body, listed = ast.parse(source).body, []
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
        both = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
        for name, value in zip(target.elts, node.value.elts, strict=True) if both else [(target, node.value)]:
            if is_number(value):
                listed.append((node.lineno, ast.unparse(name), ast.unparse(value), str(text).split("\n")[0]))
    return listed


def is_number(node: ast.expr) -> bool:
    """Whether an expression is a number, or arithmetic of numbers."""
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def list_constants() -> None:
    """Print every numeric constant, and their number."""
    count = 0
    for path in sorted((ROOT / FOLDERS[0]).rglob("*.py")):
        for line, name, value, text in constants(path.read_text(encoding="utf-8")):
            count += 1
            print(f"{path.relative_to(ROOT / FOLDERS[0] / 'accelcal')}:{line} {name} = {value}  {text}")
    print(f"{count:6d} numeric constants")


def main() -> None:
    """Print the size, or the constants."""
    if sys.argv[1:] == ["--constants"]:
        list_constants()
        return
    sources = [path.read_text(encoding="utf-8") for name in FOLDERS for path in sorted((ROOT / name).rglob("*.py"))]
    print(f"{len(sources):6d} files")
    print(f"{sum(map(statements, sources)):6d} statements")
    print(f"{sum(map(tokens, sources)):6d} tokens")
    print(f"{public_names():6d} names in accelcal.__all__")
    print(f"{schema_lines():6d} tracked lines of JSON schema")


if __name__ == "__main__":
    main()
