"""The panels of editing: validation, history, tables, histogram, compare, proposals, and the walk through review."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QCoreApplication, QEvent, QItemSelectionModel, QPointF, Qt
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QApplication, QMenu, QWidget
from pytestqt.modeltest import ModelTester
from pytestqt.qtbot import QtBot

from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.findings import Finding
from nvsim.graph.selection import GraphSelection, selection
from nvsim.mapping.evidence.new_viewpoints import NewViewpointEvidence
from nvsim_app.layers.labels import short_ids
from nvsim_app.look import colors
from nvsim_app.painting.picking import NEAR
from nvsim_app.panels.comparison import ComparePanel
from nvsim_app.panels.form import Form
from nvsim_app.panels.histogram import HistogramPanel
from nvsim_app.panels.history import HistoryPanel
from nvsim_app.panels.tables import TablePanel
from nvsim_app.panels.validation import ValidationPanel
from nvsim_app.state import edit_commands
from nvsim_app.state.directions import path_between
from nvsim_app.state.document import Document
from nvsim_app.wiring.checking import CheckPart
from nvsim_app.wiring.window import MainWindow


def cut_off(document: Document, row: int = 0) -> str:
    """Removes all edges of a viewpoint; returns its id."""
    id = document.graph_arrays.ids[row]
    pairs = [list(key) for key in document.graph.edges if id in key]
    document.editing.run("remove_edges", {"pairs": pairs})
    return id


@pytest.fixture
def validation(window: MainWindow, document: Document) -> ValidationPanel:
    window.show_dock("validation")
    document.editing.checking.validate()
    panel = window.panels["validation"]
    assert isinstance(panel, ValidationPanel)
    return panel


def test_an_edit_that_isolates_a_viewpoint_is_found_at_once(validation: ValidationPanel, document: Document) -> None:
    id = cut_off(document)
    validation.renew()
    found = [f for f in validation.model.rows if f.kind == "isolated"]
    assert [f.viewpoints for f in found] == [(id,)]
    assert validation.boxes["error"].text() == "1 error"
    document.editing.undo()
    validation.renew()
    assert not [f for f in validation.model.rows if f.kind == "isolated"]


def test_a_finding_is_selected_fixed_and_taken_back(validation: ValidationPanel, document: Document) -> None:
    id = cut_off(document)
    validation.renew()
    validation.choose(next(f for f in validation.model.rows if f.kind == "isolated"))
    assert document.editing.selection.viewpoints == {id}
    assert validation.fix.isEnabled()
    validation.apply_first_fix()
    validation.renew()
    assert not [f for f in validation.model.rows if f.kind == "isolated"]
    document.editing.undo()
    validation.renew()
    assert [f for f in validation.model.rows if f.kind == "isolated"]


def test_edits_leave_no_menus_of_fixes(
    window: MainWindow, validation: ValidationPanel, document: Document, qtbot: QtBot
) -> None:
    def menus() -> int:
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
        return len(validation.findChildren(QMenu))

    cut_off(document)
    validation.renew()
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow, timeout=3000)
    before = menus()
    undo = Qt.KeyboardModifier.ControlModifier
    for keys in 5 * [undo, undo | Qt.KeyboardModifier.ShiftModifier]:
        graph = document.graph
        qtbot.keyClick(window, Qt.Key.Key_Z, keys)
        assert document.graph is not graph
        validation.renew()
    assert menus() <= before + 1


def test_all_of_a_kind_are_ignored_with_one_reason_and_shown_again(
    validation: ValidationPanel, document: Document
) -> None:
    cut_off(document)
    validation.renew()
    kind = "isolated"
    validation.choose(next(f for f in validation.model.rows if f.kind == kind))
    validation.ignore_kind()
    assert not document.graph.ignored, "without a reason nothing happens"
    validation.reason.setText("it is so here")
    validation.ignore_kind()
    validation.renew()
    assert document.graph.ignored == {f"{kind}/*": "it is so here"}
    assert all(finding.kind != kind for finding in validation.model.rows)
    validation.ignored.setChecked(True)
    validation.choose(next(f for f in validation.model.rows if f.kind == kind))
    validation.ignore()
    assert not document.graph.ignored


def test_a_finding_is_ignored_for_good_with_a_reason(validation: ValidationPanel, document: Document) -> None:
    cut_off(document)
    validation.renew()
    validation.choose(next(f for f in validation.model.rows if f.kind == "isolated"))
    validation.ignore()
    assert not document.graph.ignored  # without a reason nothing happens
    validation.reason.setText("a lookout")
    validation.ignore()
    validation.renew()
    assert list(document.graph.ignored.values()) == ["a lookout"]
    assert not [f for f in validation.model.rows if f.kind == "isolated"]
    validation.ignored.setChecked(True)
    assert [f for f in validation.model.rows if f.kind == "isolated"]


def test_a_double_click_on_a_finding_brings_the_views_there(
    validation: ValidationPanel, window: MainWindow, document: Document, qtbot: QtBot
) -> None:
    cut_off(document, 3)
    validation.renew()
    validation.choose(next(f for f in validation.model.rows if f.kind == "isolated"))
    goal = document.graph_arrays.feet[3]
    validation.tree.doubleClicked.emit(validation.tree.currentIndex())
    qtbot.waitUntil(lambda: np.linalg.norm(window.scene.pose.pivot[:2] - goal[:2]) < 0.1, timeout=3000)
    shown = window.panels["map"].plot.getViewBox().viewRect().center()
    assert (shown.x(), shown.y()) == pytest.approx(tuple(goal[:2]), abs=0.1)


def test_findings_are_grouped_by_kind_and_their_text_wraps(validation: ValidationPanel, document: Document) -> None:
    for row in (0, 3):
        cut_off(document, row)
    validation.renew()
    tree, model = validation.tree, validation.model
    place = next(i for i, group in enumerate(model.groups) if group.kind == "isolated")
    head = model.index(place, 0)
    assert head.data() == "Viewpoints without an edge (2)" and tree.isExpanded(head)
    words = [short_ids(document.graph, finding.message) for finding in model.groups[place].findings]
    assert [model.index(i, 0, head).data() for i in range(2)] == words
    validation.resize(160, 400)
    QApplication.processEvents()
    assert tree.visualRect(model.index(0, 0, head)).height() > 2 * tree.fontMetrics().height()
    tree.collapse(head)
    validation.renew()
    assert not tree.isExpanded(model.index(place, 0)), "a collapsed group stays collapsed"


def test_all_findings_of_a_kind_are_fixed_as_one_step(validation: ValidationPanel, document: Document) -> None:
    ids = {cut_off(document, row) for row in (0, 3)}
    validation.renew()
    place = next(i for i, group in enumerate(validation.model.groups) if group.kind == "isolated")
    validation.tree.setCurrentIndex(validation.model.index(place, 0))
    assert document.editing.selection.viewpoints == ids
    assert validation.fix.isEnabled() and validation.fix.text() == "Fix all 2: Exclude it"
    before = document.graph
    validation.fix.click()
    assert not any(document.graph.viewpoints[id].included for id in ids)
    assert document.editing.history.undo_text == "Fix 2 findings: exclude it"
    document.editing.undo()
    assert document.graph is before


def test_the_obstacle_of_a_finding_is_marked_in_both_views(
    validation: ValidationPanel, window: MainWindow, document: Document, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = next(iter(document.graph.edges))
    finding = Finding("occupied", "error", "The edge crosses an occupied part of the map.", key, (key,))
    monkeypatch.setattr(type(document.editing), "findings", {finding.key: finding})
    a, b = (document.graph_arrays.feet[document.graph_arrays.index[id]] for id in key)
    found = path_between(document, *key)
    blocked = replace(found, blocked=0.25 * float(np.linalg.norm((b - a)[:2])))
    monkeypatch.setattr("nvsim_app.state.directions.path_between", lambda document, a, b: blocked)
    validation.renew()
    part = window.part(CheckPart)
    shots = {canvas: _shot(canvas.surface.widget) for canvas in window.modes.canvases}
    validation.choose(finding)
    assert part._blocked == pytest.approx(a + 0.25 * (b - a))
    marked = 0
    for canvas in shots:
        pixels, depths = canvas.surface.project(part._blocked[None])
        box = canvas.surface.widget.rect().adjusted(12, 12, -12, -12)
        if depths[0] > NEAR and box.contains(QPointF(*pixels[0]).toPoint()):
            shot = _shot(canvas.surface.widget)
            assert shot.pixelColor(QPointF(*pixels[0]).toPoint()).name() == colors.BLOCKED
            marked += 1
    assert marked, "the map shows the whole graph"
    document.editing.select(GraphSelection())
    assert part._blocked is None


def _shot(widget: QWidget) -> QImage:
    return widget.grab().toImage()


def test_the_filter_of_findings_hides_other_severities(validation: ValidationPanel, document: Document) -> None:
    cut_off(document)
    validation.renew()
    validation.boxes["error"].setChecked(False)
    assert not [f for f in validation.model.rows if f.severity == "error"]
    validation.boxes["error"].setChecked(True)
    validation.text.setText("no such words")
    assert not validation.model.rows and not validation.clean.isHidden()


def test_a_click_in_the_history_goes_there(window: MainWindow, document: Document) -> None:
    panel = window.panels["history"]
    assert isinstance(panel, HistoryPanel)
    first = document.graph
    cut_off(document)
    document.select(viewpoint=document.graph_arrays.ids[2])
    assert panel.model.rowCount() == 3
    assert panel.model.index(1, 0).data().startswith("Remove ")
    panel.list.clicked.emit(panel.model.index(0, 0))
    assert document.graph is first and document.editing.history.index == 0
    panel.list.clicked.emit(panel.model.index(2, 0))
    assert document.graph is not first


@pytest.fixture
def tables(window: MainWindow) -> TablePanel:
    window.show_dock("tables")
    panel = window.panels["tables"]
    assert isinstance(panel, TablePanel)
    panel.refresh.finish()
    return panel


def test_the_tables_are_sound_models(tables: TablePanel, qtmodeltester: ModelTester) -> None:
    qtmodeltester.check(tables.viewpoints)
    qtmodeltester.check(tables.edges)


def test_rows_and_views_select_each_other(tables: TablePanel, document: Document) -> None:
    ids = document.graph_arrays.ids
    view = tables.views[0]
    for row in (2, 5):
        flags = QItemSelectionModel.SelectionFlag.Select | QItemSelectionModel.SelectionFlag.Rows
        view.selectionModel().select(tables.viewpoints.index(row, 0), flags)
    assert document.editing.selection.viewpoints == {tables.viewpoints.row(2), tables.viewpoints.row(5)}
    document.editing.select(selection(ids[7:10]))
    rows = {index.row() for index in view.selectionModel().selectedRows()}
    assert rows == set(tables.viewpoints.places_of(frozenset(ids[7:10]))) and len(rows) == 3


def test_columns_sort_by_their_values(tables: TablePanel) -> None:
    tables.viewpoints.sort(1, Qt.SortOrder.DescendingOrder)
    degrees = [int(tables.viewpoints.index(row, 1).data()) for row in range(tables.viewpoints.rowCount())]
    assert degrees == sorted(degrees, reverse=True)


def test_an_expression_filters_the_rows_and_a_wrong_one_says_why(tables: TablePanel, document: Document) -> None:
    tables.filter.setText("degree > 4")
    tables.refresh.finish()
    degree = np.bincount(document.graph_arrays.edges.reshape(-1))
    assert tables.viewpoints.rowCount() == int((degree > 4).sum())
    tables.filter.setText("degre > 4")
    tables.refresh.finish()
    assert "degre" in tables.trouble.text() and not tables.trouble.isHidden()
    tables.filter.setText(document.graph_arrays.ids[4][:8])
    tables.refresh.finish()
    assert tables.viewpoints.rowCount() == 1 and tables.trouble.isHidden()


def test_a_range_of_the_histogram_selects(window: MainWindow, document: Document) -> None:
    window.show_dock("histogram")
    panel = window.panels["histogram"]
    assert isinstance(panel, HistogramPanel)
    panel.choice.setCurrentText("Length of edges")
    panel.refresh.finish()
    panel.region.setRegion((2.5, 9.0))
    panel.select_range()
    arrays = document.graph_arrays
    ends = arrays.positions[arrays.edges]
    long = np.flatnonzero(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > 2.5)
    assert document.editing.selection.edges == {arrays.edge_key(row) for row in long} and len(long)


def test_the_review_walks_from_the_least_certain_edge_on(window: MainWindow, document: Document) -> None:
    go = window.actions_table["next_review"]
    go.trigger()
    (first,) = document.editing.selection.edges
    window.actions_table["reviewed"].trigger()
    assert document.graph.edges[first].reviewed
    go.trigger()
    (second,) = document.editing.selection.edges
    assert second != first
    window.actions_table["remove"].trigger()
    assert second not in document.graph.edges
    go.trigger()
    (third,) = document.editing.selection.edges
    window.actions_table["accept_review"].trigger()
    (fourth,) = document.editing.selection.edges
    assert document.graph.edges[third].reviewed and fourth not in (first, second, third)


def test_the_review_counts_and_finishes_edges_between_included_viewpoints_alone(
    window: MainWindow, document: Document
) -> None:
    graph = document.graph
    excluded = max(graph.viewpoints, key=lambda id: sum(id in key for key in graph.edges))
    document.editing.run("include", {"ids": [excluded], "included": False})
    left = [key for key in graph.edges if excluded not in key]
    assert len(left) < len(graph.edges)
    window.actions_table["next_review"].trigger()
    assert f" 0 of {len(left):,} edges" in window.statusBar().currentMessage()
    document.editing.run("mark_reviewed", {"viewpoints": [], "edges": [list(key) for key in left]})
    notices: list[str] = []
    window.notices.added.connect(lambda notice: notices.append(notice.text))
    window.actions_table["next_review"].trigger()
    assert notices == ["Every edge between included viewpoints is reviewed."]


def test_another_graph_is_compared_drawn_and_merged(
    window: MainWindow, document: Document, tmp_path: Path, qtbot: QtBot
) -> None:
    graph = document.graph
    gone, moved = next(iter(graph.edges)), document.graph_arrays.ids[9]
    x, y, z = graph.viewpoints[moved].position
    other = replace(
        graph,
        edges={key: e for key, e in graph.edges.items() if key != gone},
        viewpoints={**graph.viewpoints, moved: replace(graph.viewpoints[moved], position=(x + 0.4, y, z))},
    )
    path = write_connectivity(other, tmp_path)
    part = next(p for p in window.parts if type(p).__name__ == "ComparePart")
    part.compare_with_file(path)
    panel = window.panels["compare"]
    assert isinstance(panel, ComparePanel)
    assert {d.kind for d in panel.model.rows} == {"edge removed", "viewpoint moved"}
    window.grab()
    panel.model.choose(tuple(d for d in panel.model.rows if d.kind == "edge removed"))
    panel.merge.click()
    assert gone not in document.graph.edges
    assert document.graph.viewpoints[moved].position == (x, y, z)
    qtbot.waitUntil(lambda: len(panel.model.rows) == 1, timeout=3000)
    document.editing.undo()
    assert document.graph is graph


def test_the_graph_is_compared_with_an_earlier_step(window: MainWindow, document: Document) -> None:
    cut_off(document)
    part = next(p for p in window.parts if type(p).__name__ == "ComparePart")
    part.compare_with_step(0)
    panel = window.panels["compare"]
    assert isinstance(panel, ComparePanel) and {d.kind for d in panel.model.rows} == {"edge added"}
    panel.model.choose(panel.model.rows)
    panel.merge.click()
    assert set(document.graph.edges) == set(document.contents.graph.edges)


def test_measured_evidence_becomes_part_of_the_edit_and_proposes_edges(window: MainWindow, document: Document) -> None:
    edit_commands.add_viewpoint(document.editing, (2.2, 2.2, 1.5))
    (new,) = document.editing.selection.viewpoints
    steps = len(document.editing.history.steps)
    near = document.graph_arrays.ids[0]
    pair = (min(new, near), max(new, near))
    sample = replace(next(iter(document.graph.evidence.values())), viewpoint=new)
    part = next(p for p in window.parts if type(p).__name__ == "ProposePart")
    part._on_measured(
        NewViewpointEvidence((sample,), {new: 1}, (pair,), ()), {new: document.graph.viewpoints[new].position}
    )
    assert sample.key in document.graph.evidence and document.graph.viewpoints[new].submap == 1
    assert len(document.editing.history.steps) == steps
    assert pair not in document.graph.edges and part.proposals.edges == (pair,)
    window.grab()
    window.actions_table["accept_proposals"].trigger()
    assert document.graph.edges[pair].origin == "person" and not part.proposals
    document.editing.undo()
    document.editing.undo()
    assert new not in document.graph.viewpoints


def test_what_was_measured_elsewhere_is_not_taken(window: MainWindow, document: Document) -> None:
    edit_commands.add_viewpoint(document.editing, (2.2, 2.2, 1.5))
    (new,) = document.editing.selection.viewpoints
    part = next(p for p in window.parts if type(p).__name__ == "ProposePart")
    before = document.graph
    part._on_measured(NewViewpointEvidence((), {new: 1}, (), ()), {new: (9.0, 9.0, 1.5)})
    assert document.graph is before
    part._soon.stop()


@pytest.mark.parametrize(
    ("action", "rows", "changed"),
    [
        ("connect_visible", (0, 2, 3), "edges"),
        ("set_height", (3, 4), "viewpoints"),
        ("copy_to_floor", (3, 4), "viewpoints"),
        ("align", (3,), "viewpoints"),
    ],
)
def test_a_form_runs_its_operation(
    window: MainWindow, document: Document, action: str, rows: tuple[int, ...], changed: str
) -> None:
    before = document.graph
    document.editing.select(selection([document.graph_arrays.ids[row] for row in rows]))
    window.actions_table[action].trigger()
    form = next(f for f in window.findChildren(Form) if f.isVisible())
    for name, value in (("distance", 9.0), ("height", 1.2), ("dz", 3.0)):
        if name in form.inputs:
            form.inputs[name].setValue(value)
    form.apply.click()
    form.close()
    QApplication.processEvents()
    assert document.graph is not before
    assert getattr(document.graph, changed) != getattr(before, changed)


def test_commands_on_the_selection_do_what_they_say(window: MainWindow, document: Document) -> None:
    ids, act = document.graph_arrays.ids, window.actions_table
    document.editing.select(GraphSelection(frozenset({ids[3]})))
    act["exclude"].trigger()
    assert not document.graph.viewpoints[ids[3]].included
    act["include"].trigger()
    act["lock"].trigger()
    assert document.graph.viewpoints[ids[3]].included and document.graph.viewpoints[ids[3]].locked
    before = document.graph
    act["remove"].trigger()
    assert document.graph is before and "locked" in window.modes.refusal
    act["unlock"].trigger()
    act["grow"].trigger()
    assert document.editing.selection.viewpoints == {ids[3], *document.graph.neighbors(ids[3])}
    act["component"].trigger()
    assert len(document.editing.selection.viewpoints) == len(ids)
    act["select_none"].trigger()
    assert not document.editing.selection and not act["grow"].isEnabled()
    document.editing.select(selection([ids[0], ids[-1]]))
    act["path"].trigger()
    assert {ids[0], ids[-1]} <= document.editing.selection.viewpoints and document.editing.selection.edges
    act["select_all"].trigger()
    act["invert"].trigger()
    assert not document.editing.selection
    document.editing.select(selection([ids[0], ids[1]]))
    act["merge"].trigger()
    assert len(document.graph.viewpoints) == len(ids) - 1


def test_a_panel_behind_another_tab_waits_until_it_comes_to_the_front(
    window: MainWindow, document: Document, qtbot: QtBot
) -> None:
    window.show_dock("tables")
    panel = window.panels["tables"]
    assert isinstance(panel, TablePanel)
    qtbot.waitUntil(lambda: panel.edges.rowCount() == len(document.graph.edges), timeout=3000)
    window.show_dock("jobs")
    QApplication.processEvents()
    before = panel.edges.rowCount()
    cut_off(document)
    qtbot.wait(300)
    assert panel.edges.rowCount() == before > len(document.graph.edges)
    window.show_dock("tables")
    qtbot.waitUntil(lambda: panel.edges.rowCount() == len(document.graph.edges), timeout=3000)


def test_a_single_proposed_edge_is_taken_by_the_right_button(window: MainWindow, document: Document) -> None:
    from nvsim_app.modes.mode import Pointer
    from nvsim_app.wiring.modes import ContextPart

    part = next(p for p in window.parts if type(p).__name__ == "ProposePart")
    context = window.part(ContextPart)
    window.panels["map"].frame_everything()
    QApplication.processEvents()
    plan = window.modes.canvases[1].surface
    arrays = document.graph_arrays
    lone = [id for id in arrays.ids if id not in document.graph.neighbors(arrays.ids[0]) and id != arrays.ids[0]]
    pairs = [tuple(sorted((arrays.ids[0], other))) for other in lone[-2:]]
    part.proposals.add(document.graph, tuple(pairs))
    ends = arrays.feet[[arrays.index[id] for id in pairs[0]]]
    way = ends[0] + np.linspace(0.2, 0.8, 31)[:, None] * (ends[1] - ends[0])
    pointers = [Pointer(plan, QPointF(*pixel)) for pixel in plan.project(way)[0]]
    at = next(p for p in pointers if part.proposal_under(p) == pairs[0] and p.viewpoint is None)
    actions = {action.text(): action for action in context.menu(at).actions()}
    actions["Accept this proposed edge"].trigger()
    assert pairs[0] in document.graph.edges and part.proposals.edges == (pairs[1],)
    part.dismiss_edge(pairs[1])
    assert not part.proposals


def test_proposed_viewpoints_come_with_their_edges_as_one_step(window: MainWindow, document: Document) -> None:
    from nvsim.graph.proposals import PlaceProposal

    part = next(p for p in window.parts if type(p).__name__ == "ProposePart")
    near = document.graph_arrays.ids[0]
    places = (
        PlaceProposal("new1", (2.2, 2.2, 1.5), 1.5, 3.0, (near,), 0.5, ""),
        PlaceProposal("new2", (3.2, 2.2, 1.5), 1.5, 3.0, ("new1",), 0.5, ""),
    )
    steps, before = len(document.editing.history.steps), document.graph
    part._on_found(((), places))
    window.grab()
    window.actions_table["accept_proposals"].trigger()
    assert set(document.graph.neighbors("new1")) == {near, "new2"}
    assert document.editing.selection.viewpoints == {"new1", "new2"}
    assert len(document.editing.history.steps) == steps + 1 and not part.proposals
    document.editing.undo()
    assert document.graph is before


def test_f8_goes_from_finding_to_finding_and_del_removes_the_edge(window: MainWindow, document: Document) -> None:
    ids = document.graph_arrays.ids
    assert not document.editing.findings
    window.actions_table["next_finding"].trigger()
    assert "No problems found" in window.notice_area.texts[-1]
    document.editing.run("add_edges", {"pairs": [[ids[0], ids[-1]]]})
    kinds = [f.kind for f in document.editing.findings.values()]
    seen = []
    for _ in kinds:
        window.actions_table["next_finding"].trigger()
        seen.append(window.panels["validation"].current.kind)
        assert document.editing.selection.edges == {tuple(sorted((ids[0], ids[-1])))}
    assert sorted(seen) == sorted(kinds)
    assert "F8" in window.statusBar().currentMessage()
    window.actions_table["remove"].trigger()
    assert not document.editing.findings and "F8" not in window.statusBar().currentMessage()


def test_f8_shows_the_fix_in_a_low_panel(window: MainWindow, document: Document, qtbot: QtBot) -> None:
    window.resize(960, 540)
    window.actions_table["workspace_edit"].trigger()
    window.show_dock("tables")
    document.editing.run("remove_edges", {"pairs": [list(key) for key in document.graph.edges]})
    panel = window.panels["validation"]
    window.show_dock("validation")
    qtbot.waitUntil(lambda: bool(panel.model.rows), timeout=5000)
    window.actions_table["next_finding"].trigger()
    qtbot.waitUntil(lambda: panel.fix.visibleRegion().boundingRect() == panel.fix.rect(), timeout=5000)
    assert panel.fix.isEnabled()


def test_enter_selects_what_an_expression_holds_for(window: MainWindow, document: Document, qtbot: QtBot) -> None:
    panel = window.panels["tables"]
    window.actions_table["select_expression"].trigger()
    panel.filter.setText("length > 2")
    qtbot.keyClick(panel.filter, Qt.Key.Key_Return)
    chosen, graph = document.editing.selection, document.graph
    assert chosen.edges and not chosen.viewpoints and chosen.edges < set(graph.edges)
    panel.filter.setText("degree >")
    qtbot.keyClick(panel.filter, Qt.Key.Key_Return)
    assert document.editing.selection == chosen, "what is no expression selects nothing else"
    panel.filter.setText("degree == 2")
    panel.select.click()
    assert document.editing.selection.viewpoints == {id for id in graph.viewpoints if len(graph.neighbors(id)) == 2}


def test_a_form_takes_the_place_of_the_one_before(window: MainWindow, document: Document) -> None:
    from PySide6.QtCore import QCoreApplication, QEvent

    part = next(p for p in window.parts if type(p).__name__ == "EditPart")
    document.editing.select(selection(document.graph_arrays.ids[:3]))
    window.actions_table["set_height"].trigger()
    part.form.close()
    window.actions_table["copy_to_floor"].trigger()
    second = part.form
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    assert part.form is second and second.isVisible()
    second.close()
