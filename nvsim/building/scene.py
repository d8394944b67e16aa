"""The scene of one building from its configuration: plan, trajectory, boxes, textures, and people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.building.baking import Textures, bake
from nvsim.building.config import BuildingConfig, Style
from nvsim.building.people import Person, place_people
from nvsim.building.placement import furnish
from nvsim.building.plan import Plan, Storey
from nvsim.building.raycast import Solids, make_solids
from nvsim.building.solids import Box, Color, Paint, raised, wall_boxes
from nvsim.building.stacking import make_storeys
from nvsim.building.stairs import stair_boxes
from nvsim.building.walk import climbed, frames, path
from nvsim.geometry.camera import Camera, Intrinsics, look

CAMERA_HEIGHT = 1.3  # meters above the floor
STAIRS = ("stairs", "flight")  # kinds of rooms
_WHITE: Color = (0.78, 0.77, 0.74)
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
    """A building with a trajectory.

    walk  (M, 5) x, y, heading, height of the floor, and elevation of every frame; meters and radians
    path  (N, 5) dense samples of that trajectory

    On the stairs the floor is the line through the middles of the treads, so that cameras climb evenly.
    """

    config: BuildingConfig
    storeys: tuple[Storey, ...]
    path: NDArray[np.float64]
    walk: NDArray[np.float64]
    boxes: tuple[Box, ...]
    solids: Solids
    people: tuple[Person, ...]

    @property
    def plan(self) -> Plan:
        """The plan of the lowest storey."""
        return self.storeys[0].plan

    @property
    def floor_surface(self) -> int:
        """The surface number of the lowest floor. Its ceiling follows, then those of the storey above, then people."""
        return 6 * len(self.boxes)

    @property
    def floor_surfaces(self) -> list[int]:
        """The surface numbers of all walkable surfaces: every floor, and the steps of the stairs with their risers."""
        steps = [6 * i + side for i, b in enumerate(self.boxes) if b.tread for side in range(6)]
        return [self.floor_surface + 2 * k for k in range(len(self.storeys))] + steps

    @property
    def first_person(self) -> int:
        """The surface number of the first capsule of people."""
        return self.floor_surface + 2 * len(self.storeys)

    def camera(self, frame: int) -> Camera:
        """The camera of a frame of the trajectory; it is level, except on the way down stairs. The pose is rounded so
        that files hold it exactly."""
        c = self.config
        intrinsics = Intrinsics.from_fov(c.width, c.height, np.radians(c.horizontal_fov))
        focal = round(intrinsics.fx, 4)
        x, y, heading, floor, elevation = self.walk[frame]
        pose = np.round(look(np.array([x, y, floor + CAMERA_HEIGHT]), heading, elevation), 9) + 0.0
        return Camera(Intrinsics(c.width, c.height, focal, focal, c.width / 2, c.height / 2), pose)

    def present(self, frame: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The capsules (P, 5), meters, and colors (P, 3), 0 to 1, of the people in a frame."""
        here = [p for p in self.people if p.first <= frame <= p.last]
        if not here:
            return np.empty((0, 5)), np.empty((0, 3))
        return np.concatenate([p.capsules for p in here]), np.concatenate([p.colors for p in here])


def _stream(config: BuildingConfig, part: int, storey: int = 0) -> np.random.Generator:
    """Independent random numbers for each part and storey, so that a change of one does not affect the others."""
    key = [config.seed, part, storey] if storey else [config.seed, part]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(key)))


def make_scene(config: BuildingConfig) -> Scene:
    """Makes the plans, trajectory, furniture, and people; deterministic in the configuration."""
    storeys = make_storeys(config, _stream(config, 0), _stream(config, 0, 1))
    flight = storeys[0].plan.flight
    dense = climbed(path(tuple(stop for s in storeys for stop in s.plan.stops)), flight)
    walk = frames(dense, config.step, np.radians(config.turn))
    boxes: list[Box] = []
    shaft: Paint | None = None
    for k, (plan, floor) in enumerate((s.plan, s.floor) for s in storeys):
        rng = _stream(config, 1, k)
        paints = _wall_paints(plan, rng, config.style)
        if flight is not None:
            shaft = shaft or paints["stairs"]  # one shaft through both storeys
            paints |= dict.fromkeys(STAIRS, shaft)
        track = dense[np.abs(dense[:, 3] - floor) < 0.5]
        walls = wall_boxes(plan, paints, _frame_paint(rng))
        boxes += [raised(b, floor) for b in (*walls, *furnish(plan, track, _stream(config, 2, k), config.style))]
    if flight is not None and shaft is not None:
        boxes += stair_boxes(flight, shaft)
    solids = make_solids(storeys, boxes)
    people = place_people(walk, solids, _stream(config, 3)) if config.people else ()
    return Scene(config, storeys, dense, walk, tuple(boxes), solids, people)


def textures_of(scene: Scene) -> Textures:
    """The painted and lit surfaces of a scene."""
    return bake(scene.storeys, list(scene.boxes), scene.solids, _stream(scene.config, 4))


def _frame_paint(rng: np.random.Generator) -> Paint:
    colors: tuple[Color, ...] = ((0.45, 0.30, 0.18), (0.85, 0.84, 0.80), (0.30, 0.34, 0.38))
    return Paint("plain", colors[int(rng.integers(len(colors)))])


def _wall_paints(plan: Plan, rng: np.random.Generator, style: Style) -> dict[str, Paint]:
    """Room name -> wall paint. One or two rooms are bare, without pictures or pattern; in a bare building all rooms
    are, in white."""
    if style == "bare":
        return {r.name: Paint("plain" if r.kind in STAIRS else "wall-bare", _WHITE) for r in plan.rooms}
    kinds = ["wall-bare", "wall-plain", "wall-stripes", "wall-panel", "wall-band", "wall-plain", "wall-plain"]
    chosen = [str(k) for k in rng.permutation(kinds)]
    paints = {}
    for room, kind in zip(plan.rooms, chosen + ["wall-plain"] * len(plan.rooms)):
        base = np.array(_WALL_COLORS[int(rng.integers(len(_WALL_COLORS)))])
        second = np.clip(base * rng.uniform(0.72, 0.85) + rng.uniform(-0.06, 0.06, 3), 0, 1)
        kind = "wall-plain" if room.kind == "corridor" else "wall-shaft" if room.kind in STAIRS else kind
        paints[room.name] = Paint(
            kind,
            (float(base[0]), float(base[1]), float(base[2])),
            (float(second[0]), float(second[1]), float(second[2])),
        )
    return paints
