"""A splat file of any program in the window: its Gaussians with their own colours, and nothing else. Knows no Qt."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.drawing.painter import Models
from app.state.loading import Contents
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.formats.choice import read_splats
from nvsim.splats.formats.upright import Up, up_of, upright
from nvsim.splats.types import Gaussians, SubmapModel

BULK = (2.0, 98.0)
"""Percentiles of the positions between which the thing itself lies; beyond are floaters."""


@dataclass(frozen=True)
class SplatFile:
    """The file at `path`, standing on its head until `up` is right. Can be opened in the drawing process."""

    path: Path
    up: Up

    @staticmethod
    def of(path: Path) -> SplatFile:
        """With the up axis that the file suggests. Raises InputError when it cannot be read."""
        return SplatFile(path, up_of(path))

    def contents(self) -> Contents:
        """What the window shows: where the Gaussians are. Raises InputError when the file cannot be read."""
        splats = read_splats(self.path)
        outline = outline_of(upright(splats.gaussians, self.up))
        return Contents(self.path, scene_stamp=self, outline=outline, notes=splats.notes)

    def open(self) -> Models:
        """Raises InputError when the file cannot be read."""
        splats = read_splats(self.path)
        gaussians = upright(splats.gaussians, self.up)
        model = SubmapModel(gaussians, None, None, FloorSurface.flat(0.0), bool(splats.antialiased))
        return Models(lambda camera: (0, model))


def outline_of(gaussians: Gaussians) -> np.ndarray:
    """(8, 3) corners of the box around the bulk of the Gaussians; (0, 3) when there are none."""
    if len(gaussians) == 0:
        return np.zeros((0, 3))
    low, high = np.percentile(gaussians.means, BULK, axis=0)
    picks = np.indices((2, 2, 2)).reshape(3, -1).T
    return np.where(picks, high, low).astype(np.float64)
