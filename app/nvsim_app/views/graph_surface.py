"""The interface that graph editing uses for both the map and the 3D view.

Points are in logical pixels of the view. A view implements the projection of positions to pixels and of pixels to the
floor. Picking is derived from these in the same way for both views.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF
from PySide6.QtWidgets import QWidget

from nvsim.geometry.camera import Camera
from nvsim_app.painting.picking import NEAR, nearest_point, nearest_segment, projected_segments, within_polygon
from nvsim_app.state.document import Document
from nvsim_app.state.free_floor import floor_height, trajectory_on_floor

if TYPE_CHECKING:
    from nvsim_app.views.map_view import MapView
    from nvsim_app.views.scene_view import SceneView

VIEWPOINT_REACH = 11.0  # maximum picking distance, pixels
EDGE_REACH = 7.0
FRAME_REACH = 11.0
POINT_REACH = 6.0
Place = tuple[float, float, float]


class GraphSurface:
    """The part of a view that editing modes use. Picking and selection are derived from `project` and `segments`."""

    def __init__(self, document: Document) -> None:
        self._document = document

    @property
    def widget(self) -> QWidget:
        """The widget that receives mouse events and shows hints."""
        raise NotImplementedError

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels (N, 2) and depths (N,) of world points (N, 3) in meters. A positive depth is in front of the
        camera."""
        raise NotImplementedError

    def segments(
        self, a: NDArray[np.float64], b: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """The visible parts of world segments from `a` to `b`, both (N, 3): ends in pixels (M, 4), index in the input
        (M,), depth (M,)."""
        raise NotImplementedError

    def floor_point(self, point: QPointF) -> Place | None:
        """The floor point (x, y, z) under a pixel in meters, world; None if there is none."""
        raise NotImplementedError

    @property
    def shows_graph(self) -> bool:
        """Whether the view shows the graph."""
        return True

    def disc_radii(self) -> NDArray[np.float64]:
        """(N, 2) horizontal and vertical radii in pixels of the discs of the displayed viewpoints."""
        raise NotImplementedError

    def pick_point(self, point: QPointF) -> Place | None:
        """The point of the point cloud under a pixel; None if there is none or the cloud is not shown."""
        return None

    def pick_viewpoint(self, point: QPointF) -> str | None:
        arrays = self._document.shown_arrays
        if not arrays.ids:
            return None
        row = nearest_point(*self.project(arrays.feet), (point.x(), point.y()), VIEWPOINT_REACH)
        return None if row is None else arrays.ids[row]

    def pick_edge(self, point: QPointF) -> tuple[str, str] | None:
        arrays = self._document.shown_arrays
        ends = arrays.feet[arrays.edges]
        lines, index, depth = self.segments(ends[:, 0], ends[:, 1])
        row = nearest_segment(lines, depth, (point.x(), point.y()), EDGE_REACH)
        return None if row is None else arrays.edge_key(int(index[row]))

    def pick_frame(self, point: QPointF) -> int | None:
        walk, storey = trajectory_on_floor(self._document), self._document.storeys.storey
        if not len(walk):
            return None
        pixels, depths = self.project(walk)
        if storey is not None:
            depths = np.where(storey.contains_floors(walk[:, 2]), depths, 0.0)
        return nearest_point(pixels, depths, (point.x(), point.y()), FRAME_REACH)

    def polygon_selection(self, polygon: Sequence[QPointF]) -> frozenset[str]:
        """The ids of the viewpoints inside a polygon of pixels."""
        arrays = self._document.shown_arrays
        if not arrays.ids or len(polygon) < 3:
            return frozenset()
        pixels, depths = self.project(arrays.feet)
        inside = within_polygon(pixels, np.array([(p.x(), p.y()) for p in polygon])) & (depths > NEAR)
        return frozenset(arrays.ids[row] for row in np.flatnonzero(inside))


class MapSurface(GraphSurface):
    """The map as a surface for editing. Higher viewpoints cover lower ones."""

    def __init__(self, view: MapView, document: Document) -> None:
        super().__init__(document)
        self._view = view

    @property
    def widget(self) -> QWidget:
        return self._view.canvas

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Map pixels (N, 2) of world points (N, 3) in meters, and depths (N,) that decrease with the height."""
        return self._view.to_pixels(points[:, :2]), 1e4 - points[:, 2]

    def segments(
        self, a: NDArray[np.float64], b: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """The visible segments, as in GraphSurface: (M, 4), (M,), (M,)."""
        lines = np.concatenate([self._view.to_pixels(a[:, :2]), self._view.to_pixels(b[:, :2])], axis=1)
        width, height = self.widget.width(), self.widget.height()
        seen = (np.maximum(lines[:, 0], lines[:, 2]) >= 0) & (np.minimum(lines[:, 0], lines[:, 2]) <= width)
        seen &= (np.maximum(lines[:, 1], lines[:, 3]) >= 0) & (np.minimum(lines[:, 1], lines[:, 3]) <= height)
        index = np.flatnonzero(seen)
        return lines[index], index, 1e4 - np.maximum(a[index, 2], b[index, 2])

    def disc_radii(self) -> NDArray[np.float64]:
        """(N, 2) radii of the discs in pixels, all equal."""
        return np.full((len(self._document.shown_arrays.ids), 2), self._view.graph.radius)

    def floor_point(self, point: QPointF) -> Place | None:
        x, y = self._view.to_world(point)
        return x, y, floor_height(self._document, x, y)


class SceneSurface(GraphSurface):
    """The 3D view as a surface for editing."""

    def __init__(self, view: SceneView, document: Document) -> None:
        super().__init__(document)
        self._view = view

    @property
    def widget(self) -> QWidget:
        return self._view

    @property
    def camera(self) -> Camera:
        """The camera of the displayed image, in pixels of the view."""
        return self._view.overlay_camera

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels (N, 2) and depths (N,) in meters of world points (N, 3) in meters."""
        return self._view.overlay_camera.project(points)

    def segments(
        self, a: NDArray[np.float64], b: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """The visible parts of the segments, as in GraphSurface: (M, 4), (M,), (M,)."""
        return projected_segments(self._view.overlay_camera, a, b)

    @property
    def shows_graph(self) -> bool:
        return bool(self._view.overlays["graph"].shown)

    def disc_radii(self) -> NDArray[np.float64]:
        """(N, 2) horizontal and vertical radii of the discs in pixels."""
        return self._view.overlays.graph.projected_viewpoints(self._view.overlay_camera).radii

    def pick_viewpoint(self, point: QPointF) -> str | None:
        return super().pick_viewpoint(point) if self._view.overlays["graph"].shown else None

    def pick_edge(self, point: QPointF) -> tuple[str, str] | None:
        return super().pick_edge(point) if self._view.overlays["graph"].shown else None

    def pick_frame(self, point: QPointF) -> int | None:
        return super().pick_frame(point) if self._view.overlays["trajectory"].shown else None

    def pick_point(self, point: QPointF) -> Place | None:
        dots = self._document.contents.dots
        if dots is None or not self._view.overlays["cloud"].shown:
            return None
        row = nearest_point(*self.project(dots.points.astype(np.float64)), (point.x(), point.y()), POINT_REACH)
        return None if row is None else tuple(float(v) for v in dots.points[row])  # type: ignore[return-value]

    def floor_point(self, point: QPointF) -> Place | None:
        """The intersection of the pixel's ray with the floor. The height of the floor is that of the nearest known
        position."""
        camera = self._view.overlay_camera
        k, eye = camera.intrinsics, camera.position
        ray = camera.rotation @ [(point.x() - k.cx) / k.fx, (point.y() - k.cy) / k.fy, 1.0]
        if ray[2] > -1e-3 * float(np.linalg.norm(ray)):
            return None  # at or above the horizon
        height = floor_height(self._document, float(eye[0]), float(eye[1]), below=float(eye[2]))
        place = eye
        for _ in range(4):
            place = eye + (height - eye[2]) / ray[2] * ray
            there = floor_height(self._document, float(place[0]), float(place[1]), near=height)
            if there >= eye[2] or abs(there - height) < 1e-3:
                break
            height = there
        if height >= eye[2] or float(np.linalg.norm(place - eye)) > 200.0:
            return None
        return float(place[0]), float(place[1]), float(height)
