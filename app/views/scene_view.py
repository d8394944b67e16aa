"""The centre of the window: the reconstruction as the drawing process sends it, and the overlays over it.

While the camera moves, images come at a size that holds the pace; when it rests, one at full size follows. The
overlays are drawn with the camera of the image beneath them, so that the two never swim apart.
"""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.drawing.picture_feed import PictureFeed
from app.drawing.render_child import Picture, RenderSource
from app.painting.cameras import ViewPose
from app.state.document import Document
from app.state.loading import CONTENT_PARTS
from app.views.graph_surface import SceneSurface
from app.views.navigation import Navigation
from app.views.overlays import Overlays
from app.views.places import Places
from app.views.status import paint_ground, paint_status
from nvsim.geometry.camera import Camera


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
        self.setAccessibleName("3D view")
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
        self.places = Places(document, self.navigation, lambda: self.width() / max(1, self.height()))
        self.feed = PictureFeed(self._device_size, lambda: self.pose, self)
        self.link = self.feed.link
        self.hint = ""  # what the project lacks
        self._painted: Picture | None = None  # the image that was last painted
        self._camera_of: object = None
        self._overlay_camera = self.navigation.pose.camera(1, 1)
        self._placed: ViewPose | None = self.pose  # where the program, not the user, put the camera
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

    # What others ask of it -------------------------------------------------------------------------------------

    @property
    def pose(self) -> ViewPose:
        return self.navigation.pose

    @property
    def picture(self) -> Picture | None:
        """The image on the screen."""
        return self.feed.picture

    @property
    def drawing(self) -> bool:
        """Whether an image is under way or about to be asked for."""
        return self.feed.drawing

    @property
    def channel(self) -> str:
        """One of tones.CHANNELS."""
        return self.feed.channel

    @property
    def renderer(self) -> str:
        """One of renderer_choice.PREFERENCES."""
        return self.feed.renderer

    @property
    def budget(self) -> int:
        """Gaussians drawn at most, 0 for all."""
        return self.feed.budget

    @property
    def note(self) -> str:
        """What the view waits for."""
        return self.feed.note

    def show_source(self, source: RenderSource | None) -> None:
        """Draws this reconstruction from now on; None shows the overlays alone."""
        self.feed.show(source)

    def set_channel(self, channel: str) -> None:
        self.feed.channel = channel
        self.feed.ask_sharp()

    def set_renderer(self, renderer: str) -> None:
        self.feed.renderer = renderer
        self.feed.ask_sharp()

    def set_budget(self, budget: int) -> None:
        """Draws so many Gaussians at most, those that cover most; 0 draws all."""
        self.feed.budget = budget
        self.feed.ask_sharp()

    # These are methods of the widget, since Qt forgets a connection to one when the widget goes.

    def home(self) -> None:
        self.places.home()

    def look_over(self) -> None:
        self.places.look_over()

    def look_from_above(self) -> None:
        self.places.look_from_above()

    def focus_on_selection(self) -> None:
        self.places.focus_on_selection()

    def snap_to_frame(self, index: int) -> None:
        self.places.snap_to_frame(index)

    def go_to_position(self, position: np.ndarray, heading: float | None = None) -> None:
        """Stands at `position` (3,) looking level; the heading stays unless one is given."""
        self.places.go_to_position(position, heading)

    def stay_at(self, pose: ViewPose) -> None:
        """Stands there, whatever is read of the project afterwards."""
        self._placed = None
        self.navigation.set_pose(pose)

    def show_hovered(self, viewpoint: str | None) -> None:
        """Marks the viewpoint under the cursor, be it of this view or of the map."""
        if viewpoint != self.overlays.graph.hovered:
            self.overlays.graph.hovered = viewpoint
            self.update()

    def release(self) -> None:
        """Ends the drawing process; the view is not used afterwards."""
        self.navigation.stop()
        self.feed.release()

    def _device_size(self) -> tuple[int, int]:
        ratio = self.devicePixelRatioF()
        return max(1, round(self.width() * ratio)), max(1, round(self.height() * ratio))

    def _on_moved(self) -> None:
        self.poseChanged.emit(self.pose)
        if not self.feed.follow():
            self.update()

    def _on_project(self) -> None:
        self._placed = self.pose

    def _on_contents(self, parts: frozenset[str]) -> None:
        if len(self._document.extent) and self.pose == self._placed:
            self._placed = self.places.first
            self.navigation.set_pose(self._placed)
        self.update()

    # Painting --------------------------------------------------------------------------------------------------

    @property
    def overlay_camera(self) -> Camera:
        """The camera of what is on the screen, in logical pixels."""
        width, height = max(1, self.width()), max(1, self.height())
        picture = self.feed.picture
        key = (self.pose if picture is None else picture.request, width, height)
        if self._camera_of != key:
            # The same camera for the same image: layers keep what they worked out for it.
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
        paint_status(painter, self.size(), self.pose, picture, self.note or self.hint)
        painter.end()
        if picture is not self._painted:
            self._painted = picture
            if picture is not None:
                self.pictureShown.emit(picture)

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
            self.places.go_to_position(arrays.positions[arrays.index[viewpoint]])
            return
        frame = self.pick_frame(event.position())
        if frame is not None:
            self._document.select(frame=frame)
            self.places.snap_to_frame(frame)

    def _click(self, position: QPointF) -> None:
        viewpoint = self.pick_viewpoint(position)
        if viewpoint is not None:
            self._document.select(viewpoint=viewpoint)
            return
        frame = self.pick_frame(position)
        self._document.select(frame=frame)

    def pick_viewpoint(self, point: QPointF) -> str | None:
        """The id under a pixel, of what is drawn."""
        return self.surface.pick_viewpoint(point)

    def pick_frame(self, point: QPointF) -> int | None:
        """The index of the frame under a pixel, of what is drawn."""
        return self.surface.pick_frame(point)

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
