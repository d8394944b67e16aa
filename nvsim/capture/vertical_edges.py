"""The vertical of a capture from vertical edges in its images: corners of walls, posts of doors, sides of cupboards.

In buildings, they give the vertical within 0.1 to 0.4 degrees. Cameras that people hold are off by 1 to 2 degrees on
average, and the floor of a few triangulated points by 0.5 to 3 degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.raw import RawFrame
from nvsim.capture.triangulation import read_view
from nvsim.geometry.rotation import level_axes

_SHORTEST = 0.06  # shortest line that is used, over the image width
_UPRIGHT_LINE = 0.2  # |sine| of the angle between a possibly vertical line's plane and the vertical, at most
_TILTS, _TILT = 8.0, 0.5  # degrees: largest tilt of a given vertical, and distance of the tilts that are tried
_UP_ERROR = 4.0  # degrees: usual error of a given vertical
_LINE_ERROR = 0.3  # degrees: usual error of a line
_LINES = 4  # possibly vertical lines, at least
_INFORMATION = 0.3  # information on the vertical in both directions, at least: lines of full width at right angles
_DEVIATION, _LEAST_DEVIATION = 0.15, 0.05  # degrees: deviation of the vertical for an information of 1, and the least
_IMAGES, _SIZE = 40, 960  # images whose edges are used, at most, and their longer side in pixels, at most
_THREADS = 2


@dataclass(frozen=True, eq=False)
class Lines:
    """Straight lines of images.

    normals  (N, 3) float64, unit vectors, world, at right angles to the plane of the line and the camera
    weights  (N,) float64, lengths over the image width
    """

    normals: NDArray[np.float64]
    weights: NDArray[np.float64]


def long_segments(gray: NDArray[np.uint8]) -> NDArray[np.float64]:
    """(N, 2, 2) ends in pixels of the long straight lines of an image (H, W) uint8."""
    lines = cv2.createLineSegmentDetector().detect(gray)[0]
    if lines is None:
        return np.zeros((0, 2, 2))
    ends = lines.reshape(-1, 2, 2).astype(np.float64)
    return np.asarray(ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > _SHORTEST * gray.shape[1]])


def vertical_from_lines(lines: Lines, up: NDArray[np.float64]) -> tuple[NDArray[np.float64], float] | None:
    """The vertical (3,) from the vertical edges among `lines`, near a given vertical `up`, and its standard deviation
    in radians. None if they do not determine it: a single edge, or edges in one direction, leave a tilt open."""
    east, north = level_axes(up)
    beside = np.stack([lines.normals @ east, lines.normals @ north], axis=1)
    ahead = -lines.normals @ up
    near = np.abs(ahead) < _UPRIGHT_LINE
    beside, ahead, weights = beside[near], ahead[near], lines.weights[near]
    if len(ahead) < _LINES:
        return None
    steps = np.radians(np.arange(-_TILTS, _TILTS + _TILT / 2, _TILT))
    tilts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    off = (beside @ tilts.T - ahead[:, None]) / np.radians(_TILT)
    votes = weights @ np.exp(-(off**2)) * np.exp(-((tilts / np.radians(_UP_ERROR)) ** 2).sum(axis=1) / 2)
    tilt, information = tilts[votes.argmax()], np.zeros((2, 2))
    for _ in range(10):
        off = (beside @ tilt - ahead) / np.radians(_LINE_ERROR)
        weighted = beside * (weights / (1 + off**2) ** 2)[:, None]
        information = weighted.T @ beside + 1e-6 * np.eye(2)
        tilt = np.linalg.solve(information, weighted.T @ ahead)
    least = float(np.linalg.eigvalsh(information)[0])
    if least < _INFORMATION or np.abs(tilt).max() > np.radians(_TILTS):
        return None
    found = up + tilt @ np.stack([east, north])
    return found / np.linalg.norm(found), float(np.radians(max(_DEVIATION / least**0.5, _LEAST_DEVIATION)))


def vertical_from_images(frames: Sequence[RawFrame], up: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The vertical (3,) from the vertical edges in images of a capture, near a given vertical `up`, in the frame of the
    source. None if they do not determine it. Images that cannot be read are skipped."""
    usable = [f for f in frames if f.camera_to_world is not None and f.lens is not None]
    chosen = np.unique(np.linspace(0, len(usable) - 1, min(_IMAGES, len(usable))).astype(int))
    with ThreadPoolExecutor(_THREADS) as pool:
        found = list(pool.map(_lines_of_image, [usable[i] for i in chosen]))
    lines = Lines(
        np.concatenate([np.zeros((0, 3)), *(one.normals for one in found)]),
        np.concatenate([np.zeros(0), *(one.weights for one in found)]),
    )
    vertical = vertical_from_lines(lines, up)
    return None if vertical is None else vertical[0]


def _lines_of_image(raw: RawFrame) -> Lines:
    view = read_view(raw, _SIZE)
    if view is None:
        return Lines(np.zeros((0, 3)), np.zeros(0))
    camera, image, counted = view
    k = camera.intrinsics
    ends = long_segments(np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8))
    if counted is not None:
        column, row = np.clip(ends.mean(axis=1).astype(np.int64), 0, [k.width - 1, k.height - 1]).T
        ends = ends[counted[row, column]]
    rays = np.concatenate([(ends + 0.5 - [k.cx, k.cy]) / [k.fx, k.fy], np.ones((*ends.shape[:2], 1))], axis=2)
    normals = np.cross(rays[:, 0], rays[:, 1]) @ camera.rotation.T
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / k.width
    return Lines(normals / np.linalg.norm(normals, axis=1, keepdims=True), lengths)
