"""How firmly the parts of a reconstruction are connected, and where they are not.

In front of a bare wall, few points connect the frames on one side to those on the other. Bundle adjustment then has
small errors on both sides although their scales differ. The images alone show how well each place of a video is
connected: move everything after it by a similarity and measure how much worse the images fit. This is the Fisher
information of the seven parameters of that similarity, with all points free.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

_LINK = 45  # points that two images share, at least, where the frames before and after are connected
_LOOSE_PHOTOGRAPHS = 0.05  # like _TOO_LOOSE, for photos, whose features do not drift as tracked points do
_LINK_OF_PHOTOGRAPHS = 15  # like _LINK, for two photos, which share no tracked points
_AROUND = 40  # frames before and after a place from which its connection is measured
_SIDE = 4  # images before and after a cut, at least
_FASTER = 2.8  # times the usual speed; people who start to walk after a turn reach 2.4 times
_FAST, _SHORT = 2.2, 15  # like _FASTER, next to a place without common points; images of a stretch, at most
_TOO_LOOSE = 0.025  # standard deviation of the log scale above which a video is split into pieces


@dataclass(frozen=True, eq=False)
class Observations:
    """A reconstruction as arrays: I images, P points, and N observations of points in images.

    numbers   (I,) int64, image numbers, increasing
    rotation  (I, 3, 3) float64, world to camera
    center    (I, 3) float64, camera centers, world
    focal     (I,) float64, pixels
    image     (N,) int64, index of the image
    point     (N,) int64, index of the point
    places    (P, 3) float64, points, world
    """

    numbers: NDArray[np.int64]
    rotation: NDArray[np.float64]
    center: NDArray[np.float64]
    focal: NDArray[np.float64]
    image: NDArray[np.int64]
    point: NDArray[np.int64]
    places: NDArray[np.float64]

    @cached_property
    def _by_image(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Indices (N,) of the observations, ordered by image, and the first of them of each image (I + 1,)."""
        return np.argsort(self.image, kind="stable"), np.searchsorted(
            np.sort(self.image), np.arange(len(self.numbers) + 1)
        )

    def of_images(self, images: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Indices (K,) of the observations in the selected `images` (I,), by increasing point."""
        order, first = self._by_image
        chosen = [order[first[k] : first[k + 1]] for k in np.flatnonzero(images)]
        found = np.concatenate(chosen) if chosen else np.zeros(0, np.intp)
        return found[np.argsort(self.point[found], kind="stable")]


def observations_of(model: pycolmap.Reconstruction) -> Observations:
    """The images, points, and observations of `model` as arrays."""
    numbers = np.array(sorted(model.reg_image_ids()), np.int64)
    index = {int(n): k for k, n in enumerate(numbers)}
    poses = [model.images[int(n)].cam_from_world() for n in numbers]
    focal = np.array([model.cameras[model.images[int(n)].camera_id].mean_focal_length() for n in numbers])
    image, length, places = list[int](), list[int](), []
    for p in model.points3D.values():
        places.append(p.xyz)
        elements = p.track.elements
        image += [index[element.image_id] for element in elements]
        length.append(len(elements))
    return Observations(
        numbers,
        np.array([pose.rotation.matrix() for pose in poses]),
        np.array([model.images[int(n)].projection_center() for n in numbers]),
        focal,
        np.array(image, np.int64),
        np.repeat(np.arange(len(length)), length),
        np.array(places).reshape(-1, 3),
    )


def firmly_connected_pieces(
    model: pycolmap.Reconstruction, times: NDArray[np.float64], loose: float = _TOO_LOOSE
) -> list[list[int]]:
    """Image numbers of the parts of `model` that are firmly connected, the largest first.

    `times` (N,) are the seconds of image numbers 1 to N of a video. A video is cut where the frames before and after
    are too loosely connected: the standard deviation of their relative log scale is above `loose`. It is also cut at
    jumps, where the camera would move far faster from one frame to the next than around them. Parts are merged again
    if they are connected elsewhere because the camera came back. Photos have no `times`. They are cut where the tree of
    the pairs that share most points is weak.
    """
    seen = observations_of(model)
    if not len(times):
        return _firm_groups(seen)
    count = len(seen.numbers)
    index = np.arange(count)
    shared = shared_points(seen)
    jumps = set(_jumps(seen, times).tolist())
    cuts = []
    for k in range(_SIDE - 1, count - _SIDE):  # a few images do not determine a scale of their own
        if k in jumps or shared[max(0, k - 1) : k + 1, k + 1 : k + 3].max() < _LINK:
            cuts.append(k + 1)
            continue
        if scale_deviation_at(seen, k + 1) > loose:
            cuts.append(k + 1)
    parts = np.split(index, cuts)
    parent = list(range(len(parts)))

    def root(k: int) -> int:
        while parent[k] != k:
            k = parent[k]
        return k

    for i in range(len(parts)):
        for j in range(i):
            if root(i) == root(j) or min(len(parts[i]), len(parts[j])) < 2 or (i == j + 1 and cuts[j] - 1 in jumps):
                continue
            if shared[np.ix_(parts[i], parts[j])].max() < _LINK:
                continue
            if scale_deviation(seen, np.isin(index, parts[i]), np.isin(index, parts[j])) < loose:
                parent[root(i)] = root(j)
    pieces: dict[int, list[int]] = {}
    for k, part in enumerate(parts):
        pieces.setdefault(root(k), []).extend(seen.numbers[part].tolist())
    return sorted((sorted(p) for p in pieces.values()), key=len, reverse=True)


def uncertain_images(model: pycolmap.Reconstruction, times: NDArray[np.float64]) -> set[int]:
    """Image numbers of short stretches of a video that share no points with the images on one side and are a fast step
    away from those on the other. `times` (N,) are the seconds of image numbers 1 to N. Their place is known from one
    side only, and a step of that size contradicts it."""
    seen = observations_of(model)
    shared = shared_points(seen)
    fast = _jumps(seen, times, _FAST)
    found: set[int] = set()
    for k in range(len(seen.numbers) - 1):
        if shared[max(0, k - 1) : k + 1, k + 1 : k + 3].max() < _LINK:
            after = min((f for f in fast if k < f <= k + _SHORT), default=k)
            before = max((f for f in fast if k - _SHORT <= f < k), default=k)
            found.update(seen.numbers[before + 1 : after + 1].tolist())
    return found


def _jumps(seen: Observations, times: NDArray[np.float64], faster: float = _FASTER) -> NDArray[np.int64]:
    """Indices of the images after which the camera moves `faster` times as fast as around them."""
    speed = np.linalg.norm(np.diff(seen.center, axis=0), axis=1) / np.diff(times[seen.numbers - 1])
    usual = [
        np.percentile(np.delete(speed[max(0, k - _AROUND // 2) : k + _AROUND // 2 + 1], min(k, _AROUND // 2)), 90)
        for k in range(len(speed) if len(speed) > 1 else 0)
    ]
    return np.flatnonzero(speed[: len(usual)] > faster * np.array(usual))


def _firm_groups(seen: Observations) -> list[list[int]]:
    """Image numbers of the groups of photos that are firmly connected, the largest first."""
    shared = shared_points(seen)
    np.fill_diagonal(shared, 0)
    # The tree with the smallest weights contains the most shared points. A weight of 0 would mean no edge.
    tree = minimum_spanning_tree(csr_matrix(np.where(shared > 0, 1 / np.maximum(shared, 1), 0))).tocoo()
    links = csr_matrix((np.ones(tree.nnz), (tree.row, tree.col)), shape=shared.shape)
    for i, j in zip(tree.row, tree.col, strict=True):
        cut = links.copy()
        cut[i, j] = 0
        cut.eliminate_zeros()
        _, group = connected_components(cut, directed=False)
        one, other = group == group[i], group == group[j]
        across = shared[np.ix_(one, other)]
        loose = across.max() < _LINK_OF_PHOTOGRAPHS
        if not loose and min(one.sum(), other.sum()) >= _SIDE:  # a few images do not determine a scale of their own
            loose = scale_deviation(seen, one, other) > _LOOSE_PHOTOGRAPHS
        if loose:
            links = cut
    _, group = connected_components(links, directed=False)
    groups = [seen.numbers[group == k].tolist() for k in np.unique(group)]
    return sorted(groups, key=len, reverse=True)


def shared_points(seen: Observations) -> NDArray[np.int64]:
    """(I, I) int64, number of points that two images share."""
    ones = np.ones(len(seen.image), np.int32)
    shows = csr_matrix((ones, (seen.image, seen.point)), shape=(len(seen.numbers), len(seen.places)))
    shows.data[:] = 1
    return np.asarray((shows @ shows.T).toarray(), np.int64)


def scale_deviation_at(seen: Observations, start: int) -> float:
    """The scale deviation at a place of a video: of the images from index `start` on, relative to those before."""
    index = np.arange(len(seen.numbers))
    before, after = (index >= start - _AROUND) & (index < start), (index >= start) & (index < start + _AROUND)
    return scale_deviation(seen, before, after)


def scale_deviation(seen: Observations, one: NDArray[np.bool_], other: NDArray[np.bool_], pixel: float = 1.0) -> float:
    """Standard deviation of the log scale of the images `other` (I,) relative to the images `one` (I,), if features
    have an error of `pixel` pixels. Infinite if the two are not connected."""
    lines = seen.of_images(one | other)
    first = _starts(seen.point[lines])
    sides = np.where(one[seen.image[lines]], 1, 0) + np.where(other[seen.image[lines]], 2, 0)
    on_both = np.bitwise_or.reduceat(sides, first) == 3 if len(lines) else np.zeros(0, bool)
    lines = lines[np.repeat(on_both, np.diff(first, append=len(lines)))]
    if len(lines) < 14:
        return float("inf")
    first, image = _starts(seen.point[lines]), seen.image[lines]
    origin = seen.center[other].mean(axis=0)
    away = seen.places[seen.point[lines]] - seen.center[image]
    x, y, z = np.einsum("nij,nj->in", seen.rotation[image], away)
    ahead, focal = z > 1e-6, seen.focal[image]
    z = np.where(ahead, z, 1.0)
    by_local = np.zeros((len(lines), 2, 3))
    by_local[:, 0, 0] = by_local[:, 1, 1] = focal / z
    by_local[:, 0, 2], by_local[:, 1, 2] = -focal * x / z**2, -focal * y / z**2
    by_point = (by_local @ seen.rotation[image]) * ahead[:, None, None]  # (N, 2, 3) derivative of pixels by points
    # A camera moved by a similarity about `origin` sees a point as if the point were moved by the inverse.
    offset = seen.places[seen.point[lines]] - origin
    moves = np.zeros((len(lines), 3, 7))
    moves[:, :, 0] = -offset
    moves[:, :, 1:4] = -np.eye(3)
    moves[:, 0, 5], moves[:, 0, 6] = -offset[:, 2], offset[:, 1]
    moves[:, 1, 4], moves[:, 1, 6] = offset[:, 2], -offset[:, 0]
    moves[:, 2, 4], moves[:, 2, 5] = -offset[:, 1], offset[:, 0]
    change = (by_point @ moves) * other[image][:, None, None]
    by_point_t = by_point.transpose(0, 2, 1)
    normal = np.add.reduceat(by_point_t @ by_point, first)
    mixed = np.add.reduceat(by_point_t @ change, first)
    inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    flat = change.reshape(-1, 7)
    information = flat.T @ flat - mixed.reshape(-1, 7).T @ (inverse @ mixed).reshape(-1, 7)
    values = np.linalg.eigvalsh(information)
    if not values[0] > 1e-9 * max(values[-1], 1e-12):
        return float("inf")
    return float(pixel * np.sqrt(np.linalg.inv(information)[0, 0]))


def _starts(increasing: NDArray[np.int64]) -> NDArray[np.intp]:
    """Indices of the first of each run of equal numbers."""
    return np.flatnonzero(np.diff(increasing, prepend=-1))
