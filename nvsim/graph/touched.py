"""What an edit touched: a note that an edited graph carries about the graph it was made from.

It lets `difference` look at a handful of entries instead of at all of them. A note never decides anything: what is
touched may still be equal, and without a note everything is compared. The earlier graph is referred to weakly, so that
no graph keeps its past alive.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import TypeVar

from nvsim.graph.types import EdgeKey, EvidenceKey, NavGraph

T = TypeVar("T")

_FAR = 256  # edits between two graphs; beyond that everything is compared
_NAME = "_trace"


@dataclass(frozen=True)
class Touched:
    """Ids and keys that an edit put, replaced or dropped."""

    viewpoints: tuple[str, ...] = ()
    edges: tuple[EdgeKey, ...] = ()
    evidence: tuple[EvidenceKey, ...] = ()

    def then(self, later: Touched) -> Touched:
        """What this edit and a later one touched, each name once."""
        return Touched(
            _both(self.viewpoints, later.viewpoints),
            _both(self.edges, later.edges),
            _both(self.evidence, later.evidence),
        )


def remember(after: NavGraph, before: NavGraph, touched: Touched) -> None:
    """Notes on `after` that it is `before` except for what was touched."""
    after.__dict__[_NAME] = (weakref.ref(before), touched)


def touched_between(one: NavGraph, other: NavGraph) -> Touched | None:
    """What edits touched that lead from one of the graphs to the other, in either direction; None where no notes lead
    there."""
    return _walk(one, other) or _walk(other, one)


def shorten(after: NavGraph, before: NavGraph) -> None:
    """Lets the note on `after` lead straight to `before`, for when the graphs between are about to go."""
    touched = _walk(before, after)
    if touched is not None and after is not before:
        remember(after, before, touched)


def _walk(before: NavGraph, after: NavGraph) -> Touched | None:
    found, at = Touched(), after
    for _ in range(_FAR):
        if at is before:
            return found
        note = at.__dict__.get(_NAME)
        earlier = None if note is None else note[0]()
        if note is None or earlier is None:
            return None
        found, at = (note[1].then(found) if found != Touched() else note[1]), earlier
    return None


def _both(first: tuple[T, ...], second: tuple[T, ...]) -> tuple[T, ...]:
    if not first or not second:
        return first or second
    return tuple(dict.fromkeys((*first, *second)))
