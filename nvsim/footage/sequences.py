"""Photographs that are consecutive frames of a video: recognize them, and choose and track them as in a video.

Frames of a video are often given as image files. Their order tells places apart that look alike: a corridor and the
next one would otherwise become one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from nvsim.footage.decoding import VideoFrame
from nvsim.footage.extraction import ExtractedFrames
from nvsim.footage.frame_choice import choose_images, point_positions
from nvsim.footage.tracking import frame_without_points, shrunk_gray, track_points, with_new_points

_FEWEST = 20  # images
_PAIRS = 60  # neighbors that are compared, at most
_TRACKED, _SHARE = 0.5, 0.8  # share of the points of an image that its neighbor shows, and of such pairs, at least
# At 87 to 100 % of the pairs in four sequences of frames, and at up to 74 % in ten sets of photographs in the order of
# their names.


def is_sequence(paths: Sequence[Path]) -> bool:
    """Whether images of equal size are consecutive frames of a video, by the points that neighbors share."""
    if len(paths) < _FEWEST:
        return False
    firm = 0
    pairs = np.unique(np.linspace(0, len(paths) - 2, _PAIRS).astype(int)).tolist()
    for k in pairs:
        one, other = (cv2.imread(str(path), cv2.IMREAD_COLOR) for path in paths[k : k + 2])
        if one is None or other is None:
            continue
        before = with_new_points(frame_without_points(shrunk_gray(np.asarray(one, np.uint8))), 0)
        shown = track_points(before, shrunk_gray(np.asarray(other, np.uint8)))
        firm += len(shown.ids) >= _TRACKED * max(1, len(before.ids))
    return firm >= _SHARE * len(pairs)


def choose_in_order(folder: Path, names: Sequence[str]) -> ExtractedFrames:
    """The images `names` in `folder` as frames of one video, without those that show nothing new. One second passes
    from each image to the next. The images must have one size."""

    def read() -> Iterator[VideoFrame]:
        for number, name in enumerate(names):
            image = cv2.imread(str(folder / name), cv2.IMREAD_COLOR)
            if image is not None:
                yield VideoFrame(number, float(number), np.asarray(image, np.uint8))

    lines, numbers, blurred, size = [], [], [], (0, 0)
    for index, chosen in enumerate(choose_images(read())):
        size = chosen.frame.image.shape[1], chosen.frame.image.shape[0]
        places = point_positions(chosen.tracked, size[0] / chosen.tracked.gray.shape[1])
        lines.append(np.column_stack([np.full(len(places), index), chosen.tracked.ids, places]))
        numbers.append(chosen.frame.number)
        blurred.append(chosen.blurred)
    table = np.concatenate(lines) if lines else np.zeros((0, 4))
    return ExtractedFrames(
        folder,
        tuple(names[number] for number in numbers),
        *size,
        np.zeros(len(numbers), np.int64),
        np.array(numbers, np.float64),
        np.array(blurred, bool),
        len(names),
        table[:, 0].astype(np.int64),
        table[:, 1].astype(np.int64),
        table[:, 2:],
    )
