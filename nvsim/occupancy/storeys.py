"""The occupancy maps of a building with several storeys, one map per storey, and the stairs between them.

On disk, they are a folder with `storeys.json`. It names a map for every storey, the height of its floor, and the
outline of every stair seen from above:

    {"storeys": [{"floor": 0.0, "map": "storey_0/map.yaml"}, {"floor": 3.0, "map": "storey_1/map.yaml"}],
     "stairs": [{"from": 0, "to": 1, "outline": [[1.0, 2.0], [5.8, 2.0], [5.8, 3.2], [1.0, 3.2]]}]}

The treads of a stair are free in the maps of both storeys that it connects.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError, value_text
from nvsim.files import atomic
from nvsim.files.opening import read_json
from nvsim.files.reading import reading
from nvsim.occupancy.ros import write_ros_map
from nvsim.occupancy.types import Heights, OccupancyMap

NAME = "storeys.json"
_AGAIN = "write it as `nvsim demo --storeys 2` does"
_MOST = 1000  # storeys, stairs, and corners of an outline
_LARGEST = 1 << 22  # bytes
_FARTHEST = 1e7  # meters


@dataclass(frozen=True, eq=False)
class StoreyMap:
    """The map of one storey. `floor` is its height in meters, world z; the map's cells show the obstacles on it."""

    floor: float
    occupancy: OccupancyMap


@dataclass(frozen=True)
class Stair:
    """lower, upper  indices of the storeys that it connects
    outline       (x, y) meters of the corners of its treads from above, in order
    """

    lower: int
    upper: int
    outline: tuple[tuple[float, float], ...]

    def contains(self, xy: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(N,) bool, True for `xy` (N, 2), meters, on the stair: a ray crosses the outline an odd number of times."""
        corners = np.array(self.outline, np.float64)
        x, y = np.asarray(xy, np.float64).reshape(-1, 2).T[..., None]
        (x0, y0), (x1, y1) = corners.T, np.roll(corners, -1, axis=0).T
        crosses = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            left = x < x0 + (y - y0) * (x1 - x0) / (y1 - y0)
        return np.asarray((crosses & left).sum(axis=1) % 2 == 1)


@dataclass(frozen=True, eq=False)
class StoreyMaps:
    """The storeys of a building, lowest first, and the stairs between them."""

    storeys: tuple[StoreyMap, ...]
    stairs: tuple[Stair, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """The notes of all maps."""
        return tuple(note for storey in self.storeys for note in storey.occupancy.notes)

    def nearest(self, floors: NDArray[np.floating]) -> NDArray[np.int64]:
        """(N,) int64 index of the storey whose floor is nearest to each of `floors` (N,), meters, world z."""
        levels = np.array([s.floor for s in self.storeys])
        return np.asarray(np.abs(np.asarray(floors)[:, None] - levels).argmin(axis=1), np.int64)

    def storey_under(self, heights: NDArray[np.floating]) -> NDArray[np.int64]:
        """(N,) int64 storey of cameras at `heights` (N,), meters, world z: the highest storey with its floor below the
        camera, else the lowest."""
        levels = np.array([s.floor for s in self.storeys])
        return np.asarray(np.maximum(np.searchsorted(levels, heights) - 1, 0), np.int64)


def write_storeys(maps: StoreyMaps, folder: Path) -> Path:
    """Write a ROS map for every storey into `folder`/storey_N, and then `folder`/storeys.json; returns its path.

    Raises InputError if the files cannot be written.
    """
    for k, storey in enumerate(maps.storeys):
        write_ros_map(storey.occupancy, folder / f"storey_{k}" / "map.yaml")
    data = {
        "storeys": [{"floor": s.floor, "map": f"storey_{k}/map.yaml"} for k, s in enumerate(maps.storeys)],
        "stairs": [{"from": s.lower, "to": s.upper, "outline": [list(c) for c in s.outline]} for s in maps.stairs],
    }
    atomic.write_text(folder / NAME, json.dumps(data, indent=1) + "\n")
    return folder / NAME


def is_storeys(path: Path) -> bool:
    """Whether `path` can be given to `read_storeys`: a folder, or a .json file."""
    return path.is_dir() or path.suffix.lower() == ".json"


def read_storeys(path: Path, heights: Heights | None = None) -> StoreyMaps:
    """The maps that `path` names: a folder with `storeys.json`, or that file.

    An OctoMap may contain all storeys; it is cut between `heights` over the floor of each storey. Raises InputError if
    a file cannot be read."""
    path = Path(path)
    path = path / NAME if path.is_dir() else path
    with reading(path, "a list of storeys", _AGAIN):
        return _read(path, heights)


def _read(path: Path, heights: Heights | None) -> StoreyMaps:
    from nvsim.occupancy.octomap import read_octomap
    from nvsim.occupancy.read import OCTOMAP, read_map

    data = read_json(path, "a list of storeys", _AGAIN, _LARGEST)
    rows = _rows(path, data, "storeys")
    if not rows:
        raise InputError(f"{path} names no storey; write one with its floor and its map.")
    floors = [_height(path, number, row) for number, row in enumerate(rows)]
    if any(b - a < 0.5 for a, b in zip(floors, floors[1:])):
        raise InputError(f"{path}: the floors {floors} do not rise by 0.5 m or more; name the lowest storey first.")
    stairs = tuple(_stair(path, n, row, len(rows)) for n, row in enumerate(_rows(path, data, "stairs")))
    maps = []
    for floor, row in zip(floors, rows):
        file = path.parent / row["map"]
        cut = file.suffix.lower() in OCTOMAP
        maps.append(StoreyMap(floor, read_octomap(file, heights, floor) if cut else read_map(file)))
    return StoreyMaps(tuple(maps), stairs)


def _rows(path: Path, data: object, name: str) -> list[dict[str, Any]]:
    rows = data.get(name, []) if isinstance(data, dict) else None
    if not isinstance(rows, list) or len(rows) > _MOST or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{path} has no list of at most {_MOST} {name}; see `nvsim evaluate graph --help`.")
    return rows


def _height(path: Path, number: int, row: dict[str, Any]) -> float:
    floor, name = row.get("floor"), row.get("map")
    if (
        not _is_length(floor)
        or floor is None
        or not isinstance(name, str)
        or not name.isprintable()
        or not 0 < len(name) <= 500
    ):
        raise InputError(
            f"{path}: storey {number} needs the height of its 'floor' in meters and the name of its 'map'."
        )
    return float(floor)


def _stair(path: Path, number: int, row: dict[str, Any], storeys: int) -> Stair:
    lower, upper, outline = row.get("from"), row.get("to"), row.get("outline")
    if type(lower) is not int or type(upper) is not int or not 0 <= lower < upper < storeys:
        raise InputError(f"{path}: stair {number} must lead 'from' a storey 'to' a higher one, counted from 0.")
    if not isinstance(outline, list) or not 3 <= len(outline) <= _MOST:
        raise InputError(f"{path}: stair {number} needs an 'outline' of at least three corners [x, y].")
    corners = []
    for corner in outline:
        if not isinstance(corner, list) or len(corner) != 2 or not all(map(_is_length, corner)):
            raise InputError(f"{path}: stair {number} has the corner {value_text(corner)}; write [x, y] in meters.")
        corners.append((float(corner[0]), float(corner[1])))
    return Stair(lower, upper, tuple(corners))


def _is_length(value: object) -> bool:
    """Whether it is a number of meters. NaN is not."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _FARTHEST
