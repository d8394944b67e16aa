"""Images of any size, and videos of the 3D view."""

from __future__ import annotations

import time
from collections.abc import Iterable
from itertools import count
from pathlib import Path

from PySide6.QtCore import QTimer
from PySide6.QtGui import QImage, QPainter
from PySide6.QtWidgets import QFileDialog

from nvsim.geometry.camera_path import CameraPath, KeyPose, write_camera_path
from nvsim_app.actions import Action
from nvsim_app.drawing.render_child import Picture, Request
from nvsim_app.look.icons import save_image
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.panels.camera_path import CameraPathPanel
from nvsim_app.state.reasons import with_positions, with_scene
from nvsim_app.wiring.part import Dock, Part, WindowContext

_VIEW = "still"  # name of this view in requests to the render process
_TICK = 15  # milliseconds


class CameraPathPart(Part):
    """Edits the camera path, and renders images and videos."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.poses: list[ViewPose] = []
        self.panel = CameraPathPanel()
        self._numbers = count()
        self._target: Path | None = None  # path of the image that is being rendered
        self._begun = 0.0
        self._ticks = QTimer(self, interval=_TICK)
        self._ticks.timeout.connect(self._tick)
        self.panel.added.connect(self.add)
        self.panel.removed.connect(self.remove)
        self.panel.chosen.connect(self._go_to)
        self.panel.played.connect(self._set_playing)
        self.panel.pictureWanted.connect(self._choose_picture)
        self.panel.videoWanted.connect(self._choose_video)
        context.scene.link.arrived.connect(self._on_picture)
        context.document.projectChanged.connect(self._clear)
        context.document.unitsChanged.connect(self._list)

    def docks(self) -> tuple[Dock, ...]:
        return (
            Dock("camera_path", "Camera path", self.panel, "left", tab="submaps", needs=with_positions,
                 workspaces=("explore",)),
        )  # fmt: skip

    def _has_path(self) -> bool:
        """Whether there is a path to follow. If not, shows the panel and a notice."""
        if len(self.poses) < 2:
            self.context.window.show_dock("camera_path")
            self.context.notices.info("A camera path needs two views. Go to each place and select Add view.")
        return len(self.poses) >= 2

    def _play_command(self) -> None:
        if self._has_path():
            self.panel.play.setChecked(not self.panel.play.isChecked())

    def _video_command(self) -> None:
        if self._has_path():
            self._choose_video()

    # Key poses ---------------------------------------------------------------------------------------------------

    def add(self) -> None:
        """Appends the current view to the key poses."""
        self.poses.append(self.context.scene.pose)
        self.panel.show_keys(self.poses)

    def remove(self, row: int) -> None:
        if 0 <= row < len(self.poses):
            del self.poses[row]
            self.panel.show_keys(self.poses)

    def _list(self) -> None:
        self.panel.show_keys(self.poses)

    def keep(self, poses: Iterable[ViewPose]) -> None:
        """Replaces the key poses."""
        self.poses = list(poses)
        self.panel.show_keys(self.poses)

    def _clear(self) -> None:
        self.poses = []
        self.panel.show_keys(self.poses)
        self.panel.play.setChecked(False)

    def _go_to(self, row: int) -> None:
        self.context.scene.navigation.go_to(self.poses[row])

    def _keys(self) -> list[KeyPose]:
        return [KeyPose(p.position, p.heading, p.elevation, p.fov) for p in self.poses]

    def _set_playing(self, on: bool) -> None:
        self._begun = time.monotonic()
        (self._ticks.start if on and len(self.poses) > 1 else self._ticks.stop)()

    def _tick(self) -> None:
        share = (time.monotonic() - self._begun) / self.panel.seconds.value()
        key = CameraPath(self._keys()).at(share)
        self.context.scene.navigation.set_pose(ViewPose(key.position, key.heading, key.elevation, 3.0, key.fov))
        if share >= 1:
            self.panel.play.setChecked(False)

    # Images and videos ------------------------------------------------------------------------------------------

    def _choose_picture(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self.context.window, "Save image", "view.png", "PNG (*.png)")
        if name:
            self.save_picture(Path(name))

    def save_picture(self, path: Path) -> None:
        """Renders the view in the size of the panel, and saves it."""
        scene = self.context.scene
        camera = scene.pose.camera(*self.panel.size_wanted)
        self._target = path
        request = Request(next(self._numbers), camera, scene.feed.channel, False, scene.feed.renderer, _VIEW)
        if self.context.document.contents.scene_stamp is None:
            self._save(QImage(*self.panel.size_wanted, QImage.Format.Format_RGB32), request, blank=True)
        else:
            scene.link.ask(request)

    def _on_picture(self, picture: Picture) -> None:
        if picture.request.view == _VIEW and self._target is not None:
            k = picture.request.camera.intrinsics
            image = QImage(picture.pixels.data, k.width, k.height, 4 * k.width, QImage.Format.Format_RGB32)
            self._save(image.copy(), picture.request)

    def _save(self, image: QImage, request: Request, blank: bool = False) -> None:
        assert self._target is not None
        path, self._target = self._target, None
        if blank:
            image.fill(self.context.window.palette().window().color())
        if self.panel.layers.isChecked():
            painter = QPainter(image)
            self.context.scene.overlays.paint(painter, request.camera)
            painter.end()
        with self.context.notices.reporting(about="save"):
            save_image(image, path)
            self.context.notices.info(f"Saved {path}.", about="save")

    def _choose_video(self) -> None:
        folder = QFileDialog.getExistingDirectory(self.context.window, "Folder for the frames and video.mp4")
        if folder:
            self.draw_video(Path(folder))

    def draw_video(self, folder: Path) -> None:
        """Starts a job that renders the path into `folder`."""
        project = self.context.document.project
        if project is None or self.context.document.contents.scene_stamp is None:
            self.context.notices.error("A video needs a project with trained submaps; open one first.")
            return
        keys = folder / "camera_path.json"
        width, height = self.panel.size_wanted
        words = [f"--path={keys}", f"--out={folder}", f"--width={width}", f"--height={height}"]
        words += [f"--seconds={self.panel.seconds.value()}", f"--fps={int(self.panel.fps.value())}"]
        with self.context.notices.reporting():
            write_camera_path(keys, self._keys())
            self.context.jobs.start("video", words, project, f"Video in {folder.name}", heavy=False)

    ACTIONS = (
        Action("&Camera", 3, "add_key", "&Add view to the camera path",
               "Add the current view as the next key pose of the panel Camera path", add, "Ctrl+Shift+V",
               with_positions),
        Action("&Camera", 3, "play_path", "&Play the camera path", "Fly along the key poses", _play_command,
               enabled=with_positions),
        Action("&Camera", 3, "draw_video", "Render v&ideo…",
               "Render the camera path as PNG frames and an MP4, as a job", _video_command, enabled=with_scene),
        Action("&Camera", 3, "save_sized", "&Save an image of any size…",
               "Render the view in the size that the panel Camera path sets", _choose_picture, enabled=with_positions),
    )  # fmt: skip
