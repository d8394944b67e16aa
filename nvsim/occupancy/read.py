"""Any occupancy map by the suffix of its file."""

from __future__ import annotations

from pathlib import Path

from nvsim.errors import InputError
from nvsim.occupancy.types import OccupancyMap


def read_map(path: Path) -> OccupancyMap:
    """A ROS map (.yaml, .yml) or an OctoMap (.bt, cut where a robot's body is). Raises InputError with the reason."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        from nvsim.occupancy.ros import read_ros_map

        return read_ros_map(path)
    if suffix == ".bt":
        from nvsim.occupancy.octomap import read_octomap

        return read_octomap(path)
    if not path.exists():
        raise InputError(f"The map {path} does not exist; name a ROS map .yaml or an OctoMap .bt.")
    hint = "its .yaml file" if suffix in (".pgm", ".png") else "a ROS map .yaml or an OctoMap .bt"
    raise InputError(f"{path} is not a map that can be read; name {hint}.")
