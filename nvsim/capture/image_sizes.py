"""Fit lenses to images that are not stored at the size of their camera: downscaled copies, and photos that their
orientation tag rotates."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from nvsim.capture.findings import Findings
from nvsim.capture.images import image_header, is_turned
from nvsim.capture.raw import RawCapture
from nvsim.geometry.lens import Lens

_ALIKE = (0.9, 1.1)  # ratios of images that undistortion cropped or padded rather than scaled


def fit_lenses(raw: RawCapture, findings: Findings) -> RawCapture:
    """`raw` with the lens of each frame scaled to the size of its image.

    A lens is scaled if its aspect ratio equals that of the image within a pixel (images_2, images_4). Notes list the
    scaled sizes, and the number of images that their orientation tag rotates when they are read. Other sizes are kept;
    the image decoder rejects them."""
    scaled: Counter[tuple[Lens, Lens]] = Counter()
    turned = 0
    frames = []
    for frame in raw.frames:
        header = None if frame.lens is None else image_header(frame.image_path)
        if frame.lens is None or header is None:
            frames.append(frame)
            continue
        width, height, orientation = header
        lens = frame.lens
        for size in ((width, height), (height, width)):
            if size == (width, height) or is_turned((width, height), orientation, size):
                fitting = lens if size == (lens.width, lens.height) else _resized(lens, *size)
                if fitting is not None:
                    turned += size != (width, height)
                    if fitting is not lens:
                        scaled[lens, fitting] += 1
                    lens = fitting
                    break
        frames.append(frame if lens is frame.lens else replace(frame, lens=lens))
    sizes: Counter[tuple[int, int, int, int]] = Counter()
    for (lens, other), count in scaled.items():
        sizes[lens.width, lens.height, other.width, other.height] += count
    for (width, height, new_width, new_height), count in sizes.items():
        findings.note(
            f"{count} images are {new_width}x{new_height} pixels and their camera is {width}x{height}",
            raw.source.name,
            f"the camera is scaled to the images, by {new_width / width:.4g}",
        )
    if turned:
        findings.note(
            f"{turned} images fit their camera only after the rotation in their orientation tag",
            raw.source.name,
            "they are rotated when they are read; other orientation tags are ignored",
        )
    return replace(raw, frames=tuple(frames))


def _resized(lens: Lens, width: int, height: int) -> Lens | None:
    """`lens` for images of `width` x `height` pixels; None if the two sides have different scales."""
    across, down = width / lens.width, height / lens.height
    if _ALIKE[0] < across < _ALIKE[1]:
        return None
    if abs(height - across * lens.height) > 1 and abs(width - down * lens.width) > 1:
        return None
    return lens.resized(width, height)
