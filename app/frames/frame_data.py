"""What there is to look at of one frame: its image, its masks, its candidates. Read and written in a thread, so that
the window never waits for a disk. Only its signals are Qt's."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, Signal

from nvsim.capture.types import Frame
from nvsim.errors import InputError
from nvsim.geometry.camera import Intrinsics
from nvsim.perception.hybrid import HybridSteps
from nvsim.perception.roles import Failure as MaskFailure
from nvsim.project.layout import Layout

LARGEST = 2048  # pixels: a mask is not painted finer than this


@dataclass(frozen=True, eq=False)
class FrameData:
    """image    (H, W, 3) uint8 RGB, undistorted
    mask     (H, W) bool, the floor that counts, or None before the floors were found
    machine  (H, W) bool, the floor that the machine found, or None
    depth    (h, w) float32, metres along the optical axis, 0 where unknown, or None where none was estimated
    views    (h, w) uint8, how many other images confirm it, or None
    failure  why the machine's mask is not what the hybrid segmentation meant, "" where it is
    ignored  (H, W) bool, the pixels that the capture's mask excludes, or None for a frame without one
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
    """A sentence for the user about a frame."""

    index: int
    sentence: str


def read_matter(layout: Layout, frame: Frame, index: int) -> FrameData:
    """Raises InputError for an image that cannot be read; a mask or a depth that cannot be is None."""
    from nvsim.capture.images import read_image
    from nvsim.perception.failures import read_failures
    from nvsim.perception.segment import read_mask
    from nvsim.project.corrections import mask_in_use

    size = frame.intrinsics.within(LARGEST)
    image = read_image(frame, size)
    mask = machine = None
    path = mask_in_use(layout, frame, index)
    if path.is_file():
        mask = read_mask(path, size.width, size.height)
    if layout.mask(index).is_file():
        machine = read_mask(layout.mask(index), size.width, size.height)
    failure = read_failures(layout.masks).get(index, "") if machine is not None else ""
    depth, views = _depth(layout.depth, index)
    return FrameData(index, frame, image, mask, machine, depth, views, failure, _ignored(frame, size))


def _ignored(frame: Frame, size: Intrinsics) -> NDArray[np.bool_] | None:
    """None too for a mask that cannot be read."""
    from nvsim.capture.masks import usable_pixels

    try:
        usable = usable_pixels(frame, size)
    except InputError:
        return None
    return None if usable is None else ~usable


def _depth(folder: Path, index: int) -> tuple[NDArray[np.float32] | None, NDArray[np.uint8] | None]:
    """Depth and confidence of a frame; None for both where one is missing or damaged."""
    from nvsim.depth.files import read_confidence, read_depth

    if not folder.is_dir():
        return None, None
    try:
        return read_depth(folder, index), read_confidence(folder, index)
    except InputError:
        return None, None


def write_correction(layout: Layout, frame: Frame, mask: NDArray[np.bool_] | None) -> None:
    """None goes back to the mask that the floors stage found. Raises InputError when the disk refuses."""
    from nvsim.project.corrections import remove_correction, save_correction

    if mask is None:
        remove_correction(layout, frame)
    else:
        save_correction(layout, frame, mask)


class Reader(QObject):
    """read(Matter), candidatesRead(int, HybridSteps), written(int) and failed(Failure), all from a thread of its own
    that lives from the first task to `stop`."""

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
        """Reads a frame; one that was asked for before and not begun is forgotten."""
        self._wanted = index

        def task() -> None:
            if index == self._wanted:
                self.read.emit(read_matter(layout, frame, index))

        self._do(index, task)

    def read_candidates(self, index: int, file: Path) -> None:
        def task() -> None:
            from nvsim.project.frame_candidates import read_candidates

            steps = read_candidates(file)
            if not isinstance(steps, HybridSteps):
                raise InputError(f"The candidate masks in {file} cannot be read; delete the file.")
            self.candidatesRead.emit(index, steps)

        self._do(index, task)

    def write(self, layout: Layout, frame: Frame, index: int, mask: NDArray[np.bool_] | None) -> None:
        """Stores `mask` (H, W), which is not changed any more, as the correction; None removes it."""

        def task() -> None:
            write_correction(layout, frame, mask)
            self.written.emit(index)

        self._do(index, task)

    def stop(self) -> None:
        """Returns when everything asked for is written and the thread has ended; another task starts a new one."""
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
            with contextlib.suppress(RuntimeError):  # the window is gone, and the signals with it
                try:
                    task()
                except InputError as error:
                    self.failed.emit(Failure(index, str(error)))
