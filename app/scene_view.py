"""The centre of the window: the reconstruction as the drawing process sends it, and the overlays over it.

While the camera moves, pictures come at a size that holds the pace; when it rests, one at full size follows. The
overlays are drawn with the camera of the picture beneath them, so that the two never swim apart.
"""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPointF, QRectF, Qt, QTimer, Signal
from PySide6.QtGui import (
    QFocusEvent,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QResizeEvent,
    QWheelEvent,
)
from PySide6.QtWidgets import QSizePolicy, QWidget

from app import cameras
from app.cameras import ViewPose
from app.document import Document
from app.graph_surface import SceneSurface
from app.loading import PARTS
from app.navigation import Navigation
from app.overlays import Overlays
from app.pacing import Pacing
from app.render_child import Picture, RenderSource, Request, Trouble
from app.render_link import RenderLink
from app.renderer_choice import AUTOMATIC
from app.status import paint_ground, paint_status
from nvsim.geometry.camera import Camera

REST = 100  # milliseconds without movement until the sharp picture is asked for


class SceneView(QWidget):
    """poseChanged(ViewPose); pictureShown(Picture) after it was painted; troubled(Trouble); remarked(Remark);
    hovered(str or None): the cursor came to another viewpoint."""

    poseChanged = Signal(object)
    pictureShown = Signal(object)
    troubled = Signal(object)
    remarked = Signal(object)
    hovered = Signal(object)

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("sceneView")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMouseTracking(True)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(320, 200)
        self._document = document
        self.overlays = Overlays(document, self)
        self.overlays.changed.connect(self.update)
        self.surface = SceneSurface(self, document)
        self.navigation = Navigation(self)
        self.link = RenderLink(self)
        self.pacing = Pacing()
        self.channel = "rgb"
        self.renderer = AUTOMATIC
        self.note = ""  # what the view waits for
        self.hint = ""  # what the project lacks
        self._picture: Picture | None = None
        self._image: QImage | None = None
        self._unseen = False
        self._camera_of: object = None
        self._overlay_camera = self.navigation.pose.camera(1, 1)
        self._number = 0
        self._placed = self.navigation.pose  # where the program, not the person, put the camera
        self._rest = QTimer(self, singleShot=True, interval=REST)
        self._rest.timeout.connect(self._ask_sharp)
        self.navigation.moved.connect(self._on_moved)
        self.link.arrived.connect(self._on_picture)
        self.link.opened.connect(lambda _: self._on_opened())
        self.link.troubled.connect(self._on_trouble)
        self.link.remarked.connect(self.remarked)
        document.projectChanged.connect(self._on_project)
        document.contentsChanged.connect(self._on_contents)
        document.selectionChanged.connect(self.update)
        self._on_contents(frozenset(PARTS))

    # What others ask of it -------------------------------------------------------------------------------------

    @property
    def pose(self) -> ViewPose:
        return self.navigation.pose

    @property
    def picture(self) -> Picture | None:
        """The picture on the screen."""
        return self._picture

    @property
    def drawing(self) -> bool:
        """Whether a picture is under way or about to be asked for."""
        return self._rest.isActive() or self.link.busy

    def show_hovered(self, viewpoint: str | None) -> None:
        """Marks the viewpoint under the cursor, be it of this view or of the map."""
        if viewpoint != self.overlays.graph.hovered:
            self.overlays.graph.hovered = viewpoint
            self.update()

    def show_source(self, source: RenderSource | None) -> None:
        """Draws this reconstruction from now on; None shows the overlays alone."""
        self._picture = self._image = None
        if source is None:
            self.link.close()
            self.note = ""
        else:
            self.note = "Loading the reconstruction…"
            self.link.open(source)
        self.update()

    def set_channel(self, channel: str) -> None:
        """One of tones.CHANNELS."""
        self.channel = channel
        self._ask_sharp()

    def set_renderer(self, renderer: str) -> None:
        """One of renderer_choice.PREFERENCES."""
        self.renderer = renderer
        self._ask_sharp()

    def _home_pose(self) -> ViewPose:
        contents = self._document.contents
        if contents.capture is not None and contents.capture.frames and contents.scene_stamp is not None:
            return cameras.seen_from_frame(contents.capture.frames[0].camera)
        return cameras.overview(self._document.extent)

    def _place(self) -> None:
        self._placed = self._home_pose()
        self.navigation.set_pose(self._placed)

    def home(self) -> None:
        """Where the walk began; without a reconstruction, a view over walk and graph."""
        if len(self._document.extent):
            self.navigation.go_to(self._home_pose())

    def look_over(self) -> None:
        extent = self._document.extent
        if len(extent):
            self.navigation.go_to(cameras.overview(extent))

    def look_from_above(self) -> None:
        extent = self._document.extent
        if len(extent):
            self.navigation.go_to(cameras.top_view(extent, self.width() / max(1, self.height())))

    def focus_on_selection(self) -> None:
        point = self._document.selected_point
        if point is not None:
            self.navigation.go_to(cameras.focused(self.pose, point))

    def snap_to_frame(self, index: int) -> None:
        capture = self._document.contents.capture
        if capture is not None and 0 <= index < len(capture.frames):
            self.navigation.go_to(cameras.seen_from_frame(capture.frames[index].camera))

    def go_to_position(self, position: np.ndarray, heading: float | None = None) -> None:
        """Stands at `position` (3,) looking level; keeps the heading unless one is given."""
        turn = self.pose.heading if heading is None else heading
        x, y, z = (float(v) for v in position)
        self.navigation.go_to(ViewPose((x, y, z), turn, 0.0, 3.0))

    def release(self) -> None:
        """Ends the drawing process; the view is not used afterwards."""
        self._rest.stop()
        self.navigation.stop()
        self.link.close()

    # Asking for pictures ---------------------------------------------------------------------------------------

    def _device_size(self) -> tuple[int, int]:
        ratio = self.devicePixelRatioF()
        return max(1, round(self.width() * ratio)), max(1, round(self.height() * ratio))

    def _ask(self, moving: bool) -> None:
        width, height = self._device_size()
        if moving:
            width, height = self.pacing.moving_size(width, height)
        self._number += 1
        camera = self.pose.camera(width, height)
        self.link.ask(Request(self._number, camera, self.channel, moving, self.renderer))

    def _ask_sharp(self) -> None:
        self._ask(moving=False)

    def _on_moved(self) -> None:
        self.poseChanged.emit(self.pose)
        self._rest.start()
        if self._picture is not None or self.link.ready:
            self._ask(moving=True)
        else:
            self.update()

    def _on_opened(self) -> None:
        self.note = ""
        self._ask_sharp()
        self.update()

    def _on_picture(self, picture: Picture) -> None:
        if picture.request.view != "scene":
            return
        size = picture.request.camera.intrinsics
        if picture.request.moving:
            self.pacing.learn(size.width, size.height, *self._device_size(), picture.milliseconds)
        self._picture = picture
        # The image shares the array's memory; both are kept together.
        self._image = QImage(picture.pixels.data, size.width, size.height, 4 * size.width, QImage.Format.Format_RGB32)
        self._unseen = True
        self.update()

    def _on_trouble(self, trouble: Trouble) -> None:
        self.note = trouble.message if trouble.fatal else self.note
        self.troubled.emit(trouble)
        self.update()

    def _on_project(self) -> None:
        self._placed = self.pose

    def _on_contents(self, parts: frozenset[str]) -> None:
        if len(self._document.extent) and self.pose == self._placed:
            self._place()
        self.update()

    # Painting --------------------------------------------------------------------------------------------------

    @property
    def overlay_camera(self) -> Camera:
        """The camera of what is on the screen, in logical pixels."""
        width, height = max(1, self.width()), max(1, self.height())
        key = (self.pose if self._picture is None else self._picture.request.number, width, height)
        if self._camera_of != key:
            # The same camera for the same picture: layers keep what they worked out for it.
            self._camera_of = key
            if self._picture is None:
                self._overlay_camera = self.pose.camera(width, height)
            else:
                self._overlay_camera = self._picture.request.camera.scaled(width, height)
        return self._overlay_camera

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        if self._image is not None:
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            painter.drawImage(QRectF(self.rect()), self._image)
        else:
            paint_ground(painter, self.size(), self.palette())
        self.overlays.grid.bare = self._image is None
        self.overlays.paint(painter, self.overlay_camera)
        paint_status(painter, self.size(), self.pose, self._picture, self.note or self.hint)
        painter.end()
        if self._unseen:
            self._unseen = False
            self.pictureShown.emit(self._picture)

    # Events ----------------------------------------------------------------------------------------------------

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._rest.start()
        super().resizeEvent(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self.navigation.press(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if event.buttons():
            self.navigation.drag(event)
            return
        hovered = self.pick_viewpoint(event.position())
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
        viewpoint = self.pick_viewpoint(event.position())
        if viewpoint is not None:
            arrays = self._document.graph_arrays
            self.go_to_position(arrays.positions[arrays.index[viewpoint]])
            return
        frame = self.pick_frame(event.position())
        if frame is not None:
            self._document.select(frame=frame)
            self.snap_to_frame(frame)

    def _click(self, position: QPointF) -> None:
        viewpoint = self.pick_viewpoint(position)
        if viewpoint is not None:
            self._document.select(viewpoint=viewpoint)
            return
        frame = self.pick_frame(position)
        self._document.select(frame=frame)

    def pick_viewpoint(self, point: QPointF) -> str | None:
        """The id under a pixel, of what is drawn."""
        return self.surface.pick_viewpoint(point) if self.overlays["graph"].shown else None

    def pick_frame(self, point: QPointF) -> int | None:
        """The index of the frame under a pixel, of what is drawn."""
        return self.surface.pick_frame(point) if self.overlays["trajectory"].shown else None

    def wheelEvent(self, event: QWheelEvent) -> None:
        self.navigation.wheel(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if not self.navigation.key(event, down=True):
            super().keyPressEvent(event)

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        if not self.navigation.key(event, down=False):
            super().keyReleaseEvent(event)

    def focusOutEvent(self, event: QFocusEvent) -> None:
        self.navigation.let_go()
        super().focusOutEvent(event)
