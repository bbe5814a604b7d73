"""Administrative data of a certificate: what a laboratory declares in a small TOML file, and what is still missing."""

from __future__ import annotations

import datetime
import difflib
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from accelcal._support.errors import AccelcalError

PLACES = ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
"""Where a calibration may take place, in the words of the DCC."""
NO_DATE = "0001-01-01"
NO_COUNTRY = "ZZ"


class LaboratoryError(AccelcalError):
    """A file of administrative data cannot be used. The text names file and key and states what was expected."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One piece of administrative data."""

    key: str
    """table.key of the file."""
    what: str
    check: Callable[[object], str | None]
    """Its text, or None where the value is not of the kind."""
    stand_in: str
    """What the schema accepts in its place while it is missing."""


def _text(found: object) -> str | None:
    return " ".join(found.split()) or None if isinstance(found, str) else None


def _date(found: object) -> str | None:
    return found.isoformat() if type(found) is datetime.date else None


def _code(pattern: str) -> Callable[[object], str | None]:
    return lambda found: found if isinstance(found, str) and re.fullmatch(pattern, found) else None


ENTRIES = (
    Entry("certificate.identifier", "a text that no other certificate has", _text, "missing"),
    Entry("certificate.country", 'two capital letters of ISO 3166-1, such as "DE"', _code("[A-Z]{2}"), NO_COUNTRY),
    Entry("certificate.begin", "a date without quotes, such as 2026-11-20", _date, NO_DATE),
    Entry("certificate.end", "a date without quotes, such as 2026-11-21", _date, NO_DATE),
    Entry("certificate.place", "one of " + ", ".join(PLACES), _code("|".join(PLACES)), "other"),
    Entry("laboratory.name", "a text", _text, "missing"),
    Entry("laboratory.city", "a text", _text, "missing"),
    Entry("responsible.name", "a text", _text, "missing"),
    Entry("customer.name", "a text", _text, "missing"),
    Entry("customer.city", "a text", _text, "missing"),
)
"""Administrative data that a DCC requires and no recording has."""


@dataclass(frozen=True, slots=True)
class Laboratory:
    """Administrative data as far as they are declared."""

    declared: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Texts by key."""

    @property
    def missing(self) -> tuple[str, ...]:
        """Keys that are not declared."""
        return tuple(entry.key for entry in ENTRIES if entry.key not in self.declared)

    def text(self, key: str) -> str:
        """The declared value, or a placeholder."""
        stand_in = next(entry.stand_in for entry in ENTRIES if entry.key == key)
        return self.declared.get(key, stand_in)


def read_laboratory(path: Path) -> Laboratory:
    """Read and check a file of administrative data.

    Raises
    ------
    LaboratoryError
        Naming file, key, what was found, what was expected.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise LaboratoryError(f"{path}: {(error.strerror or 'cannot be read').lower()}; check the path") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise LaboratoryError(f"{path}: not valid TOML ({error}); correct that line") from None
    known = {entry.key: entry for entry in ENTRIES}
    declared: dict[str, str] = {}
    for table, keys in content.items():
        if not isinstance(keys, dict):
            raise LaboratoryError(f"{path}: {table}: found {keys!r}, expected a table; {_nearest(table, known)}")
        for key, value in keys.items():
            name = f"{table}.{key}"
            if name not in known:
                raise LaboratoryError(f"{path}: {name}: unknown key; {_nearest(name, known)}")
            text = known[name].check(value)
            if text is None:
                raise LaboratoryError(f"{path}: {name}: found {value!r}, expected {known[name].what}")
            declared[name] = text
    return Laboratory(declared)


def _nearest(key: str, known: Mapping[str, Entry]) -> str:
    close = difflib.get_close_matches(key, known, n=1)
    return f'did you mean "{close[0]}"?' if close else "known keys: " + ", ".join(known)
