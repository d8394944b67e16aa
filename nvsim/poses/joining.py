"""Join firm pieces of a reconstruction by a similarity from matched points.

Two doors of one model look alike too. A join is therefore accepted only if enough points agree, if they are spread in
space, and if the video stays continuous: the camera may not move faster between the pieces than elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.poses.features import match_descriptors, unit_vectors
from nvsim.poses.match_database import Keypoints, Pair

_RATIO = 0.9  # distance to the best match over the distance to the second best
_FEWEST = 25  # points that agree, at least; wrong similarities had 10 at most
_NEAR = 0.03  # largest distance of matched points, as a share of the piece's extent
_SPREAD = 0.065  # least second deviation of the agreeing points, as a share of the extent
_MANY, _SPREAD_OF_MANY = 250, 0.05  # points that agree, at least, for this least deviation
_FASTER = 3.0  # largest step between pieces, in units of the usual step


@dataclass(frozen=True, eq=False)
class PosePiece:
    """numbers  (I,) int64, numbers of the images, increasing
    poses    world to camera, by image number
    points   (P, 3) float64, points that two or more of the images show
    looks    (P, 128) float32, RootSIFT descriptors
    seen     for each point, the (image number, keypoint) pairs that show it
    """

    numbers: NDArray[np.int64]
    poses: dict[int, pycolmap.Rigid3d]
    points: NDArray[np.float64]
    looks: NDArray[np.float32]
    seen: list[list[tuple[int, int]]]

    def center(self, number: int) -> NDArray[np.float64]:
        """(3,) camera center of an image."""
        pose = self.poses[number]
        return np.asarray(-pose.rotation.matrix().T @ pose.translation)

    def transformed(self, by: pycolmap.Sim3d) -> PosePiece:
        """The piece, transformed by a similarity."""
        matrix = by.scale * by.rotation.matrix()
        return PosePiece(
            self.numbers,
            {n: by.transform_camera_world(pose) for n, pose in self.poses.items()},
            self.points @ matrix.T + by.translation,
            self.looks,
            self.seen,
        )


def piece_of(model: pycolmap.Reconstruction, numbers: Sequence[int], keypoints: Sequence[Keypoints]) -> PosePiece:
    """The images `numbers` of a model as a piece, with the points that their features show."""
    inside = set(int(n) for n in numbers)
    descriptors = {n: unit_vectors(keypoints[n - 1].features) for n in inside}
    points, looks, seen = [], [], []
    for point in model.points3D.values():
        elements = [(e.image_id, e.point2D_idx) for e in point.track.elements if e.image_id in inside]
        described = [descriptors[n][k] for n, k in elements if k < len(descriptors[n])]
        if len(described) >= 2:
            mean = np.mean(described, axis=0)
            points.append(point.xyz)
            looks.append(mean / np.linalg.norm(mean))
            seen.append(elements)
    poses = {n: model.images[n].cam_from_world() for n in inside}
    return PosePiece(
        np.array(sorted(inside), np.int64),
        poses,
        np.array(points, np.float64).reshape(-1, 3),
        np.array(looks, np.float32).reshape(len(looks), -1) if looks else np.zeros((0, 0), np.float32),
        seen,
    )


def join(
    pieces: Sequence[PosePiece], clips: NDArray[np.int64]
) -> tuple[dict[int, pycolmap.Rigid3d], dict[Pair, NDArray[np.uint32]]]:
    """Joins to the largest piece all pieces that match it. `clips` (N,) are the videos of image numbers 1 to N.

    Returns the poses, world to camera, by image number. Also returns matches (M, 2) of keypoints that show one point in
    two of the pieces, by image indices."""
    rest = sorted(pieces, key=lambda p: -len(p.numbers))
    base, rest = rest[0], rest[1:]
    shared: dict[Pair, dict[int, int]] = {}
    while rest:
        # Join the piece that agrees best first: a doubtful one could draw others to a wrong place.
        tries = [_similarity(piece, base) for piece in rest]
        for k in sorted(range(len(rest)), key=lambda k: -tries[k][0]):
            count, by, here, there = tries[k]
            if by is None or count < _FEWEST:
                continue
            moved = rest[k].transformed(by)
            if not _continuous(base, moved, clips):
                continue
            for a, b in zip(here, there, strict=True):
                _note(shared, rest[k].seen[a], base.seen[b])
            base = PosePiece(
                np.sort(np.concatenate([base.numbers, moved.numbers])),
                base.poses | moved.poses,
                np.concatenate([base.points, moved.points]),
                np.concatenate([base.looks, moved.looks]),
                base.seen + moved.seen,
            )
            del rest[k]
            break
        else:
            break
    return base.poses, _pairs_with_enough_points(shared)


def _pairs_with_enough_points(shared: dict[Pair, dict[int, int]]) -> dict[Pair, NDArray[np.uint32]]:
    return {pair: np.array(sorted(found.items()), np.uint32) for pair, found in shared.items() if len(found) >= 4}


def _similarity(
    piece: PosePiece, base: PosePiece
) -> tuple[int, pycolmap.Sim3d | None, NDArray[np.int64], NDArray[np.int64]]:
    """How many points agree, the similarity that moves `piece` onto `base`, and the agreeing points of both."""
    nothing = np.zeros(0, np.int64)
    pairs = match_descriptors(piece.looks, base.looks, _RATIO)
    if len(pairs) < _FEWEST:
        return 0, None, nothing, nothing
    centers = np.array([base.center(int(n)) for n in base.numbers])
    extent = float(np.linalg.norm(np.ptp(centers, axis=0)))
    options = pycolmap.RANSACOptions()
    options.max_error = _NEAR * extent
    options.max_num_trials, options.random_seed = 20_000, 0
    # The function returns a dictionary, although the library declares a Sim3d.
    found: Any = pycolmap.estimate_sim3d_robust(piece.points[pairs[:, 0]], base.points[pairs[:, 1]], options)
    if not found:
        return 0, None, nothing, nothing
    agreed = pairs[np.asarray(found["inlier_mask"], bool)]
    spread = np.linalg.svd(base.points[agreed[:, 1]] - base.points[agreed[:, 1]].mean(axis=0), compute_uv=False)
    least = _SPREAD if len(agreed) < _MANY else _SPREAD_OF_MANY
    if spread[1] / max(len(agreed), 1) ** 0.5 < least * extent:
        return 0, None, nothing, nothing
    return len(agreed), found["tgt_from_src"], agreed[:, 0], agreed[:, 1]


def _continuous(base: PosePiece, moved: PosePiece, clips: NDArray[np.int64]) -> bool:
    """Whether no step between an image of one piece and the next image of the other is far longer than usual. From the
    end of a video to the start of the next, a step of any length is possible."""
    numbers = np.sort(np.concatenate([base.numbers, moved.numbers]))
    centers = np.array([(base if int(n) in base.poses else moved).center(int(n)) for n in numbers])
    own = np.isin(numbers, base.numbers)
    steps = np.linalg.norm(np.diff(centers, axis=0), axis=1) / np.diff(numbers)
    within = steps[own[:-1] & own[1:]]
    if not len(within):  # the images of the two pieces alternate
        within = np.linalg.norm(np.diff(centers[own], axis=0), axis=1) / np.diff(numbers[own])
    usual = np.percentile(within, 90)
    across = (own[:-1] != own[1:]) & (np.diff(clips[numbers - 1]) == 0)
    return bool((steps[across] < _FASTER * usual).all())


def _note(shared: dict[Pair, dict[int, int]], here: list[tuple[int, int]], there: list[tuple[int, int]]) -> None:
    for i, k in here:
        for j, n in there:
            a, b = ((i, k), (j, n)) if i < j else ((j, n), (i, k))
            if a[0] != b[0]:
                shared.setdefault((a[0] - 1, b[0] - 1), {})[a[1]] = b[1]
