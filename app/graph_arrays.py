"""Graph and trajectory as flat arrays, made once per change, for views that draw thousands of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Capture
from nvsim.graph.types import NavGraph
from nvsim.submaps.types import Submap


@dataclass(frozen=True, eq=False)
class GraphArrays:
    """ids        in file order
    positions  (N, 3) metres, world, of the camera
    feet       (N, 3) metres, world, on the floor beneath; where the graph is drawn, because seen from a viewpoint all
               others stand on the horizon
    edges      (M, 2) indices into ids
    submaps    (N,) submap index, -1 for none
    included   (N,) bool
    index      id -> row
    """

    ids: tuple[str, ...] = ()
    positions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    feet: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    edges: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    submaps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    included: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    index: dict[str, int] = field(default_factory=dict)

    @staticmethod
    def of(graph: NavGraph | None) -> GraphArrays:
        if graph is None:
            return GraphArrays()
        ids = tuple(graph.viewpoints)
        index = {id: i for i, id in enumerate(ids)}
        values = graph.viewpoints.values()
        positions = np.array([v.position for v in values], np.float64).reshape(-1, 3)
        feet = positions.copy()
        feet[:, 2] -= [v.height for v in values]
        return GraphArrays(
            ids,
            positions,
            feet,
            np.array([(index[a], index[b]) for a, b in graph.edges], np.int64).reshape(-1, 2),
            np.array([v.submap for v in values], np.int64),
            np.array([v.included for v in values], bool),
            index,
        )


@dataclass(frozen=True, eq=False)
class TrajectoryArrays:
    """positions (N, 3) metres, world, in frame order; submaps (N,) the submap whose core holds the frame, else -1;
    breaks (N,) bool, True where a frame does not follow the one before it (another sensor, a jump)."""

    positions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    submaps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    breaks: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))

    @staticmethod
    def of(capture: Capture | None, submaps: tuple[Submap, ...]) -> TrajectoryArrays:
        if capture is None or not capture.frames:
            return TrajectoryArrays()
        owner = np.full(len(capture.frames), -1, np.int64)
        for submap in submaps:
            owner[list(submap.core)] = submap.index
        positions = capture.positions
        gaps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        # A step many times the usual one is a jump between walks, not a part of one.
        usual = float(np.median(gaps)) if len(gaps) else 0.0
        sensors = np.array([f.sensor for f in capture.frames])
        breaks = np.ones(len(positions), bool)
        breaks[1:] = (gaps > max(2.0, 8 * usual)) | (sensors[1:] != sensors[:-1])
        return TrajectoryArrays(positions, owner, breaks)

    @property
    def segments(self) -> NDArray[np.int64]:
        """(M, 2) indices of consecutive frames of one walk."""
        ends = np.flatnonzero(~self.breaks)
        return np.stack([ends - 1, ends], axis=1)
