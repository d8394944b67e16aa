"""Editing in the window: a project's graph survives a crash, a second window only looks, saving, undo, the title."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import demo_project
import demo_room
import pytest
from pytestqt.qtbot import QtBot

from nvsim.graph.findings import check_graph
from nvsim.graph.scripts import script
from nvsim.graph.selection import GraphSelection
from nvsim.graph.store import decode_graph, encode_graph
from nvsim.graph.types import NavGraph
from nvsim.project.project import Project
from nvsim_app.state import edit_commands
from nvsim_app.state.document import Document
from nvsim_app.state.graph_files import ProjectGraph
from nvsim_app.state.loading import Contents
from nvsim_app.state.side_work import evidence_task
from nvsim_app.wiring.editing import EditPart
from nvsim_app.wiring.window import MainWindow

Opened = Callable[[], Document]


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return demo_project.write_project(tmp_path / "demo.nvsim", models=0)


@pytest.fixture
def opened(project: Path, qapp: object) -> Iterator[Opened]:
    """Opens the project once more, as another window would."""
    made: list[Document] = []

    def open() -> Document:
        document = Document()
        with Project.open(project) as stored:
            graph = stored.graph()
        document.set_contents(Contents(project, graph=graph, graph_file=ProjectGraph(project)))
        made.append(document)
        return document

    yield open
    for document in made:
        document.editing.close()


def test_edits_that_were_not_saved_come_back(opened: Opened) -> None:
    first = opened()
    key = next(iter(first.graph.edges))
    first.editing.run("remove_edges", {"pairs": [list(key)]})
    first.editing.close()  # the disk holds what a crash would leave
    told: list[str] = []
    second = Document()
    second.editing.notified.connect(told.append)
    with Project.open(first.path) as stored:
        assert key in stored.graph().edges
        contents = replace(first.contents, graph=stored.graph(), graph_file=ProjectGraph(first.path))
    second.set_contents(contents)
    assert key not in second.graph.edges and second.editing.dirty
    assert "1 unsaved edit" in told[0]
    second.editing.undo()
    assert key in second.graph.edges and not second.editing.dirty
    second.editing.close()


def test_saving_writes_the_project_and_clears_the_mark(opened: Opened, project: Path) -> None:
    document = opened()
    key = next(iter(document.graph.edges))
    document.editing.run("remove_edges", {"pairs": [list(key)]})
    assert document.editing.dirty
    document.editing.save(wait=True)
    from PySide6.QtWidgets import QApplication

    QApplication.processEvents()
    assert not document.editing.dirty
    with Project.open(project) as stored:
        assert key not in stored.graph().edges
    document.editing.undo()
    assert document.editing.dirty


def test_a_project_that_is_being_written_is_not_saved_and_says_why(opened: Opened, project: Path, qtbot: QtBot) -> None:
    document = opened()
    document.editing.run("remove_edges", {"pairs": [list(next(iter(document.graph.edges)))]})
    with Project.open(project, writable=True), qtbot.waitSignal(document.editing.failed) as failed:
        document.editing.save()
    assert "being written" in failed.args[0] and document.editing.dirty


def test_a_second_window_only_looks_and_says_so(opened: Opened, make_window: Callable[[Document], MainWindow]) -> None:
    first, second = opened(), opened()
    assert first.editing.writable and not second.editing.writable
    window = make_window(second)
    remove = window.actions_table["remove"]
    second.select(viewpoint=next(iter(second.graph.viewpoints)))
    assert not remove.isEnabled() and "another window" in remove.toolTip()
    part = window.part(EditPart)
    assert not part.looking.isHidden() and "another window" in part.looking.toolTip()
    before = second.graph
    edit_commands.remove_selection(second.editing)
    assert second.graph is before


def test_the_title_marks_unsaved_edits(window: MainWindow, document: Document) -> None:
    assert not window.isWindowModified()
    a, b = next(iter(document.graph.edges))
    document.editing.run("remove_edges", {"pairs": [[a, b]]})
    assert window.isWindowModified()
    assert window.actions_table["undo"].text() == f"&Undo remove edge {a[:8]} – {b[:8]}"
    document.editing.undo()
    assert not window.isWindowModified()
    assert window.actions_table["redo"].text() == f"&Redo remove edge {a[:8]} – {b[:8]}"


def test_views_and_panels_follow_the_edited_graph(window: MainWindow, document: Document) -> None:
    id = document.graph_arrays.ids[5]
    stored = document.contents.graph
    document.select(viewpoint=id)
    window.actions_table["remove"].trigger()
    assert id not in document.graph.viewpoints and id not in document.graph_arrays.index
    assert stored is document.contents.graph and id in stored.viewpoints
    assert not document.selection and "21 viewpoints" in window._summary.text()
    document.editing.undo()
    assert id in document.graph_arrays.index and document.graph is stored
    assert document.editing.selection == GraphSelection(frozenset({id}))
    assert document.selection.viewpoint == id


def test_the_task_to_measure_an_added_viewpoint_can_be_sent_to_a_process(document: Document) -> None:
    x, y, _ = document.graph_arrays.feet[5]
    assert document.editing.run("add_viewpoint", {"position": [x + 0.4, y, 1.5]})
    (added,) = set(document.graph.viewpoints) - set(document.contents.graph.viewpoints)
    task = evidence_task(Path("demo.nvsim"), document.graph, [added])
    sent = pickle.loads(pickle.dumps(task))
    assert (sent.project, sent.ids) == (task.project, (added,))
    assert sent.graph.viewpoints == task.graph.viewpoints and sent.graph.edges == task.graph.edges
    assert sent.graph.evidence.keys() == task.graph.evidence.keys()


def read_again(graph: NavGraph) -> NavGraph:
    """A graph equal in every value, as if the rows were read again."""
    return decode_graph(encode_graph(graph))


def test_reading_the_project_again_leaves_no_trace_in_the_history(window: MainWindow, document: Document) -> None:
    file = ProjectGraph(Path("demo.nvsim"))
    document.set_contents(replace(document.contents, path=Path("other.nvsim"), graph_file=file))
    document.set_contents(replace(document.contents, graph=read_again(document.graph)))
    assert [step.text for step in document.editing.history.steps] == ["Opened"]
    stored = document.graph
    document.editing.run("remove_edges", {"pairs": [list(next(iter(stored.edges)))]})
    steps, mine = document.editing.history.steps, document.graph
    document.set_contents(replace(document.contents, graph=read_again(stored)))  # a stage began, nothing was saved
    assert document.editing.history.steps == steps and document.graph is mine
    assert not any("built the graph" in text for text in window.notice_area.texts)
    document.editing.history.mark_saved()
    document.set_contents(replace(document.contents, graph=read_again(mine)))
    assert document.editing.history.steps == steps and document.graph is mine and not document.editing.dirty
    document.editing.undo()
    assert document.graph is stored and document.editing.dirty


def test_a_graph_that_a_job_built_again_is_no_edit_and_can_be_taken_back(
    window: MainWindow, document: Document
) -> None:
    file = ProjectGraph(Path("demo.nvsim"))
    document.set_contents(replace(document.contents, path=Path("other.nvsim"), graph_file=file))
    before = document.graph
    smaller = replace(before, edges=dict(list(before.edges.items())[:-3]))
    document.set_contents(replace(document.contents, graph=smaller))
    assert document.graph is smaller and not document.editing.dirty
    assert document.editing.history.edits_since_saved() == 0 and script(document.editing.history)[-1][0] == "#"
    document.editing.select(GraphSelection(frozenset([next(iter(before.viewpoints))])))
    assert document.graph is smaller and not document.editing.dirty
    document.editing.undo()
    document.editing.undo()
    assert document.graph is before and document.editing.dirty, "the project holds what the job built"
    document.editing.redo()
    assert document.graph is smaller and not document.editing.dirty


def test_a_graph_built_again_does_not_replace_edits(window: MainWindow, document: Document) -> None:
    document.set_contents(
        replace(document.contents, path=Path("other.nvsim"), graph_file=ProjectGraph(Path("demo.nvsim")))
    )
    document.editing.run("remove_edges", {"pairs": [list(next(iter(document.graph.edges)))]})
    mine = document.graph
    built = demo_room.graph(document.contents.submaps)
    document.set_contents(replace(document.contents, graph=replace(built, edges=dict(list(built.edges.items())[3:]))))
    assert document.graph is mine
    assert "You still edit your graph" in window.notice_area.texts[-1]


def test_walls_of_the_map_stop_the_eyes_of_an_edit() -> None:
    import demo_room
    import numpy as np

    from nvsim_app.state.editing import _see_each_other

    starts = np.array([[1.0, 3.7, 1.5], [1.0, 1.0, 1.5]])
    ends = np.array([[6.0, 3.7, 1.5], [2.0, 1.0, 1.5]])  # through the table; across the open floor
    assert _see_each_other(demo_room.occupancy(), starts, ends).tolist() == [False, True]


def test_a_large_graph_is_looked_at_while_the_person_goes_on(
    document: Document, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    import nvsim_app.state.checking

    whole = dict(document.editing.findings)
    monkeypatch.setattr(nvsim_app.state.checking, "LARGE", 0)
    monkeypatch.setattr(nvsim_app.state.checking, "SLICE", 0.0)
    with qtbot.waitSignal(document.editing.findingsChanged, timeout=5000):
        document.editing.checking.validate()
        assert not document.editing.findings  # not before all was looked at
    assert dict(document.editing.findings) == whole


def test_an_edit_during_the_first_validation_does_not_start_it_again(
    document: Document, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    import nvsim_app.state.checking

    monkeypatch.setattr(nvsim_app.state.checking, "LARGE", 0)
    monkeypatch.setattr(nvsim_app.state.checking, "SLICE", 0.0)
    editing = document.editing
    editing.checking.validate()
    validator = editing.checking._look.validator
    editing.run("remove_edges", {"pairs": [list(key) for key in document.graph.edges]})
    assert not editing.checking.complete
    qtbot.waitUntil(lambda: editing.checking.complete, timeout=5000)
    assert editing.checking._validator is validator
    assert dict(editing.findings) == {f.key: f for f in check_graph(document.graph, editing.checking._known)}
    assert any(f.kind == "isolated" for f in editing.findings.values())
