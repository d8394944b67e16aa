"""The difference between two graphs by identity. It drives redraw, validation and undo."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from nvsim.graph.touched import touched_between
from nvsim.graph.types import NavGraph

K = TypeVar("K", bound=Hashable)
_BLOCK = 256
_Parts = tuple[tuple[Any, ...], tuple[Any, ...], tuple[Any, ...]]


@dataclass(frozen=True)
class Difference:
    """Ids and keys of the elements that differ. Added elements are in file order. "changed" elements are in both graphs
    with different values."""

    added_viewpoints: tuple[str, ...] = ()
    removed_viewpoints: tuple[str, ...] = ()
    changed_viewpoints: tuple[str, ...] = ()
    added_edges: tuple[tuple[str, str], ...] = ()
    removed_edges: tuple[tuple[str, str], ...] = ()
    changed_edges: tuple[tuple[str, str], ...] = ()

    def __bool__(self) -> bool:
        return self != Difference()


def difference(before: NavGraph, after: NavGraph) -> Difference:
    """Return the difference that turns `before` into `after`. Evidence is not compared."""
    touched = touched_between(before, after)
    if touched is None:
        return Difference(*_compare(before.viewpoints, after.viewpoints), *_compare(before.edges, after.edges))
    return Difference(
        *_among(touched.viewpoints, before.viewpoints, after.viewpoints),
        *_among(touched.edges, before.edges, after.edges),
    )


def _among(names: Iterable[K], before: Mapping[K, Any], after: Mapping[K, Any]) -> _Parts:
    """Return the added, removed and changed names if only `names` can differ."""
    added, removed, changed = [], [], []
    for name in names:
        old, new = before.get(name), after.get(name)
        if old is new:
            continue
        if old is None:
            added.append(name)
        elif new is None:
            removed.append(name)
        elif old != new:
            changed.append(name)
    return _in_order(added, after), tuple(removed), tuple(changed)


def _in_order(names: list[K], mapping: Mapping[K, Any]) -> tuple[K, ...]:
    if len(names) < 2:
        return tuple(names)
    wanted = set(names)
    tail: list[K] = []
    # An edit usually adds elements at the end.
    for name in reversed(list(mapping)):
        if name not in wanted:
            break
        tail.append(name)
    if len(tail) == len(names):
        return tuple(reversed(tail))
    return tuple(name for name in mapping if name in wanted)


def _compare(before: Mapping[K, Any], after: Mapping[K, Any]) -> _Parts:
    """Return the added, removed and changed names. Equal blocks at the beginning and the end are skipped, because lists
    compare by identity first, in C. Only the part between is looked up by name."""
    if before is after:
        return (), (), ()
    old, new = list(before.values()), list(after.values())
    shorter = min(len(old), len(new))
    start = 0
    while start < shorter and old[start : start + _BLOCK] == new[start : start + _BLOCK]:
        start = min(start + _BLOCK, shorter)
    end = 0
    while end < shorter - start:
        step = min(_BLOCK, shorter - start - end)
        if old[len(old) - end - step : len(old) - end] != new[len(new) - end - step : len(new) - end]:
            break
        end += step
    was = dict(list(before.items())[start : len(old) - end])
    now = dict(list(after.items())[start : len(new) - end])
    return (
        tuple(key for key in now if key not in was),
        tuple(key for key in was if key not in now),
        tuple(key for key, value in now.items() if was.get(key, value) is not value and was[key] != value),
    )
