"""Track points from frame to frame (KLT; Lucas and Kanade 1981, Shi and Tomasi 1994).

Tracks follow weak texture, such as the edge of a plain door, that no feature descriptor matches. On a video of a
furnished house, neighboring frames have six times as many correct matches as with SIFT, and never fewer than 80.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

FOLLOWED_SIDE = 640
"""Longest side of the gray images in which points are tracked, pixels."""
_SPACING = 7  # pixels between two points
_CELLS = (8, 6)  # columns and rows of the grid over which points are spread
_MOST = 700  # points of an image
_WEAK, _WEAKEST = 4e-5, 1e-5  # smaller eigenvalue of the gradient matrix (image values 0 to 1)
_SCARCE = 250  # points; an image with fewer strong points also gets weak ones
_CLEAREST, _ENOUGH = 200, 20  # points that are tracked first; least number of them for a homography
_LEVELS = 4
_RETURN = 0.5  # pixels: largest distance from the start after tracking forward and backward
_BORDER = 3  # pixels
_LUCAS_KANADE: dict[str, Any] = {
    "winSize": (27, 27),
    "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01),
    "minEigThreshold": 1e-5,
    "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
}


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """gray    (H, W) uint8
    ids     (N,) int64, increasing: number of each point, constant while it is tracked
    places  (N, 2) float32, pixels of `gray`; (0, 0) is the center of the first pixel
    clear   (N,) float32, smaller eigenvalue of the gradient matrix at the point
    motion  (3, 3) float64, homography of most points from the previous frame
    """

    gray: NDArray[np.uint8]
    ids: NDArray[np.int64]
    places: NDArray[np.float32]
    clear: NDArray[np.float32]
    motion: NDArray[np.float64]

    def shared_with(self, other: TrackedFrame) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Indices (K,) into the points of this frame and of the other, for the K points that both have."""
        _, mine, theirs = np.intersect1d(self.ids, other.ids, assume_unique=True, return_indices=True)
        return mine, theirs


def shrunk_gray(image: NDArray[np.uint8], side: int = FOLLOWED_SIDE) -> NDArray[np.uint8]:
    """(h, w) uint8 of a BGR image (H, W, 3), shrunk so that its longest side is at most `side` pixels."""
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    scale = side / max(gray.shape)
    if scale < 1:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(gray, np.uint8)


def frame_without_points(gray: NDArray[np.uint8]) -> TrackedFrame:
    """A frame `gray` (H, W) without points."""
    nothing = np.zeros(0, np.float32)
    return TrackedFrame(gray, np.zeros(0, np.int64), np.zeros((0, 2), np.float32), nothing, np.eye(3))


def track_points(before: TrackedFrame, gray: NDArray[np.uint8], steps: int = 1) -> TrackedFrame:
    """Tracks the points of `before` into an image `gray` (H, W), `steps` frames later. A point is kept if tracking it
    back ends within half a pixel of its start.

    The clearest points are tracked first, near the positions that the last motion predicts. The homography that most of
    them follow, as in a camera rotation, then predicts all positions. It prevents points in weak texture from moving to
    a place that only looks similar.
    """
    if not len(before.ids):
        return frame_without_points(gray)
    clearest = before.places[np.argsort(-before.clear, kind="stable")[:_CLEAREST]]
    motion = np.linalg.matrix_power(before.motion, steps)
    found, good = _flow(before.gray, gray, clearest, _apply_homography(clearest, motion), _LEVELS)
    if good.sum() < 0.5 * len(clearest):
        still, good_still = _flow(before.gray, gray, clearest, clearest, _LEVELS)
        if good_still.sum() > good.sum():
            found, good = still, good_still
    homography = _homography(clearest[good], found[good])
    if homography is None:
        homography = np.eye(3)
        found, good = _flow(before.gray, gray, before.places, _apply_homography(before.places, motion), _LEVELS)
    else:
        found, good = _flow(before.gray, gray, before.places, _apply_homography(before.places, homography), 1)
    strength = cv2.cornerMinEigenVal(gray, 5)
    x, y = np.rint(found[good]).astype(int).T
    return TrackedFrame(gray, before.ids[good], found[good], np.asarray(strength[y, x], np.float32), homography)


def _homography(places: NDArray[np.float32], found: NDArray[np.float32]) -> NDArray[np.float64] | None:
    """(3, 3) homography of most `places` (N, 2) to their `found` positions. None if too few agree."""
    if len(places) < _ENOUGH:
        return None
    try:
        motion, _ = cv2.findHomography(places, found, cv2.USAC_MAGSAC, 3.0)
    except cv2.error:  # some degenerate sets of matches fail in an assertion
        return None
    return None if motion is None else np.asarray(motion, np.float64)


def _apply_homography(places: NDArray[np.float32], motion: NDArray[np.float64]) -> NDArray[np.float32]:
    """Positions `places` (N, 2) after a homography."""
    return np.asarray(cv2.perspectiveTransform(places[:, None].astype(np.float64), motion)[:, 0], np.float32)


def sharpness_change(before: TrackedFrame, after: TrackedFrame) -> float:
    """How much sharper `after` is than `before`: the median ratio of the gradients at their common points. In contrast
    to the contrast of the whole image, it does not depend on the image content."""
    mine, theirs = before.shared_with(after)
    if len(mine) < _ENOUGH:
        return 1.0
    ratio = np.maximum(after.clear[theirs], 1e-9) / np.maximum(before.clear[mine], 1e-9)
    return float(np.exp(0.5 * np.median(np.log(ratio))))


def _flow(
    before: NDArray[np.uint8],
    after: NDArray[np.uint8],
    places: NDArray[np.float32],
    guess: NDArray[np.float32],
    levels: int,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The positions of `places` (N, 2) in the next image, and which points were found forward and backward."""
    start = np.ascontiguousarray(places[:, None])
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, start, guess[:, None].copy(), maxLevel=levels, **_LUCAS_KANADE
    )
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, start.copy(), maxLevel=levels, **_LUCAS_KANADE)
    found_at = np.asarray(there[:, 0], np.float32)
    height, width = after.shape
    good = (found[:, 0] > 0) & (found_back[:, 0] > 0) & (np.abs(back - start).max(axis=(1, 2)) < _RETURN)
    good &= (found_at > _BORDER).all(axis=1) & (found_at < (width - _BORDER, height - _BORDER)).all(axis=1)
    return found_at, np.asarray(good)


def with_new_points(frame: TrackedFrame, first_id: int) -> TrackedFrame:
    """The frame with corners added in areas without points. Their numbers start at `first_id`."""
    height, width = frame.gray.shape
    clear = cv2.cornerMinEigenVal(frame.gray, 5)
    strength = clear.copy()
    for x, y in np.rint(frame.places).astype(int):
        cv2.circle(strength, (int(x), int(y)), _SPACING, 0.0, -1)
    strength[:8] = strength[-8:] = 0
    strength[:, :8] = strength[:, -8:] = 0
    peak = (strength == cv2.dilate(strength, np.ones((_SPACING, _SPACING), np.uint8))) & (strength > _WEAKEST)
    y, x = np.nonzero(peak)
    order = np.argsort(-strength[y, x], kind="stable")
    y, x = y[order], x[order]
    enough = max(int((strength[y, x] > _WEAK).sum()), _SCARCE - len(frame.ids))
    y, x = y[:enough], x[:enough]
    columns, rows = _CELLS
    room = np.full(columns * rows, _MOST // (columns * rows))
    taken = _cell(frame.places[:, 0], frame.places[:, 1], width, height)
    room -= np.minimum(room, np.bincount(taken, minlength=len(room)))
    cell = _cell(x, y, width, height)
    by_cell = np.argsort(cell, kind="stable")  # strongest first within each cell
    rank = np.empty(len(cell), int)
    counts = np.bincount(cell, minlength=len(room))
    rank[by_cell] = np.arange(len(cell)) - np.repeat(np.cumsum(counts) - counts, counts)
    kept = rank < room[cell]
    places = np.stack([x[kept], y[kept]], axis=1).astype(np.float32).reshape(-1, 2)
    if len(places):
        stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)
        refined = cv2.cornerSubPix(frame.gray, places[:, None].copy(), (3, 3), (-1, -1), stop)
        places = np.asarray(refined[:, 0], np.float32)
    ids = np.arange(first_id, first_id + len(places), dtype=np.int64)
    x, y = np.rint(places).astype(int).T
    return TrackedFrame(
        frame.gray,
        np.concatenate([frame.ids, ids]),
        np.concatenate([frame.places, places]),
        np.concatenate([frame.clear, np.asarray(clear[y, x], np.float32)]),
        frame.motion,
    )


def _cell(x: NDArray[np.generic], y: NDArray[np.generic], width: int, height: int) -> NDArray[np.int64]:
    columns, rows = _CELLS
    across = np.clip(np.asarray(x) * columns // width, 0, columns - 1).astype(np.int64)
    return np.asarray(np.clip(np.asarray(y) * rows // height, 0, rows - 1).astype(np.int64) * columns + across)
