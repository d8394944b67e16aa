"""Choose the images from which the depth of a frame is estimated: a similar viewing direction, another position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_DEGREES = 40.0
_WIDE = 60.0  # degrees; such images overlap in a strip, which is better than no overlap
_FEW = 4
_PARTS = (1.0, 0.5, 0.25)


def neighbours(poses: NDArray[np.float64], frame: int, count: int, baseline: float, spread: float = 0.2) -> list[int]:
    """Indices of at most `count` frames that show the view of `frame` with parallax, best first.

    poses     (N, 4, 4) camera to world, meters
    baseline  best distance between the two cameras for the depths of the scene, meters
    spread    chosen frames are at least this share of `baseline` apart

    If a camera only turned in place, too few frames qualify. Then cameras at a half or a quarter of the baseline are
    used. If these are too few, cameras at twice the baseline and with larger viewing angles are added.
    """
    chosen: list[int] = []
    for part, degrees in [*((p, _DEGREES) for p in _PARTS), (2.0, _DEGREES), *((p, _WIDE) for p in (*_PARTS, 2.0))]:
        if (degrees > _DEGREES or part > 1) and len(chosen) >= _FEW:
            break
        score = _scores(poses, frame, part * baseline, degrees)
        for other in np.argsort(-score, kind="stable"):
            if score[other] <= 0 or len(chosen) >= count:
                break
            apart = [np.linalg.norm(poses[other, :3, 3] - poses[taken, :3, 3]) for taken in chosen]
            if all(length > part * spread * baseline for length in apart):
                chosen.append(int(other))
    return chosen


def _scores(poses: NDArray[np.float64], frame: int, baseline: float, degrees: float) -> NDArray[np.float64]:
    """(N,) score of each frame, 0 for unusable ones. Sideways parallax scores higher than parallax along the viewing
    direction, which vanishes in the middle of the image."""
    places, views = poses[:, :3, 3], poses[:, :3, 2]
    offset = places - places[frame]
    length = np.linalg.norm(offset, axis=1)
    turned = np.degrees(np.arccos(np.clip(views @ views[frame], -1, 1)))
    aside = np.linalg.norm(offset - (offset @ views[frame])[:, None] * views[frame], axis=1)
    with np.errstate(divide="ignore"):
        fit = np.exp(-(np.log(length / baseline) ** 2))
    score: NDArray[np.float64] = fit * (0.3 + np.minimum(aside / baseline, 1.0)) * np.cos(np.radians(turned))
    score[(length < 0.15 * baseline) | (length > 4 * baseline) | (turned > degrees)] = 0.0
    return score
