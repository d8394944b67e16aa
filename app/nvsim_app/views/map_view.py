"""The map: occupancy, submaps, trajectory, and graph from above. Selection and camera are linked with the 3D view."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from pyqtgraph.GraphicsScene.mouseEvents import MouseClickEvent
from PySide6.QtCore import QEvent, QObject, QPointF, QRectF, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QResizeEvent
from PySide6.QtWidgets import QStyleOptionGraphicsItem, QWidget

from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN
from nvsim_app.look import colors, lengths
from nvsim_app.look.boxes import vbox
from nvsim_app.look.labels import Hint
from nvsim_app.look.plain_text import plain
from nvsim_app.look.theme import is_dark
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.state.document import Document
from nvsim_app.state.free_floor import weak_places
from nvsim_app.state.loading import CONTENT_PARTS
from nvsim_app.views.map_legend import MapLegend
from nvsim_app.views.map_marks import CameraMarker, GraphItem, MapFrame

PICK_PIXELS = 10
_ABOVE, _BELOW, _BESIDE = 40, 32, 100  # pixels for the north arrow and the scale: above and below, or at the right
_BORDER = (1.5, 4.0)  # meters that are shown around the trajectory and the graph: at least, and at most for walls
PACE = 50  # milliseconds between two updates of the camera marker, about the image rate of the 3D view


class MapView(QWidget):
    """The map widget. Positions are in meters, world.

    cameraDragged(x, y)   the user drags the camera marker
    cameraPlaced(x, y)    the user double-clicked; the camera flies there
    hovered(str or None)  the cursor is over another viewpoint
    """

    cameraDragged = Signal(float, float)
    cameraPlaced = Signal(float, float)
    hovered = Signal(object)

    def __init__(self, document: Document) -> None:
        super().__init__()
        self.setObjectName("mapView")
        self._document = document
        self._framed = False
        self._fitted: tuple[np.ndarray, np.ndarray] | None = None  # corners of the area that stays visible
        self._pose: ViewPose | None = None  # camera pose that is not shown yet
        self._pose_soon = QTimer(self, singleShot=True, interval=PACE)
        self._pose_soon.timeout.connect(self._place_camera)
        self.plot = pg.PlotWidget(self, enableMenu=False)
        self.setFocusProxy(self.plot)
        self.plot.setAccessibleName("Map")
        self.plot.setAspectLocked(True)
        self.plot.hideAxis("left")
        self.plot.hideAxis("bottom")
        self.plot.hideButtons()
        self.legend = MapLegend(self)
        vbox((self.plot, 1), self.legend, on=self, margins=0, spacing=0)

        self._occupancy = pg.ImageItem(axisOrder="row-major")
        self._occupancy.setZValue(0)
        self.graph = GraphItem(document)
        self._picked = pg.ScatterPlotItem(size=15, pen=pg.mkPen("#3a2c05", width=2), brush=pg.mkBrush(colors.SELECTED))
        self._picked.setZValue(40)
        self.camera = CameraMarker()
        self._walks: dict[int, pg.PlotCurveItem] = {}  # submap -> its part of the trajectory
        self.weak = pg.ScatterPlotItem(
            size=13,
            symbol="t1",
            pen=pg.mkPen("#3a2c05", width=1),
            brush=pg.mkBrush(colors.WARNING),
            hoverable=True,
            tip=lambda x, y, data: plain(data),
        )
        self.weak.setZValue(30)
        for item in (self._occupancy, self.graph, self.weak, self._picked, self.camera):
            self.plot.addItem(item)
        self._scale = _Scale(size=5, width=4, suffix="m")
        self._scale.setParentItem(self.plot.getViewBox())
        self._scale.anchor((1, 1), (1, 1), offset=(-10, -8))
        self.hint = Hint(self.plot, self._missing)
        self.frame = MapFrame(self.plot)
        self.camera.hide()
        self._scale.hide()
        self.camera.dragged.connect(self.cameraDragged)
        self.plot.viewport().setMouseTracking(True)
        self.plot.viewport().installEventFilter(self)
        self.plot.scene().sigMouseClicked.connect(self._on_click)
        self.plot.getViewBox().sigRangeChangedManually.connect(self._on_moved)
        self.plot.getViewBox().sigResized.connect(self._on_resized)
        document.projectChanged.connect(self._on_project)
        document.contentsChanged.connect(self._on_contents)
        document.graphChanged.connect(self._draw_graph)
        document.selectionChanged.connect(self._draw_selection)
        document.unitsChanged.connect(self._scale.updateBar)
        self._apply_palette()
        self._on_contents(frozenset(CONTENT_PARTS))

    def show_hovered(self, viewpoint: str | None) -> None:
        """Highlights the viewpoint under the cursor of this view or of the 3D view."""
        if viewpoint != self.graph.hovered:
            self.graph.hovered = viewpoint
            self.graph.update()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.MouseMove and isinstance(event, QMouseEvent) and not event.buttons():
            self.frame.show_position(self.to_world(event.position()) if self._framed else None)
            hovered = self._viewpoint_under(event.position())
            if hovered != self.graph.hovered:
                self.show_hovered(hovered)
                self.hovered.emit(hovered)
        elif event.type() == QEvent.Type.Leave:
            self.frame.show_position(None)
            if self.graph.hovered is not None:
                self.show_hovered(None)
                self.hovered.emit(None)
        return super().eventFilter(watched, event)

    def _viewpoint_under(self, point: QPointF) -> str | None:
        x, y = self.to_world(point)
        reach = PICK_PIXELS * self.plot.getViewBox().viewPixelSize()[0]
        row = _nearest(self._document.shown_arrays.positions, QPointF(x, y), reach)
        return None if row is None else self._document.shown_arrays.ids[row]

    def show_pose(self, pose: ViewPose) -> None:
        """Moves the camera marker, at most once per PACE."""
        self._pose = pose
        if not self._pose_soon.isActive():
            self._place_camera()

    def _place_camera(self) -> None:
        pose, self._pose = self._pose, None
        if pose is not None:
            self.camera.show()
            self.camera.show_pose(pose)
            self._pose_soon.start()

    @property
    def canvas(self) -> QWidget:
        """The widget that receives mouse events. `to_pixels` and `to_world` use its pixels."""
        return self.plot.viewport()

    def to_pixels(self, xy: np.ndarray) -> np.ndarray:
        """(N, 2) pixels of world x, y (N, 2) in meters."""
        zero = self._to_pixel(0.0, 0.0)
        return zero + xy[:, :1] * (self._to_pixel(1.0, 0.0) - zero) + xy[:, 1:2] * (self._to_pixel(0.0, 1.0) - zero)

    def to_world(self, point: QPointF) -> tuple[float, float]:
        """World x, y in meters at a pixel."""
        place = self.plot.getViewBox().mapSceneToView(self.plot.viewportTransform().inverted()[0].map(point))
        return place.x(), place.y()

    def _to_pixel(self, x: float, y: float) -> np.ndarray:
        pixel = self.plot.viewportTransform().map(self.plot.getViewBox().mapViewToScene(QPointF(x, y)))
        return np.array([pixel.x(), pixel.y()])

    def frame_everything(self) -> None:
        """Zooms to the trajectory and the graph, with the walls around them."""
        extent, known = self._document.extent[:, :2], self._known_area()
        if len(extent):
            low, high = extent.min(axis=0) - _BORDER[0], extent.max(axis=0) + _BORDER[0]
            if len(known):
                low = np.minimum(low, np.maximum(known[0] - 0.5, extent.min(axis=0) - _BORDER[1]))
                high = np.maximum(high, np.minimum(known[1] + 0.5, extent.max(axis=0) + _BORDER[1]))
            self._fit(low, high)

    def show_whole(self) -> None:
        """Zooms to the trajectory, the graph, and the known area of the occupancy map."""
        places = np.concatenate([self._document.extent[:, :2], self._known_area()])
        if len(places):
            self._fit(places.min(axis=0) - 0.5, places.max(axis=0) + 0.5)

    def _known_area(self) -> np.ndarray:
        """(2, 2) lowest and highest x, y of the known cells in meters; (0, 2) without any."""
        occupancy = self._document.contents.occupancy
        known = np.argwhere(occupancy.cells != UNKNOWN) if occupancy is not None else np.zeros((0, 2), int)
        if occupancy is None or not len(known):
            return np.zeros((0, 2))
        ends = np.array([known.min(axis=0), known.max(axis=0) + 1])[:, ::-1]
        return occupancy.origin + ends * occupancy.resolution

    def _on_moved(self, _: object) -> None:
        self._fitted = None

    def _fit(self, low: np.ndarray, high: np.ndarray) -> None:
        """Zooms to the area between two corners (2,) in meters, with space for the north arrow and the scale, so that
        they do not cover it. Another size of the map zooms anew, until the user moves or zooms it."""
        self._fitted = low, high
        width, height = max(self.plot.width(), 2 * _BESIDE), max(self.plot.height(), 2 * (_ABOVE + _BELOW))
        across, along = high - low
        above, below, right = _ABOVE, _BELOW, 0.0
        # Meters per pixel. The range has the aspect ratio of the map, because pyqtgraph changes one axis otherwise.
        meter = max(across / width, along / (height - above - below))
        beside = max(across / (width - _BESIDE), along / height)
        if beside < meter and not self.frame.titled:  # the area is larger with both at its right
            meter, above, below = beside, 0, 0
            right = max(0.0, 2 * _BESIDE - width + across / meter)  # a narrow area stays in the middle
        meter *= 1.02
        x = (low[0] + high[0] - (width - right) * meter) / 2
        y = (low[1] + high[1] - (height + below - above) * meter) / 2
        self.plot.setRange(QRectF(x, y, width * meter, height * meter), padding=0)

    @property
    def visible_range(self) -> tuple[float, float, float, float] | None:
        """x, y, width, height of the requested range in meters; None if the map is empty."""
        if not self._framed:
            return None
        (x, right), (y, top) = self.plot.getViewBox().targetRange()
        return float(x), float(y), float(right - x), float(top - y)

    def restore_range(self, x: float, y: float, width: float, height: float) -> None:
        """Restores the range of `visible_range`, and disables the initial zoom to everything."""
        if width > 0 and height > 0:
            self._framed, self._fitted = True, None
            self._scale.show()
            self.frame.show(True)
            self.plot.setRange(QRectF(x, y, width, height), padding=0)

    def center_on(self, x: float, y: float, size: float) -> None:
        """Centers the map at x, y and shows at least `size` meters. Zooms in only if the current range is more than
        eight times as large."""
        self._fitted = None
        shown = self.plot.getViewBox().viewRect()
        if min(shown.width(), shown.height()) > 8 * size:
            size *= 3
        width = height = size
        if size <= min(shown.width(), shown.height()) <= 8 * size:
            width, height = shown.width(), shown.height()
        self.plot.setRange(QRectF(x - width / 2, y - height / 2, width, height), padding=0)

    def _on_project(self) -> None:
        self._framed, self._pose = False, None
        self._scale.hide()
        self.frame.show(False)
        self.camera.hide()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "occupancy" in parts:
            self._draw_occupancy()
            if self._fitted is not None:
                self.frame_everything()
        if parts & {"capture", "submaps", "growing"}:
            self._draw_trajectory()
        if "graph" in parts:
            self._draw_graph()
        if "growing" in parts:
            self._framed = False  # the poses change, and the finished capture has another unit
        if not self._framed and len(self._document.extent):
            self._framed = True
            self._scale.show()
            self.frame.show(True)
            self.frame_everything()
        self.hint.refresh()

    def _missing(self) -> str:
        return "" if len(self._document.extent) else "The trajectory and the graph appear here from above."

    def _draw_occupancy(self) -> None:
        occupancy = self._document.contents.occupancy
        if occupancy is None:
            self._occupancy.clear()
            return
        tones = colors.OCCUPANCY_DARK if is_dark(self.palette()) else colors.OCCUPANCY_LIGHT
        picture = np.empty((*occupancy.cells.shape, 3), np.uint8)
        picture[:] = tones["unknown"]
        picture[occupancy.cells == FREE] = tones["free"]
        picture[occupancy.cells == OCCUPIED] = tones["occupied"]
        rows, columns = occupancy.cells.shape
        self._occupancy.setImage(picture, autoLevels=False)
        self._occupancy.setRect(QRectF(*occupancy.origin, columns * occupancy.resolution, rows * occupancy.resolution))

    def _draw_trajectory(self) -> None:
        for item in self._walks.values():
            self.plot.removeItem(item)
        self._walks = {}
        trajectory = self._document.drawn_trajectory
        pairs = trajectory.segments
        owners = trajectory.submaps[pairs[:, 1]] if len(pairs) else np.zeros(0, int)
        for owner in np.unique(owners):
            ends = trajectory.positions[pairs[owners == owner]].reshape(-1, 3)
            pen = pg.mkPen(colors.submap_color(int(owner)), width=2.2)
            item = pg.PlotCurveItem(ends[:, 0], ends[:, 1], connect="pairs", pen=pen)
            item.setZValue(10)
            self.plot.addItem(item)
            self._walks[int(owner)] = item
        spots, words = weak_places(self._document)
        self.weak.setData(*trajectory.positions[spots, :2].T, data=words)
        self._draw_selection()

    def _draw_graph(self, _: object = None) -> None:
        self.graph.refresh()
        self._draw_selection()

    def _draw_selection(self) -> None:
        point = self._document.selected_point if not self._document.selection.submap else None
        self.graph.update()
        if self._document.selection.viewpoint is not None:
            point = None  # the graph item marks it
        self._picked.setData([] if point is None else [point[0]], [] if point is None else [point[1]])
        chosen = self._document.selection.submap
        for owner, item in self._walks.items():
            color = QColor(colors.submap_color(owner))
            color.setAlpha(255 if chosen is None or chosen == owner else 60)
            item.setPen(pg.mkPen(color, width=4 if chosen == owner else 2.2))

    def _on_click(self, event: MouseClickEvent) -> None:
        if event.button() != Qt.MouseButton.LeftButton:
            return
        place = self.plot.getViewBox().mapSceneToView(event.scenePos())
        if event.double():
            self.cameraPlaced.emit(place.x(), place.y())
            return
        reach = PICK_PIXELS * self.plot.getViewBox().viewPixelSize()[0]
        row = _nearest(self._document.shown_arrays.positions, place, reach)
        if row is not None:
            self._document.select(viewpoint=self._document.shown_arrays.ids[row])
            return
        self._document.select(frame=_nearest(self._document.trajectory.positions, place, reach))

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.legend.fit()

    def _on_resized(self, _: object) -> None:
        self.frame.place()
        if self._fitted is not None:
            self._fit(*self._fitted)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._apply_palette()
        super().changeEvent(event)

    def _apply_palette(self) -> None:
        tones = colors.OCCUPANCY_DARK if is_dark(self.palette()) else colors.OCCUPANCY_LIGHT
        self.plot.setBackground(QColor(*tones["unknown"]))
        ink = self.palette().text().color()
        self._scale.text.setColor(ink)
        self._scale.bar.setBrush(pg.mkBrush(ink))
        self._scale.bar.setPen(pg.mkPen(None))
        self._scale.ground = QColor(*tones["unknown"], 215)
        if self._document.contents.occupancy is not None:
            self._draw_occupancy()


_SIZES = tuple(float(f"{digit}e{power}") for power in range(-2, 4) for digit in (1, 2, 5))
_LONGEST = 80  # maximum length of the scale bar, pixels


class _Scale(pg.ScaleBar):
    """A scale bar in meters or feet that adapts its length. It has a background, so that it is readable over walls and
    lines."""

    def __init__(self, size: float, width: float, suffix: str) -> None:
        super().__init__(size=size, width=width, suffix=suffix)
        self.ground = QColor()
        self.setFlag(self.GraphicsItemFlag.ItemHasNoContents, False)

    def updateBar(self) -> None:
        self.prepareGeometryChange()
        self.update()  # the background moves with the bar
        view = self.parentItem()
        if view is not None:
            unit = lengths.unit()
            # Use the mapping of the bar, because viewPixelSize may refer to the previous size.
            begin, end = (view.mapFromViewToItem(self, QPointF(x, 0.0)).x() for x in (0.0, unit.meters))
            pixels = max(end - begin, 1e-9)  # pixels per meter or foot
            fitting = max((size for size in _SIZES if size * pixels <= _LONGEST), default=_SIZES[0])
            self.size = fitting * unit.meters
            self.text.setText(f"{fitting:g} {unit.symbol}")
        super().updateBar()

    def paint(self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None) -> None:
        around = self.bar.mapRectToParent(self.bar.rect()) | self.text.mapRectToParent(self.text.boundingRect())
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(self.ground)
        painter.drawRoundedRect(around.adjusted(-7, -1, 7, 6), 4, 4)

    def boundingRect(self) -> QRectF:
        return self.childrenBoundingRect().adjusted(-8, -2, 8, 7)


def _nearest(positions: np.ndarray, place: QPointF, reach: float) -> int | None:
    if len(positions) == 0:
        return None
    distance = np.hypot(positions[:, 0] - place.x(), positions[:, 1] - place.y())
    row = int(np.argmin(distance))
    return row if distance[row] <= reach else None
