"""The images in the folders of a capture: those that are not at the listed path, and those that no frame uses.

Missing files are searched in a folder that the user names, or by name below the folder of the capture.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

from nvsim.capture.findings import Findings
from nvsim.capture.moved_files import FolderFiles, Relocation, report_moved
from nvsim.capture.raw import RawCapture, RawFrame, file_size, natural_order
from nvsim.errors import InputError, value_text


def resolve_images_in(raw: RawCapture, folder: str) -> RawCapture:
    """`raw` with missing images replaced by images of `folder`; existing images are kept.

    Each image is searched by its full name, then by ever shorter endings of it, then as `FolderFiles` matches names. An
    image that is not found stays missing. An empty `folder` changes nothing. Raises InputError if the folder does not
    exist, or if two frames would share an image."""
    if not folder:
        return raw
    place = Path(folder).expanduser().absolute()
    if not place.is_dir():
        raise InputError(f"{place} is not a folder; --images names the folder that holds the images of the capture.")
    frames = [_place_frame(frame, place) for frame in raw.frames]
    missing = [place / frame.name for frame in frames if file_size(frame.image_path) is None]
    relocation = FolderFiles(place).relocate(missing)
    for i, frame in enumerate(frames):
        listed = place / frame.name
        if file_size(frame.image_path) is None and listed in relocation.found:
            frames[i] = replace(frame, image_path=relocation.found[listed])
    taken: dict[Path, str] = {}
    for frame, before in zip(frames, raw.frames, strict=True):
        if frame is before:
            continue
        other = taken.setdefault(frame.image_path, frame.name)
        if other != frame.name:
            raise InputError(
                f"{frame.image_path} would be the image of {other} and of {frame.name}; name the folder above it, "
                "whose subfolders are named as in the capture."
            )
    return replace(raw, frames=tuple(frames))


def _place_frame(frame: RawFrame, folder: Path) -> RawFrame:
    if file_size(frame.image_path) is not None:
        return frame
    parts = [part for part in PurePosixPath(frame.name).parts if part not in ("/", "..")]
    for begin in range(len(parts)):
        candidate = folder.joinpath(*parts[begin:])
        if file_size(candidate) is not None:
            return replace(frame, image_path=candidate)
    return frame


def find_moved_images(raw: RawCapture, findings: Findings) -> RawCapture:
    """`raw` with missing images found by name below the folder of their capture, and a note about them.

    If several folders may hold the image of a frame, the frame keeps its path and lists the folders in `choices`."""
    frames = list(raw.frames)
    for root in dict.fromkeys(frame.root for frame in frames if frame.root is not None):
        paths = [frame.image_path for frame in frames if frame.root == root]
        relocation = _relocate("image", paths, root, raw, findings, [depth.path for depth in raw.depths])
        for i, frame in enumerate(frames):
            if frame.root == root and frame.image_path in relocation.found:
                frames[i] = replace(frame, image_path=relocation.found[frame.image_path])
            elif frame.root == root and frame.image_path in relocation.ambiguous:
                frames[i] = replace(frame, choices=relocation.ambiguous[frame.image_path])
    return replace(raw, frames=tuple(frames))


def find_moved_measurements(raw: RawCapture, findings: Findings) -> RawCapture:
    """`raw` with missing masks, depth images, and LiDAR scans found by name likewise.

    Each frame also gets `root`, the folder below which `find_moved_images` searches its image."""
    root = _search_root(raw)
    images = [frame.image_path for frame in raw.frames]
    masks = [frame.mask.path for frame in raw.frames if frame.mask is not None]
    moved = _relocate("mask", masks, root, raw, findings, images).found
    depths = _relocate("depth image", [d.path for d in raw.depths], root, raw, findings, images).found
    scans = _relocate("scan", [s.path for s in raw.scans], root, raw, findings).found
    return replace(
        raw,
        frames=tuple(
            replace(
                f,
                root=root if f.root is None else f.root,
                mask=f.mask and replace(f.mask, path=moved.get(f.mask.path, f.mask.path)),
            )
            for f in raw.frames
        ),
        depths=tuple(replace(d, path=depths.get(d.path, d.path)) for d in raw.depths),
        scans=tuple(replace(s, path=scans.get(s.path, s.path)) for s in raw.scans),
    )


def _relocate(
    kind: str, paths: Sequence[Path], root: Path, raw: RawCapture, findings: Findings, others: Sequence[Path] = ()
) -> Relocation:
    relocation = FolderFiles(root).relocate(paths, others)
    report_moved(kind, relocation.found, raw.source, findings)
    return relocation


def _search_root(raw: RawCapture) -> Path:
    """The folder of a capture: its own folder, or the folder above `sparse` of a COLMAP model."""
    root = raw.source if raw.source.is_dir() else raw.source.parent
    while raw.format == "colmap" and (root.name.isdigit() or root.name.startswith("sparse")):
        root = root.parent
    return root


_MOST = 200_000  # files that are examined
_NAMED = 3
IMAGE_ENDINGS = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp"})
_IMAGE_FOLDERS = frozenset({"images", "image", "imgs", "input", "rgb", "color", "frames", "photos", "records_data"})
_ADDED = re.compile(
    r"(.*[._\- ])?(masks?|depths?|disp(arity)?|normals?|semantics?|seg(mentation)?|labels?|instances?|confidence|conf"
    r"|alphas?|thumb(nail)?s?|previews?|features?|flow|edges?|sky|albedo)([._\- \d].*)?|images?_\d+",
    re.IGNORECASE,
)
"""Names of folders and files with other content than the images of frames, such as masks and smaller copies."""


def has_other_content(name: str) -> bool:
    """Whether the name of a folder, or of a file without its ending, is that of a mask, a depth image, or the like."""
    return _ADDED.fullmatch(name) is not None


def check_unused_images(raw: RawCapture, findings: Findings) -> None:
    """Add a warning about images beside those of `raw` that belong to no frame. Images of frames that the user left out
    are not reported."""
    used = {os.path.normpath(frame.image_path) for frame in raw.frames}
    used |= {os.path.normpath(depth.path) for depth in raw.depths}
    used |= {os.path.normpath(frame.mask.path) for frame in raw.frames if frame.mask is not None}
    left_out_files = {Path(name).name for name in raw.left_out}
    endings = {frame.image_path.suffix.lower() for frame in raw.frames}
    unused = [
        path
        for path in _images_beside(raw, endings)
        if os.path.normpath(path) not in used and path.name not in left_out_files
    ]
    if not unused:
        return
    unused.sort(key=lambda path: natural_order(str(path)))
    names = ", ".join(value_text(path.name) for path in unused[:_NAMED]) + (", ..." if len(unused) > _NAMED else "")
    count, total = len(raw.frames), len(raw.frames) + len(unused)
    has = "1 image has" if len(unused) == 1 else f"{len(unused)} images have"
    findings.warning(
        f"{count} of {total} images are registered; {has} no pose",
        f"{value_text(unused[0].parent)}: {names}",
        "the areas that only they show are missing; register them too, or remove them from the folder",
    )


def _images_beside(raw: RawCapture, endings: set[str]) -> Iterator[Path]:
    """The files with one of `endings` in the folders of the frames' images, and in their subfolders."""
    tops: dict[Path, bool] = {}  # folder -> whether folders in it are searched too
    for folder in dict.fromkeys(frame.image_path.parent for frame in raw.frames):
        above = next((f for f in (folder, *folder.parents[:2]) if f.name.lower() in _IMAGE_FOLDERS), None)
        tops[folder if above is None else above] = above is not None
    seen: set[Path] = set()
    count = 0
    for top, is_deep in tops.items():
        for at, children, files in os.walk(top):
            children[:] = [c for c in children if is_deep and not c.startswith(".") and not has_other_content(c)]
            place = Path(at)
            if place in seen:
                continue
            seen.add(place)
            for name in files:
                count += 1
                if count > _MOST:
                    return
                stem, ending = os.path.splitext(name)
                is_image = ending.lower() in endings and ending.lower() in IMAGE_ENDINGS
                if is_image and not name.startswith(".") and not has_other_content(stem):
                    yield place / name
