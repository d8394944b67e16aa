"""Split a reconstruction into its unconnected pieces, and remove images that only connect others."""

from __future__ import annotations

import copy
from bisect import bisect_left
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.geometry.rotation import rotation_angle
from nvsim.poses.mapping import center_of, keep_images, poses_of
from nvsim.poses.piece_reliability import Observations, firmly_connected_pieces, observations_of

LEAST = 8  # images of a piece with a scale of its own, at least
_KNOWN = 30  # points of a piece that an image beside it sees, at least
_BRIDGE, _TURNED = 3, 25.0  # images in a row that may be removed; degrees from the image before to the image after


def split_after(pieces: Iterable[Sequence[int]], cuts: Collection[int]) -> list[list[int]]:
    """The `pieces` (image numbers), each split after the images in `cuts`, the largest first. A cut applies to a piece
    also if its image is not in it."""
    found: list[list[int]] = []
    bounds = sorted(cuts)
    for piece in pieces:
        runs: dict[int, list[int]] = {}
        for n in sorted(piece):
            runs.setdefault(bisect_left(bounds, n), []).append(n)
        found.extend(runs.values())
    return sorted(found, key=len, reverse=True)


def split_off(pieces: Iterable[Sequence[int]], images: Collection[int]) -> list[list[int]]:
    """The `pieces` (image numbers), without `images`, which become pieces of their own; the largest first."""
    parts = [[n for n in piece if (n in images) == apart] for piece in pieces for apart in (False, True)]
    return sorted((part for part in parts if part), key=len, reverse=True)


def with_single_images(pieces: Sequence[Sequence[int]]) -> list[list[int]]:
    """The `pieces` (image numbers), the largest first, where a single image belongs to the piece of the image before
    and the image after it: its place is between theirs."""
    piece_of = {n: k for k, piece in enumerate(pieces) for n in piece}
    found = [list(piece) for piece in pieces]
    for k, piece in enumerate(pieces):
        before, after = piece_of.get(piece[0] - 1), piece_of.get(piece[0] + 1)
        if len(piece) == 1 and before is not None and before == after:
            found[before].append(piece[0])
            found[k].clear()
    return sorted((sorted(piece) for piece in found if piece), key=len, reverse=True)


def with_images_beside(
    model: pycolmap.Reconstruction, pieces: Sequence[Sequence[int]], reach: float
) -> list[list[int]]:
    """The `pieces` (image numbers), the largest first, where images of small pieces belong to a larger piece if they
    are at most `reach` beside it and see many of its points."""
    groups = [list(p) for p in pieces if len(p) >= LEAST]
    loose = {n for p in pieces if len(p) < LEAST for n in p}
    if not loose:
        return groups
    seen, poses = observations_of(model), poses_of(model)
    for group in groups:
        group.extend(images_beside(poses, seen, group, loose, reach))
        loose -= set(group)
    rest = [left for p in pieces if len(p) < LEAST and (left := [n for n in p if n in loose])]
    return sorted((sorted(p) for p in [*groups, *rest]), key=len, reverse=True)


def ends_of_group(group: Sequence[int]) -> list[tuple[int, int]]:
    """The images of a group before (-1) or after (1) which an image of another group comes, and this direction."""
    return [(n, towards) for n in sorted(group) for towards in (-1, 1) if n + towards not in group]


def images_beside(
    poses: Mapping[int, pycolmap.Rigid3d], seen: Observations, group: Sequence[int], loose: set[int], reach: float
) -> list[int]:
    """The `loose` images next to those of a group that see many of its points, at most `reach` from it, in the unit of
    `poses`. Their poses are as exact as those points, although the images beyond them may have another scale."""
    inside = np.isin(seen.numbers, group)
    own = np.bincount(seen.point[inside[seen.image]], minlength=len(seen.places)) >= 2
    known = dict(zip(seen.numbers.tolist(), np.bincount(seen.image[own[seen.point]], minlength=len(inside))))
    found: list[int] = []
    for end, towards in ends_of_group(group):
        n = end + towards
        while n in loose and n not in found and known[n] >= _KNOWN:
            if np.linalg.norm(center_of(poses[n]) - center_of(poses[end])) > reach:
                break
            found.append(n)
            n += towards
    return found


def split_into_pieces(
    model: pycolmap.Reconstruction,
    pieces: Sequence[Sequence[int]],
    others: Sequence[pycolmap.Reconstruction],
    times: NDArray[np.float64],
) -> list[pycolmap.Reconstruction]:
    """Splits reconstructions into pieces, the largest first.

    The pieces are the `pieces` of `model` (image numbers) and the firm pieces of `others` without images of `model`.
    `times` (N,) are the seconds of image numbers 1 to N. Each piece has its own unit. The largest of the
    `pieces` is `model` itself, without the images of the others."""
    first, *rest = pieces
    found = [model, *(submodel(model, part) for part in rest)]
    placed = set(model.reg_image_ids())
    for other in others:
        if not set(other.reg_image_ids()) - placed:
            continue
        for part in firmly_connected_pieces(other, times):
            left = set(part) - placed
            if left:
                found.append(submodel(other, left))
                placed |= left
    keep_images(model, first)
    return sorted(found, key=lambda piece: -piece.num_reg_images())


def submodel(model: pycolmap.Reconstruction, numbers: Collection[int]) -> pycolmap.Reconstruction:
    """A copy of `model` with some of its images."""
    part = copy.deepcopy(model)
    keep_images(part, numbers)
    return part


def without_bridges(model: pycolmap.Reconstruction, blurred: Collection[str]) -> tuple[str, ...]:
    """Removes images named in `blurred` from the model of a video, in place, and returns their names.

    A blurred frame connects the frames around it, and would blur a model that is trained on it. Between two sharp
    images, as many stay as are needed so that every image has something in common with the next."""
    numbers = sorted(model.reg_image_ids())
    turns = {number: model.images[number].cam_from_world().rotation.matrix() for number in numbers}
    sharp = [k for k, number in enumerate(numbers) if model.images[number].name not in blurred]

    def is_near(one: int, other: int) -> bool:
        return other - one <= _BRIDGE + 1 and rotation_angle(turns[other] @ turns[one].T) < _TURNED

    removed: set[int] = set()
    for before, after in zip(sharp, sharp[1:]):
        last, following = numbers[before], numbers[before + 1 : after + 1]
        while following:
            near = [k for k, number in enumerate(following) if is_near(last, number)]
            farthest = max(near, default=0)
            removed.update(following[:farthest])
            last, following = following[farthest], following[farthest + 1 :]
    names = tuple(model.images[number].name for number in sorted(removed))
    if removed:
        keep_images(model, set(numbers) - removed)
    return names


def names_in(model: pycolmap.Reconstruction) -> tuple[str, ...]:
    """Names of the images with a pose, by image number."""
    return tuple(model.images[number].name for number in sorted(model.reg_image_ids()))
