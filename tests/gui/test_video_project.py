"""From a video to a project in the window: the check of the video, the job, and the report about the poses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from threading import Event

import cv2
import numpy as np
import pytest
from cut_texts import cut_texts
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QImage
from PySide6.QtWidgets import QComboBox, QWidget
from pytestqt.qtbot import QtBot

from nvsim.capture.findings import SCALE_ASSUMED, SCALE_IN_HEIGHTS
from nvsim.networks.folder import VARIABLE
from nvsim.project.config import CaptureConfig
from nvsim.project.layout import Layout
from nvsim.project.project import Project
from nvsim.reconstruction.report import PosesReport, WeakPlace, write_report
from nvsim_app.jobs.queries import result_of
from nvsim_app.look.colors import submap_color
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import in_window
from nvsim_app.painting import cameras
from nvsim_app.panels.details import DetailsPanel
from nvsim_app.panels.new_project import NewProjectDialog
from nvsim_app.session import Session
from nvsim_app.state.document import Document
from nvsim_app.state.folder_listing import list_folder
from nvsim_app.state.recent_projects import place_for
from nvsim_app.wiring.new_project import NewProjectPart
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.window import MainWindow

SECONDS = 120_000
REPORT = PosesReport(
    source="/home/me/walk.mp4",
    footage="a video",
    stamp=(("/home/me/walk.mp4", 5_000_000, 1),),
    settings=1,
    looked_at=2160,
    frames=400,
    blurred=12,
    with_pose=380,
    pieces=(380, 12),
    focal_px=(910.4,),
    size_px=(1280, 720),
    residual_px=0.61,
    loops=44,
    left_out=tuple(f"0_{i:06d}.jpg" for i in range(20)),
    seconds=301.0,
)


def write_video(path: Path) -> Path:
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, (64, 48))
    for shade in range(0, 250, 50):
        video.write(np.full((48, 64, 3), shade, np.uint8))
    video.release()
    return path


def test_a_dropped_video_is_checked_asks_for_the_height_and_becomes_a_job(
    qtbot: QtBot, session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ordered: list[tuple] = []
    monkeypatch.setattr(session.window.jobs, "start", lambda *job: ordered.append(job))
    video = write_video(tmp_path / "walk.mp4")
    assert [(e.path, e.kind, e.openable) for e in list_folder(tmp_path, Event()).entries] == [(video, "video", True)]
    session.window.part(NewProjectPart).open_paths([video])
    (dialog,) = session.window.findChildren(NewProjectDialog)
    assert Path(dialog.project.text()) == place_for(video) == tmp_path / "walk.nvsim"
    qtbot.waitUntil(lambda: dialog.result_shown is not None, timeout=SECONDS)
    assert dialog.import_button.isEnabled() and "lengths are in camera heights" in dialog.verdict.text()
    qtbot.waitUntil(dialog.mending.scale.isVisible)
    qtbot.mouseClick(dialog.mending.scale, Qt.MouseButton.LeftButton)
    assert dialog.summary.rows["Length"].text() == "0 min 00 s, 5 frames"
    assert dialog.summary.rows["Resolution"].text() == "64 × 48"
    assert dialog.summary.rows["Point cloud"].isHidden()
    qtbot.keyClicks(dialog.camera_height.line, "1.45")
    qtbot.waitUntil(dialog.import_button.isEnabled, timeout=SECONDS)
    assert "computes the camera poses first" in dialog.verdict.text()
    dialog.import_button.click()
    ((verb, arguments, project, title),) = ordered
    assert (verb, project, title) == ("import", tmp_path / "walk.nvsim", "Import walk.mp4")
    assert arguments == [str(video), "--project", str(project), "--camera-height", "1.45"]


def test_installed_networks_can_be_selected_for_a_video(
    qtbot: QtBot, session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ordered: list[tuple] = []
    monkeypatch.setattr(session.window.jobs, "start", lambda *job: ordered.append(job))
    monkeypatch.setenv(VARIABLE, str(tmp_path / "models"))
    for name, form in (("disk", "aliked"), ("crowd", "segformer-ade20k")):
        (tmp_path / "models" / name).mkdir(parents=True)
        (tmp_path / "models" / name / "model.toml").write_text(f'form = "{form}"\n')
    floor_only = tmp_path / "models" / "floor-only"
    floor_only.mkdir()
    (floor_only / "model.toml").write_text('form = "segformer-ade20k"\n[result]\nvalue = "logits"\nimage = "photo"\n'
                                           'meaning = "logits"\nclasses = 150\nfloor = [3]\n')  # fmt: skip
    video = write_video(tmp_path / "walk.mp4")
    session.window.part(NewProjectPart).open_paths([video])
    (dialog,) = session.window.findChildren(NewProjectDialog)
    assert dialog.features.isHidden(), "shown before it is known whether the capture has poses"
    qtbot.waitUntil(lambda: dialog.result_shown is not None, timeout=SECONDS)
    boxes = [editor.findChild(QComboBox) for editor in (dialog.features, dialog.people)]
    assert [[box.itemText(i) for i in range(box.count())] for box in boxes] == [["none", "disk"], ["none", "crowd"]]
    for box in boxes:
        box.setFocus()
        qtbot.keyClick(box, Qt.Key.Key_Down)
    qtbot.waitUntil(dialog.import_button.isEnabled, timeout=SECONDS)
    qtbot.mouseClick(dialog.import_button, Qt.MouseButton.LeftButton)
    ((_, arguments, project, _),) = ordered
    assert arguments == [str(video), "--project", str(project), "--features", "disk", "--people", "crowd"]


def test_networks_are_not_offered_if_none_are_installed_or_the_capture_has_poses(
    qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "models"))
    of_video = {"refused": False, "findings": [], "summary": None, "videos": [], "panoramic": False}
    without = NewProjectDialog()
    qtbot.addWidget(without)
    without.show_result(result_of(json.dumps(of_video)))
    assert without.features.isHidden() and without.people.isHidden()
    (tmp_path / "models" / "disk").mkdir(parents=True)
    (tmp_path / "models" / "disk" / "model.toml").write_text('form = "aliked"\n')
    dialog = NewProjectDialog()
    qtbot.addWidget(dialog)
    for data, is_hidden in ((of_video, False), ({**of_video, "panoramic": True}, True), ({**of_video}, False)):
        dialog.show_result(result_of(json.dumps(data)))
        assert dialog.features.isHidden() == is_hidden and dialog.people.isHidden()
    del of_video["panoramic"]
    dialog.show_result(result_of(json.dumps(of_video)))
    assert dialog.features.isHidden(), "of a capture with poses"


def test_an_import_into_a_project_also_passes_that_no_network_is_chosen(
    qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the option, the import would keep the network of the earlier poses."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "models"))
    (tmp_path / "models" / "disk").mkdir(parents=True)
    (tmp_path / "models" / "disk" / "model.toml").write_text('form = "aliked"\n')
    of_video = {"refused": False, "findings": [], "summary": None, "videos": [], "panoramic": False}
    for project, options in ((None, ()), (tmp_path / "a.nvsim", ("--features", "none"))):
        dialog = NewProjectDialog(project=project)
        qtbot.addWidget(dialog)
        dialog.show_result(result_of(json.dumps(of_video)))
        with qtbot.waitSignal(dialog.chosen) as caught:
            dialog._choose(everything=False)
        assert caught.args[0].options == options


def test_the_texts_beside_the_options_of_an_import_are_in_one_column(qtbot: QtBot) -> None:
    dialog = NewProjectDialog()
    qtbot.addWidget(dialog)
    dialog.show()
    shown = [row[-1] for row in dialog._rows.values() if row[-1].isVisible()]
    assert len(shown) == 5 and len({help.x() for help in shown}) == 1
    assert not list(cut_texts(dialog))


def test_a_video_that_cannot_be_decoded_is_refused_by_the_check() -> None:
    finding = {"severity": "error", "message": "x.mp4 is empty", "where": "x.mp4", "consequence": "it cannot be used"}
    result = result_of(json.dumps({"refused": True, "findings": [finding], "summary": None, "videos": []}))
    assert result.sentence == "This capture cannot be used as it is."
    video = {"name": "y.mp4", "frames": 9, "seconds": 1.5, "rate": 6.0, "width": 64, "height": 48}
    unknown = {"severity": "warning", "message": SCALE_ASSUMED, "where": "y.mp4", "consequence": SCALE_IN_HEIGHTS}
    result = result_of(json.dumps({"refused": False, "findings": [unknown], "videos": [video, video]}))
    assert result.accepts_scale and not result.needs_scale
    assert result.sentence.startswith("These 2 videos can be used.") and result.sentence.endswith("in camera heights.")
    assert in_window(SCALE_IN_HEIGHTS) == (  # a known length has no field: it is measured in the imported capture
        "lengths are in camera heights of 1.5 m; set “Camera height”; after the import, you can also measure a known "
        "length"
    )
    with pytest.raises(ValueError, match="not a data check"):
        result_of(json.dumps({"refused": False, "findings": [], "videos": [{"name": "y.mp4"}]}))


def test_the_details_show_the_report_about_the_poses(document: Document, qtbot: QtBot) -> None:
    panel = DetailsPanel(document)
    qtbot.addWidget(panel)
    assert panel.title.isHidden()
    document.set_contents(replace(document.contents, poses=REPORT))
    panel.refresh()
    assert panel.title.text() == "Computed poses"
    words = " ".join(panel._facts.itemAt(i).widget().property("text") or "" for i in range(panel._facts.count()))
    for said in ("380 of 400 (95 %)", "12 of the chosen frames", "910 pixels at 1280 x 720", "44 pairs", "0.61 pixels"):
        assert said in words, words
    assert "20, too little in common" in words and "camera heights" not in words
    capture = document.contents.capture
    unknown = replace(capture, alignment=replace(capture.alignment, scale_known=False))
    document.set_contents(replace(document.contents, capture=unknown))
    assert panel._facts.itemAt(1).widget().property("text").startswith("assumed from a camera height of 1.5 m")


def test_the_trajectory_grows_in_the_views_while_poses_are_computed(
    qtbot: QtBot, session: Session, tmp_path: Path
) -> None:
    root = tmp_path / "house.nvsim"
    Project.create_or_open(root).close()
    session.open(root)
    document, window = session.document, session.window
    window.resize(1400, 900)
    assert window.center.currentWidget() is window.empty
    work = Layout(root).poses(1) / ".poses"
    work.mkdir(parents=True)
    for count, pieces in ((30, 1), (80, 2)):
        turn = np.linspace(0, 0.06 * count, count)
        places = np.stack([4 * np.cos(turn), 3 * np.sin(turn), np.zeros(count)], axis=1)
        piece = np.arange(count) * pieces // count
        places[piece == 1] += (7, 0, 0)
        np.savez(work / "new.npz", positions=places, frame=np.arange(1, count + 1), piece=piece)
        (work / "new.npz").replace(work / "trajectory.npz")
        qtbot.waitUntil(lambda n=count: len(document.drawn_trajectory.positions) == n, timeout=SECONDS)
        assert len(document.extent) == count and window.center.currentWidget() is window.scene
        assert set(window.part(MapPart).view._walks) == set(range(pieces))
    assert not len(document.trajectory.positions)  # there are no frames to select
    assert document.contents.capture is None and not window.actions_table["set_scale"].isEnabled()
    ink = image_of(window.scene)
    for index in (0, 1):
        color = QColor(submap_color(index))
        near = np.abs(ink.astype(int) - (color.red(), color.green(), color.blue())).max(axis=-1) < 40
        assert near.sum() > 50


def test_the_frames_are_shown_while_they_are_chosen(qtbot: QtBot, session: Session, tmp_path: Path) -> None:
    root = tmp_path / "house.nvsim"
    Project.create_or_open(root).close()
    session.open(root)
    document, window = session.document, session.window
    window.resize(1200, 800)
    plane = cv2.resize(np.random.default_rng(0).integers(0, 255, (60, 160, 3), np.uint8), (3200, 1200))
    video = cv2.VideoWriter(str(tmp_path / "walk.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10, (640, 480))
    for x in range(0, 1500, 10):
        video.write(np.ascontiguousarray(plane[300:780, x : x + 640]))
    video.release()
    given = [str(tmp_path / "walk.mp4"), "--project", str(root)]
    job = window.jobs.start("import", given, root, "Import walk.mp4")
    qtbot.waitUntil(lambda: "images chosen so far" in window.empty.sentence.text(), timeout=SECONDS)
    chosen = document.contents.chosen
    assert chosen is not None and chosen.last.is_file()
    mark = window.empty.findChildren(Label)[0]
    assert mark.pixmap().height() > 100
    window.jobs.cancel(job)


def test_weak_places_are_marked_on_the_map_and_in_the_3d_view(
    window: MainWindow, document: Document, qtbot: QtBot
) -> None:
    names = [frame.name for frame in document.contents.capture.frames]
    places = (
        WeakPlace(names[10], names[11], (3.0, 3.3), "the frames are blurred", "move more slowly here"),
        WeakPlace("images/frame_00050a.jpg", names[51], (9.0, 9.3), "the camera turned on the spot", "walk in a curve"),
    )
    window.scene.navigation.set_pose(cameras.top_view(document.extent, 1.4))
    before = image_of(window.scene)
    document.set_contents(replace(document.contents, poses=replace(REPORT, weak=places)))
    plan = window.part(MapPart).view
    plan._draw_trajectory()
    marks = plan.weak.points()
    assert [mark.data() for mark in marks] == [
        "The frames are blurred. Move more slowly here.",
        "The camera turned on the spot. Walk in a curve.",
    ]
    shown = np.array([(mark.pos().x(), mark.pos().y()) for mark in marks])
    assert shown == pytest.approx(document.trajectory.positions[[10, 50], :2])
    window.scene.update()
    after = image_of(window.scene)
    changed = np.abs(after.astype(int) - before).max(axis=-1) > 20
    assert changed.sum() > 60
    panel = DetailsPanel(document)
    qtbot.addWidget(panel)
    words = " ".join(panel._facts.itemAt(i).widget().property("text") or "" for i in range(panel._facts.count()))
    assert "0:09 to 0:09" in words and "When you film again: walk in a curve." in words


def test_a_piece_of_the_video_is_chosen_in_the_details(
    window: MainWindow, document: Document, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    ordered: list[tuple] = []
    monkeypatch.setattr(window.jobs, "start", lambda *job: ordered.append(job))
    monkeypatch.setattr(
        "nvsim_app.wiring.importing._config_of", lambda project: CaptureConfig(scale=2.0, camera_height=1.4)
    )
    panel = window.panels["details"]
    assert panel.pieces.isHidden()
    names = tuple(frame.name for frame in document.contents.capture.frames)
    report = replace(REPORT, pieces=(380, 12, 3), members=(("other.jpg",), names, ("third.jpg",)))
    document.set_contents(replace(document.contents, poses=report))
    assert not panel.pieces.isHidden() and panel.pieces.count() == 2  # the third has too few frames for a model
    assert panel.pieces.currentText() == "Piece 1: 12 frames (in use)"
    panel.pieces.setFocus()
    qtbot.keyClick(panel.pieces, Qt.Key.Key_Up)
    ((verb, arguments, project, title),) = ordered
    assert (verb, project, title) == ("import", document.project, "Import piece 0")
    assert arguments == [REPORT.source, "--project", str(project), "--camera-height", "1.4", "--model", "0"]


def test_a_video_whose_pieces_are_all_small_offers_them_before_there_is_a_capture(
    qtbot: QtBot, session: Session, tmp_path: Path
) -> None:
    root = tmp_path / "house.nvsim"
    Project.create_or_open(root).close()
    Layout(root).poses(1).mkdir()
    report = replace(REPORT, with_pose=60, pieces=(60, 50, 9))
    write_report(report, Layout(root).poses(1))
    session.open(root)
    panel = session.window.panels["details"]
    qtbot.waitUntil(lambda: not panel.pieces.isHidden(), timeout=SECONDS)
    words = " ".join(panel._facts.itemAt(i).widget().property("text") or "" for i in range(panel._facts.count()))
    assert panel.pieces.count() == 3 and panel.pieces.currentIndex() == -1 and "Only 60 of 400 frames" in words


def image_of(widget: QWidget) -> np.ndarray:
    """(H, W, 3) uint8."""
    image = widget.grab().toImage().convertToFormat(QImage.Format.Format_RGB888)
    data = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
    return data[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).copy()
