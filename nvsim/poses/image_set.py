"""Images whose poses are wanted, as value: files, cameras, order in time, points tracked through a video."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.poses.tracks import Tracks

_BETWEEN = 86_400.0  # seconds from one video to the next
_NO_TRACKS = Tracks(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)))


def times_of(seconds: NDArray[np.float64], clips: NDArray[np.int64]) -> NDArray[np.float64]:
    """(N,) `ImageSet.times` of frames at `seconds` (N,) of the videos `clips` (N,)."""
    return np.asarray(seconds + _BETWEEN * clips, np.float64)


@dataclass(frozen=True)
class UnknownCamera:
    """A camera to calibrate: width and height in pixels, and the focal length by EXIF in pixels, None if unknown."""

    width: int
    height: int
    focal: float | None = None


@dataclass(frozen=True, eq=False)
class RigOfViews:
    """Views of one panorama: cameras that share a center, with known lenses without distortion.

    turns  (C, 3, 3) camera from rig, one for each of the cameras of the images; the first is the rig itself
    frame  (N,) int64, from 0: which panorama each image is of
    """

    turns: NDArray[np.float64]
    frame: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ImageSet:
    """
    folder   in which the images lie
    names    of the N image files, those of a video in order of time
    cameras  that took them
    camera   (N,) int64, index into `cameras`
    clips    (N,) int64, which video each image is from; all 0 for photographs
    times    (N,) float64, seconds at which the frames of a video were filmed, increasing; empty for photographs, whose
             order means nothing. Another video begins a day after the last.
    tracks   points that were tracked through the images; `Tracks.frame` is an index into `names`
    rig      the rig that all cameras are on, None for images with poses of their own
    usable   of each camera, the (H, W) pixels in which features are looked for; empty for all pixels of all cameras
    """

    folder: Path
    names: tuple[str, ...]
    cameras: tuple[UnknownCamera, ...]
    camera: NDArray[np.int64]
    clips: NDArray[np.int64]
    times: NDArray[np.float64]
    tracks: Tracks = field(default=_NO_TRACKS)
    rig: RigOfViews | None = None
    usable: tuple[NDArray[np.bool_], ...] = ()

    @property
    def ordered(self) -> bool:
        """Whether neighbors in the list are neighbors in time."""
        return len(self.times) > 0
