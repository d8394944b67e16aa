"""What an agent has done, and what it is given then, as values that travel between the window and the simulator's
process. Fields have the names of Matterport3DSimulator. Knows no Qt."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.geometry.view_sweep import HEIGHT, VFOV, WIDTH

_FOCAL = HEIGHT / 2 / np.tan(VFOV / 2)


@dataclass(frozen=True)
class Pose:
    """heading, elevation in radians."""

    viewpoint: str
    heading: float
    elevation: float


@dataclass(frozen=True)
class Step:
    """One action: to a navigable location, "" to stay, then a turn by 30 degrees, of which the sign counts: heading to
    the right, elevation upwards. The location is told by its id, so that a step stays the same after an edit."""

    to: str = ""
    heading: int = 0
    elevation: int = 0


@dataclass(frozen=True)
class Walk:
    """restricted: whether only what is in the horizontal field of view can be gone to."""

    start: Pose
    steps: tuple[Step, ...] = ()
    restricted: bool = True

    def then(self, step: Step) -> Walk:
        return replace(self, steps=(*self.steps, step))

    def back(self) -> Walk:
        """Without its last step."""
        return replace(self, steps=self.steps[:-1])


@dataclass(frozen=True)
class Location:
    """x, y, z in metres, world; rel_heading in radians to the right of where the agent looks, rel_elevation above,
    rel_distance in metres; ix is the index in the connectivity file."""

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
        """(3,) metres, world."""
        return np.array([self.location.x, self.location.y, self.location.z])

    @property
    def camera(self) -> Camera:
        """The camera of the agent's image."""
        intrinsics = Intrinsics(WIDTH, HEIGHT, _FOCAL, _FOCAL, WIDTH / 2, HEIGHT / 2)
        return Camera(intrinsics, look(self.position, self.heading, self.elevation))

    def json(self) -> str:
        """All fields under the simulator's names."""
        return json.dumps(asdict(self), indent=2)


def trajectory_json(trajectory: tuple[Pose, ...]) -> str:
    """[[viewpointId, heading, elevation], ...], as a leaderboard reads it."""
    rows = (json.dumps([pose.viewpoint, pose.heading, pose.elevation]) for pose in trajectory)
    return "[" + ",\n ".join(rows) + "]"


@dataclass(frozen=True, eq=False)
class WalkedGraph:
    """ids in the order of the file, excluded ones too; included (n,) bool; positions (n, 3) metres, world; edges (m, 2)
    indices into ids."""

    ids: tuple[str, ...]
    included: NDArray[np.bool_]
    positions: NDArray[np.float64]
    edges: NDArray[np.int64]
