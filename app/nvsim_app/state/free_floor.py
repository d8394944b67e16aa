"""The floor of the building: its height at any position, free space for the walking camera, and the trajectory on
it."""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Evidence
from nvsim.occupancy.types import FREE, OCCUPIED
from nvsim.plain_text import capitalized
from nvsim_app.state.document import Document


def floor_height(
    document: Document, x: float, y: float, *, below: float | None = None, near: float | None = None
) -> float:
    """World z in meters of the floor at x, y, from the nearest viewpoint or frame; 0 if there is none.

    below   prefers floors below this height, to select the storey of the camera
    near    prefers floors near this height, to stay on one storey
    """
    feet = document.shown_arrays.feet
    if not len(feet):
        feet = trajectory_on_floor(document)
    if not len(feet):
        return 0.0
    distance = np.hypot(feet[:, 0] - x, feet[:, 1] - y)
    if below is not None and (feet[:, 2] < below).any():
        # Select a floor below the camera that is near in height and position.
        distance = distance + 3.0 * np.maximum(0.0, below - feet[:, 2]) + np.where(feet[:, 2] < below, 0.0, 1e6)
    if near is not None:
        distance = distance + 3.0 * np.abs(feet[:, 2] - near)
    return float(feet[np.argmin(distance), 2])


def trajectory_on_floor(document: Document) -> NDArray[np.float64]:
    """(N, 3) positions of the frames projected to the floor, meters, world. The camera height is the median height of
    the graph's viewpoints; without a graph, the height given at import, or else 1.5 m."""
    positions = document.trajectory.positions
    if not len(positions):
        return positions
    arrays = document.graph_arrays
    height = document.contents.camera_height or 1.5
    if arrays.ids:
        height = float(np.median(arrays.positions[:, 2] - arrays.feet[:, 2]))
    return positions - [0.0, 0.0, height]


def weak_places(document: Document) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """(N,) int64 index of the last frame before each weak part of a video, and a text about each problem."""
    report, capture = document.contents.poses, document.contents.capture
    if report is None or capture is None or not capture.frames:
        return np.zeros(0, np.int64), ()
    names = sorted((frame.name, row) for row, frame in enumerate(capture.frames))
    rows = [names[max(bisect_right(names, (place.first, len(names))) - 1, 0)][1] for place in report.weak]
    words = tuple(f"{capitalized(place.cause)}. {place.advice.capitalize()}." for place in report.weak)
    return np.array(rows, np.int64), words


SHOULDER = 0.15  # meters around the camera that must not be occupied
AROUND = 1.5  # meters from a known position or an edge within which unknown floor counts as free
_REACH = 4.0  # meters; evidence of viewpoints farther away does not cover the position
_STOREY = 1.0  # maximum height difference within a storey, meters


class FreeFloor:
    """Tests positions for free space. A test takes less than a millisecond, because it runs at every step of a walk."""

    def __init__(self, document: Document) -> None:
        self._document = document

    @property
    def places(self) -> NDArray[np.float64]:
        """(N, 3) meters, world: the floor points of viewpoints and frames, which are known to be free."""
        return np.concatenate([self._document.shown_arrays.feet, trajectory_on_floor(self._document)])

    def free(self, x: float, y: float, floor: float) -> bool:
        """Whether the position x, y on the floor at z = `floor` (meters, world) is free. It uses the map if it knows
        the position, else near evidence, else the distance to known positions and edges."""
        answer = self._on_map(x, y)
        if answer is None:
            answer = self._by_evidence(x, y, floor)
        return self._is_near_trajectory(x, y, floor) if answer is None else answer

    def _on_map(self, x: float, y: float) -> bool | None:
        """Free or occupied according to the map. None if there is no map, if the position is unknown, or if the
        building has several storeys, because the map shows only one."""
        occupancy = self._document.contents.occupancy
        if occupancy is None or len(self._document.storeys.found) > 1:
            return None
        found = occupancy.states_at(SHOULDER * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]) + (x, y))
        if (found == OCCUPIED).any():
            return False
        return True if found[0] == FREE else None

    def _by_evidence(self, x: float, y: float, floor: float) -> bool | None:
        """Free if at least one corridor measured free floor here, even if others are occluded. None if no corridor
        covers the position."""
        graph, arrays = self._document.graph, self._document.graph_arrays
        if graph is None or not graph.evidence:
            return None
        limit = 255 * self._document.contents.thresholds.cell_alpha
        way = arrays.feet - (x, y, floor)
        near = (np.hypot(way[:, 0], way[:, 1]) < _REACH) & (np.abs(way[:, 2]) < _STOREY)
        answer = None
        for row in np.flatnonzero(near):
            id, (east, north, _) = arrays.ids[row], -way[row]
            for key in graph.evidence_of.get(id, ()):
                evidence = graph.evidence[key]
                alpha = _cell(evidence, east, north) if evidence.viewpoint == id and not evidence.stale else None
                if alpha is not None and alpha < limit:
                    return True
                answer = answer if alpha is None else False
        return answer

    def _is_near_trajectory(self, x: float, y: float, floor: float) -> bool:
        arrays = self._document.graph_arrays
        way = self.places - (x, y, floor)
        near = (np.hypot(way[:, 0], way[:, 1]) < AROUND) & (np.abs(way[:, 2]) < _STOREY)
        if near.any() or not len(arrays.edges):
            return bool(near.any()) or not len(way)
        a, b = (arrays.feet[arrays.edges[:, end]] for end in (0, 1))
        along = b - a
        length = np.maximum((along[:, :2] ** 2).sum(axis=1), 1e-9)
        share = np.clip(((np.array([x, y]) - a[:, :2]) * along[:, :2]).sum(axis=1) / length, 0, 1)
        off = a + share[:, None] * along - (x, y, floor)
        return bool(((np.hypot(off[:, 0], off[:, 1]) < AROUND) & (np.abs(off[:, 2]) < _STOREY)).any())


def _cell(evidence: Evidence, east: float, north: float) -> int | None:
    """Alpha (0 to 255) of the cell at this offset in meters from the viewpoint; None outside the corridor."""
    ahead = (math.sin(evidence.heading), math.cos(evidence.heading))
    row = math.floor((east * ahead[0] + north * ahead[1] - evidence.near) / evidence.depth)
    column = math.floor(((east * ahead[1] - north * ahead[0]) / evidence.width + 0.5) * evidence.alpha.shape[1])
    inside = 0 <= row < evidence.alpha.shape[0] and 0 <= column < evidence.alpha.shape[1]
    return int(evidence.alpha[row, column]) if inside else None
