"""The navigation graph on the floor: edges, discs for viewpoints, and a line to the camera of the selected one. Parts
of the graph behind walls of the occupancy map are fainter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QRectF
from PySide6.QtGui import QColor, QPainter, QPen

from nvsim.geometry.camera import Camera
from nvsim.occupancy.types import OCCUPIED, OccupancyMap
from nvsim.project.work import STAGE
from nvsim_app.layers.layer import Layer
from nvsim_app.look import colors
from nvsim_app.painting.graph_ink import LARGE, DrawingCache, GraphInk
from nvsim_app.painting.picking import NEAR, projected_segments
from nvsim_app.state.document import Document
from nvsim_app.state.graph_arrays import GraphArrays

_NODE_METERS = 0.16  # radius of a viewpoint's disc on the floor, meters
_NODE_PIXELS = (3.5, 42.0)  # minimum and maximum radius of a disc, pixels
_BEHIND = 0.28  # opacity of viewpoints and edges behind walls
_MARGIN = 20  # pixels outside the image within which a disc may reach into it


@dataclass(frozen=True, eq=False)
class ProjectedViewpoints:
    """The viewpoints of a graph projected to a camera. Arrays have a row for each viewpoint.

    pixels   (N, 2) floor points in pixels
    depths   (N,) meters
    seen     (N,) whether the viewpoint is in view
    radii    (N, 2) horizontal and vertical radius of the disc, pixels
    order    (K,) rows of the viewpoints in view, the farthest first
    """

    camera: Camera
    arrays: GraphArrays
    pixels: NDArray[np.float64]
    depths: NDArray[np.float64]
    seen: NDArray[np.bool_]
    radii: NDArray[np.float64]
    order: NDArray[np.int64]

    @staticmethod
    def of(camera: Camera, arrays: GraphArrays) -> ProjectedViewpoints:
        pixels, depths = camera.project(arrays.feet)
        k = camera.intrinsics
        x, y = pixels.T
        seen = (depths > NEAR) & (x > -_MARGIN) & (y > -_MARGIN) & (x < k.width + _MARGIN) & (y < k.height + _MARGIN)
        radius = _radius(camera, depths)
        # A disc on the floor looks flatter from a lower angle.
        dx, dy, dz = (arrays.feet - camera.position).T
        flat = np.abs(dz) / np.maximum(np.sqrt(dx * dx + dy * dy + dz * dz), 1e-9)
        radii = np.stack([radius, np.maximum(radius * np.maximum(flat, 0.3), 2.5)], axis=1)
        order = np.flatnonzero(seen)
        return ProjectedViewpoints(camera, arrays, pixels, depths, seen, radii, order[np.argsort(-depths[order])])

    def part(self, chosen: NDArray[np.bool_], touching: bool) -> ProjectedViewpoints:
        """The viewpoints of the mask `chosen` (N,) with their edges: edges with at least one chosen end if `touching`,
        else edges with two chosen ends."""
        ends = chosen[self.arrays.edges]
        arrays = replace(self.arrays, edges=self.arrays.edges[ends.any(axis=1) if touching else ends.all(axis=1)])
        order = self.order[chosen[self.order]]
        return ProjectedViewpoints(self.camera, arrays, self.pixels, self.depths, self.seen, self.radii, order)

    @cached_property
    def lines(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The visible parts of the edges, as in `projected_segments`: ends (M, 4) in pixels, depth (M,) in meters."""
        k, edges = self.camera.intrinsics, self.arrays.edges
        front, (x, y) = self.depths > NEAR, self.pixels.T
        # Bits for the sides of the image that an end is beyond. An edge with both ends beyond one side is out of view.
        beyond = (1 * (x < 0) + 2 * (x > k.width) + 4 * (y < 0) + 8 * (y > k.height)).astype(np.uint8)
        a, b = edges.T
        both = front[a] & front[b]
        rows = np.flatnonzero(both & ((beyond[a] & beyond[b]) == 0))
        if len(rows) < len(edges):
            a, b = a[rows], b[rows]
        whole = np.empty((len(rows), 4))
        for column, values in enumerate((x[a], y[a], x[b], y[b])):
            whole[:, column] = values
        depth = np.minimum(self.depths[a], self.depths[b])
        # Only the few edges that cross the near plane must be clipped.
        passing = np.flatnonzero(~both & (front[edges[:, 0]] | front[edges[:, 1]]))
        if not len(passing):
            return whole, depth
        feet = self.arrays.feet
        cut, _, cut_depth = projected_segments(self.camera, feet[edges[passing, 0]], feet[edges[passing, 1]])
        return np.concatenate([whole, cut]), np.concatenate([depth, cut_depth])


class GraphLayer(Layer):
    """Paints the graph in the 3D view.

    hovered        the viewpoint id under the cursor, set by the views
    fades_hidden   whether viewpoints and edges behind walls are drawn faintly
    """

    name = "graph"
    title = "Graph"

    def __init__(
        self, document: Document, parent: QObject | None = None, again: Callable[[], object] | None = None
    ) -> None:
        self._document = document
        self.hovered: str | None = None
        self._ink = GraphInk()
        self._latest: ProjectedViewpoints | None = None
        self._kept = DrawingCache(parent, again)
        self.fades_hidden = True
        self._hidden: tuple[object, ...] = ()

    @property
    def missing(self) -> str:
        return "" if self._document.graph_arrays.ids else STAGE["map"].missing

    def projected_viewpoints(self, camera: Camera) -> ProjectedViewpoints:
        """The viewpoints projected to `camera`. The result is cached for repeated calls."""
        arrays = self._document.shown_arrays
        if self._latest is None or self._latest.camera is not camera or self._latest.arrays is not arrays:
            self._latest = ProjectedViewpoints.of(camera, arrays)
        return self._latest

    def hidden(self, view: ProjectedViewpoints) -> NDArray[np.bool_]:
        """(N,) bool, which viewpoints are behind walls of the occupancy map.

        All are False if there is no map, if the building has several storeys, or if the graph is so large that its
        drawing is cached."""
        occupancy = self._document.contents.occupancy
        none = occupancy is None or len(self._document.storeys.found) > 1 or len(view.arrays.edges) > LARGE
        if none or not self.fades_hidden:
            return np.zeros(len(view.arrays.ids), np.bool_)
        if len(self._hidden) != 3 or self._hidden[0] is not view or self._hidden[1] is not occupancy:
            assert occupancy is not None  # checked above
            self._hidden = view, occupancy, are_behind_walls(occupancy, view.camera.position, view.arrays.feet)
        found: NDArray[np.bool_] = self._hidden[2]  # type: ignore[assignment]
        return found

    def paint(self, painter: QPainter, camera: Camera) -> None:
        arrays = self._document.shown_arrays
        if not arrays.ids:
            return
        view = self.projected_viewpoints(camera)
        if len(arrays.edges) > LARGE:
            k = camera.intrinsics
            manner = self._ink.paint_styles(len(view.lines[0]), arrays.included[view.order])

            def draw(target: QPainter, within: QRectF | None) -> None:
                self._paint_all(target, view, within)

            def changed_area(drawn: object) -> QRectF | None:
                return _outline(camera, self._document.graph_changes.changed_segments_since(drawn))

            whole, key = self._document.graph_arrays, (camera, manner, self._document.storeys.height_range)
            self._kept.paint(painter, k.width, k.height, key, draw, whole, changed_area)
        else:
            hidden = self.hidden(view)
            if hidden.any():
                opacity = painter.opacity()
                painter.setOpacity(_BEHIND * opacity)
                self._paint_all(painter, view.part(hidden, touching=True))
                painter.setOpacity(opacity)
                view = view.part(~hidden, touching=False)
            self._paint_all(painter, view)
        self._paint_marked(painter, self.projected_viewpoints(camera))

    def _paint_all(self, painter: QPainter, view: ProjectedViewpoints, within: QRectF | None = None) -> None:
        self._ink.draw_edges(painter, *view.lines, within)
        rows = view.order
        self._ink.draw_viewpoints(painter, view.pixels[rows], view.radii[rows], view.arrays.included[rows], within)

    def _paint_marked(self, painter: QPainter, view: ProjectedViewpoints) -> None:
        arrays = view.arrays
        selected = arrays.index.get(self._document.selection.viewpoint or "")
        hovered = arrays.index.get(self.hovered or "")
        for row in (hovered, selected):
            if row is not None and view.seen[row]:
                self._ink.draw_marked(painter, view.pixels[row], view.radii[row], row == selected)
        if selected is not None:
            foot, eye = arrays.feet[[selected]], arrays.positions[[selected]]
            lines, _, _ = projected_segments(view.camera, foot, eye)
            self._ink.draw_lines(painter, lines, QPen(QColor(colors.SELECTED), 1.6))
            pixel, depth = view.camera.project(eye)
            if depth[0] > NEAR:
                self._ink.draw_marked(painter, pixel[0], np.full(2, 4.0), selected=True)


def _radius(camera: Camera, depths: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) radius in pixels of discs at `depths` (N,)."""
    radius: NDArray[np.float64] = np.clip(_NODE_METERS * camera.intrinsics.fy / np.maximum(depths, NEAR), *_NODE_PIXELS)
    return radius


def _outline(camera: Camera, places: NDArray[np.float64] | None) -> QRectF | None:
    """The pixels that edges and viewpoints at `places` (K, 2, 3) may cover; None for the whole image."""
    if places is None:
        return None
    k = camera.intrinsics
    lines, _, _ = projected_segments(camera, places[:, 0], places[:, 1])
    points, depths = camera.project(places.reshape(-1, 3))
    front = depths > NEAR
    x, y = np.concatenate([lines.reshape(-1, 2), points[front]]).T
    if not len(x):
        return QRectF()
    reach = 3.0 + float(_radius(camera, depths[front]).max(initial=0.0))
    left, right = np.clip([x.min() - reach, x.max() + reach], -1, k.width + 1).tolist()
    top, bottom = np.clip([y.min() - reach, y.max() + reach], -1, k.height + 1).tolist()
    return QRectF(left, top, right - left, bottom - top)


WALL = 2.2  # assumed height of obstacles in meters, because the map has no heights
_ABOVE = 3.0  # meters above the floor; a higher camera is above the rooms
_STEP = 0.1  # meters between two samples along a ray
_MOST = 250  # maximum number of samples per ray; longer rays are sampled more coarsely
_NEAR = 0.3  # meters at the end of the ray that are ignored, because a point beside a wall is not behind it


def are_behind_walls(
    occupancy: OccupancyMap, eye: NDArray[np.floating], feet: NDArray[np.floating]
) -> NDArray[np.bool_]:
    """(N,) bool, whether the segment from `eye` (3,) to each of the floor points `feet` (N, 3) passes an occupied cell
    below wall height. All points are in meters, world.

    All are False for a camera above the rooms. The map must show one storey."""
    if not len(feet):
        return np.zeros(0, np.bool_)
    way = feet - eye
    length = np.hypot(way[:, 0], way[:, 1])
    looks = int(np.clip(np.ceil(length.max() / _STEP), 1, _MOST))
    share = (np.arange(looks) + 0.5) / looks  # of the distance from the eye
    places = eye[:2] + share[None, :, None] * way[:, None, :2]
    height = (1.0 - share)[None, :] * -way[:, 2:]  # above the floor at the foot
    counts = (way[:, 2:] > -_ABOVE) & (height < WALL) & ((1.0 - share)[None, :] * length[:, None] > _NEAR)
    return np.asarray(((occupancy.states_at(places) == OCCUPIED) & counts).any(axis=1), np.bool_)
