"""The 3D view: images of the reconstruction from the rendering process, with overlays.

While the camera moves, the images are smaller to reach the frame rate. When it rests, an image at full size follows.
The overlays use the camera of the displayed image, so that both always match. `Places` moves the camera to standard
poses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import asin, radians, sin

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from nvsim.geometry.camera import Camera
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN
from nvsim_app.drawing.picture_feed import PictureFeed
from nvsim_app.drawing.render_child import Picture
from nvsim_app.look.theme import GRID
from nvsim_app.painting import cameras
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.painting.legend import legend_box, paint_legend
from nvsim_app.painting.value_colors import OF_CHANNEL, ValueScale
from nvsim_app.state.document import Document
from nvsim_app.state.free_floor import FreeFloor, floor_height
from nvsim_app.state.loading import CONTENT_PARTS
from nvsim_app.views.graph_surface import SceneSurface
from nvsim_app.views.navigation import Navigation, WalkLimits
from nvsim_app.views.overlays import Overlays, paint_ground, paint_status

EYE = 1.5  # default camera height above the floor in meters, if there are no viewpoints
_NEAR = 0.8  # meters: the least distance from a point that is centered
_ENOUGH = 2.0  # meters from which a point is centered without turning
_STEP = 0.05  # meters between tested places behind a point that is centered
_WALL = 0.3  # meters from the camera to a wall behind it
_WALLS = 1.9  # meters above the floor: the height of walls that are seen from above, and of a camera below the ceiling
_DOWN = radians(20)  # the camera looks down at least so much at a point that is centered
_FROM_ABOVE = radians(-60)  # a steeper camera remains above the building
_TURNS = [sign * radians(angle) for angle in range(0, 181, 20) for sign in (1, -1)]
_IN_ROOM = 1.0  # maximum height difference in meters to the eye level at which the camera is inside a room


class SceneView(QWidget):
    """The 3D view widget.

    poseChanged(ViewPose)
    pictureShown(Picture)   an image was painted
    troubled(Trouble)       an error of the rendering process
    remarked(Remark)        a message of the rendering process for the log
    hovered(str or None)    the cursor is over another viewpoint
    """

    poseChanged = Signal(object)
    pictureShown = Signal(object)
    troubled = Signal(object)
    remarked = Signal(object)
    hovered = Signal(object)

    def __init__(self, document: Document) -> None:
        super().__init__(accessibleName="3D view", focusPolicy=Qt.FocusPolicy.StrongFocus, mouseTracking=True)
        self.setObjectName("sceneView")
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(240, 200)
        self._document = document
        self.overlays = Overlays(document, self)
        self.overlays.changed.connect(self.update)
        self.surface = SceneSurface(self, document)
        self.navigation = Navigation(self)
        self.places = Places(document, self.navigation, lambda: self.width() / max(1, self.height()))
        self.feed = PictureFeed(self._device_size, lambda: self.pose, self)
        self.link = self.feed.link
        self.hint = ""  # a note about missing results of the project
        self._painted: Picture | None = None  # the last painted image
        self._camera_of: object = None
        self._overlay_camera = self.navigation.pose.camera(1, 1)
        self._placed: ViewPose | None = self.pose  # the pose that the program, not the user, set last
        self.navigation.moved.connect(self._on_moved)
        self.feed.changed.connect(self.update)
        self.feed.troubled.connect(self.troubled)
        self.feed.remarked.connect(self.remarked)
        document.projectChanged.connect(self._on_project)
        document.contentsChanged.connect(self._on_contents)
        document.graphChanged.connect(self.update)
        document.selectionChanged.connect(self.update)
        document.unitsChanged.connect(self.update)
        self._on_contents(frozenset(CONTENT_PARTS))

    # Interface -------------------------------------------------------------------------------------------------

    @property
    def pose(self) -> ViewPose:
        return self.navigation.pose

    @property
    def picture(self) -> Picture | None:
        """The displayed image."""
        return self.feed.picture

    @property
    def drawing(self) -> bool:
        """Whether an image is being rendered or will be requested soon."""
        return self.feed.drawing

    def set_channel(self, channel: str) -> None:
        self.feed.channel = channel
        self.feed.request_sharp_image()

    def set_renderer(self, renderer: str) -> None:
        self.feed.renderer = renderer
        self.feed.request_sharp_image()

    def set_budget(self, budget: int) -> None:
        """Limits the number of rendered Gaussians to those that cover most area; 0 renders all."""
        self.feed.budget = budget
        self.feed.request_sharp_image()

    def stay_at(self, pose: ViewPose) -> None:
        """Moves the camera to `pose`, and keeps it when more of the project is loaded."""
        self._placed = None
        self.navigation.set_pose(pose)

    def show_hovered(self, viewpoint: str | None) -> None:
        """Highlights the viewpoint under the cursor of this view or of the map."""
        if viewpoint != self.overlays.graph.hovered:
            self.overlays.graph.hovered = viewpoint
            self.update()

    def release(self) -> None:
        """Ends the rendering process. The view must not be used afterward."""
        self.navigation.stop()
        self.feed.release()

    def _device_size(self) -> tuple[int, int]:
        ratio = self.devicePixelRatioF()
        return max(1, round(self.width() * ratio)), max(1, round(self.height() * ratio))

    def _on_moved(self) -> None:
        self.poseChanged.emit(self.pose)
        if not self.feed.request_after_move():
            self.update()

    def _on_project(self) -> None:
        self._placed = self.pose

    def _on_contents(self, parts: frozenset[str]) -> None:
        if len(self._document.extent) and self.pose == self._placed:
            self._placed = self.places.initial_pose
            self.navigation.set_pose(self._placed)
        self.update()

    # Painting --------------------------------------------------------------------------------------------------

    @property
    def overlay_camera(self) -> Camera:
        """The camera of the displayed image, in logical pixels."""
        width, height = max(1, self.width()), max(1, self.height())
        picture = self.feed.picture
        key = (self.pose if picture is None else picture.request, width, height)
        if self._camera_of != key:
            # Use the same camera object for the same image, because layers cache results for it.
            self._camera_of = key
            if picture is None:
                self._overlay_camera = self.pose.camera(width, height)
            else:
                self._overlay_camera = picture.request.camera.scaled(width, height)
        return self._overlay_camera

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        image, picture = self.feed.image, self.feed.picture
        if image is not None:
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            painter.drawImage(QRectF(self.rect()), image)
        else:
            paint_ground(painter, self.size(), self.palette())
        self.overlays.grid.bare = image is None
        self.overlays.paint(painter, self.overlay_camera, picture is not None and picture.request.moving)
        paint_status(painter, self.size(), self.pose, picture, self.feed.note or self.hint)
        if picture is not None and (scale := OF_CHANNEL.get(picture.request.channel)) is not None:
            paint_legend(painter, scale, self._legend_corner(scale))
        painter.end()
        if picture is not self._painted:
            self._painted = picture
            if picture is not None:
                self.pictureShown.emit(picture)

    def _legend_corner(self, scale: ValueScale) -> QPointF:
        """The lower left corner of the legend, which is at the upper left of the view."""
        return QPointF(GRID, GRID + legend_box(scale, QPointF()).height())

    # Events ----------------------------------------------------------------------------------------------------

    def resizeEvent(self, event: QResizeEvent) -> None:
        self.feed.resize()
        super().resizeEvent(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self.navigation.press(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if event.buttons():
            self.navigation.drag(event)
            return
        hovered = self.surface.pick_viewpoint(event.position())
        if hovered != self.overlays.graph.hovered:
            self.setCursor(Qt.CursorShape.PointingHandCursor if hovered else Qt.CursorShape.ArrowCursor)
            self.show_hovered(hovered)
            self.hovered.emit(hovered)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self.navigation.release() and event.button() == Qt.MouseButton.LeftButton:
            self._click(event.position())

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if event.button() != Qt.MouseButton.LeftButton:
            return
        viewpoint = self.surface.pick_viewpoint(event.position())
        if viewpoint is not None:
            arrays = self._document.graph_arrays
            self.places.go_to_position(arrays.positions[arrays.index[viewpoint]])
            return
        frame = self.surface.pick_frame(event.position())
        if frame is not None:
            self._document.select(frame=frame)
            self.places.snap_to_frame(frame)
            return
        point = self.surface.pick_point(event.position()) or self.surface.floor_point(event.position())
        if point is not None:
            self.places.focus_on_point(np.array(point))

    def _click(self, position: QPointF) -> None:
        viewpoint = self.surface.pick_viewpoint(position)
        if viewpoint is not None:
            self._document.select(viewpoint=viewpoint)
            return
        frame = self.surface.pick_frame(position)
        self._document.select(frame=frame)

    def wheelEvent(self, event: QWheelEvent) -> None:
        self.navigation.wheel(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if not self.navigation.key(event, down=True):
            super().keyPressEvent(event)

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        if not self.navigation.key(event, down=False):
            super().keyReleaseEvent(event)

    def focusOutEvent(self, event: QFocusEvent) -> None:
        self.navigation.release_all()
        super().focusOutEvent(event)


class Places:
    """Moves the camera of `navigation` in animations. If there is no content, the camera does not move. `aspect`
    returns the ratio of width to height of the view."""

    def __init__(self, document: Document, navigation: Navigation, aspect: Callable[[], float]) -> None:
        self._document, self._navigation, self._aspect = document, navigation, aspect
        self._ground = FreeFloor(document)

    @property
    def initial_pose(self) -> ViewPose:
        """The initial pose: the first frame of the trajectory; without a reconstruction, an overview of trajectory and
        graph."""
        contents = self._document.contents
        if contents.capture is not None and contents.capture.frames and contents.scene_stamp is not None:
            return cameras.seen_from_frame(contents.capture.frames[0].camera)
        return cameras.overview(self._document.extent)

    def home(self) -> None:
        if len(self._document.extent):
            self._navigation.go_to(self.initial_pose)

    def show_overview(self) -> None:
        extent = self._document.extent
        if len(extent):
            self._navigation.go_to(cameras.overview(extent))

    def look_from_above(self) -> None:
        extent = self._document.extent
        if len(extent):
            self._navigation.go_to(cameras.top_view(extent, self._aspect()))

    def focus_on_selection(self) -> None:
        point = self._document.selected_point
        if point is not None:
            self.focus_on_point(point, cameras.REACH)

    def focus_on_point(self, point: NDArray[np.float64], reach: float | None = None) -> None:
        """Centers `point` (3,), meters, world, from at most `reach` meters: by default the distance now, and at most
        the default distance. Later turns are around it. The camera looks down from inside the room, or from above the
        building. If a wall would hide the point, the camera comes nearer or turns around the point."""
        pose = self._navigation.pose
        if reach is None:
            reach = min(float(np.linalg.norm(point - pose.position)), cameras.REACH)
        if pose.elevation > _FROM_ABOVE:
            above = point[2] - floor_height(self._document, point[0], point[1], near=point[2])
            steepest = asin(min(max((_WALLS - above) / reach, sin(_DOWN)), 1.0))
            pose = replace(pose, elevation=min(max(pose.elevation, -steepest), -_DOWN))
        clear = [self._clear_reach(point, -replace(pose, heading=pose.heading + t).axes[:, 2], reach) for t in _TURNS]
        best = next((i for i, r in enumerate(clear) if r >= min(reach, _ENOUGH)), int(np.argmax(clear)))
        turned = cameras.turn_pose(pose, _TURNS[best], 0.0)
        self._navigation.go_to(cameras.focused(turned, point, clear[best]))

    def _clear_reach(self, point: NDArray[np.float64], back: NDArray[np.float64], reach: float) -> float:
        """The largest distance up to `reach`, meters, from which a camera in the direction `back` (3,) sees `point`
        (3,): no wall is between them, and the floor behind the camera is known."""
        occupancy = self._document.contents.occupancy
        if occupancy is None or occupancy.states_at(point[:2]) == UNKNOWN:
            return reach
        distances = np.arange(0.0, reach + _WALL, _STEP)
        states = occupancy.states_at(point[:2] + distances[:, None] * back[:2])
        low = distances * back[2] < _WALLS
        seen = np.cumsum(states == FREE) > 0  # an object at the point does not hide it
        blocked = np.flatnonzero((states == UNKNOWN) | ((states == OCCUPIED) & low & seen))
        return min(reach, max(float(distances[blocked[0]]) - _WALL, _NEAR)) if len(blocked) else reach

    def snap_to_frame(self, index: int) -> None:
        capture = self._document.contents.capture
        if capture is not None and 0 <= index < len(capture.frames):
            self._navigation.go_to(cameras.seen_from_frame(capture.frames[index].camera))

    @property
    def walk_limits(self) -> WalkLimits:
        """The constraints of walking in this document."""
        return WalkLimits(self.eye_level, self._is_free)

    def _is_free(self, x: float, y: float, z: float) -> bool:
        return self._ground.free(x, y, floor_height(self._document, x, y, below=z))

    @property
    def walk_start(self) -> ViewPose:
        """The start pose of a walk. If the camera is inside a room, the walk starts below it. Otherwise it starts at
        the known position nearest to the point that the camera looks at, level and with the same heading."""
        pose = self._navigation.pose
        x, y, z = pose.position
        level, known = self.eye_level(x, y, z), self._ground.places
        if abs(z - level) < _IN_ROOM and self._is_free(x, y, z):
            return replace(pose, position=(x, y, level))
        ahead = pose.axes[:, 2]
        floor = floor_height(self._document, x, y, below=z)
        seen = np.asarray(pose.position) + ahead * (floor - z) / ahead[2] if ahead[2] < -0.1 else pose.pivot
        if not len(known):
            return replace(pose, position=(x, y, level))
        place = known[np.argmin(((known - seen) ** 2).sum(axis=1))]
        at = float(place[0]), float(place[1])
        return ViewPose((*at, self.eye_level(*at, float(place[2]) + EYE)), pose.heading)

    def eye_level(self, x: float, y: float, z: float) -> float:
        """World z in meters of a walking camera at x, y: the floor of the storey below z plus the median height of the
        viewpoints above the floor, or EYE if there are no viewpoints."""
        arrays = self._document.graph_arrays
        height = float(np.median(arrays.positions[:, 2] - arrays.feet[:, 2])) if arrays.ids else EYE
        return floor_height(self._document, x, y, below=z) + height

    def go_to_position(self, position: np.ndarray, heading: float | None = None) -> None:
        """Moves the camera to `position` ((3,) meters, world) with elevation 0. `heading` in radians; by default it
        does not change."""
        turn = self._navigation.pose.heading if heading is None else heading
        x, y, z = (float(v) for v in position)
        self._navigation.go_to(ViewPose((x, y, z), turn, 0.0, 3.0))
