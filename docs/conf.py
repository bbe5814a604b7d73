"""How the site is built: Sphinx, from these pages, the docstrings and the catalogue; `make docs` runs it."""

from __future__ import annotations

import inspect
import os
import re
import sys
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure as StillFigure
from plotly.graph_objects import Figure as InteractiveFigure

import accelcal
import accelcal.plots.interactive
from accelcal.cli import app as cli
from accelcal.effects import BUILT_IN, Effect, spelled
from accelcal.effects.processes import symptoms
from accelcal.plots import matplotlib
from accelcal.plots.figure import THEMES
from accelcal.plots.signature import caption, signature
from accelcal.results import json as results_json, json_text

project = "accelcal"
version = release = accelcal.__version__
copyright = "the authors of accelcal; MIT or Apache-2.0"
html_title = f"accelcal {release}"

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 600
autodoc_member_order = "bysource"
autodoc_default_options = {"undoc-members": True}
default_role = "code"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"Array": "Array", "ThemeName": "ThemeName"}
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_theme_options = {"top_of_page_buttons": []}
html_show_sourcelink = False
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]
pygments_style = "friendly"
pygments_dark_style = "github-dark"

for module in [m for name, m in sys.modules.items() if name.startswith("accelcal.plots")]:
    # They import these types for type checkers alone; with the type known, the link leads to the right class.
    vars(module).setdefault("Figure", StillFigure)
    vars(module).setdefault("Drawn", InteractiveFigure if module.__name__.endswith(".plotly") else StillFigure)

SYMPTOMS = "<!-- symptoms of the catalogue -->"
"""Mark of a page for the table of what every effect looks like."""
GALLERY = "<!-- gallery -->"
"""Mark of a page for the pictures of all effects."""
COMMANDS = "<!-- all commands -->"
"""Mark of a page for the table of all commands."""
MODULES = "<!-- modules -->"
"""Mark of a page for the index of source files."""
SCHEMAS = "<!-- schemas -->"
"""Mark of a page for the table of all JSON schemas."""


def pictures(app: Any) -> Path:
    """Folder of the cards' pictures, next to the doctrees and never among the sources."""
    return Path(app.doctreedir) / "pictures"


def draw(app: Any) -> None:
    """Draw the picture of every card, light and dark."""
    folder = pictures(app)
    folder.mkdir(parents=True, exist_ok=True)
    for effect in BUILT_IN:
        for theme in THEMES:
            matplotlib.save(matplotlib.draw(signature(effect), theme), folder / f"{effect.name}-{theme}.png")


def complete(app: Any, page: str, source: list[str]) -> None:
    """Put pictures into the page of cards, and the tables of symptoms and commands where a page has their mark."""
    if page == "effects":
        folder = os.path.relpath(pictures(app), app.srcdir)
        by_name = {effect.name: effect for effect in BUILT_IN}
        source[0] = re.sub(
            r"^## (\w+)\n", lambda head: head[0] + pair(by_name[head[1]], folder), source[0], flags=re.MULTILINE
        )
    if GALLERY in source[0]:
        source[0] = source[0].replace(GALLERY, gallery(os.path.relpath(pictures(app), app.srcdir)))
    source[0] = source[0].replace(SYMPTOMS, symptoms(BUILT_IN)).replace(COMMANDS, commands())
    source[0] = source[0].replace(SCHEMAS, schemas()).replace(MODULES, modules())


def pair(effect: Effect, folder: str, options: str = "") -> str:
    """One picture in both themes."""
    return "".join(
        f"\n```{{image}} {folder}/{effect.name}-{theme}.png\n"
        f":alt: {caption(effect)}\n:class: only-{theme}\n{options}```\n"
        for theme in THEMES
    )


OWNERS = {
    "sensor": "Of the sensor",
    "mounting": "Of its mounting",
    "timing": "Of the clocks",
    "rig": "Of the stage and its surroundings",
    "encoder": "Of the position reference",
}
"""Headings of the gallery, by the owner of an effect."""


def gallery(folder: str) -> str:
    """A picture of every effect with its name and first sentence, by owner; each leads to its card."""
    parts = []
    for owner, heading in OWNERS.items():
        parts.append(f"\n## {heading}\n\n::::{{container}} gallery\n")
        for effect in (e for e in BUILT_IN if e.owner == owner):
            anchor = effect.name.replace("_", "-")
            target = f":target: effects.html#{anchor}\n"
            name = f"**[{spelled(effect.name)}](effects.md#{anchor})**"
            parts.append(f":::{{container}} tile\n{pair(effect, folder, target)}\n{name}\n\n{effect.summary}\n:::\n")
        parts.append("::::\n")
    return "\n".join(parts)


def schemas() -> str:
    """Every JSON schema with what it is of, and a link to its file."""
    rows = [
        f"| `accelcal schema {name}` | {(inspect.getdoc(results_json.kind_of(name)) or '').splitlines()[0]} | "
        f'<a href="schemas/{name}.json">{name}.json</a> |'
        for name in results_json.SCHEMAS
    ]
    return "\n".join(["| command | what it is of | file |", "|---|---|---|", *rows])


def modules() -> str:
    """Every source file of the package and of the crates, with the first sentence of its documentation, by folder."""
    root = Path(__file__).parent.parent
    first = {".py": r'"""((?s:.*?))(?:"""|\n\n)', ".rs": r"((?://! .+\n)+)"}
    lines, folder = [], Path()
    for path in sorted([*root.glob("python/**/*.py"), *root.glob("crates/*/src/**/*.rs")], key=lambda p: (p.parent, p)):
        text = re.match(first[path.suffix], path.read_text(encoding="utf-8"))
        if path.parent != folder:
            folder = path.parent
            lines.append(f"\n## `{folder.relative_to(root)}`\n")
        if text:
            sentence = re.sub(r"\[(`[^]]*`)\]", r"\1", " ".join(text[1].replace("//! ", "").split()))
            lines.append(f"- `{path.name}`: {sentence}")
    return "\n".join(lines)


def publish(app: Any, error: Exception | None) -> None:
    """Write the schemas beside the pages."""
    folder = Path(app.outdir) / "schemas"
    folder.mkdir(parents=True, exist_ok=True)
    for name in results_json.SCHEMAS:
        (folder / f"{name}.json").write_text(json_text.dumps(results_json.schema(name)), encoding="utf-8")


def commands() -> str:
    """Every command with what it does and its example, from its own help."""
    rows = []
    for command in cli.registered_commands:
        text = inspect.getdoc(command.callback) or ""
        example = re.search(r"Example: \[bold\](.*?)\[/bold\]", text, flags=re.DOTALL)
        name = command.name or command.callback.__name__
        shown = f"`{' '.join(example[1].split())}`" if example else ""
        rows.append(f"| `{name}` | {text.splitlines()[0]} | {shown} |")
    return "\n".join(["| command | what it does | example |", "|---|---|---|", *rows])


COLON = "\N{RATIO}"
"""Replaces a colon while napoleon would read the text before it as the type of an attribute."""


def described(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Let napoleon read docstrings of this package as they are meant.

    `x : what it is` is a description of a parameter, not its type; the text of an attribute may contain a colon; and
    |rho| is an absolute value, not a substitution.
    """
    section, remaining = "", list[str]()
    for i, line in enumerate(lines):
        if i + 1 < len(lines) and lines[i + 1].startswith("---"):
            section = line
        if not line.lstrip().startswith(">>>"):
            line = line.replace("|", r"\|")
        entry = re.fullmatch(r"([\w*][\w, *]*) : (.+)", line) if section == "Parameters" else None
        remaining += [entry[1].replace("*", r"\*"), f"    {entry[2]}"] if entry else [line]
    if what in ("attribute", "property"):
        remaining[:1] = [line.replace(":", COLON) for line in remaining[:1]]
    lines[:] = remaining


def unguarded(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Restore the colons after napoleon."""
    lines[:] = [line.replace(COLON, ":") for line in lines]


def setup(app: Any) -> None:
    """Hook all of it into the build."""
    app.connect("builder-inited", draw)
    app.connect("source-read", complete)
    app.connect("build-finished", publish)
    app.connect("autodoc-process-docstring", described, priority=400)
    app.connect("autodoc-process-docstring", unguarded, priority=600)
