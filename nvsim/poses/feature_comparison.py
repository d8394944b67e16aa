"""Decide between SIFT and the features of a network: match both on a sample of pairs, and count verified matches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nvsim.files.records import Count, Figure

if TYPE_CHECKING:
    from nvsim.poses.features import FeatureFinder, Features
    from nvsim.poses.image_set import ImageSet

_PAIRS = 16  # sampled pairs of neighbors, and of similar images
_BESIDE = 8  # frames between two neighbors of the sample; nearer ones match by tracked points


@dataclass(frozen=True)
class FeatureComparison:
    """network   name of the network
    pairs     number of pairs of images that were matched with both
    matches   matches per pair that agree with a relative pose, of the network and of SIFT
    verified  share of the pairs with a relative pose, 0 to 1, of the network and of SIFT
    """

    network: str
    pairs: Count
    matches: tuple[Figure, Figure]
    verified: tuple[Figure, Figure]

    @property
    def is_network_used(self) -> bool:
        """Whether the network is worse in neither figure and better in one."""
        gains = (self.matches[0] - self.matches[1], self.verified[0] - self.verified[1])
        return min(gains) >= 0 and max(gains) > 0


def compare_features(
    images: ImageSet, sift: Sequence[Features], network: FeatureFinder, find: Callable[[int], Features]
) -> FeatureComparison:
    """Matches at most 32 pairs of neighbors and of similar images with `sift`, the features of all images, and with
    those of the `network`, which `find` gives for the index of an image. Matches count if they agree with a relative
    pose of cameras with the focal length that SIFT gives."""
    # These import pycolmap, which the reader of a report does not need.
    from nvsim.poses.features import match_features
    from nvsim.poses.image_pairs import similar_pairs
    from nvsim.poses.match_database import camera_of
    from nvsim.poses.threads import thread_pool
    from nvsim.poses.two_views import estimate_focal_length, relative_pose

    count = len(images.names)
    near = [(i, i + _BESIDE) for i in range(count - _BESIDE) if images.clips[i] == images.clips[i + _BESIDE]]
    pairs = _spread(near if images.ordered else []) + _spread(similar_pairs(sift, images.ordered, images.clips))
    used = sorted({i for pair in pairs for i in pair})
    with thread_pool() as pool:
        learned = dict(zip(used, pool.map(find, used), strict=True))
        by_sift = list(pool.map(lambda p: match_features(sift[p[0]], sift[p[1]]), pairs))
        by_network = list(pool.map(lambda p: match_features(learned[p[0]], learned[p[1]]), pairs))
    cameras = []
    for k, camera in enumerate(images.cameras):
        own = [n for n, (i, j) in enumerate(pairs) if images.camera[i] == images.camera[j] == k]
        places = [
            (sift[i].places[m[:, 0]], sift[j].places[m[:, 1]]) for (i, j), m in ((pairs[n], by_sift[n]) for n in own)
        ]
        focal = camera.focal or estimate_focal_length(places, camera.width, camera.height, None)
        cameras.append(camera_of(camera, k + 1, focal))

    def count_inliers(features: Sequence[Features] | dict[int, Features], matches: list[np.ndarray]) -> np.ndarray:
        agreeing = []
        for (i, j), own in zip(pairs, matches, strict=True):
            both = cameras[int(images.camera[i])], cameras[int(images.camera[j])]
            found = relative_pose(both, (features[i].places, features[j].places), own.astype(np.uint32))
            agreeing.append(0 if found is None else len(found.matches))
        return np.array(agreeing or [0])

    new, old = count_inliers(learned, by_network), count_inliers(sift, by_sift)
    return FeatureComparison(
        network.name,
        len(pairs),
        (round(float(new.mean()), 1), round(float(old.mean()), 1)),
        (round(float((new > 0).mean()), 3), round(float((old > 0).mean()), 3)),
    )


def _spread(pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """At most `_PAIRS` of `pairs`, evenly spread."""
    at = np.unique(np.linspace(0, len(pairs) - 1, min(_PAIRS, len(pairs))).round().astype(int))
    return [pairs[k] for k in at]
