"""Check that the steps of a journal are consistent: each drops only existing elements and leaves no edge without its
viewpoints. A damaged or manipulated journal is detected when it is opened, not at a later undo."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from nvsim.graph.delta import Delta, Runs
from nvsim.graph.types import NavGraph


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
