"""Find images in the folders of a capture that no frame uses, because reconstruction programs skip some images."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from nvsim.capture.findings import Findings
from nvsim.capture.raw import RawCapture, natural_order
from nvsim.errors import shown

IMAGE_ENDINGS = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp"})
_IMAGE_FOLDERS = frozenset({"images", "image", "imgs", "input", "rgb", "color", "frames", "photos", "records_data"})
_ADDED = re.compile(
    r"(.*[._\- ])?(masks?|depths?|disp(arity)?|normals?|semantics?|seg(mentation)?|labels?|instances?|confidence|conf"
    r"|alphas?|thumb(nail)?s?|previews?|features?|flow|edges?|sky|albedo)([._\- \d].*)?|images?_\d+",
    re.IGNORECASE,
)
"""Names of folders and files with other content than the images of frames, such as masks and smaller copies."""
_MOST = 200_000  # files that are examined
_NAMED = 3


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
    names = ", ".join(shown(path.name) for path in unused[:_NAMED]) + (", ..." if len(unused) > _NAMED else "")
    count, total = len(raw.frames), len(raw.frames) + len(unused)
    has = "1 image has" if len(unused) == 1 else f"{len(unused)} images have"
    findings.warning(
        f"{count} of {total} images are registered; {has} no pose",
        f"{shown(unused[0].parent)}: {names}",
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
            children[:] = [c for c in children if is_deep and not c.startswith(".") and not _ADDED.fullmatch(c)]
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
                if is_image and not name.startswith(".") and not _ADDED.fullmatch(stem):
                    yield place / name
