"""The folder that holds the images, where they do not lie where the capture says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePosixPath

from nvsim.capture.raw import RawCapture, RawFrame, file_size
from nvsim.errors import InputError


def looked_for_in(raw: RawCapture, folder: str) -> RawCapture:
    """`raw` with the images of `folder` for those that are not where it says: each by its name, then by ever shorter
    ends of it. An image that is not there either stays missing. "" changes nothing. Raises InputError when there is no
    such folder, or when two frames would share an image."""
    if not folder:
        return raw
    place = Path(folder).expanduser().absolute()
    if not place.is_dir():
        raise InputError(f"{place} is no folder; --images names the folder that holds the images of the capture.")
    frames = tuple(_placed(frame, place) for frame in raw.frames)
    taken: dict[Path, str] = {}
    for frame, before in zip(frames, raw.frames, strict=True):
        if frame is before:
            continue
        other = taken.setdefault(frame.image_path, frame.name)
        if other != frame.name:
            raise InputError(
                f"{frame.image_path} would be the image of {other} and of {frame.name}; name the folder above it, in "
                "which the folders of the images lie as in the capture."
            )
    return replace(raw, frames=frames)


def _placed(frame: RawFrame, folder: Path) -> RawFrame:
    if file_size(frame.image_path) is not None:
        return frame
    parts = [part for part in PurePosixPath(frame.name).parts if part not in ("/", "..")]
    for begin in range(len(parts)):
        candidate = folder.joinpath(*parts[begin:])
        if file_size(candidate) is not None:
            return replace(frame, image_path=candidate)
    return frame
