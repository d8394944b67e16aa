"""The cached evidence of edges equals newly computed evidence after every edit."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from nvsim.benchmarks.graph import random_graph
from nvsim.graph import clearness_cache
from nvsim.graph.clearness_cache import ClearnessCache
from nvsim.graph.edits import EditError
from nvsim.graph.history import History
from nvsim.graph.operations import perform_operation
from nvsim.graph.quantities import QuantityInputs, clearness, quantity
from nvsim.graph.types import EdgeKey, Evidence, NavGraph


def measured(viewpoints: int = 60) -> NavGraph:
    """A random graph with a corridor along each edge, from one of its ends or the other."""
    graph, rng = random_graph(viewpoints, seed=5), np.random.default_rng(5)
    cells = np.zeros((3, 4), np.uint8)
    found = {}
    for number, (a, b) in enumerate(graph.edges):
        start, end = (a, b) if number % 2 else (b, a)
        x, y, _ = graph.viewpoints[end].position
        alpha = rng.integers(0, 255, (3, 4)).astype(np.uint8)
        joins = end if number % 3 else ""
        e = Evidence(start, number, 0.0, 2.0, alpha, cells, cells == 0, 0.1, 0.1, 0.9, 0, (x, y), joins)
        found[e.key] = e
    return replace(graph, evidence=found)


def test_what_is_kept_is_what_one_would_work_out_anew() -> None:
    rng, kept = random.Random(3), ClearnessCache()
    history = History(measured())
    kept.update(history.graph)
    for _ in kept.fill():
        pass
    edits = 0
    while edits < 60:
        graph = history.graph
        id = rng.choice(list(graph.viewpoints))
        near = rng.choice(graph.neighbors(id) or (id,))
        kinds: list[tuple[str, dict[str, Any]]] = [
            ("shift_viewpoints", {"ids": [id], "by": [0.5, 0.0, 0.0]}),
            ("remove_viewpoints", {"ids": [id]}),
            ("split_edge", {"edge": [id, near]}),
            ("merge_viewpoints", {"ids": [id, near], "middle": True}),
            ("remove_edges", {"pairs": [[id, near]]}),
            ("mark_reviewed", {"viewpoints": [id]}),
        ]
        try:
            perform_operation(history, *rng.choice(kinds))
        except EditError:
            continue
        if edits % 4 == 0:
            history.undo()
        edits += 1
        kept.update(history.graph)
        now = history.graph
        assert [kept.at(now, key) for key in now.edges] == pytest.approx(
            [clearness(now, key) for key in now.edges], nan_ok=True
        )


def test_only_what_an_edit_touched_is_worked_out_again(monkeypatch: pytest.MonkeyPatch) -> None:
    history, kept, asked = History(measured()), ClearnessCache(), list[EdgeKey]()

    def counted(graph: NavGraph, key: EdgeKey) -> float:
        asked.append(key)
        return clearness(graph, key)

    monkeypatch.setattr(clearness_cache, "clearness", counted)
    kept.update(history.graph)
    for _ in kept.fill():
        pass
    assert sorted(asked) == sorted(history.graph.edges)
    asked.clear()
    id = next(iter(history.graph.viewpoints))
    perform_operation(history, "shift_viewpoints", {"ids": [id], "by": [0.5, 0.0, 0.0]})
    kept.update(history.graph)
    for _ in kept.fill():
        pass
    around = {id, *history.graph.neighbors(id)}
    assert {key for key in history.graph.edges if id in key} <= set(asked)
    assert all(around.intersection(key) for key in asked) and len(asked) < len(history.graph.edges) / 2


def test_quantities_and_expressions_may_ask_what_is_kept() -> None:
    graph, kept = measured(), ClearnessCache()
    kept.update(graph)
    for name in ("evidence", "alpha"):
        plain = quantity(graph, name, kind="edges")[1]
        assert quantity(graph, name, QuantityInputs(clearness=kept.at), "edges")[1] == pytest.approx(plain, nan_ok=True)


def test_filling_stops_when_another_graph_is_followed() -> None:
    graph, kept = measured(), ClearnessCache()
    kept.update(graph)
    steps = kept.fill()
    next(steps)
    kept.update(None)
    assert list(steps) == []
