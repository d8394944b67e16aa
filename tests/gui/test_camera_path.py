"""Pictures of any size, and the camera path in the window."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import demo_project
import demo_room
import pytest
from PySide6.QtGui import QImage
from pytestqt.qtbot import QtBot

from nvsim.geometry.camera_path import read_camera_path
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.state.document import Document
from nvsim_app.wiring.camera_path import CameraPathPart
from nvsim_app.wiring.window import MainWindow


@pytest.fixture
def part(window: MainWindow) -> CameraPathPart:
    return window.part(CameraPathPart)


def test_views_become_key_poses_and_playing_ends_at_the_last(
    part: CameraPathPart, window: MainWindow, qtbot: QtBot
) -> None:
    assert not part.panel.play.isEnabled() and "two key poses" in part.panel.play.toolTip()
    for x in (3.0, 6.0):
        window.scene.navigation.set_pose(ViewPose((x, 4.0, 1.5), heading=0.1 * x))
        part.panel.add.click()
    window.scene.navigation.set_pose(ViewPose((0, 0, 5)))
    part.panel.seconds.setValue(1.0)
    part.panel.play.click()
    qtbot.waitUntil(lambda: not part.panel.play.isChecked(), timeout=20_000)
    assert window.scene.pose.position == pytest.approx((6.0, 4.0, 1.5))
    part.panel.keys.setCurrentRow(0)
    part.panel.remove.click()
    assert len(part.poses) == 1 and not part.panel.video.isEnabled()


def test_a_picture_has_the_size_that_was_asked_for(
    part: CameraPathPart, window: MainWindow, qtbot: QtBot, tmp_path: Path
) -> None:
    window.scene.feed.show(demo_room.RoomSource())
    qtbot.waitUntil(lambda: window.scene.picture is not None, timeout=20_000)
    part.panel.width_box.setValue(640)
    part.panel.height_box.setValue(200)
    path = tmp_path / "view.png"
    part.save_picture(path)
    qtbot.waitUntil(path.exists, timeout=10_000)
    image = QImage(str(path))
    assert (image.width(), image.height()) == (640, 200)
    assert len({image.pixel(x, y) for x in range(0, 640, 20) for y in range(0, 200, 20)}) > 20


def test_a_picture_without_a_reconstruction_shows_the_layers(
    part: CameraPathPart, document: Document, tmp_path: Path
) -> None:
    document.set_contents(replace(document.contents, scene_stamp=None))
    part.save_picture(tmp_path / "view.png")
    assert QImage(str(tmp_path / "view.png")).width() == 1920


def test_a_video_without_a_project_says_what_is_missing(
    part: CameraPathPart, document: Document, window: MainWindow, tmp_path: Path
) -> None:
    document.set_contents(replace(document.contents, scene_stamp=None))
    part.draw_video(tmp_path)
    assert any("trained submaps" in text for text in window.notice_area.texts)


def test_the_command_draws_the_frames_of_a_path(tmp_path: Path) -> None:
    from nvsim.cli.main import main
    from nvsim.geometry.camera_path import KeyPose, write_camera_path

    project = demo_project.write_project(tmp_path / "demo.nvsim", count=2000, models=1)
    write_camera_path(tmp_path / "path.json", [KeyPose((7, 2, 1.5)), KeyPose((7, 6, 1.5), heading=1.0)])
    assert len(read_camera_path(tmp_path / "path.json").keys) == 2
    words = ["--path", str(tmp_path / "path.json"), "--out", str(tmp_path / "video"), "--width", "64", "--height", "48"]
    code = main(["video", "--project", str(project), *words, "--seconds", "1", "--fps", "3", "--json"])
    assert code == 0
    frames = sorted((tmp_path / "video").glob("frame_*.png"))
    assert [f.name for f in frames] == [f"frame_{i:05d}.png" for i in range(3)]
    assert QImage(str(frames[0])).width() == 64
