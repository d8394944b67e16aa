"""Generated interiors: buildings of the generator with random surfaces, more clutter and people, and random cameras."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nvsim.building.baking import Painters, bake
from nvsim.building.config import BuildingConfig, Style
from nvsim.building.plan import HEIGHT
from nvsim.building.raycast import make_solids
from nvsim.building.rendering import View, render
from nvsim.building.scene import Scene, make_scene
from nvsim.building.solids import Box
from nvsim.building.truth import floor_mask, normals
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.recipes.examples import SIZE, Example
from nvsim.recipes.furniture import (
    along_a_wall,
    central_furniture,
    clutter,
    random_color,
    things_on,
    under_the_ceiling,
)
from nvsim.recipes.kitchens import kitchen
from nvsim.recipes.patterns import paint_anew, paint_ceiling, paint_floor, paint_pale

FIRST_SEED = 1000
"""Seeds below this are never used for training, because demos and tests use them."""
_KITCHENS = 0.3  # share of the buildings whose rooms are kitchens
_NEAREST = 0.35  # meters; images with a smaller median depth are not used
_AT_TOPS, _AT_FRONTS = 0.35, 0.3  # shares of the cameras that look at tops and at fronts of furniture
_TRIES = 1000  # camera positions that are tested per view


def interior(number: int, count: int, upright: bool) -> list[Example]:
    """`count` views of the building with this number; all are `upright` or none is. Deterministic.

    Raises InputError if the building has too few usable camera positions.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([31, number])))
    scene = _scene(number, rng)
    painters = Painters(paint_floor, paint_pale if rng.random() < 0.35 else paint_anew, paint_ceiling)
    textures = bake(scene.storeys, list(scene.boxes), scene.solids, rng, painters)
    found: list[Example] = []
    for camera in _cameras(scene, rng, upright, _TRIES * count):
        people, clothes = _crowd(scene, camera, rng)
        view = render(camera, scene.solids, textures, people, clothes)
        if np.median(view.depth) < _NEAREST:
            continue
        image = np.rint(np.clip(view.color, 0, 1) * 255).astype(np.uint8)
        floor = floor_mask(scene, view).astype(np.uint8)
        found.append(Example(image, floor, _normals(scene, view, camera, people), camera))
        if len(found) == count:
            return found
    raise InputError(
        f"Only {len(found)} of {count} views of the generated building {number} are usable; train with --interiors "
        f"{number} or fewer."
    )


def _scene(number: int, rng: np.random.Generator) -> Scene:
    kitchens = rng.random() < _KITCHENS
    style: Style = "bare" if kitchens else str(rng.choice(["furnished", "glass", "bare"], p=[0.7, 0.15, 0.15]))  # type: ignore[assignment]
    size, storeys = ("full" if rng.random() < 0.25 else "small"), (2 if rng.random() < 0.1 else 1)
    config = BuildingConfig(seed=FIRST_SEED + number, size=size, storeys=storeys, style=style, people=False)  # type: ignore[arg-type]
    scene = make_scene(config)
    boxes = list(scene.boxes)
    for room in scene.plan.rooms:
        for rect in room.rects:
            if kitchens:
                boxes += kitchen(rect.expanded(-0.1), rng)
            density = rng.uniform(0.0, 0.1) if kitchens else 0.0 if style == "bare" else rng.uniform(0.0, 0.6)
            boxes += clutter(rect.expanded(-0.15), rng, density)
            if style != "bare":
                boxes += along_a_wall(rect.expanded(-0.05), rng) if rng.random() < 0.7 else ()
                boxes += central_furniture(rect.expanded(-0.3), rng)
            boxes += under_the_ceiling(rect, rng)
    boxes += [thing for top in _tops(boxes) if rng.random() < 0.6 for thing in things_on(top, rng)]
    return dataclasses.replace(scene, boxes=tuple(boxes), solids=make_solids(scene.storeys, boxes))


def _tops(boxes: list[Box]) -> list[Box]:
    """The boxes with a broad top at the height of seats, beds, tables and counters."""
    return [b for b in boxes if 0.3 < b.hi[2] < 1.15 and b.ground.area > 0.3 and not b.glass]


def _fronts(boxes: list[Box]) -> list[Box]:
    """The boxes with broad sides that stand on a floor."""
    return [b for b in boxes if b.hi[2] - b.lo[2] > 0.35 and 0.1 < b.ground.area < 6 and not b.glass]


def _cameras(scene: Scene, rng: np.random.Generator, upright: bool, tries: int) -> Iterator[Camera]:
    """Cameras at free positions among `tries` random ones: level, tilted, looking down like those of the map builder,
    and held at furniture."""
    rows, columns = SIZE[::-1] if upright else SIZE
    tops, fronts = _tops(list(scene.boxes)), _fronts(list(scene.boxes))
    for _ in range(tries):
        way, pose = rng.random(), None
        if tops and way < _AT_TOPS:
            pose = _at_top(tops[int(rng.integers(len(tops)))], rng)
        elif fronts and _AT_TOPS < way < _AT_TOPS + _AT_FRONTS:
            pose = _at_front(fronts[int(rng.integers(len(fronts)))], scene, rng)
        if pose is not None:
            field = rng.uniform(40, 80)
            if _indoors(scene, pose[:3, 3]) and not _inside(scene, pose[:3, 3]):
                yield Camera(
                    Intrinsics.from_fov(columns, rows, np.radians(field * columns / SIZE[1])), _roll_camera(pose, rng)
                )
            continue
        storey = scene.storeys[int(rng.integers(len(scene.storeys)))]
        room = storey.plan.rooms[int(rng.integers(len(storey.plan.rooms)))]
        rect = room.rects[int(rng.integers(len(room.rects)))].expanded(-0.3)
        position = np.array([
            rng.uniform(rect.x0, max(rect.x0, rect.x1)), rng.uniform(rect.y0, max(rect.y0, rect.y1)),
            storey.floor + rng.uniform(0.4, 1.9),
        ])  # fmt: skip
        if _inside(scene, position):
            continue
        way = rng.random()
        elevation = rng.normal(0, 8) if way < 0.45 else rng.uniform(-60, 15) if way < 0.75 else rng.normal(-45, 4)
        pose = _roll_camera(camera_pose(position, rng.uniform(0, 2 * np.pi), np.radians(elevation)), rng)
        yield Camera(Intrinsics.from_fov(columns, rows, np.radians(rng.uniform(45, 100) * columns / SIZE[1])), pose)


def _indoors(scene: Scene, position: NDArray[np.float64]) -> bool:
    """Whether a position is in a room of its storey, and not in a wall."""
    storey = max((s for s in scene.storeys if s.floor <= position[2]), key=lambda s: s.floor, default=scene.storeys[0])
    rects = [r.expanded(-0.2) for room in storey.plan.rooms for r in room.rects]
    return position[2] < storey.floor + HEIGHT and any(r.contains(position[0], position[1]) for r in rects)


def _inside(scene: Scene, position: NDArray[np.float64]) -> bool:
    """Whether a position is within 15 cm of a box."""
    return bool(((position > scene.solids.lo - 0.15) & (position < scene.solids.hi + 0.15)).all(axis=1).any())


def _roll_camera(pose: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """The pose (4, 4), turned by a few degrees about the optical axis."""
    roll = np.radians(rng.normal(0, 4))
    pose[:3, :3] = pose[:3, :3] @ np.array(
        [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
    )
    return pose


def _at_front(box: Box, scene: Scene, rng: np.random.Generator) -> NDArray[np.float64]:
    """The pose (4, 4) of a camera that a standing person holds and that looks down at a side of a piece of
    furniture."""
    along, far = int(rng.integers(2)), bool(rng.random() < 0.5)
    aim = np.array([rng.uniform(a, b) for a, b in zip(box.lo, box.hi)])
    aim[along] = box.hi[along] if far else box.lo[along]
    out, side = np.zeros(3), np.zeros(3)
    out[along], side[1 - along] = (1 if far else -1), 1
    position = aim + out * rng.uniform(0.5, 3.0) + side * rng.normal(0, 0.8)
    position[2] = max(s.floor for s in scene.storeys if s.floor <= box.hi[2]) + rng.uniform(1.0, 1.75)
    ahead = aim - position
    elevation = np.arctan2(ahead[2], np.hypot(ahead[0], ahead[1])) + np.radians(rng.normal(0, 10))
    return camera_pose(position, np.arctan2(ahead[0], ahead[1]) + rng.normal(0, 0.25), elevation)


def _at_top(top: Box, rng: np.random.Generator) -> NDArray[np.float64]:
    """The pose (4, 4) of a camera that a hand holds at a table, a counter or a bed: it looks at its top, in a third of
    the views so near that the top may fill the image, or in a third across it, as a person at the table does."""
    ground = top.ground
    aim = np.array([rng.uniform(ground.x0, ground.x1), rng.uniform(ground.y0, ground.y1), top.hi[2]])
    heading, kind = rng.uniform(0, 2 * np.pi), rng.random()
    away = rng.uniform(0.3, 1.0) if kind < 2 / 3 else rng.uniform(0.8, 2.5)
    position = aim - away * np.array([np.sin(heading), np.cos(heading), 0])
    position[2] += rng.uniform(0.15, 1.0)
    if kind < 1 / 3:  # across the top
        away += rng.uniform(0.5, 2.5)
    down = -np.degrees(np.arctan2(position[2] - aim[2], away))
    return camera_pose(position, heading + rng.normal(0, 0.15), np.radians(down + rng.normal(0, 8)))


def _crowd(scene: Scene, camera: Camera, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Capsules (P, 5) and colors (P, 3) of people, bins and columns in front of a camera."""
    level = max((s.floor for s in scene.storeys if s.floor < camera.position[2]), default=0.0)
    capsules, colors = [], []
    for _ in range(int(rng.integers(0, 4)) if rng.random() < 0.5 else 0):
        ahead = camera.rotation[:2, 2] / max(1e-6, float(np.linalg.norm(camera.rotation[:2, 2])))
        side = np.array([-ahead[1], ahead[0]])
        x, y = camera.position[:2] + ahead * rng.uniform(1.2, 5) + side * rng.uniform(-1.5, 1.5)
        if rng.random() < 0.5:  # a person
            for r, low, high in ((0.12, 0.12, 0.8), (rng.uniform(0.17, 0.24), 0.95, 1.35), (0.11, 1.55, 1.65)):
                capsules.append((x, y, level + low, level + high, r))
                colors.append(random_color(rng))
        else:
            r = rng.uniform(0.05, 0.4)
            capsules.append((x, y, level, level + rng.uniform(0.1, 2.5), r))
            colors.append(random_color(rng))
    if not capsules:
        return np.empty((0, 5)), np.empty((0, 3))
    return np.array(capsules), np.array(colors)


def _normals(scene: Scene, view: View, camera: Camera, people: NDArray[np.float64]) -> NDArray[np.float32]:
    """(H, W, 3) float32 unit normals as `truth.normals`, also on people."""
    found = normals(scene, view)
    which = view.surface - scene.first_person
    rows, columns = np.nonzero(which >= 0)
    if len(rows):
        rays = camera.rays()[rows, columns]
        along = view.depth[rows, columns] / (rays @ camera.rotation[:, 2])
        place = camera.position + along[:, None] * rays
        p = people[which[rows, columns]]
        axis = np.column_stack([p[:, 0], p[:, 1], np.clip(place[:, 2], p[:, 2], p[:, 3])])
        out = place - axis
        found[rows, columns] = out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-6)
    return found
