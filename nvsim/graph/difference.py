"""The difference between two graphs: by identity for redraw, validation and undo, and as values for the journal.

A delta holds exactly what is needed to rebuild the later graph. `check_steps` detects a damaged or manipulated journal
when it is opened, not at a later undo.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from types import MappingProxyType
from typing import Any, TypeVar, cast

from nvsim.graph.edits.change import copy_mapping
from nvsim.graph.store import encode_evidence
from nvsim.graph.touched_elements import TouchedElements, elements_touched_between, remember
from nvsim.graph.types import Edge, EdgeKey, Evidence, EvidenceKey, NavGraph, Viewpoint

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
    touched = elements_touched_between(before, after)
    if touched is None:
        return Difference(*_compare(before.viewpoints, after.viewpoints), *_compare(before.edges, after.edges))
    return Difference(
        *_changed_names(touched.viewpoints, before.viewpoints, after.viewpoints),
        *_changed_names(touched.edges, before.edges, after.edges),
    )


def _changed_names(names: Iterable[K], before: Mapping[K, Any], after: Mapping[K, Any]) -> _Parts:
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


Runs = tuple[tuple[int, int], ...]
Key = TypeVar("Key")
V = TypeVar("V")


@dataclass(frozen=True, eq=False)
class GraphDelta:
    """Elements to put and names to drop. Elements are added at the end, or replaced in place.

    viewpoints, edges, evidence           elements to put
    no_viewpoints, no_edges, no_evidence  names to drop
    ignored, scan                         new values; None if unchanged
    orders                                new orders of viewpoints, edges and evidence, as runs (start, length) of the
                                          order after putting and dropping; () if that order is right
    whole                                 the complete graph, which journals of version 1 store if the order changed
    """

    viewpoints: tuple[Viewpoint, ...] = ()
    edges: tuple[Edge, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    no_viewpoints: tuple[str, ...] = ()
    no_edges: tuple[EdgeKey, ...] = ()
    no_evidence: tuple[EvidenceKey, ...] = ()
    ignored: Mapping[str, str] | None = None
    scan: str | None = None
    orders: tuple[Runs, Runs, Runs] = ((), (), ())
    whole: NavGraph | None = None


def delta_between(before: NavGraph, after: NavGraph) -> GraphDelta:
    """Return the delta that turns `before` into `after`."""
    touched = elements_touched_between(before, after)
    viewpoints = _parts(before.viewpoints, after.viewpoints, touched.viewpoints if touched is not None else None)
    edges = _parts(before.edges, after.edges, touched.edges if touched is not None else None)
    evidence = _parts(before.evidence, after.evidence, touched.evidence if touched is not None else None)
    ignored = None if before.ignored is after.ignored else after.ignored
    scan = None if before.scan == after.scan else after.scan
    orders = viewpoints[2], edges[2], evidence[2]
    return GraphDelta(viewpoints[0], edges[0], evidence[0], viewpoints[1], edges[1], evidence[1], ignored, scan, orders)


def apply_deltas(graph: NavGraph, deltas: Sequence[GraphDelta]) -> NavGraph:
    """Return the graph after all of `deltas`. The graph is copied only once, even for many deltas."""
    for last in range(len(deltas) - 1, -1, -1):
        whole = deltas[last].whole
        if whole is not None:
            return apply_deltas(whole, deltas[last + 1 :])
    if not deltas:
        return graph
    viewpoints, edges, evidence = (
        copy_mapping(graph.viewpoints),
        copy_mapping(graph.edges),
        copy_mapping(graph.evidence),
    )
    touched: tuple[dict[str, None], dict[EdgeKey, None], dict[EvidenceKey, None]] = ({}, {}, {})
    turned = [False, False, False]
    for d in deltas:
        _apply(viewpoints, d.no_viewpoints, ((v.id, v) for v in d.viewpoints), touched[0])
        _apply(edges, d.no_edges, ((e.key, e) for e in d.edges), touched[1])
        _apply(evidence, d.no_evidence, ((e.key, e) for e in d.evidence), touched[2])
        turned[0] |= _reorder(viewpoints, d.orders[0])
        turned[1] |= _reorder(edges, d.orders[1])
        turned[2] |= _reorder(evidence, d.orders[2])
    after = NavGraph(
        next((d.scan for d in reversed(deltas) if d.scan is not None), graph.scan),
        MappingProxyType(viewpoints) if touched[0] or turned[0] else graph.viewpoints,
        MappingProxyType(edges) if touched[1] or turned[1] else graph.edges,
        MappingProxyType(evidence) if touched[2] or turned[2] else graph.evidence,
        next((d.ignored for d in reversed(deltas) if d.ignored is not None), graph.ignored),
    )
    if not any(turned):  # the note guarantees an unchanged order
        remember(after, graph, TouchedElements(tuple(touched[0]), tuple(touched[1]), tuple(touched[2])))
    return after


def _apply(
    mapping: dict[Key, V], dropped: Iterable[Key], put: Iterable[tuple[Key, V]], touched: dict[Key, None]
) -> None:
    for name in dropped:
        del mapping[name]
        touched[name] = None
    for name, value in put:
        mapping[name] = value
        touched[name] = None


def _reorder(mapping: dict[Key, V], runs: Runs) -> bool:
    """Apply `runs` to the order of a mapping. Returns whether there was a new order."""
    if not runs:
        return False
    entries = list(mapping.items())
    mapping.clear()
    for start, length in runs:
        mapping.update(entries[start : start + length])
    if len(mapping) != len(entries):
        raise ValueError("the new order of a step does not list every element")
    return True


def _parts(
    before: Mapping[Key, V], after: Mapping[Key, V], touched: Sequence[Key] | None
) -> tuple[tuple[V, ...], tuple[Key, ...], Runs]:
    """Return the values to put, the names to drop, and the order if it differs from the default."""
    if before is after:
        return (), (), ()
    if touched is None:
        put = {name: value for name, value in after.items() if not _is_equal(before.get(name), value)}
        dropped = tuple(name for name in before if name not in after)
        gone = set(dropped)
        order = [name for name in before if name not in gone] + [name for name in put if name not in before]
        return tuple(put.values()), dropped, _runs(order, list(after))
    # Elements that were dropped and put again are at the end, among the touched elements. The order of this part is
    # rebuilt.
    present = {name for name in touched if name in after}
    end = tuple(takewhile(present.__contains__, reversed(cast("dict[Key, V]", after))))[::-1]
    anew = set(end)
    inside = [name for name in touched if name in present and name not in anew]
    dropped = tuple(name for name in touched if name in before and (name not in present or name in anew))
    return tuple(after[name] for name in (*inside, *end)), dropped, ()


def _is_equal(one: object, other: object) -> bool:
    """Whether two values are equal. A graph that was read again from disk consists of other objects."""
    if one is other or not (isinstance(one, Evidence) and isinstance(other, Evidence)):
        return one == other
    return encode_evidence(one) == encode_evidence(other)


def _runs(names: Sequence[Key], wanted: Sequence[Key]) -> Runs:
    """Return `wanted` as runs (start, length) of `names`; () if both are equal."""
    if names == wanted:
        return ()
    place = {name: i for i, name in enumerate(names)}
    runs: list[tuple[int, int]] = []
    for name in wanted:
        at = place[name]
        if runs and runs[-1][0] + runs[-1][1] == at:
            runs[-1] = (runs[-1][0], runs[-1][1] + 1)
        else:
            runs.append((at, 1))
    return tuple(runs)


def check_steps(base: NavGraph, deltas: Iterable[GraphDelta]) -> None:
    """Check all steps in order. Raises ValueError that names the first inconsistent step."""
    viewpoints, edges, evidence = set(base.viewpoints), set(base.edges), set(base.evidence)
    degrees = Counter(end for key in edges for end in key)
    for number, delta in enumerate(deltas, 1):
        if delta.whole is not None:
            viewpoints, edges = set(delta.whole.viewpoints), set(delta.whole.edges)
            evidence, degrees = set(delta.whole.evidence), Counter(end for key in edges for end in key)
            continue
        gone = (set(delta.no_viewpoints), set(delta.no_edges), set(delta.no_evidence))
        if not (gone[0] <= viewpoints and gone[1] <= edges and gone[2] <= evidence):
            raise ValueError(f"step {number} removes elements that do not exist")
        new = {edge.key for edge in delta.edges}
        degrees.subtract(end for key in gone[1] for end in key)
        edges -= gone[1]
        degrees.update(end for key in new - edges for end in key)
        edges |= new
        viewpoints = (viewpoints - gone[0]) if gone[0] else viewpoints
        viewpoints |= {viewpoint.id for viewpoint in delta.viewpoints}
        evidence = (evidence - gone[2]) | {each.key for each in delta.evidence}
        if any(degrees[id] for id in gone[0] if id not in viewpoints):
            raise ValueError(f"step {number} leaves an edge without its viewpoint")
        if any(not (a < b and a in viewpoints and b in viewpoints) for a, b in new):
            raise ValueError(f"step {number} adds an edge without its viewpoints")
        counts = (len(viewpoints), len(edges), len(evidence))
        for runs, count in zip(delta.orders, counts, strict=True):
            if runs and not _is_order(runs, count):
                raise ValueError(f"step {number} has an order that does not list every element once")


def _is_order(runs: Runs, count: int) -> bool:
    at = 0
    for start, length in sorted(runs):
        if start != at or length < 1:
            return False
        at += length
    return at == count
