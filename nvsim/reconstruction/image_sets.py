"""Store footage as images for pose estimation: chosen frames of a video, or upright copies of photos."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.events import Log, Warning
from nvsim.footage.extraction import ExtractedFrames, extract_frames, rectify_files
from nvsim.footage.fisheye import PAIRS, Fisheye, find_fisheye
from nvsim.footage.sequences import choose_in_order, is_sequence
from nvsim.footage.sources import Footage
from nvsim.poses.features import NOTHING, Features, find_features, match_features
from nvsim.poses.image_set import ImageSet, UnknownCamera, times_of
from nvsim.poses.tracks import Tracks

STAGE = "poses"
_NAMED = 20
_NO_FISHEYE = 0.5  # focal length in Exif over the longer side above which the lens is not checked
ProgressCallback = Callable[[str, int, int], None]


@dataclass(frozen=True)
class StoredImages:
    """
    images      the image set; a video also has tracks
    looked_at   number of decoded frames; for photos, their number
    blurred     number of images that are much less sharp than their neighbors
    unreadable  names of photos that cannot be decoded
    frames      the frames of a video, or of photos that are frames of a video; None for other photos
    fisheye     degrees along the longer side of the fisheye lenses whose images are stored as pinhole images
    """

    images: ImageSet
    looked_at: int
    blurred: int
    unreadable: tuple[str, ...] = ()
    frames: ExtractedFrames | None = None
    fisheye: tuple[float, ...] = ()


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
    lens = frames.fisheye
    camera = UnknownCamera(frames.width, frames.height, None if lens is None else lens.pinhole.fx)
    fisheye = _report_lenses([lens], tell)
    return StoredImages(_in_order(frames, camera), frames.looked_at, blurred, frames=frames, fisheye=fisheye)


def _in_order(frames: ExtractedFrames, camera: UnknownCamera) -> ImageSet:
    return ImageSet(
        frames.folder,
        frames.names,
        (camera,),
        np.zeros(len(frames.names), np.int64),
        frames.clips,
        times_of(frames.seconds, frames.clips),
        Tracks(np.unique(frames.point, return_inverse=True)[1].astype(np.int64), frames.frame, frames.places),
    )


def _photographs(
    footage: Footage, folder: Path, report_progress: ProgressCallback, tell: Callable[[Log | Warning], None]
) -> StoredImages:
    from nvsim.footage.photographs import store_photographs

    stored = store_photographs(footage, folder, lambda done, total: report_progress("photographs", done, total))
    if stored.unreadable:
        names = ", ".join(stored.unreadable[:_NAMED]) + (", ..." if len(stored.unreadable) > _NAMED else "")
        tell(Warning(f"These files cannot be decoded and are skipped: {names}.", STAGE))
    cameras = [UnknownCamera(c.width, c.height, c.focal) for c in stored.cameras]
    by_exif = sum(c.focal is not None for c in cameras)
    tell(Log(f"Photographs: {len(stored.names)}; cameras: {len(cameras)}, {by_exif} with a focal length.", STAGE))
    lenses = []
    for k, camera in enumerate(cameras):
        lens = _rectify_photographs([folder / stored.names[i] for i in np.flatnonzero(stored.camera == k)], camera)
        if lens is not None:
            lenses.append(lens)
            cameras[k] = replace(camera, focal=lens.pinhole.fx)
    fisheye = _report_lenses(lenses, tell)
    if len(cameras) == 1 and is_sequence([folder / name for name in stored.names]):
        frames = choose_in_order(folder, stored.names)
        for name in set(stored.names) - set(frames.names):
            (folder / name).unlink(missing_ok=True)
        blurred = int(np.count_nonzero(frames.blurred))
        used = f"{len(frames.names)} of them are used, in their order."
        tell(Log(f"The photographs are consecutive frames of a video. {used}", STAGE))
        images = _in_order(frames, cameras[0])
        return StoredImages(images, len(footage.files), blurred, stored.unreadable, frames, fisheye)
    none = np.zeros(len(stored.names), np.int64)
    images = ImageSet(stored.folder, stored.names, tuple(cameras), stored.camera, none, np.zeros(0))
    return StoredImages(images, len(footage.files), 0, stored.unreadable, fisheye=fisheye)


def _report_lenses(lenses: Iterable[Fisheye | None], tell: Callable[[Log | Warning], None]) -> tuple[float, ...]:
    """The angles of view of the fisheye lenses, degrees. Reports each of them."""
    found = [lens for lens in lenses if lens is not None]
    for lens in found:
        words = f"The lens is a fisheye lens of {lens.degrees:.0f} degrees; its images are stored without distortion."
        tell(Log(words, STAGE))
    return tuple(round(lens.degrees, 1) for lens in found)


def _rectify_photographs(paths: list[Path], camera: UnknownCamera) -> Fisheye | None:
    """The fisheye lens of the photos of `camera`, which become pinhole images. None for another lens."""
    if camera.focal is not None and camera.focal > _NO_FISHEYE * max(camera.width, camera.height):
        return None
    near = list(zip(paths, paths[1:]))
    near = near[:: max(1, -(-len(near) // PAIRS))]
    lens = find_fisheye([_match_photos(*pair) for pair in near], camera.width, camera.height)
    if lens is not None:
        rectify_files(paths, lens)
    return lens


def _match_photos(first: Path, second: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Matched pixels (M, 2), (M, 2) of two photos."""
    one, other = _features_of(first), _features_of(second)
    rows = match_features(one, other)
    return one.places[rows[:, 0]], other.places[rows[:, 1]]


def _features_of(path: Path) -> Features:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    return NOTHING if image is None else find_features(np.asarray(image[..., ::-1], np.uint8))
