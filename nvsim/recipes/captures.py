"""Examples from projects: their photographs, and renders of their models from where the map builder looks, labelled by
their clouds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.perception.cloud_labels import UNKNOWN, CloudLabels
from nvsim.project.project import Project
from nvsim.project.work import lacks
from nvsim.recipes.examples import SIZE, Example

_LEAST = 0.25  # share of an image that must be labelled


def photographs(project: Project, count: int, seed: int) -> Iterator[Example]:
    """Up to `count` of the project's images, spread over its trajectory; those of which the cloud knows little are left
    out. Raises InputError for a project without a dense cloud or without floors."""
    capture = project.need_capture()
    chosen = np.unique(np.linspace(0, len(capture.frames) - 1, count).round().astype(int))
    owners = {i: submap.index for submap in project.need_submaps() for i in submap.core}
    labels = _labels(project)
    for i in map(int, chosen):
        frame = capture.frames[i]
        camera = Camera(_cut(frame.intrinsics), frame.camera.camera_to_world)
        if owners.get(i) in labels:
            yield from _example(read_image(frame, camera.intrinsics), camera, labels[owners[i]])


def renders(project: Project, count: int, seed: int) -> Iterator[Example]:
    """Up to `count` renders of the project's models, at places of the trajectory, half of them looking down 45 degrees;
    none where nothing was trained. Raises InputError as `photographs`."""
    from nvsim.render.model import render_model

    scene = project.scene()
    if scene is None:
        return
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 77])))
    places, labels = project.need_capture().positions, _labels(project)
    for _ in range(count):
        place = places[int(rng.integers(len(places)))] + np.append(rng.normal(0, 0.2, 2), rng.uniform(-0.2, 0.2))
        index, model = scene.model_at(place)
        tilt = -45 if rng.random() < 0.5 else rng.uniform(-50, 5)
        pose = look(place, rng.uniform(0, 2 * np.pi), np.radians(tilt))
        camera = Camera(Intrinsics.from_fov(SIZE[1], SIZE[0], np.radians(rng.uniform(60, 95))), pose)
        rgb = render_model(model, camera).rgb
        if rgb is not None and index in labels:
            yield from _example(np.rint(np.clip(rgb, 0, 1) * 255).astype(np.uint8), camera, labels[index])


def _labels(project: Project) -> dict[int, CloudLabels]:
    """By submap. Raises InputError."""
    cloud = project.scan()
    if cloud is None or not cloud.is_dense:
        raise InputError(f"{project.root} has no dense cloud to label its images with; choose another project.")
    found = {s.index: project.surface(s.index) for s in project.need_submaps()}
    if not any(found.values()):
        raise lacks(project.root, "floors")
    whole: dict[int, CloudLabels] = {}
    first: CloudLabels | None = None
    for index, surface in found.items():
        if surface is None:
            continue
        labels = CloudLabels(cloud, surface)
        if first is not None:  # the tree is of the cloud alone
            labels.__dict__.update(_tree=first._tree, _shape=first._shape)
        first = whole[index] = labels
    return whole


def _cut(k: Intrinsics) -> Intrinsics:
    """The middle of an image as SIZE, or turned SIZE for an upright one."""
    rows, columns = SIZE if k.width >= k.height else SIZE[::-1]
    factor = max(rows / k.height, columns / k.width)
    left, top = (k.width * factor - columns) / 2, (k.height * factor - rows) / 2
    return Intrinsics(columns, rows, k.fx * factor, k.fy * factor, k.cx * factor - left, k.cy * factor - top)


def _example(image: NDArray[np.uint8], camera: Camera, labels: CloudLabels) -> Iterator[Example]:
    floor, normals = labels.of(camera)
    if (floor != UNKNOWN).mean() >= _LEAST:
        yield Example(image, floor, normals, camera)


def name_of(project: Path) -> str:
    """What a project's examples are filed under."""
    return project.name.removesuffix(".nvsim")
