"""Runs the complete recipe: examples, training, export. Each part continues after an interruption.

Examples from projects are labeled by their point clouds: photographs, and renders from poses like the map builder's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.errors import InputError
from nvsim.evaluation.frame_truth import labels_of
from nvsim.events import Done, Listener, Progress, ignore_event
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.sampling import evenly_spaced
from nvsim.perception.cloud_labels import UNKNOWN, CloudLabels
from nvsim.project.floor_heights import floors_seen
from nvsim.project.project import Project
from nvsim.r2r.features.trunk import need_weights
from nvsim.recipes.config import RecipeConfig
from nvsim.recipes.examples import SIZE, Example, Shards, is_complete_shard, write_shard
from nvsim.recipes.interiors import interior
from nvsim.recipes.network import export
from nvsim.recipes.training import STAGE, train, weights_of

_UPRIGHT_EVERY = 5
"""Every fifth building has upright images."""
_LEAST = 0.25  # share of an image that must be labeled


def make(
    folder: Path, config: RecipeConfig, projects: Sequence[Path] = (), start: Path | None = None,
    listen: Listener = ignore_event,
) -> Path:  # fmt: skip
    """Makes examples, trains a network in `folder`, and returns the path of its ONNX file.

    projects  projects with a dense cloud and floors that provide more examples
    start     folder of another training, or its ONNX file, with the initial weights

    Raises InputError if the weights of the trunk or of `start` are missing, or two projects have one name.
    """
    need_weights()
    if start is not None:
        weights_of(start)  # raises before examples are made
    if len({name_of(p) for p in projects}) < len(projects):
        raise InputError("Two projects have the same name; rename one, because the name is the folder of its examples.")
    examples = folder / "examples"
    shards, shares = _interiors(examples, config, listen)
    groups = [_of_project(examples / name_of(p), p, config, listen) for p in projects]
    for group in groups:
        shards += group
    shares += _captured_shares([len(group) for group in groups], config)
    torch.set_num_threads(config.threads)
    network = train(folder, Shards(shards), shares, config, start, listen)
    path = export(network, folder)
    listen(Done(STAGE, f"{path} after {config.steps} steps on {len(shards)} sets of examples", {"file": str(path)}))
    return path


def _captured_shares(counts: Sequence[int], config: RecipeConfig) -> list[float]:
    """A weight for each shard of the projects, where a generated building has weight 1. `counts` has the number of
    shards of each project. Projects with shards have equal weights, and `captures_share` together."""
    filled = [count for count in counts if count]
    whole = config.captures_share / (1 - config.captures_share) * config.interiors
    return [whole / len(filled) / count for count in filled for _ in range(count)]


def _interiors(folder: Path, config: RecipeConfig, listen: Listener) -> tuple[list[Path], list[float]]:
    paths = []
    for number in range(config.interiors):
        listen(Progress(STAGE, number, config.interiors, "interiors"))
        upright = number % _UPRIGHT_EVERY == _UPRIGHT_EVERY - 1
        path = folder / "interiors" / f"{number:05d}-{config.views}"
        if not is_complete_shard(path):
            write_shard(path, interior(number, config.views, upright))
        paths.append(path)
    return paths, [1.0] * len(paths)


def _of_project(folder: Path, project: Path, config: RecipeConfig, listen: Listener) -> list[Path]:
    """A project's shards, each with examples of one size. Raises InputError if the project cannot be labeled."""
    sources: dict[str, Callable[[Project], Iterator[Example]]] = {
        "photographs": lambda opened: photographs(opened, config.captured),
        "renders": lambda opened: renders(opened, config.captured, config.seed),
    }
    found = []
    for number, (name, source) in enumerate(sources.items()):
        listen(Progress(STAGE, number, len(sources), f"{name_of(project)}: {name}"))
        done = folder / f"{name}-{config.captured}"
        if not is_complete_shard(done):
            with Project.open(project) as opened:
                examples = list(source(opened))
            sizes = dict.fromkeys(e.image.shape for e in examples)
            for k, size in enumerate(sizes):
                write_shard(done / str(k), [e for e in examples if e.image.shape == size])
            write_shard(done, [])
        found += sorted(path for path in done.iterdir() if path.is_dir())
    return found


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
