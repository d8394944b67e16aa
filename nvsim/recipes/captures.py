"""Examples from projects, labeled by their point clouds: photographs, and renders from poses like the map builder's."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.evaluation.frame_truth import labels_of
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.sampling import evenly_spaced
from nvsim.perception.cloud_labels import UNKNOWN, CloudLabels
from nvsim.project.floor_heights import floors_seen
from nvsim.project.project import Project
from nvsim.recipes.examples import SIZE, Example

_LEAST = 0.25  # share of an image that must be labeled


def photographs(project: Project, count: int) -> Iterator[Example]:
    """Yields up to `count` of the project's images, evenly spread over its trajectory. Images with few labeled pixels
    are skipped. Raises InputError if the project has no dense cloud or no floors."""
    capture, labels, floors = project.need_capture(), labels_of(project), floors_seen(project)
    for i in evenly_spaced(len(capture.frames), count):
        frame = capture.frames[i]
        camera = Camera(_cut(frame.intrinsics), frame.camera.camera_to_world)
        if i in floors:
            yield from _example(read_image(frame, camera.intrinsics), camera, labels, floors[i])


def renders(project: Project, count: int, seed: int) -> Iterator[Example]:
    """Yields up to `count` renders of the project's models at places of the trajectory; about half look down by 45
    degrees. Yields none if the project has no trained model. Raises InputError like `photographs`."""
    from nvsim.render.model import render_model

    scene = project.scene()
    if scene is None:
        return
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 77])))
    places, labels = project.need_capture().positions, labels_of(project)
    for _ in range(count):
        place = places[int(rng.integers(len(places)))] + np.append(rng.normal(0, 0.2, 2), rng.uniform(-0.2, 0.2))
        index, model = scene.model_at(place)
        tilt = -45 if rng.random() < 0.5 else rng.uniform(-50, 5)
        pose = camera_pose(place, rng.uniform(0, 2 * np.pi), np.radians(tilt))
        camera = Camera(Intrinsics.from_fov(SIZE[1], SIZE[0], np.radians(rng.uniform(60, 95))), pose)
        surface, rgb = project.surface(index), render_model(model, camera).rgb
        if rgb is not None and surface is not None:
            image = np.rint(np.clip(rgb, 0, 1) * 255).astype(np.uint8)
            yield from _example(image, camera, labels, surface)


def _cut(k: Intrinsics) -> Intrinsics:
    """Intrinsics of the image scaled and center-cropped to SIZE, or to the swapped SIZE if it is upright."""
    rows, columns = SIZE if k.width >= k.height else SIZE[::-1]
    factor = max(rows / k.height, columns / k.width)
    left, top = (k.width * factor - columns) / 2, (k.height * factor - rows) / 2
    return Intrinsics(columns, rows, k.fx * factor, k.fy * factor, k.cx * factor - left, k.cy * factor - top)


def _example(image: NDArray[np.uint8], camera: Camera, labels: CloudLabels, surface: FloorSurface) -> Iterator[Example]:
    floor, normals = labels.of(camera, surface, image)
    if (floor != UNKNOWN).mean() >= _LEAST:
        yield Example(image, floor, normals, camera)


def name_of(project: Path) -> str:
    """The folder name of a project's examples."""
    return project.name.removesuffix(".nvsim")
