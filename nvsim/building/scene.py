"""Everything about one building, from its configuration: plan, walk, boxes, textures, and who stands where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.building.baking import Textures, bake
from nvsim.building.config import BuildingConfig
from nvsim.building.layouts import make_plan
from nvsim.building.people import Person, invite
from nvsim.building.placement import furnish
from nvsim.building.plan import Plan
from nvsim.building.raycast import Solids, make_solids
from nvsim.building.solids import Box, Color, Paint, wall_boxes
from nvsim.building.walk import frames, path
from nvsim.geometry.camera import Camera, Intrinsics, look

CAMERA_HEIGHT = 1.3  # metres above the floor
_WALL_COLORS: tuple[Color, ...] = (
    (0.76, 0.74, 0.68),
    (0.68, 0.72, 0.74),
    (0.74, 0.66, 0.56),
    (0.66, 0.72, 0.64),
    (0.78, 0.76, 0.72),
    (0.62, 0.66, 0.72),
)


@dataclass(frozen=True, eq=False)
class Scene:
    """walk (M, 3): x, y and heading of every frame, metres and radians; path (N, 3) the same, densely."""

    config: BuildingConfig
    plan: Plan
    path: NDArray[np.float64]
    walk: NDArray[np.float64]
    boxes: tuple[Box, ...]
    solids: Solids
    people: tuple[Person, ...]

    @property
    def floor_surface(self) -> int:
        """The floor's number among the surfaces; the ceiling's follows, then people."""
        return 6 * len(self.boxes)

    def camera(self, frame: int) -> Camera:
        """The level camera of a frame of the trajectory, its pose rounded so that files hold it exactly."""
        c = self.config
        intrinsics = Intrinsics.from_fov(c.width, c.height, np.radians(c.horizontal_fov))
        focal = round(intrinsics.fx, 4)
        x, y, heading = self.walk[frame]
        pose = np.round(look(np.array([x, y, CAMERA_HEIGHT]), heading), 9) + 0.0
        return Camera(Intrinsics(c.width, c.height, focal, focal, c.width / 2, c.height / 2), pose)

    def present(self, frame: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The capsules (P, 5) and colours (P, 3) of the people in a frame."""
        here = [p for p in self.people if p.first <= frame <= p.last]
        if not here:
            return np.empty((0, 5)), np.empty((0, 3))
        return np.concatenate([p.capsules for p in here]), np.concatenate([p.colors for p in here])


def _stream(config: BuildingConfig, part: int) -> np.random.Generator:
    """Independent random numbers for each part, so that changing one leaves the others."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([config.seed, part])))


def make_scene(config: BuildingConfig) -> Scene:
    """Plan, walk, furniture and people; deterministic in the configuration."""
    plan = make_plan(config.size, _stream(config, 0))
    dense = path(plan.stops)
    walk = frames(dense, config.step, np.radians(config.turn))
    rng = _stream(config, 1)
    boxes = (*wall_boxes(plan, _wall_paints(plan, rng), _frame_paint(rng)), *furnish(plan, dense, _stream(config, 2)))
    solids = make_solids(plan, list(boxes))
    people = invite(walk, solids, _stream(config, 3)) if config.people else ()
    return Scene(config, plan, dense, walk, boxes, solids, people)


def textures_of(scene: Scene) -> Textures:
    """Painted and lit surfaces."""
    return bake(scene.plan, list(scene.boxes), scene.solids, _stream(scene.config, 4))


def _frame_paint(rng: np.random.Generator) -> Paint:
    colors: tuple[Color, ...] = ((0.45, 0.30, 0.18), (0.85, 0.84, 0.80), (0.30, 0.34, 0.38))
    return Paint("plain", colors[int(rng.integers(len(colors)))])


def _wall_paints(plan: Plan, rng: np.random.Generator) -> dict[str, Paint]:
    """A paint for each room; one or two rooms of a building stay bare, without pictures or pattern."""
    kinds = ["wall-bare", "wall-plain", "wall-stripes", "wall-panel", "wall-band", "wall-plain", "wall-plain"]
    chosen = [str(k) for k in rng.permutation(kinds)]
    paints = {}
    for room, kind in zip(plan.rooms, chosen + ["wall-plain"] * len(plan.rooms)):
        base = np.array(_WALL_COLORS[int(rng.integers(len(_WALL_COLORS)))])
        second = np.clip(base * rng.uniform(0.72, 0.85) + rng.uniform(-0.06, 0.06, 3), 0, 1)
        paints[room.name] = Paint(
            "wall-plain" if room.kind == "corridor" else kind,
            (float(base[0]), float(base[1]), float(base[2])),
            (float(second[0]), float(second[1]), float(second[2])),
        )
    return paints
