"""The history of a graph: steps, undo, redo, selections, drags."""

from __future__ import annotations

from dataclasses import replace

import pytest

from nvsim.benchmarks.graph import random_graph
from nvsim.graph import edits
from nvsim.graph.difference import Difference, GraphDelta, apply_deltas, delta_between, difference
from nvsim.graph.edits import EditError
from nvsim.graph.graph_cache import GraphCache
from nvsim.graph.history import History, HistoryChange
from nvsim.graph.journal_rows import decode_delta, encode_delta
from nvsim.graph.operations import apply, describe, perform_operation
from nvsim.graph.selection import NOTHING, selection
from nvsim.graph.store import decode_graph, encode_graph, same_graph
from nvsim.graph.types import NavGraph, Viewpoint, edge


def row(count: int = 6) -> NavGraph:
    ids = [f"v{i}" for i in range(count)]
    viewpoints = {id: Viewpoint(id, (2.0 * i, 0.0, 1.5)) for i, id in enumerate(ids)}
    return NavGraph("row", viewpoints, {(a, b): edge(a, b) for a, b in zip(ids, ids[1:])})


def test_undo_gives_the_very_graph_and_selection_of_before() -> None:
    first = row()
    history = History(first)
    history.select(selection(["v2"]))
    perform_operation(history, "remove_viewpoints", {"ids": ["v2"]})
    assert history.undo_text == "Remove viewpoint v2" and history.selection == NOTHING
    removed = history.graph
    assert history.undo() and history.graph is first and history.selection == selection(["v2"])
    assert history.redo() and history.graph is removed
    assert history.undo() and history.undo() and history.selection == NOTHING
    assert not history.undo()


def test_a_drag_is_one_step_and_selections_in_a_row_are_one() -> None:
    history = History(row())
    for x in range(20):
        move = {"positions": {"v1": [2.0, float(x), 1.5]}}
        perform_operation(history, "move_viewpoints", move, merge="drag 1")
    for id in ("v1", "v3", "v4"):
        history.select(selection([id]))
    assert [s.text for s in history.steps] == ["Opened", "Move viewpoint v1", "Select viewpoint v4"]
    assert difference(history.graph_at(0), history.graph).changed_viewpoints == ("v1",)
    assert history.steps[1].operation == {"edit": "move_viewpoints", "positions": {"v1": [2.0, 19.0, 1.5]}}


def test_a_selection_of_several_is_not_lost_by_a_click_beside_it() -> None:
    history = History(row())
    for ids in (["v1"], ["v1", "v2"], ["v1", "v2", "v3"], ["v2", "v3"], ["v1", "v2", "v3"]):
        history.select(selection(ids))
    assert len(history.steps) == 2, "what grows, or gives one thing up, is one step"
    history.select(NOTHING)
    assert [s.text for s in history.steps] == ["Opened", "Select 3 viewpoints", "Select nothing"]
    history.undo()
    assert history.selection == selection(["v1", "v2", "v3"])


def test_a_new_drag_or_a_save_begins_a_new_step() -> None:
    history = History(row())

    def drag(y: float, key: str) -> None:
        perform_operation(history, "move_viewpoints", {"positions": {"v1": [2.0, y, 1.5]}}, merge=key)

    drag(1, "drag 1")
    drag(2, "drag 2")
    history.mark_saved()
    drag(3, "drag 2")
    assert len(history.steps) == 4 and not history.is_saved
    history.undo()
    assert history.is_saved


def test_a_click_does_not_cost_what_was_undone() -> None:
    history = History(row())
    perform_operation(history, "remove_edges", {"pairs": [["v0", "v1"]]})
    history.undo()
    history.select(selection(["v4"]))
    assert history.selection == selection(["v4"]) and history.redo_text == "Remove edge v0 – v1"
    assert history.redo() and len(history.graph.edges) == 4


def test_the_clean_mark_survives_selections_and_is_lost_with_its_step() -> None:
    history = History(row())
    perform_operation(history, "remove_edges", {"pairs": [["v0", "v1"]]})
    history.select(selection(["v4"]))
    history.mark_saved()
    history.select(selection(["v3"]))
    assert history.is_saved
    history.go_to(0)
    assert not history.is_saved
    perform_operation(history, "remove_edges", {"pairs": [["v1", "v2"]]})
    history.undo()
    assert not history.is_saved, "the saved graph is nowhere in the history any more"


def test_listeners_hear_each_change_once_with_both_graphs() -> None:
    heard: list[HistoryChange] = []
    history = History(row())
    forget = history.listen(heard.append)
    perform_operation(history, "remove_edges", {"pairs": [["v0", "v1"]]})
    history.select(selection(["v1"]))
    history.undo()
    forget()
    history.undo()
    assert [h.before_graph is h.after_graph for h in heard] == [False, True, True]
    assert [h.selection_changed for h in heard] == [False, True, True]
    assert difference(heard[0].before_graph, heard[0].after_graph) == Difference(removed_edges=(("v0", "v1"),))


def test_a_refused_edit_leaves_the_history_alone() -> None:
    history = History(row())
    with pytest.raises(EditError, match=r"no viewpoint nobody"):
        perform_operation(history, "remove_viewpoints", {"ids": ["v1", "nobody"]})
    assert len(history.steps) == 1


def test_graphs_far_back_are_made_again_from_deltas_without_a_difference() -> None:
    first = row(8)
    graphs = GraphCache(first, budget=1)
    plain = [first]
    for i in range(150):
        before = plain[-1]
        id = f"v{i % 8}"
        x, y, z = before.viewpoints[id].position
        after = edits.move_viewpoints(before, {id: (x, y + 0.1, z)})
        if i % 5 == 0:
            key = next(iter(after.edges))
            after = edits.add_edges(edits.remove_edges(after, [key]), [key])  # to the end of the order
        graphs.store_step(i + 1, before, after)
        plain.append(after)
    for index in (150, 3, 77, 76, 75, 149, 0):
        assert same_graph(graphs[index], plain[index])


def test_a_delta_keeps_an_order_that_puts_and_drops_cannot_give() -> None:
    before = row()
    turned = NavGraph("row", dict(reversed(list(before.viewpoints.items()))), before.edges)
    renamed = edits.rename_viewpoint(before, "v1", "door")
    both = NavGraph("row", dict(reversed(list(renamed.viewpoints.items()))), renamed.edges)
    for after in (turned, renamed, both):
        delta = delta_between(before, after)
        assert same_graph(apply_deltas(before, [delta]), after)
        assert same_graph(decoded_fold(before, [delta]), after)
    assert same_graph(apply_deltas(before, [delta_between(before, renamed), delta_between(renamed, both)]), both)
    # Of what was made again another delta is made.
    made = apply_deltas(before, [delta_between(before, renamed)])
    assert same_graph(apply_deltas(before, [delta_between(before, made)]), renamed)


def decoded_fold(before: NavGraph, deltas: list[GraphDelta]) -> NavGraph:
    return apply_deltas(before, [decode_delta(encode_delta(delta)) for delta in deltas])


def test_a_step_holds_what_it_changed_and_no_more() -> None:
    """Also where the graph was read anew, another viewpoint name stands in the middle, or the scan has another name."""
    graph = random_graph(500, directions=2, seed=1)
    id = list(graph.viewpoints)[40]
    read = decode_graph(encode_graph(graph))  # other objects of the same values
    moved = edits.move_viewpoints(read, {id: (1.0, 2.0, 1.5)})
    near = len(graph.neighbors(id))
    cases = {
        "nothing": (read, 80),
        "moved": (moved, 1500 + 1000 * near),
        "renamed": (edits.rename_viewpoint(graph, id, "door"), 2500 + 1200 * near),
        "scan": (replace(graph, scan="other"), 100),
    }
    for name, (after, most) in cases.items():
        delta = delta_between(graph, after)
        blob = encode_delta(delta)
        assert len(blob) < most < len(encode_graph(graph)) / 4, (name, len(blob))
        assert same_graph(apply_deltas(graph, [decode_delta(blob)]), after), name


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("fly", {}, "There is no edit 'fly'"),
        ("remove_edges", {}, "remove_edges needs pairs"),
        ("remove_edges", {"pairs": [["a"]]}, "it must be a list of pairs of ids"),
        ("remove_edges", {"pairs": [], "all": True}, "no argument 'all'"),
        ("add_viewpoint", {"position": [1, 2, float("nan")]}, "it must be a list of three finite numbers"),
        ("include", {"ids": ["v1"], "included": 1}, "it must be true or false"),
        ("add_viewpoint_at_frame", {"frame": 3}, "no trajectory"),
    ],
)
def test_operations_refuse_arguments_in_a_sentence(name: str, arguments: dict[str, object], message: str) -> None:
    with pytest.raises(EditError, match=message):
        apply(row(), name, arguments)


def test_operations_say_what_they_do() -> None:
    assert describe("remove_edges", {"pairs": [["a", "b"], ["b", "c"]]}) == "Remove 2 edges"
    assert describe("include", {"ids": ["a"], "included": False}) == "Exclude viewpoint a"
    assert describe("lock", {"viewpoints": ["a"], "edges": [["a", "b"]]}) == "Lock viewpoint a and edge a – b"
