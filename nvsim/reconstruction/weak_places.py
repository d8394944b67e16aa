"""The weak places of a video: where its frames are not connected, the likely cause, and advice for filming again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from nvsim.footage.extraction import ExtractedFrames
from nvsim.geometry.rotation import rotation_angle
from nvsim.reconstruction.report import WeakPlace

_LEAST = 8  # frames of a piece; frames of smaller pieces count as frames without a pose
_BLANK = 60  # tracked points below which a frame shows a blank wall
_FIRM = 25  # tracked points that two neighboring frames share, at least, if they overlap enough
_TURNED = 15.0  # degrees by which the camera rotates at a place, at least, for the cause TURN
_AROUND = 3  # frames before and after a place that belong to its rotation
_STAYED = 0.05  # share of the displacement of points that a pure rotation may leave unexplained

Cause = tuple[str, str]
"""The cause of a weak place, and the advice that avoids it."""
BLURRED: Cause = "the frames are blurred", "move more slowly here and turn on more light"
BLANK: Cause = (
    "the frames show few points to track, such as a blank wall or darkness",
    "keep furniture, door frames or a tiled floor in view, and stay 1.5 m away from walls",
)
APART: Cause = "neighboring frames overlap too little", "walk and turn more slowly here"
TURN: Cause = "the camera rotated in place", "walk through the turn in a curve of 1 m or more"
OTHER_CLIP: Cause = (
    "the next video does not overlap with the previous one",
    "begin each video at a place that another one shows",
)
UNCLEAR: Cause = (
    "the frames have too little in common with the others",
    "film this place again, more slowly, and come back to it from another side",
)


def find_weak_places(frames: ExtractedFrames, pieces: Sequence[Sequence[str]], focal: float) -> tuple[WeakPlace, ...]:
    """The weak places of `frames`, in order of time. `pieces` has the names of the frames of each piece. `focal` is the
    focal length in pixels.

    A place is weak between two frames of different pieces, and over frames that are in no piece.
    """
    piece = {name: k for k, names in enumerate(pieces) if len(names) >= _LEAST for name in names}
    owner = np.array([piece.get(name, -1) for name in frames.names], np.int64)
    tracks = _Tracks(frames, focal)
    found = []
    for first, last in _gaps(owner, frames.clips):
        cause, advice = _cause(frames, tracks, first, last)
        seconds = round(float(frames.seconds[first]), 2), round(float(frames.seconds[last]), 2)
        found.append(WeakPlace(frames.names[first], frames.names[last], seconds, cause, advice))
    return tuple(found)


def _gaps(owner: NDArray[np.int64], clips: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """(first, last) frame indices of the ends of each weak place. For a run of frames without a pose, these are the
    frame before and the frame after it, if they belong to one video."""
    ends = np.flatnonzero((np.diff(owner) != 0) | (np.diff(clips) != 0)) + 1
    for start, end in zip([0, *ends.tolist()], [*ends.tolist(), len(owner)], strict=True):
        if owner[start] < 0:
            before = start - 1 if start and clips[start - 1] == clips[start] else start
            after = end if end < len(owner) and clips[end] == clips[start] else end - 1
            yield before, after
        elif end < len(owner) and owner[end] >= 0 and owner[end] != owner[start]:
            yield end - 1, end


class _Tracks:
    """The tracked points of each frame."""

    def __init__(self, frames: ExtractedFrames, focal: float) -> None:
        order = np.argsort(frames.frame, kind="stable")
        ends = np.searchsorted(frames.frame[order], np.arange(len(frames.names) + 1))
        self._own = [order[ends[k] : ends[k + 1]] for k in range(len(frames.names))]
        self._frames, self._focal = frames, focal

    def count(self, k: int) -> int:
        """Number of points of a frame."""
        return len(self._own[k])

    def _shared_pixels(self, k: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels (N, 2) of the points that both frame `k` and the next one show, in each of them."""
        (one, other), point = self._own[k : k + 2], self._frames.point
        _, a, b = np.intersect1d(point[one], point[other], assume_unique=True, return_indices=True)
        return self._frames.places[one[a]], self._frames.places[other[b]]

    def count_shared(self, k: int) -> int:
        """Number of points that both frame `k` and the next one show."""
        return len(self._shared_pixels(k)[0])

    def rotation_degrees(self, k: int) -> float:
        """Degrees by which the camera rotated from frame `k` to the next one if it only rotated, otherwise 0."""
        places = self._shared_pixels(k)
        moved = float(np.median(np.linalg.norm(places[1] - places[0], axis=1))) if len(places[0]) >= 8 else 0.0
        if moved <= 0.01 * self._frames.width:
            return 0.0
        center = np.array([self._frames.width, self._frames.height]) / 2
        before, after = (np.column_stack([(p - center) / self._focal, np.ones(len(p))]) for p in places)
        before, after = (rays / np.linalg.norm(rays, axis=1)[:, None] for rays in (before, after))
        u, _, vt = np.linalg.svd(after.T @ before)
        rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        left = self._focal * float(np.median(np.linalg.norm(after - before @ rotation.T, axis=1)))
        if left > _STAYED * moved:
            return 0.0
        return rotation_angle(rotation)


def _cause(frames: ExtractedFrames, tracks: _Tracks, first: int, last: int) -> Cause:
    if frames.clips[first] != frames.clips[last]:
        return OTHER_CLIP
    inside = np.arange(first, last + 1)
    middle = inside[1:-1] if len(inside) > 2 else inside
    if 2 * np.count_nonzero(frames.blurred[middle]) >= len(middle):
        return BLURRED
    if np.median([tracks.count(k) for k in middle]) < _BLANK:
        return BLANK
    steps = [int(k) for k in inside[:-1]]
    if steps and min(tracks.count_shared(k) for k in steps) < _FIRM:
        return APART
    around = [k for k in range(first - _AROUND, last + _AROUND) if 0 <= k < len(frames.names) - 1]
    around = [k for k in around if frames.clips[k] == frames.clips[k + 1]]
    if sum(tracks.rotation_degrees(k) for k in around) >= _TURNED:
        return TURN
    return UNCLEAR
