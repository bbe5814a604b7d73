"""What `dir()` and tab completion show of a module: its public names, not what it imports."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import ModuleType


def listing(module: Mapping[str, object]) -> Callable[[], list[str]]:
    """Make the `__dir__` of a module from its `globals()`.

    It lists `__all__`; where there is none, what the module itself defines, of a package its own modules.
    """

    def names() -> list[str]:
        listed = module.get("__all__")
        if isinstance(listed, list | tuple):
            return sorted(map(str, listed))
        return sorted(name for name, value in module.items() if not name.startswith("_") and is_own(value))

    def is_own(value: object) -> bool:
        own = str(module["__name__"])
        if isinstance(value, ModuleType):
            return value.__name__.startswith(f"{own}.")
        return getattr(value, "__module__", "") == own

    return names
