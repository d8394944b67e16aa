"""A submap of the built-in building for training, with ground truth along the trajectory and at novel views.

The views are rendered in memory like the capture on disk (people, sensor noise; no JPEG). They are cached in a file,
because rendering takes half a minute.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from scipy import ndimage

from nvsim.building.config import BuildingConfig
from nvsim.building.generation import scan
from nvsim.building.raycast import trace
from nvsim.building.rendering import render
from nvsim.building.scene import CAMERA_HEIGHT, Scene, make_scene, textures_of
from nvsim.building.truth import floor_mask, occupancy, transient_mask
from nvsim.capture.types import Cloud
from nvsim.files.atomic import replacement_file
from nvsim.geometry.camera import Camera, camera_pose
from nvsim.occupancy.types import FREE
from nvsim.submaps.split import SubmapConfig, split
from nvsim.training.views import TrainingView

HOLD_OUT = 8
NOVEL, NEAREST, FARTHEST = 32, 0.3, 0.9
"""Number of novel views, and their distances in meters from the nearest frame of the trajectory."""
CLEARANCE = 0.3
TURNED = np.radians(35), np.radians(145)
DOWN = np.radians(25)
PERSON = 0.01
"""Share of a training image above which a person in it is counted."""
_NOISE = 1.5 / 255
_VERSION = 2


@dataclass(frozen=True, eq=False)
class TrueView:
    """A view of the building with ground truth.

    camera   camera of the view
    image    (H, W, 3) uint8
    floor    (H, W) bool, floor pixels
    glass    (H, W) bool, pixels with a glass pane in front of the surface
    counted  (H, W) bool, pixels that are used for metrics
    """

    camera: Camera
    image: np.ndarray
    floor: np.ndarray
    glass: np.ndarray
    counted: np.ndarray


@dataclass(frozen=True, eq=False)
class Walk:
    """training    views of the largest submap, with people
    cloud          point cloud of the LiDAR scan
    held_out       every 8th frame of the submap; pixels of people are not counted
    novel          views off the trajectory, turned away from it and down, without people
    haunted        training cameras that see a person, rendered without people; only the person's pixels are counted
    """

    training: list[TrainingView]
    cloud: Cloud
    held_out: list[TrueView]
    novel: list[TrueView]
    haunted: list[TrueView]


def walk_through(seed: int, width: int, folder: Path) -> Walk:
    """The data of building `seed`. Its images are `width` pixels wide and three quarters as high."""
    path = folder / f"building-{seed}-{width}-{_VERSION}.npz"
    scene = make_scene(BuildingConfig(seed=seed, width=width, height=3 * width // 4))
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacement_file(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, **_made(scene))
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    k = scene.camera(0).intrinsics
    frames, kinds = arrays["frame"], arrays["kind"]
    views: dict[str, list[TrueView]] = {"held_out": [], "novel": [], "haunted": []}
    training = []
    for i, kind in enumerate(kinds):
        camera = Camera(k, arrays["pose"][i])
        image, floor = arrays["image"][i], arrays["floor"][i]
        if kind == "training":
            training.append(TrainingView(f"{frames[i]:05d}", camera, image, floor))
        else:
            views[kind].append(TrueView(camera, image, floor, arrays["glass"][i], arrays["counted"][i]))
    return Walk(training, Cloud(arrays["points"], arrays["colors"]), **views)


def _made(scene: Scene) -> dict[str, np.ndarray]:
    seed = scene.config.seed
    textures, nobody = textures_of(scene), (np.empty((0, 5)), np.empty((0, 3)))
    cloud = scan(scene, textures, np.random.default_rng([seed, 5]))
    places = np.column_stack([scene.walk[:, :2], np.full(len(scene.walk), CAMERA_HEIGHT)])
    submap = max(split(places, SubmapConfig()), key=lambda s: len(s.frames))
    rows: list[tuple] = []

    def see(kind: str, frame: int, camera: Camera, people: tuple) -> np.ndarray:
        """Adds a row. Returns a mask (H, W) of the people."""
        view = render(camera, scene.solids, textures, *people)
        noise = np.random.default_rng([seed, 6, frame]).standard_normal(view.color.shape) * _NOISE
        color = view.color + (noise if kind in ("training", "held_out") else 0)
        image = np.rint(np.clip(color, 0, 1) * 255).astype(np.uint8)
        person, pane = transient_mask(scene, view), glass(scene, camera)
        rows.append((kind, frame, camera.camera_to_world, image, floor_mask(scene, view), pane, ~person))
        return person

    for position, frame in enumerate(submap.frames):
        kind = "held_out" if position % HOLD_OUT == HOLD_OUT // 2 else "training"
        person = see(kind, frame, scene.camera(frame), scene.people_in_frame(frame))
        if kind == "training" and person.mean() > PERSON:
            see("haunted", frame, scene.camera(frame), nobody)
            rows[-1] = (*rows[-1][:6], person)
    for frame, camera in beside(scene, np.asarray(submap.core)):
        see("novel", frame, camera, nobody)
    names = ("kind", "frame", "pose", "image", "floor", "glass", "counted")
    made = {name: np.array([row[i] for row in rows]) for i, name in enumerate(names)}
    assert cloud.colors is not None
    return {**made, "points": cloud.points, "colors": cloud.colors}


def beside(scene: Scene, core: np.ndarray) -> list[tuple[int, Camera]]:
    """Cameras of novel views, each with its frame of the trajectory. `core` (N,) has the frames of the submap."""
    rng = np.random.default_rng([scene.config.seed, 77])
    truth = occupancy(scene)
    free = truth.cells == FREE
    roomy = ndimage.distance_transform_edt(free) * truth.resolution > CLEARANCE
    found: list[tuple[int, Camera]] = []
    intrinsics = scene.camera(0).intrinsics
    while len(found) < NOVEL:
        frame = int(rng.choice(core))
        x, y, heading = scene.walk[frame, :3]
        angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(NEAREST, FARTHEST)
        spot = np.array([x + distance * np.sin(angle), y + distance * np.cos(angle)])
        gap = np.linalg.norm(scene.walk[core][:, :2] - spot, axis=1).min()
        (row, column) = truth.index(spot[None])[0]
        inside = 0 <= row < free.shape[0] and 0 <= column < free.shape[1]
        turn = rng.uniform(*TURNED) * rng.choice([-1, 1])
        down = rng.uniform(0, DOWN)
        if inside and roomy[row, column] and gap > NEAREST:
            pose = camera_pose(np.array([*spot, CAMERA_HEIGHT]), heading + turn, -down)
            found.append((frame, Camera(intrinsics, pose)))
    return found


def glass(scene: Scene, camera: Camera) -> np.ndarray:
    """(H, W) bool, pixels with a glass pane in front of the surface."""
    seen = np.zeros((camera.intrinsics.height, camera.intrinsics.width), np.bool_)
    _mark_glass(camera.position.copy(), camera.rays().astype(np.float64), scene.solids, np.empty((0, 5)), seen)
    return seen


@njit
def _mark_glass(eye, rays, solids, nobody, seen):  # type: ignore[no-untyped-def]
    for row in range(seen.shape[0]):
        for column in range(seen.shape[1]):
            d = rays[row, column]
            distance, _, pane = trace(eye[0], eye[1], eye[2], d[0], d[1], d[2], solids, nobody)
            seen[row, column] = pane < distance
