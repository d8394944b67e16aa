"""Known floor of stacked storeys: one grid per storey, selected by the height of a point."""

from __future__ import annotations

import zipfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.opening import opened
from nvsim.files.stored_arrays import read_arrays, write_arrays
from nvsim.geometry.floor_surface import Floor, StackedFloor
from nvsim.perception.support import FloorSupport, Mask


@dataclass(frozen=True, eq=False)
class StackedSupport:
    """floor    the floors of all storeys
    storeys  the known floor of each storey, the lowest first
    """

    floor: StackedFloor
    storeys: tuple[FloorSupport, ...]

    @property
    def area(self) -> float:
        """Square meters of known floor; stairs count on both storeys that they join."""
        return float(sum(s.cells.sum() * s.spacing**2 for s in self.storeys))

    def is_supported(self, points: NDArray[np.floating]) -> Mask:
        """(...) bool: whether the floor at world points (..., 3), meters, is supported, on the storey that
        `StackedFloor.storey_at` selects. Places (..., 2) are on the lowest storey."""
        chosen = self.floor.storey_at(points)
        found: Mask = np.zeros(chosen.shape, bool)
        for k, support in enumerate(self.storeys):
            here = chosen == k
            if here.any():
                found[here] = support.is_supported(points[here])
        return found

    def save(self, path: Path) -> None:
        """Writes an .npz file. Raises InputError if it cannot be written."""
        rows, columns = np.max([s.cells.shape for s in self.storeys], axis=0)
        padded = [
            np.pad(s.cells, ((0, rows - s.cells.shape[0]), (0, columns - s.cells.shape[1]))) for s in self.storeys
        ]
        origins, spacing = np.array([s.origin for s in self.storeys]), np.array(self.storeys[0].spacing)
        write_arrays(path, {"storeys": np.stack(padded), "origins": origins, "spacing": spacing})

    @staticmethod
    def load(path: Path, floor: Floor) -> StackedSupport:
        """Reads the file that `save` wrote. Raises InputError if it is missing or has other content."""
        again = "run `nvsim floors --project` again"
        wanted = {"storeys": ("bui", 3), "origins": ("fi", 2), "spacing": ("fi", 0)}
        arrays = read_arrays(path, "a floor support of several storeys", wanted, again)
        cells, origins, spacing = arrays["storeys"].astype(bool), arrays["origins"], float(arrays["spacing"])
        fits = isinstance(floor, StackedFloor) and cells.shape[0] == len(floor.storeys) and cells.size > 0
        if (
            not fits
            or origins.shape != (len(cells), 2)
            or not np.isfinite([*origins.flat, spacing]).all()
            or spacing <= 0
        ):
            raise InputError(f"The floor support {path} cannot be read (its values are not valid); {again}.")
        assert isinstance(floor, StackedFloor)
        return StackedSupport(
            floor, tuple(FloorSupport(c, (float(x), float(y)), spacing) for c, (x, y) in zip(cells, origins))
        )


def is_stacked(path: Path) -> bool:
    """Whether `StackedSupport.save` wrote the file; False for any other file, also a damaged one."""
    with suppress(InputError, OSError, zipfile.BadZipFile), opened(path) as file, zipfile.ZipFile(file) as archive:
        return "storeys.npy" in archive.namelist()
    return False
