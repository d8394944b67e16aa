"""Triangulate points from the images of a capture, to find the floor if the point cloud shows none.

The points are enough to estimate the up direction and the camera height. A sample of images is matched with nearby
images. The unit is unknown, so partners are chosen by rank among images with a similar viewing direction: the
second, eighth, and 24th nearest. Only points with enough parallax are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.capture.masks import usable_pixels
from nvsim.capture.raw import RawFrame
from nvsim.capture.triangulation import Features, triangulate
from nvsim.capture.types import Frame
from nvsim.errors import InputError

_PLACES = 30  # images for which partners are searched
_RANKS = (2, 8, 24)
_TURN = np.cos(np.radians(35))
_PARALLAX = float(np.radians(4))  # between cameras; points with less scatter by more than the floor's thickness
_SIZE = 640  # pixels
_THREADS = 2


def image_points(frames: Sequence[RawFrame]) -> NDArray[np.float64]:
    """(N, 3) float64 points in the unit and frame of the source. Images that cannot be read are skipped."""
    usable = [f for f in frames if f.camera_to_world is not None and f.lens is not None]
    poses = np.array([f.camera_to_world for f in usable]).reshape(-1, 4, 4)
    pairs = _pairs(poses)
    wanted = sorted({i for pair in pairs for i in pair})

    def features(index: int) -> Features | None:
        raw = usable[index]
        assert raw.lens is not None and raw.camera_to_world is not None
        frame = Frame(raw.name, raw.image_path, raw.lens, raw.camera_to_world, raw.sensor, raw.timestamp, raw.mask)
        intrinsics = frame.intrinsics.within(_SIZE)
        try:
            image, counted = read_image(frame, intrinsics), usable_pixels(frame, intrinsics)
        except InputError:
            return None  # the stage that needs the image reports the error
        return Features.of(frame.camera.scaled(intrinsics.width, intrinsics.height), image, counted)

    with ThreadPoolExecutor(_THREADS) as pool:
        found = dict(zip(wanted, pool.map(features, wanted), strict=True))

        def points(pair: tuple[int, int]) -> NDArray[np.float64]:
            a, b = found[pair[0]], found[pair[1]]
            return np.zeros((0, 3)) if a is None or b is None else triangulate(a, b, _PARALLAX)[0]

        return np.concatenate([np.zeros((0, 3)), *pool.map(points, pairs)])


def _pairs(poses: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Index pairs into poses (N, 4, 4) of the images to match."""
    places, axes = poses[:, :3, 3], poses[:, :3, 2]
    pairs = []
    for i in np.unique(np.linspace(0, len(poses) - 1, min(_PLACES, len(poses))).astype(int)):
        distance = np.linalg.norm(places - places[i], axis=1)
        fits = np.flatnonzero((axes @ axes[i] > _TURN) & (distance > 0))
        order = fits[np.argsort(distance[fits], kind="stable")]
        pairs += [(int(i), int(order[rank])) for rank in _RANKS if rank < len(order)]
    return pairs
