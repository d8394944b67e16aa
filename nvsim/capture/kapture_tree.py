"""The content of the sensor files of a kapture tree: the sensors, and the pose of each at any timestamp."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.lens import Lens

Pose = NDArray[np.float64]
_NESTED, _CARRIERS = 8, 64  # limits: levels of nested rigs, and carriers of one sensor


@dataclass
class SensorTree:
    """The content of the sensor files. Poses are (4, 4); None if the file omits the pose or it is not rigid."""

    kinds: dict[str, str] = field(default_factory=dict)
    lenses: dict[str, Lens | None] = field(default_factory=dict)
    depth_lenses: dict[str, Lens | None] = field(default_factory=dict)
    mounts: dict[str, list[tuple[str, Pose]]] = field(default_factory=dict)  # sensor -> (rig, rig to sensor)
    poses: dict[tuple[str, int], Pose | None] = field(default_factory=dict)  # (device, timestamp) -> world to device
    _ways: dict[str, list[tuple[str, Pose | None]]] = field(default_factory=dict)

    @cached_property
    def _posed(self) -> set[str]:
        return {device for device, _ in self.poses}

    def _carriers(self, device: str) -> list[tuple[str, Pose | None]]:
        """The device and the rigs that carry it, nearest first (rigs may be nested).

        Each has the transform from the carrier to the device, None for the device itself. A rig that is reachable in
        several ways is listed once."""
        if device not in self._ways:
            ways: dict[str, Pose | None] = {device: None}
            edge = [device]
            for _ in range(_NESTED):
                reached = []
                for carried in edge:
                    way = ways[carried]
                    for rig, mount in self.mounts.get(carried, []):
                        if rig not in ways and len(ways) < _CARRIERS:
                            ways[rig] = mount if way is None else way @ mount
                            reached.append(rig)
                edge = reached
            self._ways[device] = list(ways.items())
        return self._ways[device]

    def world_to(self, device: str, timestamp: int) -> Pose | None:
        """The world-to-device pose (4, 4) of a device: its own, or through a rig that carries it. None if unknown."""
        for carrier, way in self._carriers(device):
            pose = self.poses.get((carrier, timestamp))
            if pose is not None:
                return pose if way is None else way @ pose
        return None

    def rig_of(self, device: str) -> str:
        """The outermost rig that carries a device, "" if there is none."""
        carrier = self._carriers(device)[-1][0]
        return "" if carrier == device else carrier

    def has_any_pose(self, device: str) -> bool:
        return any(carrier in self._posed for carrier, _ in self._carriers(device))
