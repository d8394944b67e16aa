"""Write the chosen frames of footage, and the points tracked through them, to a folder. Finished work is reused."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import is_regular, read_bytes, read_json
from nvsim.files.reading import reading
from nvsim.files.stored_arrays import read_arrays, write_arrays
from nvsim.footage.decoding import refuse_different_sizes
from nvsim.footage.fisheye import Fisheye, find_fisheye
from nvsim.footage.frame_choice import choose_frames, point_positions
from nvsim.footage.sources import Footage

LONGEST_SIDE = 1280
"""Longest side of the stored images, pixels. Training and depth estimation use smaller images."""
QUALITY = 95
"""JPEG quality of the stored images."""
_LIST, _TRACKS = "frames.json", "tracks.npz"
_APART = 4  # frames between two whose points show the lens


@dataclass(frozen=True, eq=False)
class ExtractedFrames:
    """
    folder      folder of the images
    names       names of the N image files, in order of time
    width       width of all images, pixels; `height` is their height
    clips       (N,) int64, index of the video of each frame
    seconds     (N,) float64, time of each frame in its video
    blurred     (N,) bool, whether the frame is blurred
    looked_at   number of decoded frames
    frame       (M,) int64, index of a frame that shows a tracked point
    point       (M,) int64, number of that point
    places      (M, 2) float64, pixels of the stored image; (0.5, 0.5) is the center of its first pixel
    fisheye     the lens of the video if the stored images are pinhole images made from those of a fisheye lens
    """

    folder: Path
    names: tuple[str, ...]
    width: int
    height: int
    clips: NDArray[np.int64]
    seconds: NDArray[np.float64]
    blurred: NDArray[np.bool_]
    looked_at: int
    frame: NDArray[np.int64]
    point: NDArray[np.int64]
    places: NDArray[np.float64]
    fisheye: Fisheye | None = None


@dataclass(frozen=True)
class VideoMoment:
    """Position of a chosen frame in its video.

    clip     index of the video
    frame    frame number in the video, from 0
    seconds  time in the video; NaN in folders of older versions with panoramas
    """

    clip: int
    frame: int
    seconds: float


def read_moments(folder: Path) -> dict[str, VideoMoment]:
    """The moments of video frames in `folder`, by file name ("0_000012.jpg"). Empty if the folder has no list of
    frames. Raises InputError if the list is damaged."""
    path = folder / _LIST
    if not is_regular(path):
        return {}
    then = "remove the folder and run the command again"
    listed = read_json(path, "a list of frames", then)
    with reading(path, "a list of frames", then):
        names = [str(name) for name in listed["names"]]
        seconds = [float(s) for s in listed.get("seconds", [np.nan] * len(names))]
        return {
            name: VideoMoment(int(clip), int(Path(name).stem.rpartition("_")[2]), at)
            for name, clip, at in zip(names, listed["clips"], seconds, strict=True)
        }


def extract_frames(
    footage: Footage, folder: Path, looked_at: Callable[[int, int], None] = lambda done, total: None
) -> ExtractedFrames:
    """Writes the chosen frames of `footage` to `folder`, or reads them if an earlier run finished them. The frames of a
    fisheye lens are stored as pinhole images.

    Raises InputError for files that cannot be decoded, for videos of different sizes, and if writing fails."""
    stamp = [[str(f.absolute()), f.stat().st_size, f.stat().st_mtime_ns] for f in footage.files]
    if (folder / _LIST).exists():
        found = _read(folder, stamp)
        if found is not None:
            return found
    refuse_different_sizes(footage.files)
    atomic.make_folder(folder)
    (folder / _LIST).unlink(missing_ok=True)
    names, clips, seconds, blurred = [], [], [], []
    lines: list[NDArray[np.float64]] = []
    size: tuple[int, int] | None = None
    counted = 0

    def count(done: int, total: int) -> None:
        nonlocal counted
        counted = done
        looked_at(done, total)

    for index, chosen in enumerate(choose_frames(footage.files, count)):
        image = _limit_size(chosen.frame.image)
        height, width = image.shape[:2]
        size = width, height
        name = f"{chosen.clip}_{chosen.frame.number:06d}.jpg"
        encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
        atomic.write_bytes(folder / name, encoded.tobytes())
        scale = width / chosen.tracked.gray.shape[1]
        places = point_positions(chosen.tracked, scale)
        lines.append(np.column_stack([np.full(len(places), index), chosen.tracked.ids, places]))
        names.append(name)
        clips.append(chosen.clip)
        seconds.append(chosen.frame.seconds)
        blurred.append(chosen.blurred)
    if size is None:
        raise InputError(f"{footage.source} has no usable frame; choose another video.")
    table = np.concatenate(lines)
    fisheye = find_fisheye(_points_shared_by_frames(table, len(names)), *size)
    if fisheye is not None:
        rectify_files([folder / name for name in names], fisheye)
        table[:, 2:] = fisheye.places(table[:, 2:])
        table = table[np.isfinite(table).all(axis=1)]
    tracks = {"frame": table[:, 0].astype(np.int64), "point": table[:, 1].astype(np.int64), "places": table[:, 2:]}
    write_arrays(folder / _TRACKS, tracks, compressed=False)
    listed = {
        "footage": stamp,
        "names": names,
        "size": size,
        "clips": clips,
        "seconds": seconds,
        "blurred": blurred,
        "looked_at": counted,
        "fisheye": fisheye and fisheye.focal,
    }
    atomic.write_text(folder / _LIST, json.dumps(listed))
    found = _read(folder, stamp)
    assert found is not None
    return found


def rectify_files(paths: Sequence[Path], fisheye: Fisheye) -> None:
    """Replaces image files of a fisheye lens by pinhole images. Raises InputError if writing fails."""

    def rectify(path: Path) -> None:
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        rectified = fisheye.rectified(np.asarray(image, np.uint8))
        encoded = cv2.imencode(path.suffix, rectified, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
        atomic.write_bytes(path, encoded.tobytes())

    with ThreadPoolExecutor() as pool:
        list(pool.map(rectify, paths))


def _read(folder: Path, stamp: list[list[object]]) -> ExtractedFrames | None:
    """The frames in `folder` if they belong to the files of `stamp`."""
    path = folder / _LIST
    with reading(path, "a list of frames", "remove the folder and run the command again"):
        listed = json.loads(read_bytes(path).decode())
        if listed["footage"] != stamp or any(not (folder / name).is_file() for name in listed["names"]):
            return None
        wanted = {"frame": ("i", 1), "point": ("i", 1), "places": ("f", 2)}
        arrays = read_arrays(folder / _TRACKS, "tracked points", wanted, "run the command again", frozenset())
        width, height = listed["size"]
        focal = listed.get("fisheye")
        return ExtractedFrames(
            folder,
            tuple(listed["names"]),
            width,
            height,
            np.array(listed["clips"], np.int64),
            np.array(listed["seconds"], np.float64),
            np.array(listed["blurred"], bool),
            int(listed["looked_at"]),
            arrays["frame"],
            arrays["point"],
            arrays["places"],
            focal and Fisheye(width, height, float(focal)),
        )


def _points_shared_by_frames(
    table: NDArray[np.float64], count: int
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """The points that frames a few frames apart share. The rows of `table` are frame, point, x, and y."""
    found = []
    frames = [table[table[:, 0] == k, 1:] for k in range(count)]
    for one, other in zip(frames, frames[_APART:]):
        _, mine, theirs = np.intersect1d(one[:, 0], other[:, 0], assume_unique=True, return_indices=True)
        found.append((one[mine, 1:], other[theirs, 1:]))
    return found


def _limit_size(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    scale = LONGEST_SIDE / max(image.shape[:2])
    if scale >= 1:
        return image
    return np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
