"""The families of criteria that a corridor can be decided by, and how a user names them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal

from nvsim.errors import InputError

NETWORK_NORMAL: Final = "network-normal"
FAMILIES = ("alpha", "normal", NETWORK_NORMAL, "depth", "slice")
"""In the order in which they are asked."""
NormalSource = Literal["criteria", "gaussians", "network", "both"]


def chosen(names: Iterable[str]) -> tuple[str, ...]:
    """The families named, each once and in their order. Names may stand alone or with commas between them.

    Raises InputError where there is none, or one that is no family.
    """
    words = {word.strip() for name in names for word in str(name).split(",")} - {""}
    for word in sorted(words - set(FAMILIES)):
        raise InputError(
            f"The criterion {word!r} is unknown; --criteria takes {', '.join(FAMILIES)}, joined by commas."
        )
    if not words:
        raise InputError(f"No criterion is named; give --criteria one of {', '.join(FAMILIES)}, or several.")
    return tuple(family for family in FAMILIES if family in words)


def with_normals(criteria: Iterable[str], source: NormalSource) -> tuple[str, ...]:
    """The families with those of the normals that `source` says: of the Gaussians, of a network, or both, of which each
    must pass; "criteria" leaves them as they are."""
    if source == "criteria":
        return tuple(criteria)
    normals = {"gaussians": ("normal",), "network": (NETWORK_NORMAL,), "both": ("normal", NETWORK_NORMAL)}[source]
    return chosen((*(family for family in criteria if family not in ("normal", NETWORK_NORMAL)), *normals))
