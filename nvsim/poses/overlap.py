"""Matches between images, found without the given poses. The given poses are tested against these matches.

A large capture is sampled. The sample has short runs of frames in file order, spread over the capture. It also has
every frame whose image is unlike both of its neighbors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import decode
from nvsim.capture.types import Frame
from nvsim.errors import InputError
from nvsim.geometry.sampling import evenly_spaced
from nvsim.poses.features import NOTHING, Features, find_features, match_features
from nvsim.poses.threads import thread_pool

SIDE = 640  # pixels of the longest side of the images that are matched
_FEATURES = 500  # features of an image
_ALL = 56  # frames: a capture with no more frames is not sampled
_RUNS, _OFFSETS = 14, (0, 1, 3, 9)  # of a sampled capture: number of runs, and frames of each run
_GAPS, _WIDE_GAPS = (1, 2), (4, 8)  # in file order, between matched frames if all frames are used
_WIDE = 56  # pairs with wide gaps, at most
_PAIRS = 150  # pairs chosen without regard to file order, at most
_FEW_PAIRS = 12  # with fewer matched pairs, other pairs are tried
_OFF = 1.5  # pixels from an epipolar line, of images of SIDE
_MATCHES, _SHARE = 24, 0.5  # matches that agree with one fundamental matrix, at least: number, and share of all
_CHANCE = 20  # similar features of images that have nothing in common, at most
_KEPT = 60  # matches of a pair that are kept, at most
_THUMBNAIL = (32, 24)
_UNLIKE = 0.3  # correlation of the two neighbors minus the correlation with them, at least, for an odd frame
_ODD = 12  # odd frames (unlike their neighbors) that are examined, at most
_THUMBNAILS = 1000  # frames; in larger captures, odd frames are not searched


@dataclass(frozen=True, eq=False)
class Overlap:
    """Two images that show one place, with their matches.

    first, second  indices of the frames, first < second
    places         (M, 2, 2) float64, pixels of the stored images; the axes are match, image, and x and y
    """

    first: int
    second: int
    places: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Overlaps:
    """The pairs of images that overlap.

    pairs             pairs of images that show one place
    unmatched_frames  indices of frames that match neither neighbor in file order, although their neighbors match each
                      other
    order             indices of all frames in file order, one camera after the other
    """

    pairs: tuple[Overlap, ...]
    unmatched_frames: tuple[int, ...]
    order: tuple[int, ...]


def find_overlaps(frames: Sequence[Frame]) -> Overlaps:
    """Matches pairs of `frames` that are near in file order. If too few pairs match, it also compares frames whose
    poses are near. Images that cannot be read have no match."""
    with thread_pool() as pool:
        return _OverlapSearch(frames, lambda work, items: list(pool.map(work, items))).run()


class _OverlapSearch:
    def __init__(self, frames: Sequence[Frame], mapped: Callable[..., list]) -> None:
        self._frames, self._mapped = frames, mapped
        self._order = _in_order(frames)
        self._features: dict[int, Features] = {}
        self._tried: dict[tuple[int, int], Overlap | None] = {}
        self._alike: dict[tuple[int, int], int] = {}

    def run(self) -> Overlaps:
        count = len(self._frames)
        if count <= _ALL:
            odd: list[int] = []
            near = [(i, i + gap) for i in range(count) for gap in _GAPS if i + gap < count]
            wide = [(i, i + gap) for i in range(count) for gap in _WIDE_GAPS if i + gap < count]
            near += [wide[k] for k in evenly_spaced(len(wide), _WIDE)]
        else:
            odd = self._unlike_neighbors()
            starts = evenly_spaced(count - _OFFSETS[-1], _RUNS)
            runs = [[start + offset for offset in _OFFSETS] for start in starts]
            near = [(a, b) for run in runs for k, a in enumerate(run) for b in run[k + 1 :]]
        for k in odd:
            near += [(k - 1, k), (k, k + 1), (k - 1, k + 1)]
        self._match((self._order[a], self._order[b]) for a, b in near)
        sampled = list(self._features)
        if self._count_found() < _FEW_PAIRS:
            self._match(self._near_by_pose(sampled))
        if self._count_found() < _FEW_PAIRS:
            everything = [(a, b) for k, a in enumerate(sampled) for b in sampled[k + 1 :]]
            self._match(everything[k] for k in evenly_spaced(len(everything), _PAIRS))
        strangers = self._frames_unlike_neighbors(odd if odd else range(1, count - 1) if count <= _ALL else ())
        self._match((s, other) for s in strangers[:_ODD] for other in sampled)
        return Overlaps(
            tuple(found for found in self._tried.values() if found is not None), strangers, tuple(self._order)
        )

    def _count_found(self) -> int:
        return sum(found is not None for found in self._tried.values())

    def _match(self, pairs: Iterable[tuple[int, int]]) -> None:
        new = list(dict.fromkeys((min(p), max(p)) for p in pairs if p[0] != p[1]))
        new = [pair for pair in new if pair not in self._tried]
        missing = [i for i in dict.fromkeys(i for pair in new for i in pair) if i not in self._features]
        self._features.update(zip(missing, self._mapped(self._features_of_image, missing), strict=True))
        self._tried.update(zip(new, self._mapped(self._compare, new), strict=True))

    def _features_of_image(self, index: int) -> Features:
        """The features of an image, in pixels of the stored image."""
        image = _image(self._frames[index])
        if image is None:
            return NOTHING
        factor = min(1.0, SIDE / max(image.shape[:2]))
        if factor < 1:
            smaller = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
            image = np.asarray(smaller, np.uint8)
        found = find_features(image, _FEATURES)
        return Features(found.places / factor, found.descriptors)

    def _compare(self, pair: tuple[int, int]) -> Overlap | None:
        one, other = (self._features[i] for i in pair)
        matches = match_features(one, other)
        self._alike[pair] = len(matches)
        if len(matches) < _MATCHES:
            return None
        a, b = one.places[matches[:, 0]], other.places[matches[:, 1]]
        lens = self._frames[pair[0]].lens
        off = _OFF * max(1.0, max(lens.width, lens.height) / SIDE)
        _, agree = cv2.findFundamentalMat(a, b, cv2.FM_RANSAC, off, 0.995, 500)
        if agree is None:
            return None
        rows = np.flatnonzero(agree.ravel())
        if len(rows) < max(_MATCHES, _SHARE * len(matches)):
            return None
        rows = rows[evenly_spaced(len(rows), _KEPT)]
        return Overlap(*pair, np.stack([a[rows], b[rows]], axis=1))

    def _near_by_pose(self, sampled: Sequence[int]) -> list[tuple[int, int]]:
        """For each frame, the three frames nearest by given position with a similar viewing direction."""
        poses = np.stack([self._frames[i].camera_to_world for i in sampled]) if sampled else np.zeros((0, 4, 4))
        pairs = []
        for i, pose in enumerate(poses):
            similar = np.flatnonzero(poses[:, :3, 2] @ pose[:3, 2] > 0.7)
            distance = np.linalg.norm(poses[similar, :3, 3] - pose[:3, 3], axis=1)
            pairs += [(sampled[i], sampled[j]) for j in similar[np.argsort(distance, kind="stable")[:4]] if j != i]
        return pairs

    def _frames_unlike_neighbors(self, places: Iterable[int]) -> tuple[int, ...]:
        """Frames, by their indices in file order, with many features that their neighbors do not show."""
        found = []
        for k in places:
            before, here, after = (self._order[k + step] for step in (-1, 0, 1))
            shared = (self._alike.get((min(here, other), max(here, other)), _CHANCE) for other in (before, after))
            if max(shared) >= _CHANCE:
                continue
            bridged = self._tried.get((min(before, after), max(before, after))) is not None
            if bridged and len(self._features[here]) >= _FEATURES // 4:
                found.append(here)
        return tuple(found)

    def _unlike_neighbors(self) -> list[int]:
        """Indices in file order of the frames whose thumbnail is unlike both neighbors, the most unlike first."""
        if len(self._frames) > _THUMBNAILS:
            return []
        small = np.stack(self._mapped(_thumbnail, [self._frames[i] for i in self._order]))
        next_one, next_but_one = (small[:-1] * small[1:]).sum(axis=1), (small[:-2] * small[2:]).sum(axis=1)
        unlike = next_but_one - np.maximum(next_one[:-1], next_one[1:])
        worst = np.argsort(-unlike)[:_ODD]
        return [int(k) + 1 for k in worst if unlike[k] > _UNLIKE]


def _in_order(frames: Sequence[Frame]) -> list[int]:
    """Indices of the frames, one camera after the other if each camera has several images."""
    sensors = list(dict.fromkeys(frame.sensor for frame in frames))
    if len(sensors) * 4 > len(frames):
        return list(range(len(frames)))
    return sorted(range(len(frames)), key=lambda i: (sensors.index(frames[i].sensor), i))


def _image(frame: Frame) -> NDArray[np.uint8] | None:
    try:
        return decode(frame.image_path, (frame.lens.width, frame.lens.height))
    except InputError:
        return None


def _thumbnail(frame: Frame) -> NDArray[np.float32]:
    """(768,) gray values with mean 0 and length 1; zeros for an image without contrast."""
    image = _image(frame)
    if image is None:
        return np.zeros(_THUMBNAIL[0] * _THUMBNAIL[1], np.float32)
    gray = cv2.cvtColor(cv2.resize(image, _THUMBNAIL, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    values = gray.astype(np.float32).ravel()
    values -= values.mean()
    length = float(np.linalg.norm(values))
    return values / length if length > 1 else np.zeros_like(values)
