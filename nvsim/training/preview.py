"""The image that shows how far a training is: image and model side by side, below them what makes up the model."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.files.atomic import write_bytes
from nvsim.render.workspace import LOCK
from nvsim.training.fit import Fit
from nvsim.training.views import TrainingView


def preview(fit: Fit, view: TrainingView) -> NDArray[np.uint8]:
    """(2 H, 2 W, 3) RGB: image, model; alpha of the Gaussians (black on the floor, where they must not be), background
    and floor texture alone."""
    model, alpha = fit.composite(view.camera)
    with LOCK:
        background = fit.paint(view.camera, np.ones_like(alpha)).transpose(1, 2, 0).copy()
    below = np.concatenate([np.repeat(alpha[..., None], 3, axis=2), background], axis=1)
    above = np.concatenate([view.image, _bytes(model)], axis=1)
    return np.concatenate([above, _bytes(below)])


def write_preview(fit: Fit, view: TrainingView, path: Path) -> None:
    """A JPEG at `path`. Raises InputError when the disk refuses."""
    picture = preview(fit, view)
    # OpenCV does not survive a path that is not UTF-8, so it never gets to see one.
    write_bytes(path, cv2.imencode(".jpg", picture[..., ::-1])[1].tobytes())


def _bytes(colours: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.asarray(255 * np.clip(colours, 0, 1), np.uint8)
