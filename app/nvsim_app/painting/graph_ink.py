"""Paints edges and viewpoints at given pixels, in the same style on the map and in the 3D view, and caches drawings.

Painting ten thousand viewpoints must be fast. If many are visible, they are small. Discs are then copied to whole
pixels without scaling, lines are one pixel wide without antialiasing, and lines shorter than a disc are skipped. With
the cache, moving the cursor does not repaint them, and an edit of one viewpoint repaints only its surroundings.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QRect, QRectF, QSize, Qt, QTimer
from PySide6.QtGui import QColor, QImage, QPainter, QPen, QPixmap

from nvsim_app.look import colors
from nvsim_app.painting.primitives import Primitives, disc

REST = 150  # milliseconds after which a view counts as resting
LARGEST_PATCH = 0.3  # maximum share of the image that is repainted partially; beyond it, everything is repainted
Draw = Callable[[QPainter, QRectF | None], None]


class DrawingCache:
    """Caches a drawing as an image.

    The first time, a drawing is painted directly, because a moving view does not need it again. The second time, it is
    painted into an image, which is used for later paintings.

    again   requests another painting; called when the view rests, so that the image exists before it is needed
    """

    def __init__(self, parent: QObject | None = None, again: Callable[[], object] | None = None) -> None:
        self._view: Hashable = None
        self._content: object = None
        self._image: QImage | None = None
        self._rest = QTimer(parent, singleShot=True, interval=REST) if again is not None else None
        if self._rest is not None and again is not None:
            self._rest.timeout.connect(again)

    def paint(
        self,
        painter: QPainter,
        width: int,
        height: int,
        view: Hashable,
        draw: Draw,
        content: object = None,
        touched: Callable[[object], QRectF | None] | None = None,
    ) -> None:
        """Paints a drawing of `width` x `height` logical pixels, from the cache if possible.

        draw      paints the drawing; if it gets a rectangle, it may skip everything outside
        view      differs if the position or the style of the drawing changed
        content   another object if the content of the drawing changed; it is referenced, so that its id() stays unique
        touched   maps the previous content to the changed rectangle in logical pixels; None means everywhere
        """
        ratio = painter.device().devicePixelRatioF()
        view = (view, width, height, ratio)
        if view != self._view:
            self._view, self._content, self._image = view, content, None
            draw(painter, None)
            if self._rest is not None:
                self._rest.start()
            return
        if self._image is not None and content is not self._content:
            where = None if touched is None else touched(self._content)
            if where is None or not self._patch(self._image, where, ratio, draw):
                self._image = None
        if self._image is None:
            self._image = QImage(round(width * ratio), round(height * ratio), QImage.Format.Format_ARGB32_Premultiplied)
            self._image.setDevicePixelRatio(ratio)
            self._image.fill(0)
            own = QPainter(self._image)
            own.setRenderHint(QPainter.RenderHint.Antialiasing)
            draw(own, None)
            own.end()
        self._content = content
        painter.drawImage(0, 0, self._image)

    def _patch(self, image: QImage, where: QRectF, ratio: float, draw: Draw) -> bool:
        """Repaints a part of the image. Returns False if the part is too large."""
        # Whole device pixels, because antialiasing would affect the border otherwise.
        pixels = QRectF(ratio * where.x(), ratio * where.y(), ratio * where.width(), ratio * where.height())
        box: QRect = pixels.toAlignedRect() & image.rect()
        if box.width() * box.height() > LARGEST_PATCH * image.width() * image.height():
            return False
        if box.isEmpty():
            return True
        part = QRectF(box.x() / ratio, box.y() / ratio, box.width() / ratio, box.height() / ratio)
        own = QPainter(image)
        own.setClipRect(part)
        own.setCompositionMode(QPainter.CompositionMode.CompositionMode_Clear)
        own.fillRect(part, 0)
        own.setCompositionMode(QPainter.CompositionMode.CompositionMode_SourceOver)
        own.setRenderHint(QPainter.RenderHint.Antialiasing)
        draw(own, part)
        own.end()
        return True


SMOOTH_LINES = 4000  # maximum number of antialiased lines
SMOOTH_DISCS = 1500  # maximum number of antialiased discs
LARGE = 2000  # number of edges above which drawings are cached
_SHORT = 3.0  # pixels; if there are many lines, shorter ones are covered by the discs at their ends
_BANDS = ((12.0, np.inf, 1.2, 170), (5.0, 12.0, 1.8, 190), (0.0, 5.0, 2.6, 225))
"""Styles of lines by depth: minimum and maximum depth in meters, width in pixels, opacity up to 255."""


class GraphInk:
    """Paints graphs. Sprites and buffers are reused between paintings."""

    def __init__(self) -> None:
        self._primitives = Primitives()
        self._node = disc(colors.NODE, colors.NODE_OUTLINE)
        self._left_out = disc(colors.TRAJECTORY, "#20252b", shape="ring")
        self._selected = disc(colors.SELECTED, "#3a2c05", 36)
        self._stamps: dict[tuple[bool, int, float], QPixmap] = {}

    def draw_edges(
        self,
        painter: QPainter,
        lines: NDArray[np.floating],
        depth: NDArray[np.floating] | None = None,
        within: QRectF | None = None,
    ) -> None:
        """Paints lines (N, 4) as x1 y1 x2 y2 in pixels. With `depth` (N,) in meters, near lines are thicker. The style
        depends on the number of lines. If `within` is given, lines outside it are skipped."""
        many = len(lines) > SMOOTH_LINES
        if within is not None:
            rows = _lines_in_box(lines, within)
            lines, depth = lines[rows], None if depth is None else depth[rows]
        color = QColor(colors.EDGE)
        if many:
            way = np.abs(lines[:, 2:] - lines[:, :2])
            painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
            painter.setPen(QPen(color.darker(115), 1))  # opaque: blending would take twice as long
            self._primitives.draw_lines(painter, lines[np.maximum(way[:, 0], way[:, 1]) > _SHORT])
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            return
        if depth is None:
            painter.setPen(QPen(color, 1.4))
            self._primitives.draw_lines(painter, lines)
            return
        for near, far, width, opacity in _BANDS:
            color.setAlpha(opacity)
            painter.setPen(QPen(color, width))
            self._primitives.draw_lines(painter, lines[(depth >= near) & (depth < far)])

    def draw_viewpoints(
        self,
        painter: QPainter,
        pixels: NDArray[np.floating],
        radii: NDArray[np.floating],
        included: NDArray[np.bool_],
        within: QRectF | None = None,
    ) -> None:
        """Paints discs at `pixels` (N, 2) with horizontal and vertical `radii` (N, 2) in pixels, in the given order.
        Viewpoints that are not `included` (N,) are gray rings. If `within` is given, discs outside it are skipped."""
        reach = None if within is None else _discs_in_box(pixels, radii + 2.0, within)
        for wanted in (False, True):
            chosen = included == wanted
            many = np.count_nonzero(chosen) > SMOOTH_DISCS
            rows = np.flatnonzero(chosen if reach is None else chosen & reach)
            if not many:
                sprite = self._node if wanted else self._left_out
                self._primitives.draw_sprites(painter, pixels[rows], radii[rows] / 12, sprite)
                continue
            small = radii[rows, 0] < 6
            ratio = painter.device().devicePixelRatioF()
            sizes = np.maximum(3, np.round(2 * radii[rows, 0] * ratio)).astype(int)
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, False)
            for size in np.unique(sizes[small]):
                among = rows[small & (sizes == size)]
                stamp = self._stamp(wanted, int(size), ratio)
                # At whole device pixels and without scaling, Qt copies the sprite instead of resampling it.
                half = size / ratio / 2
                places = np.round((pixels[among] - half) * ratio) / ratio + half
                self._primitives.draw_sprites(painter, places, np.full((len(among), 2), 1.0), stamp)
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            sprite = self._node if wanted else self._left_out
            self._primitives.draw_sprites(painter, pixels[rows[~small]], radii[rows[~small]] / 12, sprite)

    @staticmethod
    def paint_styles(lines: int, included: NDArray[np.bool_]) -> tuple[bool, bool, bool]:
        """Whether the fast style is used for this number of lines, of included viewpoints, and of other viewpoints.
        `included` is (N,) bool."""
        used = int(np.count_nonzero(included))
        return lines > SMOOTH_LINES, used > SMOOTH_DISCS, len(included) - used > SMOOTH_DISCS

    def draw_marked(
        self, painter: QPainter, pixel: NDArray[np.floating], radii: NDArray[np.floating], selected: bool
    ) -> None:
        """Paints an enlarged viewpoint, which is selected or under the cursor, at `pixel` (2,) with `radii` (2,)."""
        sprite = self._selected if selected else self._node
        size = np.maximum(radii, 4.0)[None] * (1.35 if selected else 1.7) / (sprite.width() / 4)
        self._primitives.draw_sprites(painter, pixel[None], size, sprite)

    def draw_lines(self, painter: QPainter, lines: NDArray[np.floating], pen: QPen) -> None:
        """Paints lines (N, 4) as x1 y1 x2 y2 in pixels with a given pen."""
        painter.setPen(pen)
        self._primitives.draw_lines(painter, lines)

    def _stamp(self, included: bool, size: int, ratio: float) -> QPixmap:
        """The disc with a diameter of `size` device pixels."""
        key = included, size, ratio
        if key not in self._stamps:
            source = self._node if included else self._left_out
            stamp = source.scaled(
                QSize(size, size), Qt.AspectRatioMode.IgnoreAspectRatio, Qt.TransformationMode.SmoothTransformation
            )
            stamp.setDevicePixelRatio(ratio)
            self._stamps[key] = stamp
        return self._stamps[key]


def _lines_in_box(lines: NDArray[np.floating], box: QRectF) -> NDArray[np.int64]:
    """(K,) rows of `lines` (N, 4) whose bounding boxes, including the pen width, intersect the box."""
    x1, y1, x2, y2 = lines.T
    wide = 4.0  # pixels, the widest pen with antialiasing
    meets = (np.minimum(x1, x2) <= box.right() + wide) & (np.maximum(x1, x2) >= box.left() - wide)
    meets &= (np.minimum(y1, y2) <= box.bottom() + wide) & (np.maximum(y1, y2) >= box.top() - wide)
    return np.flatnonzero(meets)


def _discs_in_box(points: NDArray[np.floating], radii: NDArray[np.floating], box: QRectF) -> NDArray[np.bool_]:
    """(N,) bool, which of the discs at `points` (N, 2) intersect the box."""
    x, y = points.T
    across, down = radii.T
    meets = (x >= box.left() - across) & (x <= box.right() + across)
    return meets & (y >= box.top() - down) & (y <= box.bottom() + down)
