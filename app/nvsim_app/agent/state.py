"""The actions and the state of an agent, as values that the window and the simulator process exchange. Fields have the
names of Matterport3DSimulator. Does not use Qt."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import HEIGHT, VFOV, WIDTH

_FOCAL = HEIGHT / 2 / np.tan(VFOV / 2)


@dataclass(frozen=True)
class Pose:
    """A pose of the agent: viewpoint id, heading and elevation in radians."""

    viewpoint: str
    heading: float
    elevation: float


@dataclass(frozen=True)
class Step:
    """One action: a move, then a turn of 30 degrees. The viewpoint id stays valid after an edit, unlike an index.

    to          viewpoint id of a navigable location, "" to stay
    heading     positive turns to the right, negative to the left; only the sign is used
    elevation   positive looks up, negative down; only the sign is used
    """

    to: str = ""
    heading: int = 0
    elevation: int = 0


@dataclass(frozen=True)
class Walk:
    """A start pose and the steps after it. restricted: only locations in the horizontal field of view are navigable."""

    start: Pose
    steps: tuple[Step, ...] = ()
    restricted: bool = True

    def with_step(self, step: Step) -> Walk:
        return replace(self, steps=(*self.steps, step))


@dataclass(frozen=True)
class Location:
    """A navigable location, or the location of the agent.

    ix              index in the connectivity file
    x, y, z         meters, world
    rel_heading     radians to the right of the agent's viewing direction
    rel_elevation   radians above the agent's viewing direction
    rel_distance    meters
    """

    viewpointId: str
    ix: int
    x: float
    y: float
    z: float
    rel_heading: float
    rel_elevation: float
    rel_distance: float


@dataclass(frozen=True)
class AgentState:
    """A state of the simulator without its images; angles in radians."""

    scanId: str
    step: int
    location: Location
    heading: float
    elevation: float
    viewIndex: int
    navigableLocations: tuple[Location, ...]

    @property
    def pose(self) -> Pose:
        return Pose(self.location.viewpointId, self.heading, self.elevation)

    @property
    def position(self) -> NDArray[np.float64]:
        """(3,) meters, world."""
        return np.array([self.location.x, self.location.y, self.location.z])

    @property
    def camera(self) -> Camera:
        """The camera of the agent's image."""
        intrinsics = Intrinsics(WIDTH, HEIGHT, _FOCAL, _FOCAL, WIDTH / 2, HEIGHT / 2)
        return Camera(intrinsics, camera_pose(self.position, self.heading, self.elevation))

    def json(self) -> str:
        """All fields as JSON, with the names of the simulator."""
        return json.dumps(asdict(self), indent=2)


def trajectory_json(trajectory: tuple[Pose, ...]) -> str:
    """The trajectory as JSON in the format of leaderboards: [[viewpointId, heading, elevation], ...]."""
    rows = (json.dumps([pose.viewpoint, pose.heading, pose.elevation]) for pose in trajectory)
    return "[" + ",\n ".join(rows) + "]"


@dataclass(frozen=True, eq=False)
class WalkedGraph:
    """The graph that the agent walks.

    ids         viewpoint ids in the order of the file, including excluded viewpoints
    included    (n,) bool
    positions   (n, 3) float64 meters, world
    edges       (m, 2) int64 indices into ids
    """

    ids: tuple[str, ...]
    included: NDArray[np.bool_]
    positions: NDArray[np.float64]
    edges: NDArray[np.int64]
