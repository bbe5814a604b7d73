"""Names of effects that a notebook completes: `names.cu<tab>` is "cubic"."""

from __future__ import annotations

from accelcal.effects.processes import find
from accelcal.effects.registry import CATALOGUE


class Names:
    """Every effect of the catalogue as an attribute, whose value is its name; those of users appear when they enter.

    Examples
    --------
    >>> Names().cubic, "odd_quadratic" in dir(Names())
    ('cubic', True)
    """

    __slots__ = ()

    def __getattr__(self, name: str) -> str:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return find(name).name
        except ValueError as error:
            raise AttributeError(str(error)) from None

    def __dir__(self) -> list[str]:
        return sorted(CATALOGUE)

    def __repr__(self) -> str:
        return f"Names({len(CATALOGUE)} effects; effects.names.<tab> lists them)"


names = Names()
"""The catalogue's names."""
