"""Correct drift: move short parts of a video by similarities so that its loops close.

Over a long video, scale and direction drift a little at every turn. Bundle adjustment cannot correct this, because the
points of a loop are too far from where the images show them. Similarities of parts can (Strasdat et al. 2010). Bundle
adjustment follows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix, kron
from scipy.spatial.transform import Rotation

from nvsim.geometry.rotation import fitted_similarity, level_axes
from nvsim.poses.match_database import Pair
from nvsim.poses.two_views import TwoViews

PART = 12  # images of a part
FIRM = (0.03, 0.01, 0.03)  # usual drift from part to part: logarithm of scale, radians, share of the depth
_OFF = 0.05  # depths: distance of the two positions of a point of a closed loop
_CLOSED = 0.07  # depths: with a smaller distance, the floor and walls are more accurate than the loop
_COUNTED, _SOLVED = 15, 60  # effective number of points that two parts share, at most; number that is used, at most
_GROWTHS = 6  # rounds in which loops are added
_PLAUSIBLE = 0.8  # depths: farther apart, the two views may show two places
_MANY, _MOST, _SAME_SHIFT = 20, 0.6, 0.3  # loops between two pieces, at least; share that agrees; depths of agreement
_SPREAD = 0.4  # depths: least deviation, in both directions of the plan, of the places of these loops
_BENT, _FEW_BENT = 0.15, 0.15  # allowed change of a part's shape over its extent; allowed share of parts beyond it
_FEWEST = 8  # points of a loop, at least
LOOSE = (0.3, 0.05, 0.1)  # usual drift, in camera heights, where few points connect the parts
_GAUGE = np.array([1.0, 1.0, 1.0, 1.0, 100.0, 100.0, 100.0])  # weights that hold the first part in place
_DRIFT = 7.0  # errors of a wall direction by which parts usually drift; far larger ones belong to oblique walls
_HEIGHT, _WALL = 0.03, 0.007  # errors of the anchors: logarithm of the height, radians


@dataclass(frozen=True, eq=False)
class _Loops:
    """Pairs of positions of points that a loop shows twice.

    first, second            (M, 3) positions of each point by one part and by the other, world
    first_part, second_part  (M,) the parts
    pair                     (M,) index of the pair of images
    sure                     (M,) weights: inverse of the allowed distance
    """

    first: NDArray[np.float64]
    second: NDArray[np.float64]
    first_part: NDArray[np.int64]
    second_part: NDArray[np.int64]
    pair: NDArray[np.int64]
    sure: NDArray[np.float64]

    def select(self, rows: NDArray[np.bool_]) -> _Loops:
        """The points selected by the mask `rows` (M,)."""
        return _Loops(
            self.first[rows],
            self.second[rows],
            self.first_part[rows],
            self.second_part[rows],
            self.pair[rows],
            self.sure[rows],
        )

    def with_weights(self) -> _Loops:
        """At most 60 points of the same two parts, evenly chosen, with weights that count them as at most 15: they have
        similar errors, whichever pairs of images they come from."""
        parts = np.stack([self.first_part, self.second_part])
        _, group, count = np.unique(parts, axis=1, return_inverse=True, return_counts=True)
        group = group.ravel()
        rank = np.empty(len(group), np.int64)
        rank[np.argsort(group, kind="stable")] = np.concatenate([np.arange(n) for n in count])
        count = count[group]
        few = replace(self, sure=self.sure * np.minimum(1, _COUNTED / np.minimum(count, _SOLVED)) ** 0.5)
        return few.select((count <= _SOLVED) | ((rank + 1) * _SOLVED // count > rank * _SOLVED // count))


@dataclass(frozen=True, eq=False)
class PartAnchors:
    """Height, vertical, and walls of each of K parts, NaN where unknown.

    height  (K,) float64, height of the cameras above the floor
    up      (K, 3) float64, unit vectors of the vertical, world
    tilt    (K,) float64, standard deviations of the vertical, radians
    wall    (K, 3) float64, unit vectors, world, along the walls or at right angles to them
    """

    height: NDArray[np.float64]
    up: NDArray[np.float64]
    tilt: NDArray[np.float64]
    wall: NDArray[np.float64]


def empty_loops() -> _Loops:
    """An empty set of loops."""
    none, whole = np.zeros((0, 3)), np.zeros(0, np.int64)
    return _Loops(none, none, whole, whole, whole, np.zeros(0))


def empty_anchors(parts: int) -> PartAnchors:
    """Anchors of `parts` parts without any known value."""
    unknown = np.full((parts, 3), np.nan)
    return PartAnchors(unknown[:, 0], unknown, unknown[:, 0], unknown)


def without_drift(
    model: pycolmap.Reconstruction,
    loops: Mapping[Pair, TwoViews],
    anchored: Callable[[list[list[int]]], PartAnchors] | None = None,
    pieces: Sequence[Sequence[int]] = (),
) -> tuple[dict[int, pycolmap.Rigid3d], list[Pair]]:
    """Closes `loops`. Returns poses (world to camera, by image number) and the closed loops.

    A loop is closed if it agrees with the other loops. Its two views of a place must also be near each other. Otherwise
    they could show two similar places, such as two doors of a corridor. `anchored` returns the anchors of parts,
    each given by its image numbers. `pieces` are the image numbers of the firm pieces of an upright reconstruction.
    Their relative place is uncertain, so many loops that agree may move one piece by more."""
    numbers = np.array(sorted(model.reg_image_ids()))
    poses = {int(n): model.images[int(n)].cam_from_world() for n in numbers}
    piece_of = np.zeros(int(numbers[-1]) + 1, np.int64)
    for k, piece in enumerate(pieces):
        piece_of[list(piece)] = k
    rows = np.split(np.arange(len(numbers)), np.flatnonzero(np.diff(piece_of[numbers])) + 1)
    rows = [part for run in rows for part in np.array_split(run, -(-len(run) // PART))]
    part_of = {int(n): k for k, part in enumerate(rows) for n in numbers[part]}
    pairs = [p for p in loops if p[0] + 1 in poses and p[1] + 1 in poses]
    depth = median_depth(model)
    seen = _points_of_loops(model, {p: loops[p] for p in pairs}, part_of, depth)
    moves, used = np.zeros((len(rows), 7)), np.zeros(len(pairs), bool)
    if len(rows) < 2:
        return poses, []
    shift = _shifts_of_pieces(seen, np.array([piece_of[numbers[part[0]]] for part in rows]), len(pairs), depth)
    by = np.pad(shift, ((0, 0), (4, 0)))
    poses = {n: transform_pose(pose, by[part_of[n]], np.zeros(3)) for n, pose in poses.items()}
    seen = replace(seen, first=seen.first + shift[seen.first_part], second=seen.second + shift[seen.second_part])
    centers = np.array([-poses[int(n)].rotation.matrix().T @ poses[int(n)].translation for n in numbers])
    pivot = np.array([centers[part].mean(axis=0) for part in rows])
    joint = np.array([centers[part[0]] for part in rows[1:]])
    groups = [numbers[part].tolist() for part in rows]
    anchors = empty_anchors(len(rows)) if anchored is None else anchored(groups)
    plausible = _near_pairs(seen, moves, pivot, len(pairs), _PLAUSIBLE * depth)
    if anchored is not None and plausible.any() and _loop_distance(seen, plausible) < _CLOSED * depth:
        return poses, [pair for pair, use in zip(pairs, plausible, strict=True) if use]
    for _ in range(_GROWTHS):  # closed loops bring the two views of other loops near each other
        grown = used | _near_pairs(seen, moves, pivot, len(pairs), _PLAUSIBLE * depth)
        if (grown == used).all():
            break
        used = grown
        moves = _solve(seen.select(used[seen.pair]), pivot, joint, depth, anchors)
    while used.any():
        agree = used & _near_pairs(seen, moves, pivot, len(pairs), 2 * _OFF * depth)
        if (agree == used).all():
            break
        used = agree
        if used.any():
            moves = _solve(seen.select(used[seen.pair]), pivot, joint, depth, anchors)
    kept = [pair for pair, use in zip(pairs, used, strict=True) if use]
    if not kept:
        return poses, []
    return {n: transform_pose(pose, moves[part_of[n]], pivot[part_of[n]]) for n, pose in poses.items()}, kept


def keeps_shape(before: pycolmap.Reconstruction, after: pycolmap.Reconstruction) -> bool:
    """Whether nearly all short parts of the video keep their shape. Over a second or two, tracks alone determine the
    shape to a few percent. Loops that bend it are wrong or could not be adjusted."""
    depth = median_depth(before)
    numbers = sorted(set(before.reg_image_ids()) & set(after.reg_image_ids()))
    old, new = (np.array([m.images[n].projection_center() for n in numbers]).reshape(-1, 3) for m in (before, after))
    bent = []
    for k in range(0, len(numbers) - PART + 1, PART // 2):
        one, other = old[k : k + PART], new[k : k + PART]
        extent = float(np.linalg.norm(np.ptp(one, axis=0)))
        if extent < FIRM[2] * depth:
            continue  # a rotation in place has no shape
        scale, rotation, shift = fitted_similarity(other, one)
        moved = scale * other @ rotation.T + shift
        bent.append(np.linalg.norm(moved - one, axis=1).max() > max(_BENT * extent, FIRM[2] * depth))
    return sum(bent) <= _FEW_BENT * len(bent)


def _near_pairs(
    seen: _Loops, moves: NDArray[np.float64], pivot: NDArray[np.float64], count: int, most: float
) -> NDArray[np.bool_]:
    """(count,) bool, pairs of images with enough points and a median distance below `most` after `moves`."""
    off = np.linalg.norm(
        _apply_similarities(moves[seen.first_part], pivot[seen.first_part], seen.first)
        - _apply_similarities(moves[seen.second_part], pivot[seen.second_part], seen.second),
        axis=1,
    )
    own = [off[seen.pair == k] for k in range(count)]
    return np.array([len(o) >= _FEWEST and np.median(o) < most for o in own], bool)


def _shifts_of_pieces(seen: _Loops, piece: NDArray[np.int64], count: int, depth: float) -> NDArray[np.float64]:
    """(K, 3) translations of the K parts, which belong to the pieces `piece` (K,), that bring the two views of places
    nearer in `count` pairs of images.

    Identical doors of one corridor agree on a translation along it. Therefore the loops between two pieces must be many
    and spread over the plan, and most of them must agree."""
    off, where = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    between = np.full((count, 2), -1)
    for k in range(count):
        rows = np.flatnonzero(seen.pair == k)
        if len(rows) >= _FEWEST:
            off[k] = np.median(seen.first[rows] - seen.second[rows], axis=0)
            where[k] = np.median(seen.first[rows], axis=0)
            between[k] = piece[seen.first_part[rows[0]]], piece[seen.second_part[rows[0]]]
    links = []
    for a, b in np.unique(between[between[:, 0] != between[:, 1]], axis=0):
        rows = np.flatnonzero((between == (a, b)).all(axis=1))
        usual = np.median(off[rows], axis=0)
        agree = np.linalg.norm(off[rows] - usual, axis=1) < _SAME_SHIFT * depth
        if agree.sum() < _MANY or agree.mean() < _MOST:
            continue
        if np.linalg.eigvalsh(np.cov(where[rows[agree], :2].T))[0] > (_SPREAD * depth) ** 2:
            links.append((int(agree.sum()), int(a), int(b), usual))
    group, shift = np.arange(piece.max() + 1), np.zeros((piece.max() + 1, 3))
    for _, a, b, usual in sorted(links, key=lambda link: -link[0]):
        if group[a] != group[b]:
            own = group == group[b]
            shift[own] += shift[a] + usual - shift[b]
            group[own] = group[a]
    return shift[piece]


def _loop_distance(seen: _Loops, pairs: NDArray[np.bool_]) -> float:
    """Distance between the two views of a place: the median over the selected pairs of images."""
    off = np.linalg.norm(seen.first - seen.second, axis=1)
    return float(np.median([np.median(off[seen.pair == k]) for k in np.flatnonzero(pairs)]))


def median_depth(model: pycolmap.Reconstruction) -> float:
    """Median distance from a camera to a point that it shows, in the unit of the model."""
    points = list(model.points3D.values())[:: max(1, len(model.points3D) // 2000)]
    if not points:
        return 1.0
    seen = [model.images[p.track.elements[0].image_id].projection_center() for p in points]
    return float(np.median(np.linalg.norm(np.array([p.xyz for p in points]) - np.array(seen), axis=1)))


def _points_of_loops(
    model: pycolmap.Reconstruction, loops: Mapping[Pair, TwoViews], part_of: Mapping[int, int], depth: float
) -> _Loops:
    first, second, sure = list[NDArray[np.float64]](), list[NDArray[np.float64]](), list[float]()
    first_part, second_part, pair = list[int](), list[int](), list[int]()
    for k, ((i, j), views) in enumerate(loops.items()):
        one, other = model.images[i + 1].points2D, model.images[j + 1].points2D
        eye = np.asarray(model.images[i + 1].projection_center())
        for a, b in views.matches:
            x, y = one[int(a)], other[int(b)]
            if x.has_point3D() and y.has_point3D():
                first.append(model.points3D[x.point3D_id].xyz)
                second.append(model.points3D[y.point3D_id].xyz)
                first_part.append(part_of[i + 1])
                second_part.append(part_of[j + 1])
                pair.append(k)
                # The error of a point grows with the square of its distance.
                away = float(np.linalg.norm(first[-1] - eye)) / depth
                sure.append(1 / (_OFF * depth * max(1.0, away**2)))
    if not pair:
        return empty_loops()
    return _Loops(
        np.array(first).reshape(-1, 3),
        np.array(second).reshape(-1, 3),
        np.array(first_part, np.int64),
        np.array(second_part, np.int64),
        np.array(pair, np.int64),
        np.array(sure),
    )


def _solve(
    loops: _Loops, pivot: NDArray[np.float64], joint: NDArray[np.float64], depth: float, anchors: PartAnchors
) -> NDArray[np.float64]:
    """(K, 7) for each part: logarithm of scale, rotation vector, translation."""
    slip = np.tile([FIRM[0], *[FIRM[1]] * 3, *[FIRM[2] * depth] * 3], (len(joint), 1))
    return solve(loops.with_weights(), pivot, joint, slip, anchors)


def solve(
    loops: _Loops,
    pivot: NDArray[np.float64],
    joint: NDArray[np.float64],
    slip: NDArray[np.float64],
    anchors: PartAnchors,
) -> NDArray[np.float64]:
    """Moves parts so that loops close and anchors agree.

    Returns (K, 7) for each part: logarithm of scale, rotation vector in radians, translation, about its `pivot` (K, 3).
    Neighboring parts meet at `joint` (K - 1, 3) and differ by about `slip` (K - 1, 7), standard deviations."""
    parts = len(pivot)
    before, after = np.arange(parts - 1), np.arange(1, parts)
    count = len(loops.pair)
    high = np.flatnonzero(np.isfinite(anchors.height))
    level = np.flatnonzero(np.isfinite(anchors.up[:, 0]))
    walled = np.flatnonzero(np.isfinite(anchors.wall[:, 0]))
    usual = float(np.median(np.log(anchors.height[high]))) if len(high) else 0.0
    up = (anchors.up[level] / anchors.tilt[level, None]).sum(axis=0) if len(level) else np.array([0, 0, 1.0])
    up /= np.linalg.norm(up)
    east, north = level_axes(up)

    # Without anchors, only this term determines the pose of the first part.
    gauge = _GAUGE if len(high) + len(walled) else np.full(7, 100.0)

    def wall_angles(moves: NDArray[np.float64]) -> NDArray[np.float64]:
        turned = Rotation.from_rotvec(moves[walled, 1:4]).apply(anchors.wall[walled])
        return np.arctan2(turned @ north, turned @ east)

    quarter = np.exp(4j * wall_angles(np.zeros((parts, 7)))).sum() if len(walled) else 1.0
    main = np.angle(quarter) / 4

    def residuals(flat: NDArray[np.float64]) -> NDArray[np.float64]:
        moves = flat.reshape(parts, 7)
        slips = np.concatenate(
            [
                moves[after, :4] - moves[before, :4],
                _apply_similarities(moves[after], pivot[after], joint)
                - _apply_similarities(moves[before], pivot[before], joint),
            ],
            axis=1,
        )
        open_ = _apply_similarities(
            moves[loops.first_part], pivot[loops.first_part], loops.first
        ) - _apply_similarities(moves[loops.second_part], pivot[loops.second_part], loops.second)
        off = np.linalg.norm(open_, axis=1) * loops.sure
        # The Cauchy loss is applied here because it is used for loops and walls only.
        weight = np.sqrt(np.log1p(off**2)) / np.maximum(off, 1e-9) * loops.sure
        aside = ((wall_angles(moves) - main + np.pi / 4) % (np.pi / 2) - np.pi / 4) / _WALL
        return np.concatenate(
            [
                (slips / slip).ravel(),
                (open_ * weight[:, None]).ravel(),
                (moves[high, 0] + np.log(anchors.height[high]) - usual) / _HEIGHT,
                (
                    (Rotation.from_rotvec(moves[level, 1:4]).apply(anchors.up[level]) - up) / anchors.tilt[level, None]
                ).ravel(),
                np.sign(aside) * _DRIFT * np.sqrt(np.log1p((aside / _DRIFT) ** 2)),
                moves[0] * gauge,
            ]
        )

    slips, open_points = np.arange(7 * (parts - 1)), 7 * (parts - 1) + np.arange(3 * count)
    held = np.concatenate([high, np.repeat(level, 3), walled, np.zeros(7, np.int64)])
    rows = [slips, slips, open_points, open_points, 7 * (parts - 1) + 3 * count + np.arange(len(held))]
    moved = [before.repeat(7), after.repeat(7), loops.first_part.repeat(3), loops.second_part.repeat(3), held]
    row, part = np.concatenate(rows), np.concatenate(moved)
    touched = csr_matrix((np.ones(len(row), np.int8), (row, part)), (int(rows[-1][-1]) + 1, parts))
    pattern = kron(touched, np.ones((1, 7), np.int8), "csr")
    found = least_squares(residuals, np.zeros(7 * parts), jac_sparsity=pattern, x_scale="jac", max_nfev=100)
    return np.asarray(found.x.reshape(parts, 7))


def _apply_similarities(
    moves: NDArray[np.float64], pivot: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N, 3) points after the similarities `moves` (N, 7) about `pivot` (N, 3)."""
    turned = Rotation.from_rotvec(moves[:, 1:4]).apply(points - pivot)
    return np.asarray(np.exp(moves[:, :1]) * turned + pivot + moves[:, 4:])


def transform_pose(pose: pycolmap.Rigid3d, move: NDArray[np.float64], pivot: NDArray[np.float64]) -> pycolmap.Rigid3d:
    """A pose, world to camera, after the similarity `move` (7,) of the world about `pivot` (3,)."""
    rotation = pose.rotation.matrix()
    center = _apply_similarities(move[None], pivot[None], (-rotation.T @ pose.translation)[None])[0]
    turned = rotation @ Rotation.from_rotvec(move[1:4]).as_matrix().T
    return pycolmap.Rigid3d(pycolmap.Rotation3d(turned), -turned @ center)
