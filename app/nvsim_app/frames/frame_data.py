"""The displayed data of one frame: image, masks, depth, candidates, and the render from its camera.

A thread reads and writes files, so that the window never waits for a disk. The rendering process makes the render.
"""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QTimer, Signal

from nvsim.capture.types import Frame
from nvsim.errors import InputError
from nvsim.files.frame_numbers import number_in
from nvsim.geometry.camera import Intrinsics
from nvsim.perception.hybrid import HybridSteps
from nvsim.perception.roles import Failure as MaskFailure
from nvsim.project.layout import Layout
from nvsim_app.drawing.render_child import Picture, Request
from nvsim_app.frames.pictures import render
from nvsim_app.views.scene_view import SceneView

LARGEST = 2048  # maximum side length of the displayed image and mask, pixels


@dataclass(frozen=True, eq=False)
class FrameData:
    """The data of a frame that the page shows.

    image    (H, W, 3) uint8 RGB, undistorted
    mask     (H, W) bool, the floor mask in use, or None if the floors stage has not run
    machine  (H, W) bool, the floor that the floors stage found, or None
    depth    (h, w) float32, meters along the optical axis, 0 if unknown; None if no depth was estimated
    views    (h, w) uint8, how many other images confirm the depth, or None
    failure  why the mask may be wrong, "" if there is no reason
    ignored  (H, W) bool, the pixels that the capture's mask excludes, or None if the frame has no mask
    """

    index: int
    frame: Frame
    image: NDArray[np.uint8]
    mask: NDArray[np.bool_] | None
    machine: NDArray[np.bool_] | None
    depth: NDArray[np.float32] | None = None
    views: NDArray[np.uint8] | None = None
    failure: MaskFailure = ""
    ignored: NDArray[np.bool_] | None = None


@dataclass(frozen=True, eq=False)
class Failure:
    """An error of a frame, as a sentence for the user."""

    index: int
    sentence: str


def read_frame_data(layout: Layout, frame: Frame, index: int) -> FrameData:
    """Reads the data of a frame. Raises InputError if the image cannot be read. A depth image that cannot be read is
    None."""
    from nvsim.capture.images import read_image
    from nvsim.perception.failures import read_failures
    from nvsim.perception.segment import read_mask

    size = frame.intrinsics.limited_to(LARGEST)
    image = read_image(frame, size)
    mask = machine = None
    path = layout.mask_in_use(frame.name, index)
    if path.is_file():
        mask = read_mask(path, size.width, size.height)
    own = layout.mask_of(frame.name, index)
    if own.is_file():
        machine = read_mask(own, size.width, size.height)
    number = number_in(layout.masks, frame.name, index)
    failure = read_failures(layout.masks).get(number, "") if machine is not None else ""
    depth, views = _depth(layout.depth, number_in(layout.depth, frame.name, index))
    return FrameData(index, frame, image, mask, machine, depth, views, failure, _ignored(frame, size))


def _ignored(frame: Frame, size: Intrinsics) -> NDArray[np.bool_] | None:
    """The excluded pixels (H, W), None if the frame has no mask or the mask cannot be read."""
    from nvsim.capture.masks import usable_pixels

    try:
        usable = usable_pixels(frame, size)
    except InputError:
        return None
    return None if usable is None else ~usable


def _depth(folder: Path, index: int) -> tuple[NDArray[np.float32] | None, NDArray[np.uint8] | None]:
    """Depth and confidence of a frame; None for both if one is missing or damaged."""
    from nvsim.depth.files import read_confidence, read_depth

    if not folder.is_dir():
        return None, None
    try:
        return read_depth(folder, index), read_confidence(folder, index)
    except InputError:
        return None, None


def write_correction(layout: Layout, frame: Frame, mask: NDArray[np.bool_] | None) -> None:
    """Stores `mask` (H, W) bool as the correction of a frame; None removes the correction. Raises InputError if the
    file cannot be written."""
    from nvsim.project.corrections import remove_correction, save_correction

    if mask is None:
        remove_correction(layout, frame)
    else:
        save_correction(layout, frame, mask)


class Reader(QObject):
    """Reads and writes frames in a thread that runs from the first task to `stop`.

    read(FrameData)                     the data of the requested frame
    candidatesRead(int, HybridSteps)    the candidates of a frame
    written(int)                        the correction of a frame is stored
    failed(Failure)                     a task failed
    """

    read = Signal(object)
    candidatesRead = Signal(int, object)
    written = Signal(int)
    failed = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._tasks: queue.SimpleQueue[tuple[int, Callable[[], None]] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._wanted = -1

    def open(self, layout: Layout, frame: Frame, index: int) -> None:
        """Reads a frame. Earlier requests that have not started are dropped."""
        self._wanted = index

        def task() -> None:
            if index == self._wanted:
                self.read.emit(read_frame_data(layout, frame, index))

        self._do(index, task)

    def read_candidates(self, index: int, file: Path) -> None:
        """Reads the candidate masks of a frame from `file`. An InputError in the thread is emitted as `failed`."""

        def task() -> None:
            from nvsim.project.frame_candidates import read_candidates

            steps = read_candidates(file)
            if not isinstance(steps, HybridSteps):
                raise InputError(f"The candidate masks in {file} cannot be read; delete the file.")
            self.candidatesRead.emit(index, steps)

        self._do(index, task)

    def write(self, layout: Layout, frame: Frame, index: int, mask: NDArray[np.bool_] | None) -> None:
        """Stores `mask` (H, W) bool as the correction; None removes it. Do not modify `mask` afterward."""

        def task() -> None:
            write_correction(layout, frame, mask)
            self.written.emit(index)

        self._do(index, task)

    def stop(self) -> None:
        """Finishes all writes and ends the thread. Another task starts a new thread."""
        self._wanted = -1
        thread, self._thread = self._thread, None
        if thread is not None:
            self._tasks.put(None)
            thread.join()

    def _do(self, index: int, task: Callable[[], None]) -> None:
        self._tasks.put((index, task))
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="frame reader", daemon=True)
            self._thread.start()

    def _run(self) -> None:
        while (entry := self._tasks.get()) is not None:
            index, task = entry
            with contextlib.suppress(RuntimeError):  # the window and its signals are deleted
                try:
                    task()
                except InputError as error:
                    self.failed.emit(Failure(index, str(error)))


_VIEW = "frame"  # view name that distinguishes these requests from those of the 3D view


class FrameRender(QObject):
    """Requests renders of the open frame.

    wanted()            the receiver must call `ask` with the current frame and scale
    rendered(Painted)   a new render
    """

    wanted = Signal()
    rendered = Signal(object)

    def __init__(self, scene: SceneView, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._scene = scene
        self._numbers = count()
        self._matter: FrameData | None = None
        self._soon = QTimer(self, singleShot=True, interval=30)
        self._soon.timeout.connect(self.wanted)
        scene.link.arrived.connect(self._on_picture)
        scene.link.opened.connect(self.schedule)

    def schedule(self) -> None:
        """Schedules `wanted` after the frame or its scale changed. Repeated calls delay it."""
        self._soon.start()

    def ask(self, matter: FrameData, scale: float, channel: str) -> None:
        """Requests a render at `scale` pixels per pixel of the photo, at most 1. `channel` is one of tones.CHANNELS."""
        self._matter = matter
        height, width = matter.image.shape[:2]
        size = max(1, round(width * min(1.0, scale))), max(1, round(height * min(1.0, scale)))
        camera, scene = matter.frame.camera.scaled(*size), self._scene
        number = next(self._numbers)
        scene.link.ask(Request(number, camera, channel, False, scene.feed.renderer, _VIEW, values=True))

    def _on_picture(self, picture: Picture) -> None:
        if picture.request.view != _VIEW or self._matter is None:
            return
        if np.array_equal(picture.request.camera.camera_to_world, self._matter.frame.camera_to_world):
            self.rendered.emit(render(picture.pixels, picture.request.channel, picture.values))
