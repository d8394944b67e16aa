"""Agglomerative clustering of the camera positions, and the overlap between the clusters (paper section III-B). Storeys
are clustered separately.

Storeys are separated only if they are stacked. A hill, a ramp, or a split level has one floor at every place, and
counts as one storey here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.storeys import FEW, storeys

_LEVEL = 0.3  # meters by which cameras on a storey differ from its level
_MOST = 0.7  # least share of such cameras; otherwise the trajectory has one storey
_OVER = 3.0  # meters, seen from above, between cameras of stacked storeys


@dataclass(frozen=True, eq=False)
class TrajectoryStoreys:
    """levels  (S,) meters, world z: height of most cameras on each storey, ascending; (1,) for one storey
    part    (N,) for each camera: 2 k on storey k, 2 k + 1 on a stair from storey k to storey k + 1
    """

    levels: NDArray[np.float64]
    part: NDArray[np.int64]

    def cameras_of_storey(self, storey: int) -> NDArray[np.bool_]:
        """(N,) bool, True for cameras on a storey and on the stairs that lead to it."""
        return np.asarray(np.abs(self.part - 2 * storey) <= 1)

    def nearest(self, heights: NDArray[np.floating] | float) -> NDArray[np.int64]:
        """(...,) int64 index of the storey with the nearest camera level for `heights` (...,), meters, world z."""
        return np.asarray(np.abs(np.asarray(heights)[..., None] - self.levels).argmin(axis=-1), np.int64)


def storeys_of(positions: NDArray[np.floating]) -> TrajectoryStoreys:
    """The storeys of camera `positions` (N, 3), meters."""
    points = np.asarray(positions, np.float64).reshape(-1, 3)
    z = points[:, 2]
    one = TrajectoryStoreys(np.array([np.median(z) if len(z) else 0.0]), np.zeros(len(z), np.int64))
    levels = np.array([s.floor for s in storeys(z)])
    if len(levels) < 2:
        return one
    found = TrajectoryStoreys(levels, np.zeros(len(z), np.int64))
    nearest = found.nearest(z)
    off = z - levels[nearest]
    level = np.abs(off) <= _LEVEL
    if level.mean() < _MOST or not _is_stacked([points[level & (nearest == k), :2] for k in range(len(levels))]):
        return one
    part = 2 * nearest
    part += np.where((off > _LEVEL) & (nearest + 1 < len(levels)), 1, 0)
    part -= np.where((off < -_LEVEL) & (nearest > 0), 1, 0)
    counts = np.bincount(part, minlength=2 * len(levels))
    few = (part % 2 == 1) & (counts[part] < FEW)
    return TrajectoryStoreys(levels, np.where(few, 2 * nearest, part))


def _is_stacked(storeys: list[NDArray[np.float64]]) -> bool:
    """Whether cameras of any two of `storeys`, each (M, 2), are close to each other seen from above."""
    from scipy.spatial import cKDTree

    trees = [cKDTree(places) for places in storeys if len(places)]
    return any(a.count_neighbors(b, _OVER) > 0 for i, a in enumerate(trees) for b in trees[i + 1 :])


@dataclass(frozen=True, eq=False)
class Submap:
    """index    position in the list, also its name on disk
    core      frame indices of the cluster, ascending; every frame is in exactly one core
    frames    core and the frames within the overlap distance of it, ascending
    positions (len(core), 3) float64 camera positions of the core, meters, world; they define "the closest submap"
    """

    index: int
    core: tuple[int, ...]
    frames: tuple[int, ...]
    positions: NDArray[np.float64]


def nearest_submap(submaps: tuple[Submap, ...] | list[Submap], position: NDArray[np.floating]) -> int:
    """Index of the submap with the core camera nearest to `position` (3,), meters (paper Algorithm 1, line 4)."""
    distances = [float(np.min(np.sum((s.positions - position) ** 2, axis=1))) for s in submaps]
    return submaps[int(np.argmin(distances))].index


# Ward linkage stores all pairs of its points: 2000 points are 16 MB and half a second, 20000 would be 1.6 GB.
_MOST_CLUSTERED = 2000
_THINNING = 0.25
_CLIMBED = 3.5  # meters: least overlap for frames on a stair, as far as a corridor reaches
_MOST_TRIED = 4  # times the number of submaps that frames without overlap need
_NEARLY = 1.2  # times the smallest possible size of the largest submap
_APART = 1e4  # meters of vertical offset that separate storeys and stairs into their own clusters


@dataclass(frozen=True)
class SubmapConfig:
    """How the trajectory is split into submaps."""

    count: int | None = None
    """C, the number of submaps. If it is not given, the memory budget determines it."""
    overlap: float = 1.5
    """delta, meters: a frame this close to a frame of the core also belongs to the submap."""
    memory_gb: float = 2.0
    """Peak memory for training one submap, in GB, if the number of submaps is not given."""
    megabytes_per_frame: float = 8.0
    """Peak memory that each training frame adds, in MB."""
    # A 480x360 image as float32 with mask and loss buffers (6 MB), and the 1200 Gaussians that a new view adds on a
    # trajectory with a frame every 0.3 m (parameters, gradient, two Adam moments, gradient rows per thread: 1.5 kB).

    @property
    def frames_per_submap(self) -> int:
        """The largest number of frames, including overlap, that the memory budget allows."""
        return max(1, int(self.memory_gb * 1000 / self.megabytes_per_frame))


def split(positions: NDArray[np.floating], config: SubmapConfig | None = None) -> tuple[Submap, ...]:
    """Split a trajectory into submaps: Ward clusters of the camera `positions` (N, 3), meters, in order of first frame.

    Each submap also contains the frames within `overlap` of its core. The result is deterministic.

    If storeys are stacked, each storey and each stair between two storeys has its own submaps, as far as `count`
    allows. A submap includes frames on a stair from farther away, because a storey shows little of the stair. There are
    never more submaps than distinct positions.

    If `count` is None, it is the smallest number whose largest submap fits the memory budget. If overlap makes that
    impossible, it is the smallest number whose largest submap is nearly the smallest possible. Raises InputError if the
    count or the overlap is invalid.
    """
    config = config or SubmapConfig()
    if config.count is not None and config.count < 1:
        raise InputError(
            f"The number of submaps is {config.count}; give at least 1, or omit it to choose it automatically."
        )
    if not config.overlap >= 0:
        raise InputError(f"The submap overlap is {config.overlap} m; give a distance of 0 m or more.")
    points = np.asarray(positions, np.float64).reshape(-1, 3)
    if len(points) == 0:
        return ()
    parts = storeys_of(points).part
    several = len(np.unique(parts))
    clustered, member = _represent_points(points if several == 1 else points + np.outer(parts, [0.0, 0.0, _APART]))
    most = len(np.unique(clustered, axis=0))
    merges = _ward_merges(clustered)
    reach = np.where(parts % 2 == 1, max(config.overlap, _CLIMBED), config.overlap)
    if config.count is not None:
        return _cut(points, merges, member, min(config.count, most), reach)
    needed = max(-(-len(points) // config.frames_per_submap), several)
    tried: dict[int, tuple[Submap, ...]] = {}
    count = min(several, most)
    while count <= min(most, _MOST_TRIED * needed):
        tried[count] = _cut(points, merges, member, count, reach)
        if _largest(tried[count]) <= config.frames_per_submap:
            return tried[count]
        count = max(count + max(1, count // 10), min(needed, most))
    enough = _NEARLY * min(map(_largest, tried.values()))
    return next(submaps for submaps in tried.values() if _largest(submaps) <= enough)


def _largest(submaps: tuple[Submap, ...]) -> int:
    """The number of frames of the largest submap."""
    return max(len(submap.frames) for submap in submaps)


def table_rows(submaps: tuple[Submap, ...], positions: NDArray[np.floating]) -> list[dict[str, int | str]]:
    """A table of `submaps` over the camera `positions` (N, 3), meters: a row by column name for each submap. Shared
    frames also belong to a neighbor."""
    rows: list[dict[str, int | str]] = []
    for s in submaps:
        size = " x ".join(f"{side:.1f}" for side in np.ptp(np.asarray(positions)[list(s.core)], axis=0))
        shared = len(s.frames) - len(s.core)
        rows.append(
            {"submap": s.index, "frames": len(s.frames), "shared frames": shared, "extent of own frames, m": size}
        )
    return rows


def _represent_points(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """At most _MOST_CLUSTERED points (means over cubes) that represent all, and the index of each point's mean."""
    if len(points) <= _MOST_CLUSTERED:
        return points, np.arange(len(points))
    edge = _THINNING
    while True:
        cells = np.floor((points - points.min(axis=0)) / edge).astype(np.int64)
        _, member = np.unique(cells, axis=0, return_inverse=True)
        member = member.reshape(-1)
        number = int(member.max()) + 1
        if number <= _MOST_CLUSTERED:
            break
        edge *= 1.5
    weight = np.bincount(member, minlength=number)
    means = np.stack([np.bincount(member, points[:, axis], number) / weight for axis in range(3)], axis=1)
    return means, member


def _ward_merges(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """(N - 1, 2) merges in the order of Ward's criterion: ids below N are points, and N + i is the result of merge i.
    The whole tree is computed once, so that testing another number of clusters is cheap."""
    from scipy.cluster.hierarchy import ward
    from scipy.spatial.distance import pdist

    if len(points) == 1:
        return np.empty((0, 2), np.int64)
    return ward(pdist(points))[:, :2].astype(np.int64)


def _cut(
    points: NDArray[np.float64],
    merges: NDArray[np.int64],
    member: NDArray[np.int64],
    count: int,
    reach: NDArray[np.float64],
) -> tuple[Submap, ...]:
    """The clusters after all but the last `count` - 1 merges, each with the frames no farther from it than their
    `reach` (N,), meters."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    leaves = len(merges) + 1
    done = leaves - count
    rows, columns = leaves + np.repeat(np.arange(done), 2), merges[:done].reshape(-1)
    tree = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * leaves - 1, 2 * leaves - 1))
    labels = connected_components(tree, directed=False)[1][:leaves][member]
    _, first = np.unique(labels, return_index=True)
    submaps = []
    for index, frame in enumerate(np.sort(first)):
        core = np.flatnonzero(labels == labels[frame])
        distance, _ = cKDTree(points[core]).query(points, distance_upper_bound=reach.max() + 1e-9)
        frames = np.union1d(core, np.flatnonzero(distance <= reach))
        submaps.append(Submap(index, tuple(core.tolist()), tuple(frames.tolist()), points[core]))
    return tuple(submaps)
