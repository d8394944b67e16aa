"""A splat file of any program in the window: only its Gaussians with their colors. Does not use Qt."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.drawing.painter import Models
from app.state.loading import Contents
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.formats.choice import read_splats
from nvsim.splats.turning import Up, up_of, upright
from nvsim.splats.types import Gaussians, SubmapModel

BULK = (2.0, 98.0)
"""Percentiles of the positions between which the object is; Gaussians outside are floaters."""


@dataclass(frozen=True)
class SplatFile:
    """The splat file at `path` with its up axis. The rendering process can open it."""

    path: Path
    up: Up

    @staticmethod
    def of(path: Path) -> SplatFile:
        """The splat file with the up axis that the file suggests. Raises InputError if it cannot be read."""
        return SplatFile(path, up_of(path))

    def contents(self) -> Contents:
        """The contents for the window: the outline of the Gaussians. Raises InputError if the file cannot be read."""
        splats = read_splats(self.path)
        outline = outline_of(upright(splats.gaussians, self.up))
        return Contents(self.path, scene_stamp=self, outline=outline, notes=splats.notes)

    def open(self) -> Models:
        """The model for the rendering process. Raises InputError if the file cannot be read."""
        splats = read_splats(self.path)
        gaussians = upright(splats.gaussians, self.up)
        model = SubmapModel(gaussians, None, None, FloorSurface.flat(0.0), bool(splats.antialiased))
        return Models(lambda camera: (0, model))


def outline_of(gaussians: Gaussians) -> np.ndarray:
    """(8, 3) float64 corners of the box around the bulk of the Gaussians; (0, 3) if there are none."""
    if len(gaussians) == 0:
        return np.zeros((0, 3))
    low, high = np.percentile(gaussians.means, BULK, axis=0)
    picks = np.indices((2, 2, 2)).reshape(3, -1).T
    return np.where(picks, high, low).astype(np.float64)
