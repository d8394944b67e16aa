"""Masks of a capture: the pixels of an image to ignore. They are found beside the images, checked, and read."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.images import sampling
from nvsim.capture.raw import RawCapture, RawFrame, file_size, read_bytes
from nvsim.capture.types import Frame, MaskFile
from nvsim.errors import InputError
from nvsim.files.images import decode_pixels, is_cut_off
from nvsim.files.opening import opened
from nvsim.geometry.camera import Intrinsics
from nvsim.geometry.sampling import evenly_spaced

_JPEG_BLACK = 127  # JPEG blurs the edges between black and white
_OPAQUE = 0.98  # least opacity of a pixel that counts
_PNG_COLOR_TYPE = 25  # bytes before it in a PNG
_SAMPLED = 24  # images with an alpha channel that are searched for transparent pixels
_AGAIN = "copy it again from the source, or remove it"
_TRANSPARENT = "all pixels of the image are transparent"
_NOT_USED = "the mask is not used, so all pixels of the image are used"


def with_masks_beside(raw: RawCapture) -> RawCapture:
    """`raw` with the masks that its format stores beside or inside the images rather than in a list.

    - COLMAP: `masks/NAME.png`, black is ignored. NAME is the image's name with or without its extension.
    - instant-ngp: `dynamic_mask_NAME.png`, white is ignored.
    - PNG with transparent pixels: these are ignored.

    Frames that already have a mask keep it."""
    find = {"colmap": _colmap_mask, "instant-ngp": _dynamic_mask}.get(raw.format)
    frames = raw.frames
    if find is not None:
        frames = tuple(f if f.mask is not None else replace(f, mask=find(f)) for f in frames)
    layered = [f.image_path for f in frames if f.mask is None and _has_alpha(f.image_path)]
    if any(_shows_through(layered[i]) for i in evenly_spaced(len(layered), _SAMPLED)):
        own = set(layered)
        frames = tuple(
            replace(f, mask=MaskFile(f.image_path.absolute(), "transparent")) if f.image_path in own else f
            for f in frames
        )
    return replace(raw, frames=frames)


def _has_alpha(path: Path) -> bool:
    """Whether the file is a PNG with an alpha channel."""
    if path.suffix.lower() != ".png":
        return False
    try:
        with opened(path) as file:
            header = file.read(_PNG_COLOR_TYPE + 1) or b""
    except (InputError, OSError):
        return False  # the data check reports it
    return header.startswith(b"\x89PNG") and header[_PNG_COLOR_TYPE:] in (b"\4", b"\6")


def _shows_through(path: Path) -> bool:
    try:
        return not decode_mask(MaskFile(path, "transparent")).all()
    except InputError:
        return False


def _colmap_mask(frame: RawFrame) -> MaskFile | None:
    """The mask in a folder `masks` beside the folder of the images, or inside that folder."""
    depth = len(Path(frame.name).parts)
    if depth == 0 or len(frame.image_path.parts) <= depth + 1:
        return None
    images = frame.image_path.parents[depth - 1]
    for folder in (images.parent / "masks", images / "masks"):
        for name in (f"{frame.name}.png", str(Path(frame.name).with_suffix(".png"))):
            if file_size(folder / name) is not None:
                return MaskFile((folder / name).absolute())
    return None


def _dynamic_mask(frame: RawFrame) -> MaskFile | None:
    path = frame.image_path.with_name(f"dynamic_mask_{frame.image_path.stem}.png")
    return None if file_size(path) is None else MaskFile(path.absolute(), "white")


def check_masks(raw: RawCapture, findings: Findings) -> RawCapture:
    """`raw` without unusable masks; each becomes a warning. Decodes every mask."""
    masked = [f for f in raw.frames if f.mask is not None]
    if not masked:
        return raw
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        faults = dict(zip((f.where for f in masked), pool.map(_fault, masked), strict=True))
    for frame in masked:
        if fault := faults[frame.where]:
            then = _NOT_USED if fault != _TRANSPARENT else "its hidden colors are used; --leave-out skips the image"
            findings.warning(fault, frame.where, then, (frame.name,) if fault == _TRANSPARENT else ())
    used = Counter(f.mask.ignored == "transparent" for f in masked if f.mask and not faults[f.where])
    for transparent, count in sorted(used.items()):
        message = f"{count} of {len(raw.frames)} images have {'transparent pixels' if transparent else 'a mask'}"
        which = "transparent" if transparent else "masked"
        findings.note(message, raw.source.name, f"depth, floors, and training ignore the {which} pixels")
    return replace(raw, frames=tuple(replace(f, mask=None) if faults.get(f.where) else f for f in raw.frames))


def _fault(frame: RawFrame) -> str:
    """The fault of a frame's mask; "" for none."""
    assert frame.mask is not None
    size = file_size(frame.mask.path)
    if size is None:
        return "the mask is missing"
    try:
        usable = decode_mask(frame.mask)
    except InputError as error:
        return str(error).replace(str(frame.mask.path), "the mask").rstrip(".")
    if frame.lens is not None and not _has_same_aspect(usable, frame.lens.width, frame.lens.height):
        height, width = usable.shape
        image = f"{frame.lens.width}x{frame.lens.height}"
        return f"the mask is {width}x{height} pixels, which does not fit an image of {image}"
    nothing = _TRANSPARENT if frame.mask.ignored == "transparent" else "the mask ignores the whole image"
    return "" if usable.any() else nothing


def _has_same_aspect(usable: NDArray[np.bool_], width: int, height: int) -> bool:
    """Whether the mask has the aspect ratio of an image of that size, within a pixel."""
    tall, wide = usable.shape
    return abs(wide * height - tall * width) <= max(width, height)


def decode_mask(mask: MaskFile) -> NDArray[np.bool_]:
    """(H, W) bool as stored, True for pixels to use. Raises InputError if the mask cannot be read."""
    data = read_bytes(mask.path)
    if is_cut_off(data):
        raise InputError(f"{mask.path} is truncated (its end mark is missing); {_AGAIN}.")
    if mask.ignored == "transparent":
        pixels = decode_pixels(data, mask.path, cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION, then=_AGAIN)
        if pixels.ndim < 3 or pixels.shape[2] < 4:
            return np.ones(pixels.shape[:2], bool)
        return np.asarray(pixels[..., 3] >= _OPAQUE * np.iinfo(pixels.dtype).max)
    gray = decode_pixels(data, mask.path, cv2.IMREAD_GRAYSCALE, what="a mask", then=_AGAIN)
    white = gray > (_JPEG_BLACK if data.startswith(b"\xff\xd8") else 0)
    return np.asarray(white if mask.ignored == "black" else ~white)


def usable_pixels(frame: Frame, intrinsics: Intrinsics) -> NDArray[np.bool_] | None:
    """(H, W) bool of `frame` in the view of the pinhole `intrinsics`, True for pixels to use; None without a mask.

    It is undistorted and resampled like the image in `read_image`. A pixel is True if no stored pixel that contributes
    to it is ignored. Raises InputError naming the mask if it is missing, damaged, or has another aspect ratio than the
    image."""
    if frame.mask is None:
        return None
    usable, lens = decode_mask(frame.mask), frame.lens
    if not _has_same_aspect(usable, lens.width, lens.height):
        raise InputError(f"{frame.mask.path} does not fit its image, {lens.width}x{lens.height} pixels; {_AGAIN}.")
    if usable.shape != (lens.height, lens.width):
        size = (lens.width, lens.height)
        usable = cv2.resize(usable.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT) > 0
    finer, mapping = sampling(lens, intrinsics)
    ignored = (~usable).astype(np.float32)
    sampled = cv2.remap(
        ignored, mapping[..., 0], mapping[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )  # fmt: skip
    if finer > 1:
        sampled = cv2.resize(sampled, (intrinsics.width, intrinsics.height), interpolation=cv2.INTER_AREA)
    return np.asarray(sampled < 1e-3)


def usable_pixels_of_frames(frames: Iterable[Frame], longest_side: int) -> Iterator[NDArray[np.bool_] | None]:
    """Yield `usable_pixels` of each frame: (H, W) bool, at most `longest_side` pixels a side, or None."""
    for frame in frames:
        yield usable_pixels(frame, frame.intrinsics.limited_to(longest_side))
