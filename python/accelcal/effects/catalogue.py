"""A catalogue: entries by name, and room for catalogues that others in the same process do not see."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

Entry = TypeVar("Entry")


class Catalogue(MutableMapping[str, Entry]):
    """Entries by name, in the order of entry.

    There is one for the process. Inside :meth:`apart` the same object is another one, for whoever runs in that context
    alone: a thread or a task begun there sees it if the context is copied to it.
    """

    def __init__(self) -> None:
        self._common: dict[str, Entry] = {}
        self._apart: ContextVar[dict[str, Entry] | None] = ContextVar("catalogue", default=None)

    @contextmanager
    def apart(self) -> Iterator[None]:
        """A catalogue that begins as that of the process; what is entered into it or removed is so inside alone."""
        token = self._apart.set(dict(self._common))
        try:
            yield
        finally:
            self._apart.reset(token)

    @property
    def _entries(self) -> dict[str, Entry]:
        own = self._apart.get()
        return self._common if own is None else own

    def __getitem__(self, name: str) -> Entry:
        return self._entries[name]

    def __setitem__(self, name: str, entry: Entry) -> None:
        self._entries[name] = entry

    def __delitem__(self, name: str) -> None:
        del self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __contains__(self, name: object) -> bool:
        return name in self._entries

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self)})"
