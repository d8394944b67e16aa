"""Preview images of a training: image and model side by side, below them the parts of the model. Files exist for the
newest step and for some earlier ones."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.files.atomic import write_bytes
from nvsim.render.workspace import LOCK
from nvsim.training.model_fit import ModelFit
from nvsim.training.views import TrainingView

MOST_STEPS = 20
KEPT_RUNS = 2
QUALITY = 92  # of JPEG


def preview(fit: ModelFit, view: TrainingView) -> NDArray[np.uint8]:
    """(2 H, 2 W, 3) uint8 RGB. Above are image and model; below are the alpha of the Gaussians and the background with
    the floor texture alone. Alpha should be black on the floor."""
    model, alpha = fit.composite(view.camera)
    with LOCK:
        background = fit.paint(view.camera, np.ones_like(alpha)).transpose(1, 2, 0).copy()
    below = np.concatenate([np.repeat(alpha[..., None], 3, axis=2), background], axis=1)
    above = np.concatenate([view.image, _bytes(model)], axis=1)
    return np.concatenate([above, _bytes(below)])


def psnr_of(picture: NDArray[np.uint8]) -> float:
    """Decibels between image and model of a `preview` (2 H, 2 W, 3), rounded to 8 bits."""
    height, width = picture.shape[0] // 2, picture.shape[1] // 2
    error = picture[:height, :width].astype(np.float32) - picture[:height, width:]
    return float(10 * np.log10(255**2 / max(float(np.mean(error**2)), 1e-3)))


class PreviewFiles:
    """The newest image at `path`, and beside it files NAME_RUN_STEP.jpg. There are at most MOST_STEPS steps of this
    run, spread over it, and those of the KEPT_RUNS - 1 previous runs.

    run  name of the training, hexadecimal, increasing with time; a run resumed from a checkpoint keeps its name
    """

    def __init__(self, path: Path, run: str) -> None:
        self._path, self._run = path, run

    def write(self, picture: NDArray[np.uint8], step: int) -> Path:
        """Writes the image (H, W, 3) RGB of a step; returns the path that keeps it. Raises InputError if it cannot be
        written."""
        # OpenCV fails on a path that is not UTF-8, so it only encodes.
        data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
        write_bytes(self._path, data)
        path = self._path.with_name(f"{self._path.stem}_{self._run}_{step:07d}.jpg")
        write_bytes(path, data)
        self._tidy(step)
        return path

    def _tidy(self, step: int) -> None:
        found = _runs(self._path)
        for run in sorted(found.keys() - {self._run})[: -(KEPT_RUNS - 1)]:
            _remove(found[run].values())
        mine = found.get(self._run, {})
        _remove(mine.pop(later) for later in [s for s in mine if s > step])  # steps after a checkpoint were not kept
        steps = sorted(mine)
        while len(steps) > MOST_STEPS:
            # Remove the step whose neighbors are nearest to each other; the first and the last stay.
            least = min(range(1, len(steps) - 1), key=lambda i: (steps[i + 1] - steps[i - 1], i))
            _remove([mine[steps.pop(least)]])


def is_run(name: object) -> bool:
    """Whether `name` is valid as the name of a run."""
    return isinstance(name, str) and re.fullmatch("[0-9a-f]{1,16}", name) is not None


def _runs(path: Path) -> dict[str, dict[int, Path]]:
    """Run -> step -> file, for all files beside `path`."""
    pattern = re.compile(re.escape(path.stem) + r"_([0-9a-f]{1,16})_(\d{1,12})\.jpg")
    found: dict[str, dict[int, Path]] = {}
    for file in path.parent.iterdir():
        match = pattern.fullmatch(file.name)
        if match is not None:
            found.setdefault(match[1], {})[int(match[2])] = file
    return found


def _remove(files: Iterable[Path]) -> None:
    for file in files:
        with contextlib.suppress(OSError):  # tried again later
            file.unlink(missing_ok=True)


def _bytes(colours: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.asarray(255 * np.clip(colours, 0, 1), np.uint8)
