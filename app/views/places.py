"""Where the eye of the 3D view can be sent: home, overview, above, what is selected, a frame, a position."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from app.painting import cameras
from app.painting.cameras import ViewPose
from app.state.document import Document
from app.state.ground import Ground
from app.state.on_floor import floor_height
from app.views.navigation import Navigation, Walk

EYE = 1.5  # metres above the floor, where no viewpoint says otherwise
_IN_ROOM = 1.0  # metres from the height of a walking eye, within which one is in the room already


class Places:
    """Sends `navigation` smoothly; without anything to see it stays. `aspect` is width by height of the view."""

    def __init__(self, document: Document, navigation: Navigation, aspect: Callable[[], float]) -> None:
        self._document, self._navigation, self._aspect = document, navigation, aspect
        self._ground = Ground(document)

    @property
    def first(self) -> ViewPose:
        """Where the trajectory began; without a reconstruction, a view over trajectory and graph."""
        contents = self._document.contents
        if contents.capture is not None and contents.capture.frames and contents.scene_stamp is not None:
            return cameras.seen_from_frame(contents.capture.frames[0].camera)
        return cameras.overview(self._document.extent)

    def home(self) -> None:
        if len(self._document.extent):
            self._navigation.go_to(self.first)

    def look_over(self) -> None:
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

    def snap_to_frame(self, index: int) -> None:
        capture = self._document.contents.capture
        if capture is not None and 0 <= index < len(capture.frames):
            self._navigation.go_to(cameras.seen_from_frame(capture.frames[index].camera))

    @property
    def walk(self) -> Walk:
        """How one walks here."""
        return Walk(self.eye_level, self._is_free)

    def _is_free(self, x: float, y: float, z: float) -> bool:
        return self._ground.free(x, y, floor_height(self._document, x, y, below=z))

    @property
    def walk_start(self) -> ViewPose:
        """Where a walk begins: under the eye where it is within a room, else on the place nearest to what the eye looks
        at where somebody stood, level and in the same direction."""
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
        """World z of a walking eye at x, y: as high above the local floor, of the storey beneath z, as the trajectory's
        cameras or the viewpoints are."""
        arrays = self._document.graph_arrays
        height = float(np.median(arrays.positions[:, 2] - arrays.feet[:, 2])) if arrays.ids else EYE
        return floor_height(self._document, x, y, below=z) + height

    def go_to_position(self, position: np.ndarray, heading: float | None = None) -> None:
        """Stands at `position` (3,) looking level; the heading stays unless one is given."""
        turn = self._navigation.pose.heading if heading is None else heading
        x, y, z = (float(v) for v in position)
        self._navigation.go_to(ViewPose((x, y, z), turn, 0.0, 3.0))
