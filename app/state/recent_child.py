"""Checks recent projects in a child process: whether each exists, and a small existing image of it. A disk that does
not respond does not block the window. Does not use Qt."""

from __future__ import annotations

import base64
import json
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.state.child import Child, answer
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


class RecentChild:
    """Checks projects in a child process that `result` starts."""

    def __init__(self, projects: Sequence[Path]) -> None:
        self._projects = [str(path) for path in projects]
        self._lock = threading.Lock()
        self._child: Child | None = None
        self._killed = False

    def result(self) -> dict[Path, Looked] | None:
        """Runs the check and waits for it. None after `kill`. Raises InputError if no process can be started."""
        with tempfile.TemporaryDirectory(prefix="nvsim-recent-") as folder:
            (Path(folder) / "asked.json").write_text(json.dumps(self._projects))
            with self._lock:
                if self._killed:
                    return None
                self._child = Child("app.state.recent_child", Path(folder), "Recent projects cannot be checked")
            found = self._child.output()
        if found is None:
            return None
        return {
            Path(path): Looked(there, base64.b64decode(picture)) for path, (there, picture) in json.loads(found).items()
        }

    def kill(self) -> None:
        """Ends the process. Can be called from any thread, also before the start and after the end."""
        with self._lock:
            self._killed = True
            if self._child is not None:
                self._child.kill()


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
    from nvsim.files.regular import is_regular, read_json
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


def _work(folder: Path) -> bytes:
    from nvsim.files.regular import read_json

    found = {}
    for project in read_json(folder / "asked.json", "the request", "try again"):
        looked = look_at(Path(project))
        found[project] = looked.there, base64.b64encode(looked.picture).decode()
    return json.dumps(found).encode()


if __name__ == "__main__":
    sys.exit(answer(_work))
