"""The families of criteria that decide about corridors, and how a user names them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal

from nvsim.errors import InputError

NETWORK_NORMAL: Final = "network-normal"
FAMILIES = ("alpha", "normal", NETWORK_NORMAL, "depth", "slice")
"""In the order in which they are tested."""
MEANS = ("tau_alpha", "tau_normal", "tau_network_normal", "tau_depth", "tau_slice", "support")
"""The thresholds of rule mean. The paper mode names its criteria here, so that a criterion that is added later does not
change the paper's map."""
NormalSource = Literal["criteria", "gaussians", "network", "both"]


def parse_families(names: Iterable[str]) -> tuple[str, ...]:
    """Return the named families, each once and in their order. Names may be separate, or separated by commas.

    Raises InputError if no family is named, or if a name is unknown.
    """
    words = {word.strip() for name in names for word in str(name).split(",")} - {""}
    for word in sorted(words - set(FAMILIES)):
        raise InputError(
            f"The criterion {word!r} is unknown; --criteria takes {', '.join(FAMILIES)}, separated by commas."
        )
    if not words:
        raise InputError(f"No criterion is given; choose one or several of {', '.join(FAMILIES)} with --criteria.")
    return tuple(family for family in FAMILIES if family in words)


def with_normals(criteria: Iterable[str], source: NormalSource) -> tuple[str, ...]:
    """Return the families with those of normals replaced according to `source`: normals of the Gaussians, of a network,
    or both, which must both pass. "criteria" changes nothing."""
    if source == "criteria":
        return tuple(criteria)
    normals = {"gaussians": ("normal",), "network": (NETWORK_NORMAL,), "both": ("normal", NETWORK_NORMAL)}[source]
    return parse_families((*(family for family in criteria if family not in ("normal", NETWORK_NORMAL)), *normals))
