"""Writes the masks of a scan: the pixels of each strip whose surfaces no training image shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic
from nvsim.geometry.directions import skybox
from nvsim.graph.types import NavGraph
from nvsim.r2r.observations.drawing import Source
from nvsim.r2r.observations.layout import ScanPlaces, png


def write_unseen(source: Source, graph: NavGraph, places: ScanPlaces, side: int) -> list[Path]:
    """Writes a mask for each included viewpoint with unseen pixels, as wide as its strip with faces of `side` pixels.
    Returns the paths. Raises InputError if a model is unreadable or writing fails."""
    assert source.photographed is not None
    drawn = [v for v in graph.viewpoints.values() if v.included]
    files = []
    for v in sorted(drawn, key=lambda v: source.scene.nearest(np.array(v.position))):
        shown = source.photographed.at(np.array(v.position))
        if not shown.all():
            path = places.unseen(v.id)
            atomic.write_bytes(path, png(unseen_strip(shown, side)))
            files.append(path)
    return files


def unseen_strip(shown: NDArray[np.bool_], side: int) -> NDArray[np.uint8]:
    """(side, 6 * side) uint8, 255 for unseen pixels, from the photographed directions `shown` (6, S, S)."""
    strip = skybox([np.where(face, 0, 255).astype(np.uint8) for face in shown])
    rows = np.arange(side) * len(strip) // side
    columns = np.arange(6 * side) * len(strip) // side
    return np.asarray(strip[rows[:, None], columns], np.uint8)
