"""Random edits, selections, undos, redos, saves and reopenings keep every rule of a graph and of its history."""

from __future__ import annotations

import random
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from nvsim.graph.difference import apply_deltas, delta_between, difference
from nvsim.graph.edits import EditError
from nvsim.graph.history import History
from nvsim.graph.journal import Journal
from nvsim.graph.operations import OPERATIONS, describe, perform_operation
from nvsim.graph.selection import GraphSelection
from nvsim.graph.store import decode_graph, encode_graph, same_graph
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge

seeds = st.integers(0, 2**32 - 1)


def small_graph(seed: int) -> NavGraph:
    """Some ten viewpoints on a coarse grid, so that coincidences happen, some edges, some evidence."""
    rng = random.Random(seed)
    ids = [f"{rng.randrange(1000):03d}{i}" for i in range(rng.randint(0, 12))]
    viewpoints = {}
    for id in ids:
        place = (rng.randrange(5), rng.randrange(5) / 2, rng.choice([1.5, 4.5]))
        viewpoints[id] = Viewpoint(id, place, origin=rng.choice(["start", "step"]))
    edges = {e.key: e for a in ids for b in ids if a < b and rng.random() < 0.3 for e in (edge(a, b),)}
    cells = np.full((2, 2), 7, np.uint8)
    evidence = {}
    for id in ids:
        for direction in rng.sample(range(10), rng.randint(0, 3)):
            joins = rng.choice(ids) if direction >= 8 else ""
            found = Evidence(
                id, direction, 0.0, 2.5, cells, cells, cells > 0, 0.0, 0.1, 0.9, 0, (0.0, 0.0), joins, "open"
            )
            evidence[found.key] = found
    return NavGraph("machine", viewpoints, edges, evidence)


def assert_rules(graph: NavGraph) -> None:
    """Rules of every graph, and of the indices that edits update."""
    assert all(id == v.id for id, v in graph.viewpoints.items())
    assert all(e.key == key and e.a < e.b for key, e in graph.edges.items())
    assert all(end in graph.viewpoints for key in graph.edges for end in key)
    for key, e in graph.evidence.items():
        assert e.key == key and e.viewpoint in graph.viewpoints and (not e.joins or e.joins in graph.viewpoints)
    fresh = NavGraph(graph.scan, graph.viewpoints, graph.edges, graph.evidence)
    assert {k: set(v) for k, v in graph.adjacency.items()} == {k: set(v) for k, v in fresh.adjacency.items()}
    assert {k: set(v) for k, v in graph.evidence_of.items()} == {k: set(v) for k, v in fresh.evidence_of.items()}
    assert all(len(set(others)) == len(others) for others in graph.adjacency.values())
    assert graph.short_length == fresh.short_length


def random_arguments(name: str, graph: NavGraph, rng: random.Random) -> dict[str, object]:
    """Arguments for an operation, mostly sensible."""
    ids, keys = list(graph.viewpoints), list(graph.edges)

    def value(kind: str) -> object:
        match kind:
            case "name":
                return rng.choice(ids) if ids and rng.random() < 0.7 else f"n{rng.randrange(20)}"
            case "flag":
                return rng.random() < 0.5
            case "number":
                return rng.choice([-1.0, 0.0, 0.3, 0.5, 2.5, 3.0])
            case "integer":
                return rng.randrange(-1, 5)
            case "place":
                return [rng.randrange(5), rng.randrange(5) / 2, rng.choice([1.5, 4.5])]
            case "places":
                return {id: value("place") for id in rng.sample(ids, min(len(ids), 3))}
            case "edge":
                return list(rng.choice(keys)) if keys else ["x", "y"]
            case "viewpoints":
                return rng.sample(ids, rng.randint(0, min(len(ids), 4)))
            case _:
                pairs = rng.sample(keys, min(len(keys), 2)) if rng.random() < 0.5 else []
                return [list(key) for key in pairs] or [rng.sample(ids, 2)] if len(ids) > 1 else []

    return {a.name: value(a.kind) for a in OPERATIONS[name].arguments if a.needed or rng.random() < 0.6}


class EditorMachine(RuleBasedStateMachine):
    """A history in a journal beside a model: the list of graphs that it must hold."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory()
        self.path = Path(self.folder.name) / "edits.db"

    @initialize(seed=seeds)
    def begin(self, seed: int) -> None:
        self.saved = small_graph(seed)
        self.journal = Journal.open(self.path)
        self.history: History = self.journal.history(self.saved)
        self.model: list[tuple[NavGraph, GraphSelection]] = [(self.saved, GraphSelection())]
        self.at = 0

    @rule(name=st.sampled_from(sorted(OPERATIONS)), seed=seeds, drag=st.booleans())
    def edit(self, name: str, seed: int, drag: bool) -> None:
        rng = random.Random(seed)
        before, steps = self.history.graph, len(self.history.steps)
        arguments = random_arguments(name, before, rng)
        merge = "drag" if drag and name == "move_viewpoints" else None
        try:
            perform_operation(self.history, name, arguments, merge=merge)
        except EditError as error:
            assert str(error)[0].isupper() or str(error)[0].isalnum() or str(error)[0] in "'\"", str(error)
            assert self.history.graph is before and len(self.history.steps) == steps
            return
        assert describe(name, arguments)
        after = self.history.graph
        self._check_change(before, after)
        self._follow()

    @rule(seed=seeds, edges=st.booleans())
    def select(self, seed: int, edges: bool) -> None:
        rng = random.Random(seed)
        graph = self.history.graph
        ids, keys = list(graph.viewpoints), list(graph.edges)
        self.history.select(
            GraphSelection(
                frozenset(rng.sample(ids, rng.randint(0, len(ids)))),
                frozenset(rng.sample(keys, rng.randint(0, len(keys)))) if edges else frozenset(),
            )
        )
        self._follow()

    @rule()
    def undo(self) -> None:
        assert self.history.undo() == (self.at > 0)
        self.at = max(0, self.at - 1)

    @rule()
    def redo(self) -> None:
        assert self.history.redo() == (self.at + 1 < len(self.model))
        self.at = min(len(self.model) - 1, self.at + 1)

    @rule(seed=seeds)
    def jump(self, seed: int) -> None:
        self.at = random.Random(seed).randrange(len(self.model))
        self.history.go_to(self.at)

    @rule()
    def save(self) -> None:
        self.saved = decode_graph(encode_graph(self.history.graph))
        self.history.mark_saved()
        assert self.history.is_saved

    @rule(changed=st.booleans())
    def reopen(self, changed: bool) -> None:
        clean = self.history.is_saved
        self.journal.close()
        self.journal = Journal.open(self.path)
        if changed and self.history.steps[1:]:
            self.saved = replace(self.saved, scan=f"{self.saved.scan}x")
        self.history = self.journal.history(self.saved)
        if not any(step.changes for step in self.history.steps):
            self.model, self.at = [(self.saved, GraphSelection())], 0  # nothing is kept of mere looking
        if changed and len(self.history.steps) > 1 and self.history.undo_text == "Changed outside the editor":
            assert same_graph(self.history.graph, self.saved) and self.history.is_saved
            self._follow()
        else:
            assert not clean or self.history.is_saved

    def _check_change(self, before: NavGraph, after: NavGraph) -> None:
        """The notes that edits leave give the same difference and delta as comparing everything."""
        bare = NavGraph(after.scan, after.viewpoints, after.edges, after.evidence, after.ignored)
        for noted, compared in (
            (difference(before, after), difference(before, bare)),
            (difference(after, before), difference(bare, before)),
        ):
            for name, found in vars(noted).items():
                other = getattr(compared, name)
                assert found == other if name.startswith("added") else sorted(found) == sorted(other), name
        assert same_graph(apply_deltas(before, [delta_between(before, after)]), after)

    def _follow(self) -> None:
        """The model takes over what the history says it is, after the steps that both must share."""
        self.at = self.history.index
        kept = self.model[: self.at]
        self.model = [*kept, (self.history.graph, self.history.selection), *self.model[self.at + 1 :]]
        self.model = self.model[: len(self.history.steps)]

    @invariant()
    def history_holds_what_was_done(self) -> None:
        if not hasattr(self, "history"):
            return
        assert self.history.index == self.at and len(self.history.steps) == len(self.model)
        graph, _ = self.model[self.at]
        assert same_graph(self.history.graph, graph)
        assert self.history.selection.viewpoints <= set(self.history.graph.viewpoints)
        assert self.history.selection.edges <= set(self.history.graph.edges)
        assert_rules(self.history.graph)

    def teardown(self) -> None:
        if hasattr(self, "journal"):
            self.journal.close()
        self.folder.cleanup()


def test_random_editing_breaks_no_rule() -> None:
    run_state_machine_as_test(EditorMachine, settings=settings(max_examples=12, stateful_step_count=25, deadline=None))


def test_a_change_from_outside_after_an_undo_is_a_step_of_its_own() -> None:
    machine = EditorMachine()
    try:
        machine.begin(0)
        machine.edit("add_viewpoint", 0, False)
        for act in (
            machine.undo,
            lambda: machine.reopen(True),
            machine.undo,
            machine.redo,
            lambda: machine.reopen(False),
        ):
            act()
            machine.history_holds_what_was_done()
        assert [step.outside for step in machine.history.steps] == [False, True]
    finally:
        machine.teardown()
