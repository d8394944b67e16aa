"""Find black borders of images, and leave them out. Undistortion leaves such borders (Polycam, ScanNet, COLMAP with
blank pixels), and so does the conversion of a video to another aspect ratio.

The files are not changed: the lens of a frame has the width of the border. Without this, models learn that the building
is black there, and depth is estimated for pixels that show nothing.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.images import decode
from nvsim.capture.raw import RawCapture, RawFrame
from nvsim.errors import InputError
from nvsim.geometry.sampling import evenly_spaced

_SAMPLED, _FEWEST = 96, 8  # images that are read in all, and of a camera at least
_BLACK = 12  # of 255; JPEG makes black pixels near an edge a little brighter
_BLACK_ON_AVERAGE = 3.0  # of 255; dark surfaces are brighter, by the noise of the camera
_SHARE_OF_IMAGES = 0.75  # in which a pixel is black
_NOTICEABLE = 0.002  # share of the image
_LARGEST = 0.3  # share of the image that is cut off at most
_LEAST_IMAGES = 3  # fewer do not tell a border from a dark room
_MARGIN = 2  # pixels beside the border, which are mixed with it


def cut_black_borders(raw: RawCapture, findings: Findings) -> RawCapture:
    """`raw` with the black borders of its images in their lenses, and in those of their depth images. A note states how
    much is cut off.

    A border that would cut off more than 30 % of the images is kept, with a warning. Fisheye images are skipped: their
    pinhole camera sees only the lit circle."""
    frames, place = list(raw.frames), raw.source.name
    cameras = _cameras(frames)
    for indices in cameras:
        lens = frames[indices[0]].lens
        assert lens is not None
        most = max(_FEWEST, _SAMPLED // len(cameras))
        black = _black_at_border([frames[indices[k]] for k in evenly_spaced(len(indices), most)])
        if black is None or black.mean() < _NOTICEABLE:
            continue
        border = _least_border(black)
        left, top, right, bottom = border
        share = 1 - (lens.width - left - right) * (lens.height - top - bottom) / (lens.width * lens.height)
        whose = f"{len(indices)} of {len(frames)} images"
        if share > _LARGEST:
            message = f"{whose} have a black border, {black.mean():.0%} of their area"
            findings.warning(message, place, "it counts as black surfaces; crop the images, or add masks")
            continue
        sides = " ".join(f"{name} {n}" for name, n in zip(("left", "top", "right", "bottom"), border, strict=True) if n)
        message = f"{whose} have a black border, so {share:.1%} of their area is not used"
        findings.note(message, place, f"pixels cut off: {sides}; the files are not changed")
        for i in indices:
            lens = frames[i].lens
            assert lens is not None
            frames[i] = replace(frames[i], lens=replace(lens, border=border))
    cut = {(b.name, b.lens): f.lens for b, f in zip(raw.frames, frames, strict=True)}
    depths = tuple(replace(d, lens=cut.get((d.frame, d.lens)) or d.lens) for d in raw.depths)
    return replace(raw, frames=tuple(frames), depths=depths)


def _cameras(frames: Sequence[RawFrame]) -> list[list[int]]:
    """The indices of the frames of each camera, which have one sensor and lens. If many images have a lens of their
    own, all of one size belong together."""
    lenses = {i: f.lens for i, f in enumerate(frames) if f.lens is not None and not f.lens.is_fisheye}
    own = 4 * len({(frames[i].sensor, lens) for i, lens in lenses.items()}) > len(lenses)
    cameras: dict[object, list[int]] = {}
    for i, lens in lenses.items():
        cameras.setdefault((lens.width, lens.height) if own else (frames[i].sensor, lens), []).append(i)
    return list(cameras.values())


def _black_at_border(frames: Sequence[RawFrame]) -> NDArray[np.bool_] | None:
    """(H, W) bool: pixels that are black in most images and connected to the edge of the image by such pixels. None if
    fewer than 3 images can be read, if the images are black everywhere, or if these pixels are dark surfaces."""
    import cv2

    def brightness(frame: RawFrame) -> NDArray[np.uint8] | None:
        assert frame.lens is not None
        try:
            return np.asarray(decode(frame.image_path, (frame.lens.width, frame.lens.height)).max(axis=2))
        except InputError:
            return None  # the data check reports it

    lens = frames[0].lens
    assert lens is not None
    count, (black, total) = 0, np.zeros((2, lens.height, lens.width), np.uint16)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for found in pool.map(brightness, frames):
            if found is not None:
                count += 1
                black += found <= _BLACK
                total += found
    if count < _LEAST_IMAGES:
        return None
    padded = np.pad(black >= _SHARE_OF_IMAGES * count, 1, constant_values=True).astype(np.uint8)
    _, labels = cv2.connectedComponents(padded, connectivity=4)
    border = np.asarray(labels[1:-1, 1:-1] == labels[0, 0])
    return border if border.any() and not border.all() and total[border].mean() <= _BLACK_ON_AVERAGE * count else None


def _least_border(black: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """The border (left, top, right, bottom) without which no pixel is `black` (H, W). Row by row and column by column,
    the side with the largest share of black pixels is cut off. Then each side grows as far as it can."""
    height, width = black.shape
    border = np.zeros(4, int)

    def inside() -> NDArray[np.bool_]:
        left, top, right, bottom = border
        return black[top : height - bottom, left : width - right]

    while (rest := inside()).any():
        border[np.argmax([rest[:, 0].mean(), rest[0].mean(), rest[:, -1].mean(), rest[-1].mean()])] += 1
    for side in range(4):
        while border[side] and not inside().any():
            border[side] -= 1
        border[side] += inside().any()
    left, top, right, bottom = (int(n) + _MARGIN if n else 0 for n in border)
    return left, top, right, bottom
