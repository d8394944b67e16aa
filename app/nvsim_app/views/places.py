"""Moves the camera of the 3D view to standard poses: home, overview, from above, selection, frame, position."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim_app.painting import cameras
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.state.document import Document
from nvsim_app.state.free_floor import FreeFloor, floor_height
from nvsim_app.views.navigation import Navigation, WalkLimits

EYE = 1.5  # default camera height above the floor in meters, if there are no viewpoints
_IN_ROOM = 1.0  # maximum height difference in meters to the eye level at which the camera is inside a room


class Places:
    """Moves the camera of `navigation` in animations. If there is no content, the camera does not move. `aspect`
    returns the ratio of width to height of the view."""

    def __init__(self, document: Document, navigation: Navigation, aspect: Callable[[], float]) -> None:
        self._document, self._navigation, self._aspect = document, navigation, aspect
        self._ground = FreeFloor(document)

    @property
    def first(self) -> ViewPose:
        """The initial pose: the first frame of the trajectory; without a reconstruction, an overview of trajectory and
        graph."""
        contents = self._document.contents
        if contents.capture is not None and contents.capture.frames and contents.scene_stamp is not None:
            return cameras.seen_from_frame(contents.capture.frames[0].camera)
        return cameras.overview(self._document.extent)

    def home(self) -> None:
        if len(self._document.extent):
            self._navigation.go_to(self.first)

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
            self._navigation.go_to(cameras.focused(self._navigation.pose, point))

    def focus_on_point(self, point: NDArray[np.float64]) -> None:
        """Centers `point` (3,), meters, world, from at most the default distance. Later turns are around it."""
        pose = self._navigation.pose
        distance = float(np.linalg.norm(point - pose.position))
        self._navigation.go_to(cameras.focused(pose, point, min(distance, cameras.REACH)))

    def snap_to_frame(self, index: int) -> None:
        capture = self._document.contents.capture
        if capture is not None and 0 <= index < len(capture.frames):
            self._navigation.go_to(cameras.seen_from_frame(capture.frames[index].camera))

    @property
    def walk(self) -> WalkLimits:
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
