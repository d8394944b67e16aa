"""The navigation graph on the floor: edges, discs for viewpoints, and a stem to the eye of the selected one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PySide6.QtGui import QColor, QPainter, QPen

from app import colors
from app.document import Document
from app.graph_arrays import GraphArrays
from app.graph_ink import LARGE, GraphInk
from app.kept_drawing import KeptDrawing
from app.layers.layer import Layer
from app.picking import NEAR, projected_segments
from nvsim.geometry.camera import Camera

_NODE_METRES = 0.16  # radius of a viewpoint's disc on the floor
_NODE_PIXELS = (3.5, 42.0)  # least and most radius of a disc
_MARGIN = 20  # pixels beside the picture whose discs still reach into it


@dataclass(frozen=True, eq=False)
class Seen:
    """The viewpoints as one camera sees them; arrays have a row for each viewpoint.

    pixels (N, 2), depths (N,) in metres, seen (N,), radii (N, 2) in pixels; order (K,) those seen, far ones first
    """

    camera: Camera
    arrays: GraphArrays
    pixels: NDArray[np.float64]
    depths: NDArray[np.float64]
    seen: NDArray[np.bool_]
    radii: NDArray[np.float64]
    order: NDArray[np.int64]

    @staticmethod
    def of(camera: Camera, arrays: GraphArrays) -> Seen:
        pixels, depths = camera.project(arrays.feet)
        k = camera.intrinsics
        seen = (depths > NEAR) & (pixels > -_MARGIN).all(axis=1)
        seen &= (pixels[:, 0] < k.width + _MARGIN) & (pixels[:, 1] < k.height + _MARGIN)
        radius = np.clip(_NODE_METRES * k.fy / np.maximum(depths, NEAR), *_NODE_PIXELS)
        # A disc that lies on the floor looks flatter the more level the view of it is.
        toward = arrays.feet - camera.position
        flat = np.abs(toward[:, 2]) / np.maximum(np.linalg.norm(toward, axis=1), 1e-9)
        radii = np.stack([radius, np.maximum(radius * np.maximum(flat, 0.3), 2.5)], axis=1)
        order = np.flatnonzero(seen)
        return Seen(camera, arrays, pixels, depths, seen, radii, order[np.argsort(-depths[order])])

    def lines(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What is in view of the edges, as `projected_segments` gives it: ends in pixels (M, 4), depth (M,)."""
        k, edges = self.camera.intrinsics, self.arrays.edges
        front = self.depths > NEAR
        # Which sides of the picture an end lies beyond, as bits: an edge with both ends beyond one is out of view.
        beyond = (
            1 * (self.pixels[:, 0] < 0)
            + 2 * (self.pixels[:, 0] > k.width)
            + 4 * (self.pixels[:, 1] < 0)
            + 8 * (self.pixels[:, 1] > k.height)
        ).astype(np.uint8)
        a, b = edges[:, 0], edges[:, 1]
        both = front[a] & front[b]
        rows = np.flatnonzero(both & ((beyond[a] & beyond[b]) == 0))
        whole = np.concatenate([self.pixels[a[rows]], self.pixels[b[rows]]], axis=1)
        depth = np.minimum(self.depths[a[rows]], self.depths[b[rows]])
        # Few pass the eye; only these have to be cut.
        passing = np.flatnonzero(~both & (front[a] | front[b]))
        if not len(passing):
            return whole, depth
        feet = self.arrays.feet
        cut, _, cut_depth = projected_segments(self.camera, feet[a[passing]], feet[b[passing]])
        return np.concatenate([whole, cut]), np.concatenate([depth, cut_depth])


class GraphLayer(Layer):
    """`hovered` is set by the views: the id under the cursor."""

    name = "graph"
    title = "Graph"

    def __init__(self, document: Document) -> None:
        self._document = document
        self.hovered: str | None = None
        self._ink = GraphInk()
        self._latest: Seen | None = None
        self._kept = KeptDrawing()

    @property
    def missing(self) -> str:
        return "" if self._document.graph_arrays.ids else "no navigation graph is built yet"

    def seen(self, camera: Camera) -> Seen:
        """Where the viewpoints are for `camera`; kept for the next who asks with the same."""
        arrays = self._document.graph_arrays
        if self._latest is None or self._latest.camera is not camera or self._latest.arrays is not arrays:
            self._latest = Seen.of(camera, arrays)
        return self._latest

    def paint(self, painter: QPainter, camera: Camera) -> None:
        arrays = self._document.graph_arrays
        if not arrays.ids:
            return
        view = self.seen(camera)
        if len(arrays.edges) > LARGE:
            k = camera.intrinsics
            self._kept.paint(painter, k.width, k.height, view, lambda p: self._paint_all(p, view))
        else:
            self._paint_all(painter, view)
        self._paint_marked(painter, view)

    def _paint_all(self, painter: QPainter, view: Seen) -> None:
        lines, depth = view.lines()
        self._ink.draw_edges(painter, lines, depth)
        rows = view.order
        self._ink.draw_viewpoints(painter, view.pixels[rows], view.radii[rows], view.arrays.included[rows])

    def _paint_marked(self, painter: QPainter, view: Seen) -> None:
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
