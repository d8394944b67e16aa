"""Notes on edited graphs about the elements that an edit touched.

With a note, `difference` compares a few entries and not the whole graph. A note is only a hint: a touched element may
still be equal, and without a note everything is compared. The note holds a weak reference to the earlier graph, so that
graphs do not keep their predecessors in memory.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import TypeVar

from nvsim.graph.types import EdgeKey, EvidenceKey, NavGraph

T = TypeVar("T")

_FAR = 256  # maximum number of edits between two graphs; beyond it, everything is compared
_NAME = "_trace"


@dataclass(frozen=True)
class TouchedElements:
    """Ids and keys that an edit added, replaced or removed."""

    viewpoints: tuple[str, ...] = ()
    edges: tuple[EdgeKey, ...] = ()
    evidence: tuple[EvidenceKey, ...] = ()

    def merged_with(self, later: TouchedElements) -> TouchedElements:
        """Return the elements that this edit and a later one touched, each name once."""
        return TouchedElements(
            _union(self.viewpoints, later.viewpoints),
            _union(self.edges, later.edges),
            _union(self.evidence, later.evidence),
        )


def remember(after: NavGraph, before: NavGraph, touched: TouchedElements) -> None:
    """Store a note on `after`: it equals `before` except for the touched elements."""
    after.__dict__[_NAME] = (weakref.ref(before), touched)


def elements_touched_between(one: NavGraph, other: NavGraph) -> TouchedElements | None:
    """Return the elements that the edits between two graphs touched, in either direction. None if no notes connect the
    graphs."""
    return _follow_notes(one, other) or _follow_notes(other, one)


def shorten_note(after: NavGraph, before: NavGraph) -> None:
    """Let the note on `after` refer directly to `before`. Use this if the graphs between them are about to be
    deleted."""
    touched = _follow_notes(before, after)
    if touched is not None and after is not before:
        remember(after, before, touched)


def _follow_notes(before: NavGraph, after: NavGraph) -> TouchedElements | None:
    found, at = TouchedElements(), after
    for _ in range(_FAR):
        if at is before:
            return found
        note = at.__dict__.get(_NAME)
        earlier = None if note is None else note[0]()
        if note is None or earlier is None:
            return None
        found, at = (note[1].merged_with(found) if found != TouchedElements() else note[1]), earlier
    return None


def _union(first: tuple[T, ...], second: tuple[T, ...]) -> tuple[T, ...]:
    if not first or not second:
        return first or second
    return tuple(dict.fromkeys((*first, *second)))
