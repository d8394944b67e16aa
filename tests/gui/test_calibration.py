"""The calibration page: benefit and cost of each threshold, and a suggestion that sets its slider."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import demo_project
import pytest
from pytestqt.qtbot import QtBot

from nvsim.errors import InputError
from nvsim.evaluation.calibration import calibrate
from nvsim.mapping.config import MappingConfig
from nvsim.occupancy.read import read_map
from nvsim.project.project import Project
from nvsim_app.processes.child import Child
from nvsim_app.session import Session
from nvsim_app.state.side_work import CALIBRATION, CalibrationRequest
from nvsim_app.wiring.thresholds import CalibratePart, ThresholdPart

WANT = 0.5
"""The demo room has few ways."""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return demo_project.write_project(tmp_path / "demo.nvsim", count=500, models=0)


def asked(project: Path, **other: object) -> CalibrationRequest:
    with Project.open(project) as opened:
        return replace(CalibrationRequest(project, opened.need_graph(), MappingConfig(), want=WANT), **other)


@pytest.fixture
def part(qtbot: QtBot, session: Session, project: Path) -> Iterator[CalibratePart]:
    session.open(project)
    document = session.document
    qtbot.waitUntil(lambda: document.graph is not None and document.contents.occupancy is not None, timeout=20_000)
    part = session.window.part(CalibratePart)
    part.panel.want.setValue(WANT)
    yield part


def done(part: CalibratePart, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: not part.calibrations.busy, timeout=60_000)


def test_the_process_finds_what_the_library_finds(project: Path) -> None:
    given = asked(project)
    got = Child(CALIBRATION, given).result()
    assert got is not None
    with Project.open(project) as opened:
        map_file = opened.layout.ground_truth / "map.yaml"
        positions = opened.need_capture().positions
    config = given.config
    own = calibrate(given.graph, read_map(map_file), positions, config, WANT, config.robot_radius)
    assert got.map == map_file
    for name in ("now", "sweeps", "suggested"):
        assert getattr(got.found, name) == getattr(own, name)


def test_a_project_without_a_map_says_what_is_missing(project: Path) -> None:
    for file in (project / "ground_truth").glob("map.*"):
        file.unlink()
    with pytest.raises(InputError, match=r"no occupancy map to compare with: select one with Map"):
        Child(CALIBRATION, asked(project)).result()


def test_a_chosen_map_that_is_none_is_one_sentence(project: Path) -> None:
    (project / "nothing.yaml").write_text("image: nothing.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    with pytest.raises(InputError, match=r"nothing\.pgm"):
        Child(CALIBRATION, asked(project, truth=project / "nothing.yaml")).result()


def test_what_nobody_wants_any_more_ends_at_once(project: Path) -> None:
    child = Child(CALIBRATION, asked(project))
    child.kill()
    assert child.result() is None


def test_the_page_shows_a_row_and_curves_for_every_threshold_that_decides(part: CalibratePart, qtbot: QtBot) -> None:
    part.show_panel()
    assert part.calibrations.busy and "every value" in part.panel.status.text()
    assert part.panel.plot is None, "plots take long to make"
    done(part, qtbot)
    found, panel = part.calibrations.last_result, part.panel
    assert found is not None and panel.model.rowCount() == len(found.sweeps) > 3
    for row, field in enumerate(found.sweeps):
        panel.list.setCurrentIndex(panel.model.index(row, 0))
        assert panel.chosen == field
        x, y = panel.plot.curves["coverage"].getData()
        assert x.tolist() == [r["threshold"] for r in found.sweeps[field]]
        assert y.tolist() == [r["coverage"] for r in found.sweeps[field]]
        now = getattr(part.context.document.contents.thresholds, field)
        assert [line.value() for line in panel.plot.now] == [now, now]
        suggested = part.calibrations.suggestion(field, "robot")["threshold"]
        assert all(line.isVisible() == (suggested is not None) for line in panel.plot.suggested)
        assert f"{found.now['validity_robot']:.3f}" in panel.words.text()
    assert not panel.grab().isNull()


def test_a_suggestion_goes_to_its_slider_and_no_further(part: CalibratePart, qtbot: QtBot) -> None:
    part.show_panel()
    done(part, qtbot)
    panel, sliders = part.panel, part.context.part(ThresholdPart).panel
    judge = panel.judge.currentData()
    before = part.context.document.contents.thresholds
    for row in range(panel.model.rowCount()):
        panel.list.setCurrentIndex(panel.model.index(row, 0))
        if panel.obstacle is None:
            break
    assert panel.obstacle is None, "this room has a suggestion to take"
    field = panel.chosen
    value = part.calibrations.suggestion(field, judge)["threshold"]
    assert panel.take.text() == f"Use {value:.2f}" and panel.take.isEnabled()
    panel.take.click()
    assert sliders.rows[field].figure.value() == pytest.approx(value)
    assert part.context.document.contents.thresholds == before
    assert panel.obstacle == "the slider already has the suggested value" and not panel.take.isEnabled()
    assert panel.plot.now[0].value() == pytest.approx(value)
    other = next(f for f in part.calibrations.last_result.sweeps if f != field)
    assert part.calibrations.changed_thresholds(other) == (field,) and part.calibrations.changed_thresholds(field) == ()
    panel.list.setCurrentIndex(panel.model.index(panel.model.rows.index(other), 0))
    assert "Other sliders have moved" in panel.status.text()


def test_what_was_worked_out_for_an_earlier_graph_is_not_taken(part: CalibratePart, qtbot: QtBot) -> None:
    part.show_panel()
    done(part, qtbot)
    editing = part.context.document.editing
    editing.run("remove_viewpoints", {"ids": [next(iter(editing.graph.viewpoints))]})
    assert "graph has changed" in part.panel.status.text()
    assert part.panel.obstacle == "the graph has changed since this was calculated" and not part.panel.take.isEnabled()
    part.panel.again.click()
    done(part, qtbot)
    assert part.calibrations.is_of_this_graph and "judged by" in part.panel.status.text()


def test_what_cannot_be_judged_is_said_on_the_page(part: CalibratePart, qtbot: QtBot, tmp_path: Path) -> None:
    part.panel.choose_map(tmp_path / "gone.yaml")
    done(part, qtbot)
    assert "gone.yaml" in part.panel.status.text() and not part.panel.take.isEnabled()


def test_closing_the_window_ends_the_process(part: CalibratePart, qtbot: QtBot) -> None:
    part.show_panel()
    process = part.calibrations._process
    qtbot.waitUntil(lambda: process.process_id is not None, timeout=10_000)
    pid = process.process_id
    assert pid is not None
    part.context.window.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
