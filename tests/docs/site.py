"""What is checked of built pages: links that lead somewhere, and nothing that a network would have to deliver."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {
    "script": ("src",),
    "link": ("href",),
    "img": ("src", "srcset"),
    "source": ("src", "srcset"),
    "video": ("src", "poster"),
    "audio": ("src",),
    "iframe": ("src",),
    "object": ("data",),
    "embed": ("src",),
    "use": ("href", "xlink:href"),
    "image": ("href", "xlink:href"),
}
"""Attributes by which a page makes a browser fetch something when it is opened."""
LINKS_TO_FOLLOW = {"next", "prev", "search", "index", "author", "copyright", "help", "canonical"}
"""Relations of a link that no browser fetches by itself."""
REMOTE = re.compile(r"^\s*(?:[a-z][a-z0-9+.-]*:)?//", re.IGNORECASE)
IN_STYLES = re.compile(r"url\(\s*['\"]?([^'\")]+)|@import\s+['\"]([^'\"]+)")


@dataclass
class Page(HTMLParser):
    """The addresses of one page."""

    loads: list[str] = field(default_factory=list)
    links: list[str] = field(default_factory=list)
    anchors: set[str] = field(default_factory=set)
    styles: list[str] = field(default_factory=list)
    inside: str = ""

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.inside = tag
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        self.styles.append(given.get("style", ""))
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if tag == "link" and set(given.get("rel", "").split()) & LINKS_TO_FOLLOW:
            self.links.append(given.get("href", ""))
            return
        self.loads += [given[name] for name in LOADED.get(tag, ()) if name in given]

    def handle_data(self, data: str) -> None:
        if self.inside == "style":
            self.styles.append(data)


def read(path: Path) -> Page:
    """Return the addresses on a page."""
    page = Page()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def remote(folder: Path) -> Iterator[str]:
    """Yield everything that opening a page of a folder, or one of its style sheets, would fetch from a network."""
    for path in sorted(folder.rglob("*.html")):
        page = read(path)
        fetched = [*page.loads, *(address for text in page.styles for address in in_styles(text))]
        yield from (f"{path.name}: {address}" for address in fetched if REMOTE.match(address))
    for path in sorted(folder.rglob("*.css")):
        fetched = in_styles(path.read_text(encoding="utf-8"))
        yield from (f"{path.name}: {address}" for address in fetched if REMOTE.match(address))


def in_styles(text: str) -> list[str]:
    """Addresses in CSS."""
    return [a or b for a, b in IN_STYLES.findall(text)]


def broken(folder: Path) -> Iterator[str]:
    """Yield every link of the pages of a folder, and everything they load, that is not there."""
    pages = {path.resolve(): read(path) for path in folder.rglob("*.html")}
    for path, page in sorted(pages.items()):
        for address in (*page.links, *page.loads):
            parts = urlsplit(address)
            if parts.scheme or REMOTE.match(address):
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.is_file():
                yield f"{path.name}: {address}: there is no such file"
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                yield f"{path.name}: {address}: there is no such place on the page"
