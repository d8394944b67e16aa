"""The difference between two graphs as values, including evidence and order. A delta holds exactly what is needed to
rebuild the later graph. `check_steps` detects a damaged or manipulated journal when it is opened, not at a later
undo."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from types import MappingProxyType
from typing import TypeVar, cast

from nvsim.graph.edits.change import copied
from nvsim.graph.store import encode_evidence
from nvsim.graph.touched import Touched, remember, touched_between
from nvsim.graph.types import Edge, EdgeKey, Evidence, EvidenceKey, NavGraph, Viewpoint

Runs = tuple[tuple[int, int], ...]
K = TypeVar("K")
V = TypeVar("V")


@dataclass(frozen=True, eq=False)
class Delta:
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


def delta_between(before: NavGraph, after: NavGraph) -> Delta:
    """Return the delta that turns `before` into `after`."""
    touched = touched_between(before, after)
    viewpoints = _parts(before.viewpoints, after.viewpoints, touched.viewpoints if touched is not None else None)
    edges = _parts(before.edges, after.edges, touched.edges if touched is not None else None)
    evidence = _parts(before.evidence, after.evidence, touched.evidence if touched is not None else None)
    ignored = None if before.ignored is after.ignored else after.ignored
    scan = None if before.scan == after.scan else after.scan
    orders = viewpoints[2], edges[2], evidence[2]
    return Delta(viewpoints[0], edges[0], evidence[0], viewpoints[1], edges[1], evidence[1], ignored, scan, orders)


def folded(graph: NavGraph, deltas: Sequence[Delta]) -> NavGraph:
    """Return the graph after all of `deltas`. The graph is copied only once, even for many deltas."""
    for last in range(len(deltas) - 1, -1, -1):
        whole = deltas[last].whole
        if whole is not None:
            return folded(whole, deltas[last + 1 :])
    if not deltas:
        return graph
    viewpoints, edges, evidence = copied(graph.viewpoints), copied(graph.edges), copied(graph.evidence)
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
        remember(after, graph, Touched(tuple(touched[0]), tuple(touched[1]), tuple(touched[2])))
    return after


def _apply(mapping: dict[K, V], dropped: Iterable[K], put: Iterable[tuple[K, V]], touched: dict[K, None]) -> None:
    for name in dropped:
        del mapping[name]
        touched[name] = None
    for name, value in put:
        mapping[name] = value
        touched[name] = None


def _reorder(mapping: dict[K, V], runs: Runs) -> bool:
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
    before: Mapping[K, V], after: Mapping[K, V], touched: Sequence[K] | None
) -> tuple[tuple[V, ...], tuple[K, ...], Runs]:
    """Return the values to put, the names to drop, and the order if it differs from the default."""
    if before is after:
        return (), (), ()
    if touched is None:
        put = {name: value for name, value in after.items() if not _same(before.get(name), value)}
        dropped = tuple(name for name in before if name not in after)
        gone = set(dropped)
        order = [name for name in before if name not in gone] + [name for name in put if name not in before]
        return tuple(put.values()), dropped, _runs(order, list(after))
    # Elements that were dropped and put again are at the end, among the touched elements. The order of this part is
    # rebuilt.
    present = {name for name in touched if name in after}
    end = tuple(takewhile(present.__contains__, reversed(cast("dict[K, V]", after))))[::-1]
    anew = set(end)
    inside = [name for name in touched if name in present and name not in anew]
    dropped = tuple(name for name in touched if name in before and (name not in present or name in anew))
    return tuple(after[name] for name in (*inside, *end)), dropped, ()


def _same(one: object, other: object) -> bool:
    """Whether two values are equal. A graph that was read again from disk consists of other objects."""
    if one is other or not (isinstance(one, Evidence) and isinstance(other, Evidence)):
        return one == other
    return encode_evidence(one) == encode_evidence(other)


def _runs(names: Sequence[K], wanted: Sequence[K]) -> Runs:
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


def check_steps(base: NavGraph, deltas: Iterable[Delta]) -> None:
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
