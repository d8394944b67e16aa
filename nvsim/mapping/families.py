"""The families of criteria that a corridor can be decided by, and how a user names them."""

from __future__ import annotations

from collections.abc import Iterable

from nvsim.errors import InputError

FAMILIES = ("alpha", "normal", "depth", "slice")
"""In the order in which they are asked."""
_RESERVED = "network-normal"


def chosen(names: Iterable[str]) -> tuple[str, ...]:
    """The families named, each once and in their order. Names may stand alone or with commas between them.

    Raises InputError where there is none, or one that is no family.
    """
    words = {word.strip() for name in names for word in str(name).split(",")} - {""}
    for word in sorted(words - set(FAMILIES)):
        why = "waits for a network of surface normals, and none is installed" if word == _RESERVED else "is unknown"
        raise InputError(f"The criterion {word!r} {why}; --criteria takes {', '.join(FAMILIES)}, joined by commas.")
    if not words:
        raise InputError(f"No criterion is named; give --criteria one of {', '.join(FAMILIES)}, or several.")
    return tuple(family for family in FAMILIES if family in words)
