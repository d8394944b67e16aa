"""The process that makes thumbnails, measures the floor share of masks, and computes candidate masks. Does not use
Qt."""

from __future__ import annotations

import contextlib
import hashlib
import json
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.project.layout import Layout
from nvsim_app.processes.serving import Requests, short_reason

if TYPE_CHECKING:
    from nvsim.capture.types import Frame
    from nvsim.project.frame_candidates import CandidateMaker

THUMBNAIL = (160, 120)  # minimum width and height of a thumbnail, pixels; the image may be smaller
COVERAGE = "coverage.json"
_BATCH = 64  # number of frames per answer about floor shares


@dataclass(frozen=True)
class ThumbnailRequest:
    """Requests thumbnails in this order. Each gets a Thumbnail or Failed."""

    frames: tuple[int, ...]


@dataclass(frozen=True)
class CoverageRequest:
    """Requests the floor shares of all masks. They arrive in several Coverage."""


@dataclass(frozen=True)
class CandidateRequest:
    """Requests the candidate masks of a frame: Candidates or Failed."""

    frame: int


@dataclass(frozen=True)
class PromptRequest:
    """Requests the masks of the prompted network: Prompted or Failed.

    points  x, y in shares of the image, True for floor
    """

    frame: int
    points: tuple[tuple[float, float, bool], ...]


Request = ThumbnailRequest | CoverageRequest | CandidateRequest | PromptRequest


@dataclass(frozen=True)
class Thumbnail:
    frame: int
    file: Path


@dataclass(frozen=True)
class Coverage:
    """shares: frame -> floor share of its mask. complete: whether all masks are read."""

    shares: dict[int, float]
    complete: bool = False


@dataclass(frozen=True)
class Candidates:
    """file: the candidate masks of the frame."""

    frame: int
    file: Path


@dataclass(frozen=True, eq=False)
class PromptResult:
    """add, take: (H, W) bool, the pixels to add to the mask and to remove from it."""

    frame: int
    add: NDArray[np.bool_]
    take: NDArray[np.bool_]


@dataclass(frozen=True)
class FailedRequest:
    """what: "thumbnail", "candidates" or "prompt"."""

    what: str
    frame: int
    sentence: str


class Worker:
    """Processes requests one by one."""

    def __init__(self, root: Path, requests: Requests) -> None:
        """Raises InputError if the project cannot be opened."""
        from nvsim.project.project import Project

        self._project = Project.open(root)
        self._requests = requests
        self._maker: CandidateMaker | None = None
        self._coverage: Iterator[None] | None = None
        self._thumbnails: list[int] = []
        self._number = 0  # of the request for these thumbnails

    def run(self) -> None:
        """Works until the window closes. Thumbnails have priority over floor shares, because the user waits for
        them."""
        while True:
            while self._requests.waiting or (not self._thumbnails and self._coverage is None):
                self._receive(*self._requests.wait_for_request())
            self._step()

    def _receive(self, number: int, request: Request) -> None:
        if isinstance(request, ThumbnailRequest):
            self._number, self._thumbnails = number, list(request.frames)[::-1]
        elif isinstance(request, CoverageRequest):
            self._coverage = self._read_coverage(number)
        elif isinstance(request, CandidateRequest):
            self._requests.answer(number, _result_or_failure("candidates", request.frame, self._make_candidates))
        else:
            self._requests.answer(number, _result_or_failure("prompt", request.frame, lambda _: self._prompt(request)))

    def _step(self) -> None:
        if self._thumbnails:
            made = _result_or_failure("thumbnail", self._thumbnails.pop(), self._make_thumbnail)
            self._requests.answer(self._number, made, more=bool(self._thumbnails))
        elif self._coverage is not None and next(self._coverage, self) is self:
            self._coverage = None

    def _make_thumbnail(self, frame: int) -> Thumbnail:
        image_path, lens = (found := self._project.need_capture().frames[frame]).image_path, found.lens
        path = thumbnail_path(self._project.layout, found)
        with contextlib.suppress(OSError):
            if path.stat().st_mtime_ns >= image_path.stat().st_mtime_ns:
                return Thumbnail(frame, path)
        import cv2

        from nvsim.capture.images import decode_for_camera
        from nvsim.files.atomic import write_bytes
        from nvsim.files.opening import read_bytes

        data = read_bytes(image_path)
        # Reduction by the decoder is several times as fast as decoding the full image.
        for reduced in (cv2.IMREAD_REDUCED_COLOR_8, cv2.IMREAD_REDUCED_COLOR_4, cv2.IMREAD_COLOR):
            image = decode_for_camera(data, image_path, reduced, (lens.width, lens.height))
            if min(image.shape[:2]) >= THUMBNAIL[1]:
                break
        image = lens.upright(image)
        height, width = image.shape[:2]
        scale = min(1.0, max(THUMBNAIL[0] / width, THUMBNAIL[1] / height))
        size = max(1, round(width * scale)), max(1, round(height * scale))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        write_bytes(path, cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes())
        return Thumbnail(frame, path)

    def _read_coverage(self, number: int) -> Iterator[None]:
        """Sends the floor share of every frame with a mask in batches. Caches the shares on disk with the modification
        time of the mask."""
        from nvsim.perception.segment import read_mask
        from nvsim.project.corrections import corrected_frames

        layout, capture = self._project.layout, self._project.capture()
        frames = capture.frames if capture is not None else ()
        corrected = corrected_frames(layout, frames)
        kept = _read_cache(layout.cache / COVERAGE)
        shares: dict[int, float] = {}
        for index, frame in enumerate(frames):
            path = layout.correction(frame.name) if index in corrected else layout.mask_of(frame.name, index)
            key = str(path.relative_to(layout.root))
            with contextlib.suppress(OSError, InputError):
                stamp = path.stat().st_mtime_ns
                if kept.get(key, [None])[0] != stamp:
                    kept[key] = [stamp, round(float(read_mask(path).mean()), 4)]
                    if len(shares) % 8 == 7:
                        yield
                shares[index] = kept[key][1]
            if len(shares) >= _BATCH:
                self._requests.answer(number, Coverage(shares), more=True)
                shares = {}
                yield
        self._requests.answer(number, Coverage(shares, complete=True))
        from nvsim.files.atomic import write_text

        with contextlib.suppress(InputError):  # without the cache, the next window computes the shares again
            write_text(layout.cache / COVERAGE, json.dumps(kept))

    def _make_candidates(self, frame: int) -> Candidates:
        return Candidates(frame, self._candidate_maker().make(frame))

    def _prompt(self, request: PromptRequest) -> PromptResult:
        points = np.array([point[:2] for point in request.points], float)
        on_floor = np.array([on for *_, on in request.points])
        return PromptResult(request.frame, *self._candidate_maker().prompt(request.frame, points, on_floor))

    def _candidate_maker(self) -> CandidateMaker:
        if self._maker is None:
            from nvsim.project.frame_candidates import CandidateMaker

            self._maker = CandidateMaker(self._project)
        return self._maker


def thumbnail_path(layout: Layout, frame: Frame) -> Path:
    """The thumbnail file of a frame. The name depends on the image path, its turns, and its border, so that a repeated
    import reuses it."""
    lens = frame.lens
    shown = str(frame.image_path)
    if lens.turns or any(lens.border):
        shown += f" {lens.turns} {lens.border}"
    name = hashlib.sha1(shown.encode("utf-8", "surrogateescape"), usedforsecurity=False).hexdigest()[:20]
    return layout.cache / "thumbnails" / f"{name}.jpg"


def _result_or_failure(what: str, frame: int, make: Callable[[int], object]) -> object:
    """The result of `make`, or why there is none."""
    try:
        return make(frame)
    except InputError as error:
        return FailedRequest(what, frame, str(error))
    except Exception as error:
        traceback.print_exc()
        return FailedRequest(what, frame, f"The image could not be processed: {short_reason(error)}")


def _read_cache(path: Path) -> dict[str, Any]:
    """The cached shares: path of a mask -> [modification time, floor share]; empty if the cache is damaged."""
    from nvsim.files.opening import read_json

    try:
        found = read_json(path, "the floor shares", "")
    except InputError:
        return {}
    rows = found.items() if isinstance(found, dict) else ()
    return {name: row for name, row in rows if isinstance(row, list) and len(row) == 2 and _is_share(row[1])}


def _is_share(value: object) -> bool:
    return type(value) in (int, float) and 0.0 <= value <= 1.0  # type: ignore[operator]


def serve(requests: Requests, root: Path) -> None:
    """Answers the requests for frames of the project at `root`. Raises InputError if it cannot be opened."""
    Worker(root, requests).run()
