"""Choose the frames of a video that get a camera pose: sharp frames with enough overlap."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.footage.decoding import VideoFrame, video_facts, video_frames
from nvsim.footage.tracking import (
    TrackedFrame,
    frame_without_points,
    sharpness_change,
    shrunk_gray,
    track_points,
    with_new_points,
)

_STEP = 0.08  # image widths: median motion of the points from one chosen frame to the next
_EARLY = 0.6  # share of the step after which a frame may be chosen
_ALIVE, _LOST = 0.55, 0.35  # share of tracked points below which the next frame is due, and tracking has failed
_FIRM = 160  # points that connect two chosen frames; with fewer, the next frame is due
_FEW = 40  # points; an image with fewer counts as if it had so many
_FOUND = 0.35  # share of the previous frame's points that a sharp frame shows
_WAITING = 12  # candidates for the next chosen frame, at most
_BLURRED = 0.6  # sharpness over that of the last second; a frame below it waits for a better one
_MEMORY = 0.85  # weight of the log sharpness of a frame in that of the next
_PATIENCE = 2.0  # steps after which a blurred frame is chosen anyway


@dataclass(frozen=True, eq=False)
class ChosenFrame:
    """A frame that gets a camera pose.

    frame    the video frame
    clip     index of the video
    tracked  its points, including the new points that start here
    blurred  whether it is less than 0.6 times as sharp as its neighbors in time
    """

    frame: VideoFrame
    clip: int
    tracked: TrackedFrame
    blurred: bool


@dataclass(eq=False)
class _Candidate:
    frame: VideoFrame
    tracked: TrackedFrame
    sharpness: float
    moved: float = 0.0
    alive: float = 1.0


def choose_frames(
    videos: tuple[Path, ...], looked_at: Callable[[int, int], None] = lambda done, total: None
) -> Iterator[ChosenFrame]:
    """Yields the chosen frames of all videos in order.

    `looked_at` is called with the number of decoded frames and their expected total (0 if unknown). Point numbers are
    unique over all videos. Raises InputError for a file that cannot be decoded."""
    facts = [video_facts(path) for path in videos]
    total = sum(f.frames for f in facts)
    done, next_id = 0, 0
    for clip, path in enumerate(videos):
        chooser = _Chooser(clip, next_id)
        for frame in video_frames(path):
            yield from chooser.looked_at(frame)
            looked_at(done + frame.number + 1, total)
        yield from chooser.choose_last()
        done, next_id = done + facts[clip].frames, chooser.next_id


def choose_images(images: Iterable[VideoFrame]) -> Iterator[ChosenFrame]:
    """Yields the chosen frames of `images`, the frames of one video in order."""
    chooser = _Chooser(0, 0)
    for image in images:
        yield from chooser.looked_at(image)
    yield from chooser.choose_last()


class _Chooser:
    def __init__(self, clip: int, first_id: int) -> None:
        self.next_id = first_id
        self._clip = clip
        self._anchor: TrackedFrame | None = None  # the last chosen frame
        self._latest: TrackedFrame | None = None  # the last decoded frame
        self._waiting: list[_Candidate] = []
        self._earlier: _Candidate | None = None  # the last decoded frame that can be chosen
        self._sharp = 1.0  # sharpness of the last frame
        self._held: _Candidate | None = None  # a frame that shows too few of the points

    def looked_at(self, frame: VideoFrame) -> Iterator[ChosenFrame]:
        """Yields the frames that are chosen after `frame` was decoded."""
        candidate = _Candidate(frame, frame_without_points(shrunk_gray(frame.image)), 1.0)
        if self._latest is None:
            yield self._choose(candidate)
            return
        queue = [candidate]
        while queue:
            candidate = queue.pop(0)
            held, self._held = self._held, None
            tracked = track_points(self._latest, candidate.tracked.gray, 1 if held is None else 2)
            if held is not None:
                # The previous frame shows too few of the points. Without it, this frame may show more of them.
                through = track_points(track_points(self._latest, held.tracked.gray), candidate.tracked.gray)
                if len(through.ids) > len(tracked.ids):
                    queue = [candidate, *queue]
                    candidate, tracked = held, track_points(self._latest, held.tracked.gray)
            elif len(tracked.ids) < _FOUND * len(self._latest.ids):
                self._held = candidate
                continue
            chosen = self._frame_after_tracking(candidate, tracked)
            if chosen is not None:
                queue = [c for c in self._waiting if c.frame.number > chosen.frame.number] + queue
                self._waiting = []
                yield self._choose(chosen)

    def choose_last(self) -> Iterator[ChosenFrame]:
        """Yields the last frame of the video if it shows more than the last chosen one."""
        if self._waiting:
            yield self._choose(max(self._waiting, key=lambda c: c.sharpness))

    def _frame_after_tracking(self, candidate: _Candidate, tracked: TrackedFrame) -> _Candidate | None:
        """The frame to choose after the points were `tracked` into the candidate. None if no frame is due."""
        assert self._anchor is not None and self._latest is not None
        candidate.sharpness = self._sharp**_MEMORY * sharpness_change(self._latest, tracked)
        self._sharp = candidate.sharpness
        self._latest = candidate.tracked = tracked
        mine, theirs = self._anchor.shared_with(self._latest)
        candidate.alive = min(len(mine) / max(_FEW, len(self._anchor.ids)), len(mine) / _FIRM * _ALIVE)
        candidate.moved = 1.0
        if len(mine) >= 8:
            shift = self._anchor.places[mine] - self._latest.places[theirs]
            candidate.moved = float(np.median(np.linalg.norm(shift, axis=1))) / candidate.tracked.gray.shape[1]
        earlier, self._earlier = self._earlier, candidate
        if candidate.alive < _LOST and earlier is not None:
            self._waiting.append(candidate)
            return earlier  # the last frame before tracking failed
        if candidate.moved < _EARLY * _STEP and candidate.alive >= _ALIVE:
            return None
        self._waiting.append(candidate)
        if len(self._waiting) > _WAITING:
            del self._waiting[min(range(_WAITING), key=lambda k: self._waiting[k].sharpness)]
        if candidate.moved < _STEP and candidate.alive >= _ALIVE:
            return None
        best = max(self._waiting, key=lambda c: c.sharpness)
        patient = candidate.moved < _PATIENCE * _STEP and candidate.alive >= _ALIVE
        return None if patient and self._is_blurred(best) else best

    def _is_blurred(self, candidate: _Candidate) -> bool:
        return candidate.sharpness < _BLURRED

    def _choose(self, candidate: _Candidate) -> ChosenFrame:
        self._sharp, self._earlier = candidate.sharpness, None
        self._anchor = self._latest = with_new_points(candidate.tracked, self.next_id)
        self.next_id = max(self.next_id, int(self._anchor.ids.max(initial=-1)) + 1)
        return ChosenFrame(candidate.frame, self._clip, self._anchor, self._is_blurred(candidate))


def point_positions(tracked: TrackedFrame, scale: float) -> NDArray[np.float64]:
    """(N, 2) float64 positions of the points in pixels of the stored image. The center of its first pixel is (0.5,
    0.5). `scale` is the size of the stored image divided by that of the gray image."""
    return (tracked.places.astype(np.float64) + 0.5) * scale
