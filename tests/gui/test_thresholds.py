"""Threshold sliders: the window counts and draws their changes at once, and applies them in one step."""

from __future__ import annotations

from dataclasses import replace

import pytest
from painted_layers import pixels_on_map
from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from nvsim.mapping.config import MappingConfig
from nvsim_app.state.document import Document
from nvsim_app.thresholds.slider import FIXED, preset, thresholds, with_value
from nvsim_app.thresholds.threshold_preview import changed_segments
from nvsim_app.wiring.inspector import InspectorPart
from nvsim_app.wiring.thresholds import ThresholdPart
from nvsim_app.wiring.window import MainWindow


@pytest.fixture
def part(window: MainWindow) -> ThresholdPart:
    return window.part(ThresholdPart)


def tried(part: ThresholdPart, qtbot: QtBot) -> None:
    """Waits until what is tried is decided."""
    trial = part.trial
    qtbot.waitUntil(lambda: trial.outcome is not None and trial.outcome.config == trial.config, timeout=10_000)


def test_every_threshold_has_a_slider_or_a_reason_to_have_none() -> None:
    named = {t.field for t in thresholds()} | set(FIXED) | {"rule", "both_ways", "criteria"}
    assert named == set(vars(MappingConfig()))
    for threshold in thresholds():
        for config in (MappingConfig(), MappingConfig.paper()):
            value = threshold.value_in(config)
            assert threshold.to_value(threshold.to_step(value)) == pytest.approx(value)


def test_a_robot_too_wide_for_the_evidence_gives_up_its_margin() -> None:
    assert with_value(MappingConfig(), "robot_radius", 0.45).margin == 0.0
    assert with_value(MappingConfig(robot_radius=0.4), "margin", 0.2).robot_radius == pytest.approx(0.25)
    like = preset(MappingConfig(tau_dist=2.0), MappingConfig.paper())
    assert like.rule == "mean" and like.tau_dist == 2.0


def test_a_slider_counts_and_draws_what_would_disappear(part: ThresholdPart, document: Document, qtbot: QtBot) -> None:
    assert document.contents.graph is not None
    edges = len(document.contents.graph.edges)
    row = part.panel.rows["tau_alpha"]
    row.slider.setValue(0)
    tried(part, qtbot)
    outcome = part.trial.outcome
    # Diagonals of the demo room end beside their viewpoint: those edges have no evidence, and stay.
    assert outcome is not None and 0 < len(outcome.lost_edges) < edges and outcome.isolated_viewpoints > 0
    gone = len(outcome.lost_edges)
    assert f"−{gone:,}" in part.panel.outcome.text() and "last edge" in part.panel.notes.text()
    assert row.figure.value() == 0.0 and row.name.font().bold()
    assert changed_segments(part.trial, document)["disappear"].shape == (gone, 2, 3)
    assert pixels_on_map(part.layer, part.context) > 0
    picture = part.context.scene.grab().toImage()
    assert not picture.isNull()
    part.panel.reset.click()
    tried(part, qtbot)
    assert (
        not part.trial.outcome
        and "No edge appears" in part.panel.outcome.text()
        and pixels_on_map(part.layer, part.context) == 0
    )
    assert not part.panel.apply.isEnabled() and "change no edge" in part.panel.apply.toolTip()


def test_many_moves_in_one_turn_are_decided_once(part: ThresholdPart, qtbot: QtBot, monkeypatch) -> None:
    part.trial.prepare()
    qtbot.waitUntil(lambda: part.trial.redecider is not None, timeout=10_000)
    decided = []
    monkeypatch.setattr(part.trial.redecider, "decide", lambda config, f=part.trial.redecider.decide: (
        decided.append(config), f(config))[1])  # fmt: skip
    for step in range(20, 60):
        part.panel.rows["row_alpha"].slider.setValue(step)
    tried(part, qtbot)
    assert len(decided) == 1 and decided[0].row_alpha == pytest.approx(0.59)


def test_presets_set_all_sliders_and_mark_their_places(part: ThresholdPart, qtbot: QtBot) -> None:
    part.panel.apply_preset("paper")
    tried(part, qtbot)
    assert part.trial.config.rule == "mean" and not part.trial.config.both_ways
    row = part.panel.rows["support"]
    assert row.figure.value() == 0.0 and row.slider._marks["paper"] == 0 and row.slider._marks["default"] == 85
    assert not part.panel.rows["row_alpha"].slider.isEnabled(), "the paper's rule does not ask about rows"
    part.panel.apply_preset("project")
    assert not part.trial.differs


def test_the_inspector_speaks_of_the_thresholds_that_are_tried(
    part: ThresholdPart, window: MainWindow, document: Document, qtbot: QtBot
) -> None:
    inspector = window.part(InspectorPart)
    document.select(viewpoint=document.graph_arrays.ids[7])
    assert any(d.open for d in inspector.inspection.directions)
    part.panel.rows["tau_alpha"].figure.setValue(0.0)
    tried(part, qtbot)
    assert not any(d.open for d in inspector.inspection.directions)


def test_a_graph_that_is_read_anew_starts_with_its_own_thresholds(
    part: ThresholdPart, document: Document, qtbot: QtBot
) -> None:
    part.panel.rows["tau_alpha"].slider.setValue(10)
    tried(part, qtbot)
    contents = document.contents
    assert contents.graph is not None
    built = replace(MappingConfig(), row_alpha=0.33)
    document.set_contents(replace(contents, graph=replace(contents.graph), thresholds=built))
    assert part.trial.config == built and part.trial.outcome is None
    QApplication.processEvents()


def test_building_again_orders_the_job_with_what_is_tried(
    part: ThresholdPart, document: Document, tmp_path, monkeypatch, qtbot: QtBot
) -> None:
    document.set_contents(replace(document.contents, path=tmp_path))
    ordered: list = []
    monkeypatch.setattr(part.context.jobs, "start", lambda *a: ordered.append(a))
    part.panel.rows["row_alpha"].figure.setValue(0.35)
    tried(part, qtbot)
    part.panel.build.click()
    ((verb, arguments, project, _),) = ordered
    assert verb == "map" and project == tmp_path and "--reapply" in arguments
    assert arguments[arguments.index("--row-alpha") + 1] == "0.35"


def test_a_criterion_is_chosen_by_name_and_what_was_not_measured_waits_for_a_build(
    part: ThresholdPart, document: Document, tmp_path, monkeypatch, qtbot: QtBot
) -> None:
    panel, trial = part.panel, part.trial
    shown = lambda: {name for name, row in panel.rows.items() if not row.isHidden()}  # noqa: E731
    assert {"tau_alpha", "row_normal", "support"} < shown() and not {"tau_depth", "cell_slice"} & shown()
    document.select(viewpoint=document.graph_arrays.ids[7])
    panel.families["normal"].click()
    tried(part, qtbot)
    assert trial.config.criteria == ("alpha",) and "row_normal" not in shown()
    panel.families["alpha"].click()
    assert trial.config.criteria == ("alpha",) and panel.families["alpha"].isChecked(), "something must decide"
    panel.families["slice"].click()
    qtbot.waitUntil(lambda: bool(trial.refusal), timeout=10_000)
    assert "cell_slice" in shown() and trial.outcome is None and not panel.apply.isEnabled()
    assert "not measured" in panel.outcome.text() and "'slice'" in panel.notes.text()
    inspector = next(p for p in part.context.window.findChildren(InspectorPart))
    assert inspector.inspection.config == trial.project_config and inspector.inspection.directions
    document.set_contents(replace(document.contents, path=tmp_path))
    ordered: list = []
    monkeypatch.setattr(part.context.jobs, "start", lambda *a: ordered.append(a))
    panel.build.click()
    ((_, arguments, _, _),) = ordered
    at = arguments.index("--criteria")
    assert arguments[at + 1 : at + 3] == ["alpha", "slice"]
    assert "--views" not in arguments
    panel.reset.click()
    tried(part, qtbot)
    assert not trial.refusal and not trial.differs


def test_the_map_is_built_again_from_views_like_those_of_its_evidence(
    part: ThresholdPart, document: Document, tmp_path, monkeypatch, qtbot: QtBot
) -> None:
    part.trial.set_config(replace(part.trial.project_config, views="panorama"))
    document.set_contents(replace(document.contents, path=tmp_path))
    ordered: list = []
    monkeypatch.setattr(part.context.jobs, "start", lambda *a: ordered.append(a))
    part.panel.build.click()
    ((_, arguments, _, _),) = ordered
    assert arguments[arguments.index("--views") + 1] == "panorama"


def test_closing_while_the_evidence_is_summed_up_leaves_nothing(part: ThresholdPart, settings: QSettings) -> None:
    part.trial.prepare()
    part.store(settings)
    assert part.trial._thread is None


def test_applying_is_one_step_that_can_be_undone_and_comes_back_with_the_project(
    part: ThresholdPart, document: Document, qtbot: QtBot
) -> None:
    before = document.graph
    assert before is not None
    part.panel.rows["tau_alpha"].slider.setValue(0)
    tried(part, qtbot)
    assert part.trial.outcome is not None and part.panel.apply.isEnabled()
    gone = len(part.trial.outcome.lost_edges)
    part.panel.apply.click()
    after = document.graph
    assert after is not None and len(after.edges) == len(before.edges) - gone
    assert document.editing.history is not None and f"{gone} disappear" in document.editing.history.steps[-1].text
    tried(part, qtbot)
    assert not part.trial.outcome, "the graph is what is tried"
    document.editing.undo()
    assert document.graph is not None and dict(document.graph.edges) == dict(before.edges)
    tried(part, qtbot)
    assert part.trial.outcome and len(part.trial.outcome.lost_edges) == gone
    document.editing.redo()
    # A project that is opened again is decided as it was last applied.
    part.trial.on_graph(fresh=True)
    assert not part.trial.differs
    part._on_contents(frozenset({"graph"}))
    assert part.trial.config.tau_alpha == 0.0
    tried(part, qtbot)
    # Undone thresholds stay undone.
    document.editing.undo()
    part.trial.on_graph(fresh=True)
    part._on_contents(frozenset({"graph"}))
    assert not part.trial.differs
    document.editing.redo()
    part.trial.on_graph(fresh=True)
    part._on_contents(frozenset({"graph"}))
    assert part.trial.config.tau_alpha == 0.0
    tried(part, qtbot)


def test_edits_of_a_person_are_part_of_what_is_tried(part: ThresholdPart, document: Document, qtbot: QtBot) -> None:
    assert document.graph is not None
    part.panel.rows["tau_alpha"].slider.setValue(0)
    tried(part, qtbot)
    assert part.trial.outcome is not None and part.trial.redecider is not None
    a, b = (part.trial.redecider.ids[i] for i in part.trial.outcome.lost_edges[0])
    gone = len(part.trial.outcome.lost_edges)
    assert document.editing.run("lock", {"viewpoints": [], "edges": [[a, b]], "locked": True})
    qtbot.waitUntil(lambda: part.trial.outcome is not None, timeout=10_000)
    assert len(part.trial.outcome.lost_edges) == gone - 1 and part.trial.outcome.kept_by_user == 1
    assert "1 edge stays" in part.panel.notes.text()
