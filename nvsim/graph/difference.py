"""What differs between two graphs, by identity: it drives redraw, validation and undo."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.graph.types import NavGraph


@dataclass(frozen=True)
class Difference:
    """Ids and keys in file order. "changed" are those in both graphs with another value."""

    added_viewpoints: tuple[str, ...] = ()
    removed_viewpoints: tuple[str, ...] = ()
    changed_viewpoints: tuple[str, ...] = ()
    added_edges: tuple[tuple[str, str], ...] = ()
    removed_edges: tuple[tuple[str, str], ...] = ()
    changed_edges: tuple[tuple[str, str], ...] = ()

    def __bool__(self) -> bool:
        return self != Difference()


def difference(before: NavGraph, after: NavGraph) -> Difference:
    """What has to happen to `before` to become `after`; evidence is not looked at."""
    return Difference(
        tuple(id for id in after.viewpoints if id not in before.viewpoints),
        tuple(id for id in before.viewpoints if id not in after.viewpoints),
        tuple(id for id, v in after.viewpoints.items() if before.viewpoints.get(id, v) != v),
        tuple(key for key in after.edges if key not in before.edges),
        tuple(key for key in before.edges if key not in after.edges),
        tuple(key for key, e in after.edges.items() if before.edges.get(key, e) != e),
    )
