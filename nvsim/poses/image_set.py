"""Images without poses as input of pose estimation: files, cameras, order in time, tracked points."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.poses.tracks import Tracks

_BETWEEN = 86_400.0  # seconds from one video to the next
_NO_TRACKS = Tracks(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)))


def times_of(seconds: NDArray[np.float64], clips: NDArray[np.int64]) -> NDArray[np.float64]:
    """(N,) float64 `ImageSet.times` of frames at `seconds` (N,) of the videos `clips` (N,)."""
    return np.asarray(seconds + _BETWEEN * clips, np.float64)


def mask_path(masks: Path, name: str) -> Path:
    """The path of the mask of the image `name` in the folder `masks`."""
    return masks / f"{name}.png"


@dataclass(frozen=True)
class UnknownCamera:
    """A camera to calibrate: width and height in pixels, and the focal length from EXIF in pixels, None if unknown."""

    width: int
    height: int
    focal: float | None = None


@dataclass(frozen=True, eq=False)
class RigOfViews:
    """Views of a panorama: cameras that share a center and have known lenses without distortion.

    turns  (C, 3, 3) float64, rig to camera, for each camera of the image set; the first camera is the rig itself
    frame  (N,) int64, index of the panorama of each image, from 0
    """

    turns: NDArray[np.float64]
    frame: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ImageSet:
    """
    folder   folder of the images
    names    file names of the N images, those of a video in order of time
    cameras  the cameras of the images
    camera   (N,) int64, index into `cameras`
    clips    (N,) int64, index of the video of each image; all 0 for photos
    times    (N,) float64, seconds at which the frames of a video were filmed, increasing; empty for photos, whose
             order has no meaning. The next video begins a day after the last.
    tracks   points that were tracked through the images; `Tracks.frame` is an index into `names`
    rig      the rig of all cameras, None for images with separate poses
    masks    folder of masks NAME.png, black where features are not searched; None without masks, and an image may have
             none
    usable   for each camera, (H, W) bool: pixels in which features are searched; empty for all pixels of all cameras
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
    masks: Path | None = None

    def usable_pixels(self, index: int) -> NDArray[np.bool_] | None:
        """(H, W) bool, pixels of an image in which features are searched; None for all."""
        import cv2  # the window imports this module when it starts

        usable = self.usable[int(self.camera[index])] if self.usable else None
        mask = None if self.masks is None else cv2.imread(str(mask_path(self.masks, self.names[index])), 0)
        if mask is None:
            return usable
        return np.asarray(mask > 0 if usable is None else usable & (mask > 0))

    @property
    def ordered(self) -> bool:
        """Whether neighbors in the list are also neighbors in time."""
        return len(self.times) > 0
