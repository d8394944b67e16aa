"""Store footage as images for pose estimation: chosen frames of a video, or upright copies of photos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nvsim.events import Log, Warning
from nvsim.footage.extraction import ExtractedFrames, extract_frames
from nvsim.footage.sources import Footage
from nvsim.poses.image_set import ImageSet, UnknownCamera, times_of
from nvsim.poses.tracks import Tracks

STAGE = "poses"
_NAMED = 20
ProgressCallback = Callable[[str, int, int], None]


@dataclass(frozen=True)
class StoredImages:
    """
    images      the image set; a video also has tracks
    looked_at   number of decoded frames; for photos, their number
    blurred     number of images that are much less sharp than their neighbors
    unreadable  names of photos that cannot be decoded
    frames      the frames of a video, None for photos
    """

    images: ImageSet
    looked_at: int
    blurred: int
    unreadable: tuple[str, ...] = ()
    frames: ExtractedFrames | None = None


def store_images(
    footage: Footage, folder: Path, report_progress: ProgressCallback, tell: Callable[[Log | Warning], None]
) -> StoredImages:
    """Stores the images of `footage` in `folder`. Raises InputError for files that cannot be decoded, and if writing
    fails."""
    if footage.kind == "photographs":
        return _photographs(footage, folder, report_progress, tell)
    return _frames(footage, folder, report_progress, tell)


def _frames(
    footage: Footage, folder: Path, report_progress: ProgressCallback, tell: Callable[[Log | Warning], None]
) -> StoredImages:
    frames = extract_frames(footage, folder, lambda done, total: report_progress("frames", done, total))
    blurred = int(np.count_nonzero(frames.blurred))
    tell(Log(f"{len(frames.names)} of {frames.looked_at} frames are used; {blurred} of them are blurred.", STAGE))
    images = ImageSet(
        frames.folder,
        frames.names,
        (UnknownCamera(frames.width, frames.height),),
        np.zeros(len(frames.names), np.int64),
        frames.clips,
        times_of(frames.seconds, frames.clips),
        Tracks(np.unique(frames.point, return_inverse=True)[1].astype(np.int64), frames.frame, frames.places),
    )
    return StoredImages(images, frames.looked_at, blurred, frames=frames)


def _photographs(
    footage: Footage, folder: Path, report_progress: ProgressCallback, tell: Callable[[Log | Warning], None]
) -> StoredImages:
    from nvsim.footage.photographs import store_photographs

    stored = store_photographs(footage, folder, lambda done, total: report_progress("photographs", done, total))
    if stored.unreadable:
        names = ", ".join(stored.unreadable[:_NAMED]) + (", ..." if len(stored.unreadable) > _NAMED else "")
        tell(Warning(f"These files cannot be decoded and are skipped: {names}.", STAGE))
    cameras = tuple(UnknownCamera(c.width, c.height, c.focal) for c in stored.cameras)
    by_exif = sum(c.focal is not None for c in cameras)
    tell(Log(f"Photographs: {len(stored.names)}; cameras: {len(cameras)}, {by_exif} with a focal length.", STAGE))
    none = np.zeros(len(stored.names), np.int64)
    images = ImageSet(stored.folder, stored.names, cameras, stored.camera, none, np.zeros(0))
    return StoredImages(images, len(footage.files), 0, stored.unreadable)
