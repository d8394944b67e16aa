"""From a video to a project by the window: what it says about the video, the job, and the report about the poses."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PySide6.QtCore import QSettings, Qt
from pytestqt.qtbot import QtBot

from app.jobs.check import result_of
from app.panels.details import DetailsPanel
from app.panels.new_project import NewProjectDialog
from app.session import Session
from app.state.document import Document
from app.state.folder_listing import FolderLook
from app.state.project_place import place_for
from app.wiring.new_project import NewProjectPart
from nvsim.capture.findings import SCALE_ASSUMED, SCALE_IN_HEIGHTS
from nvsim.reconstruction.report import PosesReport

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


@pytest.fixture
def session(qtbot: QtBot, settings: QSettings) -> Iterator[Session]:
    made = Session(settings)
    qtbot.addWidget(made.window)
    made.window.show()
    yield made
    made.close()


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
    assert [(e.path, e.kind, e.openable) for e in FolderLook(tmp_path).result().entries] == [(video, "video", True)]
    next(p for p in session.window.parts if isinstance(p, NewProjectPart)).take([video])
    (dialog,) = session.window.findChildren(NewProjectDialog)
    assert Path(dialog.project.text()) == place_for(video) == tmp_path / "walk.nvsim"
    qtbot.waitUntil(lambda: dialog.result_shown is not None, timeout=SECONDS)
    assert dialog.import_button.isEnabled() and "lengths are in camera heights" in dialog.verdict.text()
    qtbot.waitUntil(dialog.mending.scale.isVisible)
    qtbot.mouseClick(dialog.mending.scale, Qt.MouseButton.LeftButton)
    assert dialog.summary.rows["Length"].text() == "0 min 00 s, 5 frames"
    assert dialog.summary.rows["Resolution"].text() == "64 × 48"
    assert dialog.summary.rows["Cloud"].isHidden()
    qtbot.keyClicks(dialog.camera_height.line, "1.45")
    qtbot.waitUntil(dialog.import_button.isEnabled, timeout=SECONDS)
    assert "computes the camera poses first" in dialog.verdict.text()
    dialog.import_button.click()
    ((verb, arguments, project, title),) = ordered
    assert (verb, project, title) == ("import", tmp_path / "walk.nvsim", "Import walk.mp4")
    assert arguments == [str(video), "--project", str(project), "--camera-height", "1.45"]


def test_a_video_that_cannot_be_decoded_is_refused_by_the_check() -> None:
    finding = {"severity": "error", "message": "x.mp4 is empty", "where": "x.mp4", "consequence": "it cannot be used"}
    result = result_of(json.dumps({"refused": True, "findings": [finding], "summary": None, "videos": []}))
    assert result.sentence == "This capture cannot be used as it is."
    video = {"name": "y.mp4", "frames": 9, "seconds": 1.5, "rate": 6.0, "width": 64, "height": 48}
    unknown = {"severity": "warning", "message": SCALE_ASSUMED, "where": "y.mp4", "consequence": SCALE_IN_HEIGHTS}
    result = result_of(json.dumps({"refused": False, "findings": [unknown], "videos": [video, video]}))
    assert result.assumes_scale and not result.wants_scale
    assert result.sentence.startswith("These 2 videos can be used.") and result.sentence.endswith("in camera heights.")
    with pytest.raises(ValueError, match="not a data check"):
        result_of(json.dumps({"refused": False, "findings": [], "videos": [{"name": "y.mp4"}]}))


def test_the_details_show_the_report_about_the_poses(document: Document, qtbot: QtBot) -> None:
    panel = DetailsPanel(document)
    qtbot.addWidget(panel)
    assert panel.title.isHidden()
    document.set_contents(replace(document.contents, poses=REPORT))
    panel.refresh()
    assert panel.title.text() == "Poses from a video"
    words = " ".join(panel._facts.itemAt(i).widget().property("text") or "" for i in range(panel._facts.count()))
    for said in ("380 of 400 (95 %)", "12 of the chosen frames", "910 pixels at 1280 x 720", "44 pairs", "0.61 pixels"):
        assert said in words, words
    assert "20, too little in common" in words
