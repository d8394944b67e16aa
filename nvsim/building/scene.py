"""The scene of one building from its configuration: plan, trajectory, boxes, textures, and people.

The trajectory of a robot follows the stops of the plan: rounded corners, turns in place, an image per step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.building.baking import Textures, bake
from nvsim.building.config import BuildingConfig, Style
from nvsim.building.placement import furnish
from nvsim.building.plan import GOING, HEIGHT, INNER_WALL, LENGTH, Flight, Plan, Rect, Storey, TrajectoryCorner
from nvsim.building.raycast import Solids, make_solids, trace
from nvsim.building.solids import TOP, Box, Color, Paint, raised, wall_boxes
from nvsim.building.stacking import make_storeys
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose

_RISER = Paint("plain", (0.74, 0.72, 0.68))
_TREADS = Paint("wood", (0.50, 0.36, 0.24)), Paint("wood", (0.58, 0.43, 0.29))
_CORNER = 0.6  # meters before a corner where the turn begins
_LOOKING_DOWN = np.radians(20)
_NODDING = 0.8  # meters of the stairs over which the camera turns down and up again
_SHARPEST = np.radians(125)  # beyond this angle the robot stops and turns in place


def stair_boxes(flight: Flight, walls: Paint) -> list[Box]:
    """The steps, whose tops are treads, and the edge of the opening. The edge has the paint of the surrounding `walls`,
    but the last riser that of the steps."""
    steps = [
        Box((g.x0, g.y0, 0.0), (g.x1, g.y1, height), _RISER, ((TOP, _TREADS[i % 2]),), tread=True)
        for i, (g, height) in enumerate(flight.treads())
    ]
    hole, wide = flight.rect, flight.rect.expanded(INNER_WALL)
    edges = (
        Rect(wide.x0, wide.y0, hole.x0, wide.y1),
        Rect(hole.x1, wide.y0, wide.x1, wide.y1),
        Rect(hole.x0, wide.y0, hole.x1, hole.y0),
        Rect(hole.x0, hole.y1, hole.x1, wide.y1),
    )
    return steps + [
        Box(
            (e.x0, e.y0, HEIGHT),
            (e.x1, e.y1, flight.climb),
            _RISER if e.expanded(1e-3).contains(*flight.head) else walls,
        )
        for e in edges
    ]


_SHIRTS = ((0.75, 0.22, 0.20), (0.20, 0.35, 0.68), (0.85, 0.70, 0.25), (0.25, 0.52, 0.34), (0.82, 0.82, 0.84))
_TROUSERS = ((0.16, 0.18, 0.26), (0.36, 0.30, 0.24), (0.28, 0.28, 0.30))
_SKINS = ((0.82, 0.64, 0.52), (0.55, 0.38, 0.28), (0.70, 0.52, 0.40))


@dataclass(frozen=True, eq=False)
class Person:
    """A person made of vertical capsules.

    capsules  (P, 5) x, y, lower and upper center height, radius; meters
    colors    (P, 3) RGB, 0 to 1
    first     first frame in which the person is present
    last      last frame in which the person is present
    """

    capsules: NDArray[np.float64]
    colors: NDArray[np.float64]
    first: int
    last: int


def place_people(walk: NDArray[np.float64], solids: Solids, rng: np.random.Generator) -> tuple[Person, ...]:
    """One person per about 70 frames of the trajectory `walk` (M, 5). Each is 1.8 to 4 m in front of the camera, for 5
    to 9 frames."""
    people = []
    count = max(1, len(walk) // 70)
    for k in range(count):
        for _ in range(200):
            first = int((k + rng.uniform(0.1, 0.8)) * len(walk) / count)
            last = min(first + int(rng.integers(5, 10)), len(walk) - 1)
            x, y, heading, floor, _ = walk[(first + last) // 2]
            angle, distance = heading + rng.uniform(-0.35, 0.35), rng.uniform(1.8, 4.0)
            px, py = round(x + distance * np.sin(angle), 3), round(y + distance * np.cos(angle), 3)
            if _stands_free(px, py, walk[first : last + 1], solids):
                people.append(make_person(px, py, floor, first, last, rng))
                break
    return tuple(people)


def _stands_free(px: float, py: float, views: NDArray[np.float64], solids: Solids) -> bool:
    """Whether a place is away from furniture and the trajectory, and visible from the middle one of the `views` (K, 5).
    All views must be on the floor of the place."""
    x, y, _, floor, _ = views[len(views) // 2]
    ceiling = solids.levels[np.isclose(solids.levels[:, 0], floor), 1]
    if not len(ceiling) or np.ptp(views[:, 3]) > 0:
        return False
    here = (solids.lo[:, 2] < ceiling[0]) & (solids.hi[:, 2] > floor)
    gap = np.maximum(np.maximum(solids.lo[here, :2] - (px, py), (px, py) - solids.hi[here, :2]), 0)
    if np.hypot(gap[:, 0], gap[:, 1]).min() < 0.35 or np.hypot(views[:, 0] - px, views[:, 1] - py).min() < 1.0:
        return False
    distance = float(np.hypot(px - x, py - y))
    t, _, glass = trace(x, y, floor + 1.3, (px - x) / distance, (py - y) / distance, 0.0, solids, np.empty((0, 5)))
    return bool(min(t, glass) > distance)


def make_person(x: float, y: float, floor: float, first: int, last: int, rng: np.random.Generator) -> Person:
    """A person who stands at (x, y) meters on a floor at height `floor`, in random clothes."""
    tall = rng.uniform(0.94, 1.06)
    side = rng.uniform(0, np.pi)
    c, s = np.cos(side), np.sin(side)
    shirt, trousers = _SHIRTS[int(rng.integers(5))], _TROUSERS[int(rng.integers(3))]
    skin = _SKINS[int(rng.integers(3))]
    parts = [
        (-0.10, 0.08, 0.80, 0.085, trousers),
        (0.10, 0.08, 0.80, 0.085, trousers),
        (0.00, 0.95, 1.30, 0.175, shirt),
        (-0.23, 0.85, 1.36, 0.055, shirt),
        (0.23, 0.85, 1.36, 0.055, shirt),
        (0.00, 1.50, 1.62, 0.095, skin),
        (0.00, 1.62, 1.66, 0.105, (0.18, 0.14, 0.11)),
    ]
    capsules = np.array([(x + u * c, y + u * s, floor + z0 * tall, floor + z1 * tall, r) for u, z0, z1, r, _ in parts])
    return Person(np.round(capsules, 4), np.array([p[4] for p in parts]), first, last)


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
        pose = np.round(camera_pose(np.array([x, y, floor + CAMERA_HEIGHT]), heading, elevation), 9) + 0.0
        return Camera(Intrinsics(c.width, c.height, focal, focal, c.width / 2, c.height / 2), pose)

    def people_in_frame(self, frame: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
    dense = with_floor_heights(path(tuple(stop for s in storeys for stop in s.plan.trajectory_corners)), flight)
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


def _heading(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.arctan2(b[0] - a[0], b[1] - a[1]))


def _wrap_angle(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def path(stops: tuple[TrajectoryCorner, ...]) -> NDArray[np.float64]:
    """(N, 3) x, y and unwrapped heading (0 is +y, clockwise), meters and radians, every centimeter or half degree."""
    points = [np.array([s.x, s.y]) for s in stops]
    spins = [s.turns_in_place for s in stops]
    kept = [0] + [i for i in range(1, len(points)) if np.linalg.norm(points[i] - points[i - 1]) > 0.02]
    points, spins = [points[i] for i in kept], [spins[i] for i in kept]
    heading = _heading(points[0], points[1])
    pieces = [np.array([[*points[0], heading]])]
    here = points[0]
    for i in range(1, len(points) - 1):
        before, corner, after = points[i - 1], points[i], points[i + 1]
        turn = _wrap_angle(_heading(corner, after) - heading)
        in_place = spins[i] or abs(turn) > _SHARPEST
        if spins[i]:
            turn -= 2 * np.pi * (1 if turn > 0 else -1)
        lengths = float(np.linalg.norm(corner - before)), float(np.linalg.norm(after - corner))
        cut = 0.0 if in_place or abs(turn) < 0.02 else min(_CORNER, 0.48 * lengths[0], 0.48 * lengths[1])
        towards = np.array([np.sin(heading), np.cos(heading)])
        pieces.append(_straight(here, corner - cut * towards, heading))
        if in_place:
            count = max(2, int(np.ceil(abs(turn) / np.radians(0.5))))
            angles = heading + turn * np.arange(1, count + 1) / count
            pieces.append(np.column_stack([np.tile(corner, (count, 1)), angles]))
            here = corner
        elif cut > 0:
            outward = (after - corner) / lengths[1]
            pieces.append(_bend(corner - cut * towards, corner, corner + cut * outward, heading))
            here = corner + cut * outward
        else:
            here = corner
        heading += turn
    pieces.append(_straight(here, points[-1], heading))
    return np.concatenate(pieces)


def _straight(a: NDArray[np.float64], b: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
    count = max(1, int(np.ceil(np.linalg.norm(b - a) / 0.01)))
    s = np.arange(1, count + 1)[:, None] / count
    return np.column_stack([a + s * (b - a), np.full(count, heading)])


def _bend(
    a: NDArray[np.float64], corner: NDArray[np.float64], b: NDArray[np.float64], heading: float
) -> NDArray[np.float64]:
    """A quadratic Bezier curve about the corner, heading along its tangent."""
    s = np.arange(1, 161)[:, None] / 160
    xy = (1 - s) ** 2 * a + 2 * s * (1 - s) * corner + s**2 * b
    tangent = (1 - s) * (corner - a) + s * (b - corner)
    angles = np.unwrap(np.concatenate([[heading], np.arctan2(tangent[:, 0], tangent[:, 1])]))[1:]
    return np.column_stack([xy, angles])


def with_floor_heights(dense: NDArray[np.float64], flight: Flight | None) -> NDArray[np.float64]:
    """(N, 5) a path (N, 3) with the height of the floor under it, meters, and the elevation of the camera, radians. The
    path begins on the lowest floor and changes storeys on the flight. On the way down the camera looks down."""
    floor, elevation = np.zeros(len(dense)), np.zeros(len(dense))
    if flight is not None:
        ahead = flight.distance_along(dense[:, :2])
        beside = np.linalg.norm(dense[:, :2] - flight.foot - np.outer(ahead, flight.direction), axis=1)
        on = (beside < flight.width / 2) & (ahead > -GOING / 2) & (ahead < LENGTH + GOING / 2)
        floor[on] = flight.height_at(dense[on, :2])
        up = False
        for i in range(len(dense)):
            if on[i]:
                up = ahead[i] > LENGTH / 2
            elif up:
                floor[i] = flight.climb
        down = on & (np.gradient(floor) < 0)
        elevation[down] = -_LOOKING_DOWN * np.clip(np.minimum(ahead, LENGTH - ahead)[down] / _NODDING, 0, 1)
    return np.column_stack([dense, floor, elevation])


def frames(dense: NDArray[np.float64], step: float, turn: float) -> NDArray[np.float64]:
    """The samples (M, 5) of a path (N, 5) at which an image is recorded: `step` meters or `turn` radians apart, or an
    equal amount of both combined. Rounded to a micrometer, so that every machine agrees."""
    moved = np.linalg.norm(np.diff(dense[:, :2], axis=0), axis=1) / step
    turned = np.diff(dense[:, 2]) / turn
    traveled = np.concatenate([[0.0], np.cumsum(np.hypot(moved, turned))])
    chosen = np.searchsorted(np.round(traveled, 6), np.arange(int(traveled[-1]) + 1))
    return np.round(dense[np.minimum(chosen, len(dense) - 1)], 6)
