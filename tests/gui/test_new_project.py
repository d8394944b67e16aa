"""From a capture to a project: the check in plain words, then the import and everything after it, by the buttons."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import tiny_capture
from PySide6.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
from PySide6.QtGui import QDragEnterEvent, QDropEvent
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from nvsim.capture.findings import SCALE_UNKNOWN, FindingGroup
from nvsim.errors import InputError
from nvsim_app.jobs.queries import CheckResult, result_of
from nvsim_app.panels.new_project import NewProject, NewProjectDialog
from nvsim_app.panels.stages import StageBar
from nvsim_app.session import Session
from nvsim_app.wiring.new_project import NewProjectPart

SECONDS = 120_000


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_capture.write_capture(tmp_path_factory.mktemp("building"))


def part_of(session: Session) -> NewProjectPart:
    return session.window.part(NewProjectPart)


def test_findings_are_grouped_by_what_is_the_matter() -> None:
    findings = [
        {"severity": "error", "message": "the image is missing", "where": f"frame {i}", "consequence": "lost"}
        for i in range(3)
    ] + [{"severity": "warning", "message": "the scale is unknown", "where": "x", "consequence": "asked"}]
    result = result_of(json.dumps({"refused": True, "findings": findings}))
    assert [(g.message, len(g.places)) for g in result.kinds] == [
        ("the image is missing", 3),
        ("the scale is unknown", 1),
    ]
    assert result.needs_scale and result.sentence == "This capture cannot be used as it is."
    with pytest.raises(ValueError, match="not a data check"):
        result_of('{"psnr": 3}')


def test_a_folder_without_a_capture_is_explained_and_cannot_be_imported(qtbot: QtBot, tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    dialog = NewProjectDialog([tmp_path / "pictures"])
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)
    qtbot.addWidget(dialog)
    dialog.show()
    qtbot.waitUntil(lambda: dialog.result_shown is not None, timeout=SECONDS)
    assert "cannot be used" in dialog.verdict.text() and not dialog.run_button.isEnabled()
    assert "empty folder" in dialog.findings.topLevelItem(0).text(0)
    dialog.reject()


def test_the_scale_is_asked_for_where_it_is_unknown(qtbot: QtBot, tmp_path: Path) -> None:
    dialog = NewProjectDialog()
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)
    qtbot.addWidget(dialog)
    dialog.project.setText(str(tmp_path / "new.nvsim"))
    dialog.show_result(CheckResult(False, (FindingGroup("warning", SCALE_UNKNOWN, "it asks", ("x",), ()),)))
    assert not dialog.run_button.isEnabled() and "height of the cameras" in dialog.verdict.text()
    dialog.show_result(CheckResult(False, ()))
    assert dialog.run_button.isEnabled()
    dialog.project.setText(str(tmp_path))
    assert dialog.run_button.isEnabled()
    (tmp_path / "thesis.tex").write_text("")
    dialog.project.setText(f"{tmp_path}/")
    assert "contains other files" in dialog.problem.text() and not dialog.run_button.isEnabled()


def test_axes_that_fit_the_images_are_offered_and_chosen_by_a_button(qtbot: QtBot, tmp_path: Path) -> None:
    dialog = NewProjectDialog()
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)
    qtbot.addWidget(dialog)
    finding = {"severity": "error", "message": "the poses do not fit the images", "where": "x", "consequence": "y"}
    result = result_of(json.dumps({"refused": True, "findings": [{**finding, "fix": "--axes opencv"}]}))
    assert result.axes == "opencv" and result.is_fixable
    assert not result_of(json.dumps({"refused": True, "findings": [{**finding, "fix": "--axes odd"}]})).axes
    dialog.show_result(result)
    assert dialog.mending.axes.isVisibleTo(dialog) and dialog.mending.axes.text() == "Read poses as opencv"
    dialog.mending.axes.click()
    assert dialog.axes.value() == "opencv"
    dialog.reject()


def test_a_dropped_capture_becomes_a_project_and_the_next_stage_is_offered(
    qtbot: QtBot, session: Session, capture: Path, tmp_path: Path
) -> None:
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(capture))])
    copy, left, none = Qt.DropAction.CopyAction, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
    for event in (
        QDragEnterEvent(QPoint(50, 50), copy, data, left, none),
        QDropEvent(QPointF(50, 50), copy, data, left, none),
    ):
        QApplication.sendEvent(session.window, event)
        assert event.isAccepted()
    (dialog,) = session.window.findChildren(NewProjectDialog)
    assert dialog.capture.text() == str(capture) and dialog.project.text().endswith("capture.nvsim")
    project = tmp_path / "rooms.nvsim"
    dialog.project.setText(str(project))
    qtbot.waitUntil(lambda: dialog.run_button.isEnabled(), timeout=SECONDS)
    assert dialog.verdict.text().startswith("The capture")

    qtbot.mouseClick(dialog.import_button, Qt.MouseButton.LeftButton)
    jobs = session.window.jobs
    assert [h.job.order.verb for h in jobs.handles] == ["import"]
    empty = session.window.empty
    assert empty.sentence.text() == "Import capture …" and empty.imports.isHidden()
    qtbot.waitUntil(lambda: session.document.contents.capture is not None, timeout=SECONDS)
    qtbot.waitUntil(lambda: jobs.handles[0].state == "done", timeout=SECONDS)
    (bar,) = session.window.findChildren(StageBar)
    qtbot.waitUntil(bar.isVisible, timeout=SECONDS)
    for width in (900, 420):
        session.window.scene.resize(width, 400)
        assert bar.geometry().right() <= width and bar.settings.geometry().right() <= bar.width()
    assert bar.stage.text() == "Cut into submaps only"
    tiny_capture.write_settings(project)
    qtbot.mouseClick(bar.stage, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: len(session.document.contents.submaps) == 1, timeout=SECONDS)
    assert jobs.handles[1].job.order.arguments[-2:] == ("--count", "1")
    qtbot.waitUntil(lambda: not jobs.running, timeout=SECONDS)


def test_several_captures_become_one_list_and_one_project(qtbot: QtBot, session: Session, tmp_path: Path) -> None:
    captures = [tmp_path / "first", tmp_path / "second"]
    dialog = part_of(session).open_dialog(captures)
    assert dialog.captures() == captures
    dialog.project.setText(str(tmp_path / "house.nvsim"))
    dialog.poses.show_value("given")
    ordered: list[list[str]] = []
    session.window.jobs.start = lambda verb, arguments, *_: ordered.append(arguments)  # type: ignore[method-assign]
    qtbot.waitUntil(lambda: dialog.result_shown is not None, timeout=SECONDS)
    assert dialog.result_shown is not None and dialog.result_shown.refused  # neither is there
    dialog.show_result(CheckResult(False, ()))
    qtbot.mouseClick(dialog.import_button, Qt.MouseButton.LeftButton)
    assert ordered[0][-2:] == ["--poses", "given"]
    source = Path(ordered[0][0])
    assert source.parent == tmp_path / "house.nvsim"
    assert source.read_text().splitlines() == [str(c) for c in captures]


@pytest.mark.parametrize("adds", [False, True])
def test_no_import_starts_if_the_names_of_skipped_frames_cannot_be_stored(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, adds: bool
) -> None:
    def refuse(*_: object) -> None:
        raise InputError("The disk is full.")

    monkeypatch.setattr("nvsim_app.wiring.new_project.write_names", refuse)
    notices: list[str] = []
    session.notices.added.connect(lambda notice: notices.append(notice.text))
    part = part_of(session)
    new = NewProject((tmp_path / "walk",), tmp_path / "walk.nvsim", (), True, ("a.jpg",))
    (part._add if adds else part._make)(new)
    assert not session.window.jobs.handles
    assert notices == ["The disk is full."]


def test_a_second_walk_is_added_and_the_next_stage_is_offered_again(
    session: Session, capture: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    from nvsim.cli.main import main

    project, second = tmp_path / "house.nvsim", tmp_path / "second"
    shutil.copytree(capture, second)
    assert main(["import", str(capture), "--project", str(project), "--hold-out", "5"]) == 0
    assert main(["submaps", "--project", str(project), "--count", "1"]) == 0
    session.open(project)
    document, window = session.document, session.window
    qtbot.waitUntil(lambda: bool(document.contents.submaps), timeout=SECONDS)
    frames = len(document.contents.capture.frames)
    bar = window.findChild(StageBar)
    qtbot.waitUntil(lambda: "floor" in bar.sentence.text(), timeout=SECONDS)
    window.actions_table["add_capture"].trigger()
    dialog = window.findChildren(NewProjectDialog)[-1]
    assert dialog.windowTitle() == "Add a capture" and dialog.hold_out.value() == 5 and not dialog.hold_out.isEnabled()
    dialog.set_captures([second])
    qtbot.waitUntil(dialog.import_button.isEnabled, timeout=SECONDS)
    qtbot.mouseClick(dialog.import_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: len(document.contents.capture.frames) == 2 * frames, timeout=SECONDS)
    qtbot.waitUntil(lambda: bar.isVisible() and "capture has changed" in bar.sentence.text(), timeout=SECONDS)
    assert document.contents.missing_verb == "submaps"
    qtbot.mouseClick(bar.stage, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: document.contents.missing_verb == "floors", timeout=SECONDS)
    assert {i for s in document.contents.submaps for i in s.core} == set(range(2 * frames))


def test_what_is_wrong_with_a_capture_is_mended_where_it_is_said(
    qtbot: QtBot, session: Session, capture: Path, tmp_path: Path
) -> None:
    broken = Path(shutil.copytree(capture, tmp_path / "walk"))
    images = sorted((broken / "images").iterdir())
    for image in images[:3]:
        image.write_bytes(b"")
    elsewhere = (broken / "images").rename(tmp_path / "elsewhere")
    dialog = part_of(session).open_dialog([broken])
    dialog.project.setText(str(tmp_path / "walk.nvsim"))

    def checked() -> None:
        qtbot.waitUntil(lambda: not dialog.check.running and not dialog._due.isActive(), timeout=SECONDS)

    qtbot.waitUntil(lambda: dialog.result_shown is not None, timeout=SECONDS)
    mending = dialog.mending
    assert [k.message for k in dialog.result_shown.kinds if k.severity == "error"] == ["the image is missing"]
    assert mending.folder.isVisible() and not mending.leave_out.isEnabled()  # nothing would be left
    dialog.look_in(str(elsewhere))
    checked()
    assert not mending.folder.isVisible() and mending.leave_out.text() == "Leave out 3 frames"
    assert dialog.summary.rows["Images"].text() == f"{len(images)}, 3 cannot be used"
    dialog.grab()
    qtbot.mouseClick(mending.leave_out, Qt.MouseButton.LeftButton)
    checked()
    assert dialog.import_button.isEnabled() and mending.take_back.text() == "Include 3 frames again"
    assert dialog.summary.rows["Images"].text() == f"{len(images) - 3}"
    qtbot.mouseClick(dialog.import_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: session.document.contents.capture is not None, timeout=SECONDS)
    frames = session.document.contents.capture.frames
    assert len(frames) == len(images) - 3 and {f.image_path.parent for f in frames} == {elsewhere}
    qtbot.waitUntil(lambda: not session.window.jobs.running, timeout=SECONDS)


def test_one_of_several_colmap_models_is_selected_in_the_form(qtbot: QtBot, tmp_path: Path) -> None:
    names = [f"{i}.png" for i in range(4)]
    (tmp_path / "images").mkdir()
    for i, name in enumerate(names):
        image = np.full((48, 64, 3), 60 + 10 * i, np.uint8)
        assert cv2.imwrite(str(tmp_path / "images" / name), image)
    for model, kept in (("0", (0, 1, 2)), ("1", (3,))):
        folder = tmp_path / "sparse" / model
        folder.mkdir(parents=True)
        (folder / "cameras.txt").write_text("1 PINHOLE 64 48 40 40 32 24\n")
        (folder / "images.txt").write_text("".join(f"{i + 1} 1 0 0 0 {i} 0 0 1 {names[i]}\n\n" for i in kept))
    dialog = NewProjectDialog([tmp_path], tmp_path / "new.nvsim")
    qtbot.addWidget(dialog)
    dialog.show()
    assert not dialog.model.isVisible()
    qtbot.waitUntil(lambda: dialog.result_shown is not None, timeout=SECONDS)
    assert dialog.model.isVisible() and dialog.summary.rows["Images"].text() == "3"
    dialog.model.line.setText("1")
    qtbot.waitUntil(lambda: dialog.summary.rows["Images"].text() == "1", timeout=SECONDS)
    chosen = []
    dialog.chosen.connect(chosen.append)
    dialog._choose(everything=False)
    assert chosen[0].options == ("--model", "1")
