"""Text from files and names, made fit for a terminal: no character that a terminal obeys instead of showing it."""

from __future__ import annotations

import re

_OBEYED = r"\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufeff"
"""Control characters but tab and line feed, marks that turn the direction of writing, halves of surrogate pairs."""
OBEYED = re.compile(f"[{_OBEYED}]")
"""What never stands in a line or a page of output."""
OBEYED_IN_NAMES = re.compile(f"[{_OBEYED}\t\n]")
"""The same for a name or one sentence, where tab and line feed have no place either."""


def visible(text: str, *, one_line: bool = False) -> str:
    r"""The text with every character that a terminal would obey written as its escape.

    Parameters
    ----------
    text : of any origin.
    one_line : whether tabs and line feeds are escaped as well.

    Examples
    --------
    >>> visible("\x1b[2J") == r"\x1b[2J"
    True
    """
    return (OBEYED_IN_NAMES if one_line else OBEYED).sub(
        lambda found: f"\\x{code:02x}" if (code := ord(found[0])) < 0x100 else f"\\u{code:04x}", text
    )
