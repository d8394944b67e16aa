"""Layers of the capture: its point cloud, the cameras of its frames as pyramids, the floor mask of a frame, and the
trajectory in the colors of its submaps or, while the camera poses of a video are computed, of the pieces of the
video."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPen, QTransform

from nvsim.capture.types import Frame
from nvsim.geometry.camera import Camera
from nvsim.project.work import STAGE
from nvsim_app.layers.layer import Layer
from nvsim_app.look import colors
from nvsim_app.painting.dots import MOST, Dots
from nvsim_app.painting.picking import NEAR, projected_segments
from nvsim_app.painting.primitives import Primitives, disc
from nvsim_app.state.document import Document
from nvsim_app.state.free_floor import trajectory_on_floor, weak_places

MOST_DOTS_MOVING = 12_000
_NEAR = 0.1  # meters
_LARGE = 3.0  # meters; nearer points get a dot of 3 pixels instead of 2


class CloudLayer(Layer):
    """The point cloud, written directly into an image; one painter call per dot would take ten times as long."""

    name = "cloud"
    title = "Point cloud"
    shown = False
    opacity = 0.8

    def __init__(self, document: Document) -> None:
        self._document = document
        self._dots: Dots | None = None
        self._image = np.zeros((0, 0), np.uint32)

    @property
    def missing(self) -> str:
        return "" if self._document.contents.scan_cloud is not None else "there is no point cloud"

    def release_project(self) -> None:
        self._dots = None

    def paint(self, painter: QPainter, camera: Camera) -> None:
        cloud = self._document.contents.scan_cloud
        if cloud is None:
            self._dots = None
            return
        if self._dots is None or self._dots.cloud is not cloud:
            ready = self._document.contents.dots
            self._dots = ready if ready is not None and ready.cloud is cloud else Dots.of(cloud)
        k = camera.intrinsics
        if self._image.shape != (k.height, k.width):
            self._image = np.zeros((k.height, k.width), np.uint32)
        self._image[:] = 0
        most = MOST_DOTS_MOVING if self.moving else MOST
        draw_dots(self._image, camera, self._dots.points[:most], self._dots.tones[:most])
        picture = QImage(self._image.data, k.width, k.height, 4 * k.width, QImage.Format.Format_ARGB32_Premultiplied)
        painter.drawImage(QRectF(0, 0, k.width, k.height), picture)


def draw_dots(
    image: NDArray[np.uint32], camera: Camera, points: NDArray[np.float32], tones: NDArray[np.uint32]
) -> None:
    """Writes a dot of 2 or 3 pixels for each of `points` (N, 3) in meters, world, with colors `tones` (N,) into `image`
    (H, W). Near dots cover far dots."""
    height, width = image.shape
    to_camera = camera.world_to_camera.astype(np.float32)
    x, y, depths = to_camera[:3, :3] @ points.T + to_camera[:3, 3:]
    k = camera.intrinsics
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x, y = np.float32(k.fx) * x / depths + np.float32(k.cx), np.float32(k.fy) * y / depths + np.float32(k.cy)
    seen = (depths > _NEAR) & (x >= 0) & (y >= 0) & (x < width - 2) & (y < height - 2)
    rows = np.flatnonzero(seen)
    # Whole centimeters up to 655 m, because sorting 16-bit integers takes a tenth of the time of floats.
    nearness = np.uint16(65535) - np.minimum(100 * depths[rows], 65535).astype(np.uint16)
    rows = rows[np.argsort(nearness, kind="stable")]
    places, tones, depths = y[rows].astype(np.intp) * width + x[rows].astype(np.intp), tones[rows], depths[rows]
    flat = image.reshape(-1)
    first_near = int(np.searchsorted(-depths, -_LARGE))
    for part, size in ((slice(None, first_near), 2), (slice(first_near, None), 3)):
        for offset in (dy * width + dx for dy in range(size) for dx in range(size)):
            flat[places[part] + offset] = tones[part]


REACH = 8.0  # meters from the camera within which frusta are shown
MOST_FRUSTA = 150  # maximum number of frusta; the nearest are shown
STANDING_IN = 0.3  # meters; a nearer frustum is hidden, because it would only frame the image
MOST_FRUSTA_MOVING = 60
_LENGTH = 0.22  # meters along the optical axis
_SHARE, _LONGEST = 0.03, 1.0  # length as a share of the site, and its maximum in meters, without a reconstruction


def frustum_edges(frames: Sequence[Frame], length: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The edges of the frames' pyramids, `length` meters deep: starts and ends, each (N, 8, 3) meters, world."""
    poses = np.array([f.camera_to_world for f in frames], np.float64).reshape(-1, 4, 4)
    sizes = np.array([(k.width, k.height, k.cx, k.cy, k.fx, k.fy) for k in (f.intrinsics for f in frames)], np.float64)
    width, height, cx, cy, fx, fy = sizes.reshape(-1, 6).T[..., None]
    rays = np.ones((len(frames), 4, 3))
    rays[..., 0] = (width * (0, 1, 1, 0) - cx) / fx
    rays[..., 1] = (height * (0, 0, 1, 1) - cy) / fy
    eyes = np.repeat(poses[:, None, :3, 3], 4, axis=1)
    tips = length * rays @ poses[:, :3, :3].transpose(0, 2, 1) + eyes
    return np.concatenate([eyes, tips], axis=1), np.concatenate([tips, np.roll(tips, -1, axis=1)], axis=1)


def frustum(frame: Frame, length: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The edges of one pyramid, `length` meters deep: starts and ends, each (8, 3) meters, world."""
    starts, ends = frustum_edges([frame], length)
    return starts[0], ends[0]


class FrustumLayer(Layer):
    """The cameras of the frames near the view's camera. Without a reconstruction, of all frames, evenly thinned."""

    name = "frusta"
    title = "Camera frusta"
    shown = False
    opacity = 0.7

    def __init__(self, document: Document) -> None:
        self._document = document
        self._primitives = Primitives()
        self._of: object = None
        self._everywhere = False
        self._starts = self._ends = np.zeros((0, 8, 3))

    @property
    def missing(self) -> str:
        return "" if len(self._document.trajectory.positions) else STAGE["import"].missing

    def release_project(self) -> None:
        self._of, self._starts, self._ends = None, np.zeros((0, 8, 3)), np.zeros((0, 8, 3))

    def paint(self, painter: QPainter, camera: Camera) -> None:
        capture = self._document.contents.capture
        if capture is None or not capture.frames:
            return
        positions, most = self._document.trajectory.positions, MOST_FRUSTA_MOVING if self.moving else MOST_FRUSTA
        everywhere = self._document.contents.scene_stamp is None
        if self._of is not capture or self._everywhere != everywhere:
            size = float(np.ptp(positions[:, :2], axis=0).max()) if everywhere else 0.0
            self._starts, self._ends = frustum_edges(capture.frames, min(max(_LENGTH, _SHARE * size), _LONGEST))
            self._of, self._everywhere = capture, everywhere
        distance = np.linalg.norm(positions - camera.position, axis=1)
        if everywhere:
            near = np.unique(np.linspace(0, len(positions) - 1, most).astype(np.intp))
            near = near[distance[near] > STANDING_IN]
        else:
            near = np.flatnonzero((distance < REACH) & (distance > STANDING_IN))
            near = near[np.argsort(distance[near], kind="stable")[:most]]
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, not self.moving)
        lines, index, _ = projected_segments(camera, self._starts[near].reshape(-1, 3), self._ends[near].reshape(-1, 3))
        owners = self._document.trajectory.submaps[near[index // 8]]
        for owner in np.unique(owners):
            painter.setPen(QPen(QColor(colors.submap_color(int(owner))), 1.2))
            self._primitives.draw_lines(painter, lines[owners == owner])


class SelectedFrameLayer(Layer):
    """The camera of the selected frame."""

    name = "selected_frame"
    title = "Selected frame"

    def __init__(self, document: Document) -> None:
        self._document = document
        self._primitives = Primitives()
        self._sprite = disc(colors.CAMERA, "#3d1010", 20)

    @property
    def missing(self) -> str:
        return "" if self._document.selection.frame is not None else "no frame is selected"

    def paint(self, painter: QPainter, camera: Camera) -> None:
        index, capture = self._document.selection.frame, self._document.contents.capture
        if index is None or capture is None:
            return
        frame = capture.frames[index]
        if np.linalg.norm(frame.camera_to_world[:3, 3] - camera.position) < STANDING_IN:
            return
        starts, ends = frustum(frame, 0.35)
        lines, _, _ = projected_segments(camera, starts, ends)
        pen = QPen(QColor(colors.CAMERA), 2)
        pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        painter.setPen(pen)
        self._primitives.draw_lines(painter, lines)
        pixels, depth = camera.project(starts[:1])
        if depth[0] > NEAR:
            self._primitives.draw_sprites(painter, pixels, np.full((1, 2), 0.5), self._sprite)


AT_CAMERA = 0.02  # meters; from farther away, the mask would not match the floor


class FrameMaskLayer(Layer):
    """The floor mask of the frame that `show` sets."""

    name = "frame_mask"
    title = "Floor mask of the frame"
    shown = False
    opacity = 0.45

    def __init__(self) -> None:
        self._camera: Camera | None = None
        self._image: QImage | None = None

    @property
    def missing(self) -> str:
        return "" if self._image is not None else "no frame with a floor mask is selected"

    def show(self, camera: Camera | None, image: QImage | None) -> None:
        """Sets the camera of a frame and its mask as an image of any size; None shows nothing."""
        self._camera, self._image = camera, image

    def paint(self, painter: QPainter, camera: Camera) -> None:
        if self._camera is None or self._image is None:
            return
        if np.linalg.norm(self._camera.position - camera.position) > AT_CAMERA:
            return
        turn = pixel_homography(self._camera, camera)
        k = self._camera.intrinsics
        corners = np.array([(0, 0, 1), (k.width, 0, 1), (k.width, k.height, 1), (0, k.height, 1)]) @ turn.T
        if (corners[:, 2] < 0.1).any():
            return  # a part is behind the camera
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.setTransform(QTransform(*(float(v) for v in turn.T.ravel())), True)
        painter.drawImage(QRectF(QPointF(0, 0), QPointF(k.width, k.height)), self._image)


def pixel_homography(source: Camera, target: Camera) -> NDArray[np.float64]:
    """(3, 3) homography from homogeneous pixels of `source` to those of `target`. Both cameras have one position. The
    third component of a result is positive in front of `target`."""
    turn: NDArray[np.float64] = _matrix(target) @ target.rotation.T @ source.rotation @ np.linalg.inv(_matrix(source))
    return turn


def _matrix(camera: Camera) -> NDArray[np.float64]:
    k = camera.intrinsics
    return np.array([(k.fx, 0, k.cx), (0, k.fy, k.cy), (0, 0, 1)])


class TrajectoryLayer(Layer):
    """The trajectory, with marks at weak camera poses of a reconstruction."""

    name = "trajectory"
    title = "Trajectory"

    def __init__(self, document: Document) -> None:
        self._document = document
        self._primitives = Primitives()
        self._weak = disc(colors.WARNING, "#3a2c05", 14)

    @property
    def missing(self) -> str:
        return "" if len(self._document.drawn_trajectory.positions) else STAGE["import"].missing

    def paint(self, painter: QPainter, camera: Camera) -> None:
        trajectory = self._document.drawn_trajectory
        pairs = trajectory.segments
        if len(pairs) == 0:
            return
        is_growing = trajectory is self._document.contents.growing
        positions = trajectory.positions if is_growing else trajectory_on_floor(self._document)
        lines, index, _ = projected_segments(camera, positions[pairs[:, 0]], positions[pairs[:, 1]])
        owners = trajectory.submaps[pairs[index, 1]]
        for owner in np.unique(owners):
            color = QColor(colors.submap_color(int(owner)))
            color.setAlpha(220)
            painter.setPen(QPen(color, 2.0))
            self._primitives.draw_lines(painter, lines[owners == owner])
        spots, _ = weak_places(self._document)
        if len(spots):
            pixels, depths = camera.project(positions[spots])
            self._primitives.draw_sprites(painter, pixels[depths > NEAR], np.ones((1, 2)), self._weak)
