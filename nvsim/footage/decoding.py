"""Decode videos frame by frame, upright.

The FFmpeg of OpenCV decodes H.264, HEVC, VP9, and, if the build has the decoder, AV1. It applies the rotation that
phones store in the container.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError

FASTEST = 12.0
"""Frames per second that are decoded. Between two of them, a walking person moves by less than a tenth of a room."""


@dataclass(frozen=True, eq=False)
class VideoFrame:
    """number  index in the file, from 0
    seconds  presentation time
    image    (H, W, 3) uint8 BGR, upright
    """

    number: int
    seconds: float
    image: NDArray[np.uint8]


@dataclass(frozen=True)
class VideoFacts:
    """Facts from a video header: number of frames (0 if unknown), frames per second (0 if unknown), and width and
    height in pixels after rotation."""

    frames: int
    rate: float
    width: int
    height: int


def video_facts(path: Path) -> VideoFacts:
    """Reads the header of a video. Raises InputError if the file cannot be opened as a video."""
    video = _open_video(path)
    try:
        width, height = int(video.get(cv2.CAP_PROP_FRAME_WIDTH)), int(video.get(cv2.CAP_PROP_FRAME_HEIGHT))
        frames, rate = video.get(cv2.CAP_PROP_FRAME_COUNT), video.get(cv2.CAP_PROP_FPS)
        rate = float(rate) if np.isfinite(rate) and 0 < rate < 1e4 else 0.0
        return VideoFacts(int(frames) if np.isfinite(frames) and 0 < frames < 1e8 else 0, rate, width, height)
    finally:
        video.release()


def refuse_different_sizes(videos: Sequence[Path]) -> None:
    """Raises InputError if a file cannot be opened as a video, or if it has another size than the first."""
    facts = [video_facts(path) for path in videos]
    for path, one in zip(videos, facts, strict=True):
        if (one.width, one.height) != (facts[0].width, facts[0].height):
            raise InputError(
                f"{path} is {one.width}x{one.height} pixels and another video {facts[0].width}x{facts[0].height}; use "
                "videos of one camera in one orientation."
            )


def video_frames(path: Path, fastest: float = FASTEST) -> Iterator[VideoFrame]:
    """Yields the frames of a video in order, at most `fastest` per second.

    A frame that cannot be decoded is skipped. Decoding ends where no further frame can be read. Raises InputError if
    the file cannot be opened or has no frame.
    """
    video = _open_video(path)
    number, due, last = -1, -1.0, -1.0
    try:
        while video.grab():
            number += 1
            seconds = float(video.get(cv2.CAP_PROP_POS_MSEC)) / 1000
            if not np.isfinite(seconds) or seconds < last or (number and seconds == last):
                seconds = last + 1 / 30  # some containers have no usable times
            last = seconds
            if seconds < due - 1e-6:
                continue
            decoded, image = video.retrieve()
            if not decoded or image is None or image.ndim != 3:
                continue
            due = max(due, seconds - 1 / fastest) + 1 / fastest if due >= 0 else seconds + 1 / fastest
            yield VideoFrame(number, seconds, np.asarray(image, np.uint8))
    finally:
        video.release()
    if due < 0:
        raise InputError(f"{path} has no frame that can be decoded; export it as MP4 with H.264 and try again.")


def _open_video(path: Path) -> cv2.VideoCapture:
    try:
        empty = path.stat().st_size == 0
    except OSError as error:
        raise InputError(f"{path} cannot be opened ({error.strerror}); check the path.") from error
    if empty:
        raise InputError(f"{path} is empty (0 bytes); copy it again from the camera.")
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not video.isOpened():
        video.release()
        raise InputError(f"{path} cannot be decoded as a video; export it as MP4 with H.264 and try again.")
    video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
    return video
