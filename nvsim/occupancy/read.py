"""Read an occupancy map; the suffix of its file decides the format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.errors import InputError

if TYPE_CHECKING:
    from nvsim.occupancy.types import Heights, OccupancyMap

ROS, OCTOMAP = (".yaml", ".yml"), (".bt", ".ot")
"""Suffixes of the files that can be read."""
WORDS = "a ROS map .yaml or an OctoMap .bt or .ot"


def read_map(path: Path, heights: Heights | None = None) -> OccupancyMap:
    """A ROS map, or an OctoMap cut between `heights` over its floor. Raises InputError if the file cannot be read."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in ROS:
        from nvsim.occupancy.ros import read_ros_map

        return read_ros_map(path)
    if suffix in OCTOMAP:
        from nvsim.occupancy.octomap import read_octomap

        return read_octomap(path, heights)
    if not path.exists():
        raise InputError(f"The map {path} does not exist; name {WORDS}.")
    hint = "its .yaml file" if suffix in (".pgm", ".png") else WORDS
    raise InputError(f"{path} is not a map that can be read; name {hint}.")
