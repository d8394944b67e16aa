"""The findings in the window are those of the graph on screen, as `nvsim graph check` reports them."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from nvsim.cli.graph_target import read_one_graph
from nvsim.cli.main import main
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.findings import check_graph
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.project.project import Project
from nvsim_app.layers.labels import short_id
from nvsim_app.panels.validation import ValidationPanel
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents, ProjectReader
from nvsim_app.state.opened_files import GraphSource
from nvsim_app.wiring.window import MainWindow

IDS = [f"{i:032x}" for i in range(8)]


def small_graph() -> NavGraph:
    """Two rows of four viewpoints, with the edges of a grid."""
    viewpoints = {id: Viewpoint(id, (2.0 * (i % 4), 2.0 * (i // 4), 1.5), 1.5) for i, id in enumerate(IDS)}
    pairs = [(i, i + 1) for i in range(7) if i != 3] + [(i, i + 4) for i in range(4)]
    edges = {made.key: made for i, j in pairs for made in (edge(IDS[i], IDS[j]),)}
    return NavGraph("small", viewpoints, edges, {})


def write(folder: Path, kind: str) -> Path:
    if kind == "connectivity file":
        write_connectivity(small_graph(), folder)
        return folder / "small_connectivity.json"
    with Project.create_or_open(folder / "small.nvsim") as project:
        project.set_graph(small_graph())
    return folder / "small.nvsim"


class Window:
    """A document that shows `path` without a window around it. It ends without saving."""

    def __init__(self, path: Path) -> None:
        self.path, self.document = path, Document()
        self._reader = None if path.is_file() else ProjectReader(path)
        self.document.set_contents(Contents(path))
        if self._reader is None:
            self.document.set_contents(GraphSource(path).contents())
        self.read()

    def read(self) -> None:
        for contents in () if self._reader is None else self._reader.updates():
            self.document.set_contents(contents)
        QApplication.processEvents()

    def end(self) -> None:
        self.document.editing.close()
        if self._reader is not None:
            self._reader.close()


def settle(window: Window) -> None:
    """Lets a pending validation run: the end of saving is one event, and the validation that it orders the next."""
    for _ in range(20):
        QApplication.processEvents()
        if window.document.editing.checking.complete:
            break


SMALL = st.integers(0, 7)
ACTIONS = st.one_of(
    st.tuples(st.just("remove_edges"), SMALL, SMALL),
    st.tuples(st.just("add_edges"), SMALL, SMALL),
    st.tuples(st.just("remove_viewpoints"), SMALL),
    st.tuples(st.just("shift_viewpoints"), SMALL),
    st.tuples(st.sampled_from(["undo", "redo", "save", "reopen", "read again"])),
)


def act(window: Window, action: tuple) -> Window:
    editing = window.document.editing
    match action:
        case "remove_edges" | "add_edges" as name, i, j:
            editing.run(name, {"pairs": [[IDS[i], IDS[j]]]})
        case "remove_viewpoints", i:
            editing.run("remove_viewpoints", {"ids": [IDS[i]]})
        case "shift_viewpoints", i:
            editing.run("shift_viewpoints", {"ids": [IDS[i]], "by": [0.0, 1.9, 0.9]})
        case ("undo",):
            editing.undo()
        case ("redo",):
            editing.redo()
        case ("save",):
            editing.save(wait=True)
        case ("read again",):
            window.read()
        case ("reopen",):
            window.end()
            return Window(window.path)
    return window


@pytest.mark.parametrize("kind", ["project", "connectivity file"])
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(actions=st.lists(ACTIONS, max_size=8))
def test_the_window_and_the_command_agree_after_any_actions(
    qapp: QApplication, capsys: pytest.CaptureFixture[str], kind: str, actions: list[tuple]
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        window = Window(write(Path(folder), kind))
        for action in actions:
            window = act(window, action)
            QApplication.processEvents()
            settle(window)
            document = window.document
            assert document.editing.checking.complete
            assert set(document.editing.findings.values()) == set(
                check_graph(document.graph, read_one_graph(window.path).context)
            )
        window.document.editing.save(wait=True)
        QApplication.processEvents()
        settle(window)
        capsys.readouterr()
        main(["graph", "check", str(window.path), "--json"])
        (report,) = json.loads(capsys.readouterr().out)
        assert {f["key"] for f in report["findings"]} == set(window.document.editing.findings)
        window.end()


def test_findings_after_recovery_count_the_restored_edits(qapp: QApplication, tmp_path: Path) -> None:
    first = Window(write(tmp_path, "project"))
    assert not [f for f in first.document.editing.findings.values() if f.severity == "error"]
    first.document.editing.run("remove_edges", {"pairs": [[IDS[0], IDS[1]], [IDS[0], IDS[4]]]})
    wanted = set(first.document.editing.findings)
    assert wanted
    first.end()
    second = Window(first.path)
    assert set(second.document.editing.findings) == wanted
    second.document.editing.undo()
    assert not [f for f in second.document.editing.findings.values() if f.severity == "error"]
    second.end()


def test_the_panel_says_that_it_checks_until_the_findings_are_known(document: Document, qtbot: QtBot) -> None:
    panel = ValidationPanel(document)
    qtbot.addWidget(panel)
    document.editing.checking.schedule_validation(document.graph, None)
    panel.renew()
    assert panel.clean.text() == "Checking…" and panel.boxes["error"].text() == "errors"
    document.editing.checking.validate()
    panel.renew()
    assert panel.clean.text() == "No problems found." and panel.boxes["error"].text() == "0 errors"


def test_a_panel_shows_no_findings_of_another_graph(document: Document, qtbot: QtBot) -> None:
    panel = ValidationPanel(document)
    qtbot.addWidget(panel)
    panel.show()
    qtbot.waitUntil(lambda: panel.clean.text() == "No problems found.")
    document.editing.checking.schedule_validation(document.graph, None)
    assert panel.clean.text() == "Checking…" and panel.clean.isVisible() and not panel.tree.isVisible()
    qtbot.waitUntil(lambda: panel.clean.text() == "No problems found.")
    panel.hide()
    id = next(iter(document.graph.viewpoints))
    document.editing.run("remove_edges", {"pairs": [list(key) for key in document.graph.edges if id in key]})
    assert panel.clean.text() == "Checking…", "when it comes to the front, it shows no older state"
    panel.show()
    qtbot.waitUntil(lambda: panel.tree.isVisible())
    assert short_id(document.graph, id) in panel.model.index(0, 0, panel.model.index(0, 0)).data()
    assert id[:8] not in panel.model.index(0, 0, panel.model.index(0, 0)).data()


def test_f8_does_not_say_that_there_are_no_problems_if_the_filter_hides_them(
    window: MainWindow, document: Document, qtbot: QtBot
) -> None:
    document.editing.run("remove_edges", {"pairs": [list(key) for key in list(document.graph.edges)[:6]]})
    id = next(iter(document.graph.viewpoints))
    document.editing.run("remove_edges", {"pairs": [list(key) for key in document.graph.edges if id in key]})
    assert document.editing.findings
    panel = window.panels["validation"]
    panel.text.setText("nothing like this")
    QTest.keyClick(window, Qt.Key.Key_F8)
    assert window.notice_area.texts == ["No finding matches the filter."]


def test_a_restored_selection_shows_its_details(qapp: QApplication, tmp_path: Path) -> None:
    first = Window(write(tmp_path, "project"))
    first.document.editing.run("remove_edges", {"pairs": [[IDS[0], IDS[1]]]})
    first.document.select(viewpoint=IDS[3])
    first.end()
    second = Window(first.path)
    assert second.document.editing.selection.viewpoints == {IDS[3]}
    assert second.document.selection.viewpoint == IDS[3]
    second.end()


def test_a_saved_file_is_checked_again_with_its_new_lists(qapp: QApplication, tmp_path: Path) -> None:
    window = Window(write(tmp_path, "connectivity file"))
    checking = window.document.editing.checking
    window.document.editing.run("remove_edges", {"pairs": [[IDS[0], IDS[1]]]})
    before = checking._validator
    window.document.editing.save(wait=True)
    QApplication.processEvents()
    settle(window)
    assert checking.complete and checking._validator is not before
    known = read_one_graph(window.path).context
    assert set(window.document.editing.findings.values()) == set(check_graph(window.document.graph, known))
    window.end()
