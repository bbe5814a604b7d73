"""Every command and every option that a sentence of the product advises exists."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import typer

import accelcal
from accelcal import cli

SOURCES = Path(accelcal.__file__).parent
COMMANDS = typer.main.get_command(cli.app).commands
CALL = re.compile(r"(?<![\w./])accelcal (?=[a-z]+\b)(?P<verb>[a-z]+)(?P<rest>[^;\"`\n]*)")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
NO_COMMANDS = {"as", "brings", "made", "was", "workbench"}
"""Words that follow the product's name where it is the subject of a sentence."""


def texts(tree: ast.AST) -> Iterator[str]:
    """Strings of a module but docstrings, what is formatted into them as {}."""
    inside = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    inside |= {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside:
            yield node.value


def wrong(text: str) -> list[str]:
    """Commands and options in a text that do not exist."""
    missing, anywhere = [], {"--help", "--version"}
    for command in COMMANDS.values():
        anywhere |= {option for p in command.params for option in (*p.opts, *p.secondary_opts)}
    for call in CALL.finditer(text):
        verb, options = call["verb"], OPTION.findall(call["rest"])
        if verb in NO_COMMANDS and not options:
            continue
        if verb not in COMMANDS:
            missing.append(f"accelcal {verb}")
            continue
        of_command = {option for p in COMMANDS[verb].params for option in (*p.opts, *p.secondary_opts)}
        missing += [f"accelcal {verb} {option}" for option in options if option not in of_command]
    if ".py --" not in text and "rustc --" not in text:  # another program's
        missing += [option for option in OPTION.findall(text) if option not in anywhere]
    return missing


def test_commands_and_options_in_sentences_exist() -> None:
    listed, calls = [], 0
    for path in sorted(SOURCES.rglob("*.py")):
        for text in texts(ast.parse(path.read_text(encoding="utf-8"))):
            calls += bool(CALL.search(text))
            listed += [f"{path.relative_to(SOURCES)}: {name} in {text!r}" for name in wrong(text)]
    assert calls > 30
    assert listed == []


def test_a_command_and_an_option_that_do_not_exist_are_reported() -> None:
    assert wrong("use accelcal divide RUN.csv") == ["accelcal divide"]
    assert wrong("run: accelcal improve RUN.csv --method replay") == ["accelcal improve --method"]
    assert wrong("or use a part of it (--frm, --to)") == ["--frm"]
