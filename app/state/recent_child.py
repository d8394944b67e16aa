"""Checks recent projects in a side process: whether each exists, and a small existing image of it. A disk that does
not respond does not block the window. Does not use Qt."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from app.processes.child import Program
from app.processes.serving import Requests
from nvsim.errors import InputError
from nvsim.project.layout import Layout

PICTURE = (240, 160)  # size of the area that an image must cover, pixels
LAST_VIEW = "view.jpg"
"""File in the cache of a project: the last image of the 3D view when the project was closed."""


@dataclass(frozen=True)
class Looked:
    """The result for one project.

    there    whether it is a project that can be opened
    picture  JPEG, b"" if the project has no image
    """

    there: bool
    picture: bytes


def look_at(project: Path) -> Looked:
    """Checks one project. Never raises; a project that cannot be read has no image."""
    from nvsim.project.path_kind import path_kind

    if path_kind(project) != "project":
        return Looked(False, b"")
    for image in _images(project):
        try:
            return Looked(True, _small(image))
        except InputError:
            continue
    return Looked(True, b"")


def _images(project: Path) -> Iterator[Path]:
    """Existing images of the project, the most informative first."""
    from nvsim.files.opening import is_regular, read_json
    from nvsim.project.project import Project

    layout = Layout(project)
    if is_regular(layout.cache / LAST_VIEW):
        yield layout.cache / LAST_VIEW
    try:
        with Project.open(project) as opened:
            layout = opened.layout
        tree = read_json(layout.imported / "capture.json", "a stored capture", "import it again")
        frames = tree["frames"]
        yield Path(str(frames[len(frames) // 2]["image"]))
    except (InputError, OSError, KeyError, TypeError, IndexError, ValueError):
        pass
    thumbnails = sorted((layout.cache / "thumbnails").glob("*.jpg"))
    yield from thumbnails[len(thumbnails) // 2 :][:1]


def _small(image: Path) -> bytes:
    """The image as JPEG, reduced so that it just covers PICTURE. Raises InputError if the file is not an image."""
    import cv2

    from nvsim.capture.images import decode

    pixels = decode(image)
    height, width = pixels.shape[:2]
    share = min(1.0, max(PICTURE[0] / width, PICTURE[1] / height))  # the view crops it
    size = max(1, round(width * share)), max(1, round(height * share))
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 85])[1])


def _look(requests: Requests, projects: tuple[Path, ...]) -> dict[Path, Looked]:
    return {project: look_at(project) for project in projects}


RECENT = Program(_look, "recent projects", "Recent projects cannot be checked", memory=1 << 30)
"""Paths of projects -> path -> Looked"""
