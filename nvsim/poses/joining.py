"""Join firm pieces of a reconstruction by a similarity from matched points.

Two doors of one model look alike too. A join is therefore accepted only if enough points agree, if they are spread in
space, and if the video stays continuous: the camera may not move faster between the pieces than elsewhere. Relative
poses of pairs of images, which do not depend on the points, may not contradict the join.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.geometry.rotation import rotation_angle
from nvsim.poses.features import match_descriptors, unit_vectors
from nvsim.poses.match_database import Keypoints, Pair

_RATIO = 0.9  # distance to the best match over the distance to the second best
_FEWEST = 25  # points that agree, at least; wrong similarities had 10 at most
_NEAR = 0.03  # largest distance of matched points, as a share of the piece's extent
_SPREAD = 0.08  # least second deviation of the agreeing points, as a share of the extent
_MANY, _SPREAD_OF_MANY = 250, 0.05  # points that agree, at least, for this least deviation
_SPREAD_OF_CONFIRMED = 0.065  # the least deviation if pairs of images agree with the join
_APART = 17  # frames between the images of such a pair, at least: near ones agree although both are at a wrong place
_PAIRS, _VERIFIED = 24, 5  # pairs of images that are compared; relative poses among them, at least, to judge a join
_TURNED = 3.2  # degrees: median difference of their rotations, at most; 1 to 2.7 in right joins, 4 to 7 in wrong ones
_FASTER = 3.0  # largest step between pieces, in units of the usual step
RotationOf = Callable[[Pair], NDArray[np.float64] | None]
"""The relative rotation (3, 3), first to second image, of a pair of images, by index. None if it is unknown."""


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
    pieces: Sequence[PosePiece], clips: NDArray[np.int64], rotation_of: RotationOf = lambda pair: None
) -> tuple[dict[int, pycolmap.Rigid3d], dict[Pair, NDArray[np.uint32]]]:
    """Joins to the largest piece all pieces that match it. `clips` (N,) are the videos of image numbers 1 to N.
    `rotation_of` measures relative rotations from the images.

    Returns the poses, world to camera, by image number. Also returns matches (M, 2) of keypoints that show one point in
    two of the pieces, by image indices."""
    rest = sorted(pieces, key=lambda p: -len(p.numbers))
    base, rest = rest[0], rest[1:]
    shared: dict[Pair, dict[int, int]] = {}
    while rest:
        # Join the piece that agrees best first: a doubtful one could draw others to a wrong place.
        tries = [_similarity(piece, base) for piece in rest]
        for k in sorted(range(len(rest)), key=lambda k: -tries[k][0]):
            count, by, here, there, is_wide = tries[k]
            if by is None or count < _FEWEST:
                continue
            moved = rest[k].transformed(by)
            if not _continuous(base, moved, clips):
                continue
            own: dict[Pair, dict[int, int]] = {}
            for a, b in zip(here, there, strict=True):
                _note(own, rest[k].seen[a], base.seen[b])
            confirmed = _confirmed(base.poses | moved.poses, own, rotation_of)
            if confirmed is False or (confirmed is None and not is_wide):
                continue
            for pair, found in own.items():
                shared.setdefault(pair, {}).update(found)
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


def _confirmed(
    poses: dict[int, pycolmap.Rigid3d], shared: dict[Pair, dict[int, int]], rotation_of: RotationOf
) -> bool | None:
    """Whether the relative rotations of the pairs of images that share most points, far apart in the video, agree with
    the `poses`. None if too few are known."""
    off = []
    apart = [(i, j) for i, j in shared if j - i >= _APART]
    for i, j in sorted(apart, key=lambda pair: -len(shared[pair]))[:_PAIRS]:
        rotation = rotation_of((i, j))
        if rotation is not None:
            relative = poses[j + 1].rotation.matrix() @ poses[i + 1].rotation.matrix().T
            off.append(rotation_angle(relative.T @ rotation))
    return float(np.median(off)) < _TURNED if len(off) >= _VERIFIED else None


def _similarity(
    piece: PosePiece, base: PosePiece
) -> tuple[int, pycolmap.Sim3d | None, NDArray[np.int64], NDArray[np.int64], bool]:
    """How many points agree, the similarity that moves `piece` onto `base`, the agreeing points of both, and whether
    these are spread widely."""
    nothing = np.zeros(0, np.int64)
    pairs = match_descriptors(piece.looks, base.looks, _RATIO)
    if len(pairs) < _FEWEST:
        return 0, None, nothing, nothing, False
    centers = np.array([base.center(int(n)) for n in base.numbers])
    extent = float(np.linalg.norm(np.ptp(centers, axis=0)))
    options = pycolmap.RANSACOptions()
    options.max_error = _NEAR * extent
    options.max_num_trials, options.random_seed = 20_000, 0
    # The function returns a dictionary, although the library declares a Sim3d.
    found: Any = pycolmap.estimate_sim3d_robust(piece.points[pairs[:, 0]], base.points[pairs[:, 1]], options)
    if not found:
        return 0, None, nothing, nothing, False
    agreed = pairs[np.asarray(found["inlier_mask"], bool)]
    spread = np.linalg.svd(base.points[agreed[:, 1]] - base.points[agreed[:, 1]].mean(axis=0), compute_uv=False)
    least = _SPREAD if len(agreed) < _MANY else _SPREAD_OF_MANY
    deviation = spread[1] / max(len(agreed), 1) ** 0.5 / extent
    if deviation < min(least, _SPREAD_OF_CONFIRMED):
        return 0, None, nothing, nothing, False
    return len(agreed), found["tgt_from_src"], agreed[:, 0], agreed[:, 1], bool(deviation >= least)


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
