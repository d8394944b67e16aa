"""The process that makes thumbnails, measures the floor share of masks, and computes candidate masks. Does not use Qt.

`python -m app.frames.worker PROJECT` reads one JSON object per line, and writes one JSON object per line:

    {"do": "thumbnails", "frames": [3, 4]}   in this order; replaces the previous request of thumbnails
        {"did": "thumbnail", "frame": 3, "file": PATH}
    {"do": "coverage"}                       {"did": "coverage", "shares": {"3": 0.41, ...}, "more": true}
    {"do": "candidates", "frame": 3}         {"did": "candidates", "frame": 3, "file": PATH}
    {"do": "prompt", "frame": 3, "points": [[x, y, true], ...]}   x, y in shares of the image, true for floor
        {"did": "prompt", "frame": 3, "shape": [h, w], "add": BITS, "take": BITS}   packed, deflated, base 64

If a request fails, it writes {"did": "failed", "do": ..., "frame": 3, "sentence": ...}. It ends when its input ends.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from app.frames.files import COVERAGE, THUMBNAIL, thumbnail_path
from nvsim.errors import InputError
from nvsim.project.layout import Layout

if TYPE_CHECKING:
    from nvsim.project.frame_candidates import CandidateMaker

_BATCH = 64  # number of frames per message about floor shares
Say = Callable[[dict[str, Any]], None]


class Worker:
    """Processes requests one by one. Another thread adds requests to `wishes` meanwhile."""

    def __init__(self, root: Path, say: Say) -> None:
        from nvsim.project.project import Project

        self._project = Project.open(root)
        self._say = say
        self._maker: CandidateMaker | None = None
        self.wishes: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._coverage: Iterator[None] | None = None
        self._thumbnails: list[int] = []

    def run(self) -> None:
        """Works until the input ends. Thumbnails have priority over floor shares, because the user waits for them."""
        while True:
            busy = bool(self._thumbnails) or self._coverage is not None
            with contextlib.suppress(queue.Empty):
                while True:
                    wish = self.wishes.get(block=not busy)
                    if wish is None:
                        return
                    self._hear(wish)
                    busy = True
            self._step()

    def _hear(self, wish: dict[str, Any]) -> None:
        if wish["do"] == "thumbnails":
            self._thumbnails = list(wish["frames"])[::-1]
        elif wish["do"] == "coverage":
            self._coverage = self._read_coverage()
        elif wish["do"] == "candidates":
            self._try("candidates", wish["frame"], self._make_candidates)
        elif wish["do"] == "prompt":
            self._try("prompt", wish["frame"], lambda frame: self._prompt(frame, wish["points"]))

    def _step(self) -> None:
        if self._thumbnails:
            self._try("thumbnail", self._thumbnails.pop(), self._make_thumbnail)
        elif self._coverage is not None and next(self._coverage, self) is self:
            self._coverage = None

    def _try(self, what: str, frame: int, make: Callable[[int], Path | dict[str, Any]]) -> None:
        try:
            made = make(frame)
            self._say({"did": what, "frame": frame} | (made if isinstance(made, dict) else {"file": str(made)}))
        except InputError as error:
            self._say({"did": "failed", "do": what, "frame": frame, "sentence": str(error)})
        except Exception as error:
            traceback.print_exc()
            self._say({"did": "failed", "do": what, "frame": frame, "sentence": f"Unexpected error: {error}"})

    def _make_thumbnail(self, frame: int) -> Path:
        image_path, lens = (found := self._project.need_capture().frames[frame]).image_path, found.lens
        path = thumbnail_path(self._project.layout, image_path)
        with contextlib.suppress(OSError):
            if path.stat().st_mtime_ns >= image_path.stat().st_mtime_ns:
                return path
        import cv2

        from nvsim.capture.images import decode_for_camera
        from nvsim.files.atomic import write_bytes
        from nvsim.files.regular import read_bytes

        data = read_bytes(image_path)
        # Reduction by the decoder is several times as fast as decoding the full image.
        for reduced in (cv2.IMREAD_REDUCED_COLOR_8, cv2.IMREAD_REDUCED_COLOR_4, cv2.IMREAD_COLOR):
            image = decode_for_camera(data, image_path, reduced, (lens.width, lens.height))
            if min(image.shape[:2]) >= THUMBNAIL[1]:
                break
        height, width = image.shape[:2]
        scale = min(1.0, max(THUMBNAIL[0] / width, THUMBNAIL[1] / height))
        size = max(1, round(width * scale)), max(1, round(height * scale))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        write_bytes(path, cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes())
        return path

    def _read_coverage(self) -> Iterator[None]:
        """Sends the floor share of every frame with a mask in batches. Caches the shares on disk with the modification
        time of the mask."""
        from nvsim.perception.segment import read_mask
        from nvsim.project.corrections import corrected_frames

        layout, capture = self._project.layout, self._project.capture()
        frames = capture.frames if capture is not None else ()
        corrected = corrected_frames(layout, frames)
        kept = _kept(layout.cache / COVERAGE)
        shares: dict[str, float] = {}
        for index, frame in enumerate(frames):
            path = layout.correction(frame.name) if index in corrected else layout.mask(index)
            key = str(path.relative_to(layout.root))
            with contextlib.suppress(OSError, InputError):
                stamp = path.stat().st_mtime_ns
                if kept.get(key, [None])[0] != stamp:
                    kept[key] = [stamp, round(float(read_mask(path).mean()), 4)]
                    if len(shares) % 8 == 7:
                        yield
                shares[str(index)] = kept[key][1]
            if len(shares) >= _BATCH:
                self._say({"did": "coverage", "shares": shares, "more": True})
                shares = {}
                yield
        self._say({"did": "coverage", "shares": shares, "more": False})
        from nvsim.files.atomic import write_text

        with contextlib.suppress(InputError):  # without the cache, the next window computes the shares again
            write_text(layout.cache / COVERAGE, json.dumps(kept))

    def _make_candidates(self, frame: int) -> Path:
        return self._candidate_maker().make(frame)

    def _prompt(self, frame: int, prompts: list[list[Any]]) -> dict[str, Any]:
        import numpy as np

        from app.frames.files import packed

        points = np.array([p[:2] for p in prompts], float)
        add, take = self._candidate_maker().prompt(frame, points, np.array([bool(p[2]) for p in prompts]))
        return {"shape": list(add.shape), "add": packed(add), "take": packed(take)}

    def _candidate_maker(self) -> CandidateMaker:
        if self._maker is None:
            from nvsim.project.frame_candidates import CandidateMaker

            self._maker = CandidateMaker(self._project)
        return self._maker


def _kept(path: Path) -> dict[str, Any]:
    """The cached shares: path of a mask -> [modification time, floor share]; empty if the cache is damaged."""
    from nvsim.files.regular import read_json

    try:
        found = read_json(path, "the floor shares", "")
    except InputError:
        return {}
    rows = found.items() if isinstance(found, dict) else ()
    return {name: row for name, row in rows if isinstance(row, list) and len(row) == 2 and _is_share(row[1])}


def _is_share(value: object) -> bool:
    return type(value) in (int, float) and 0.0 <= value <= 1.0  # type: ignore[operator]


def main(root: Path, source: IO[str], target: IO[str]) -> int:
    """Processes the requests of `source` until it ends. Returns exit code 0, or 2 if the project cannot be opened."""
    if hasattr(os, "nice"):
        os.nice(10)  # the window and its renderer have priority

    def say(message: dict[str, Any]) -> None:
        try:
            target.write(json.dumps(message) + "\n")
            target.flush()
        except BrokenPipeError:
            os._exit(0)  # the window was closed

    try:
        worker = Worker(root, say)
    except InputError as error:
        say({"did": "failed", "do": "open", "frame": -1, "sentence": str(error)})
        return 2

    def listen() -> None:
        for line in source:
            worker.wishes.put(json.loads(line))
        worker.wishes.put(None)

    threading.Thread(target=listen, daemon=True).start()
    worker.run()
    return 0


if __name__ == "__main__":
    sys.exit(main(Layout(Path(sys.argv[1])).root, sys.stdin, sys.stdout))
