"""Correlate the photographed share of places with the PSNR of their panoramas: a table and one JSON line.

python -m tests.benchmarks.seen_share FOLDER [--seed N] [--steps N] [--places N]

The small built-in building is captured without its scan. In its east room, only images that look west remain, so that
places there are photographed from one side. The true panoramas are rendered by the building. A finished FOLDER is
measured again without training.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray

from nvsim.building import BuildingConfig, generate
from nvsim.building.generation import ROOM, _farthest_point_order
from nvsim.building.rendering import render
from nvsim.building.scene import CAMERA_HEIGHT, Scene, make_scene, textures_of
from nvsim.building.truth import true_occupancy
from nvsim.capture.alignment import to_aligned_frame
from nvsim.evaluation.scores import psnr
from nvsim.geometry.camera import Camera
from nvsim.geometry.directions import cube
from nvsim.mapping.views.photographed import SIDE, photographed_directions, share_of_sphere
from nvsim.occupancy.paths import clearance
from nvsim.occupancy.types import FREE
from nvsim.project.photographed import PhotographedDirections
from nvsim.project.project import Project
from nvsim.render.panorama import render_cube
from tests.benchmarks.harness import report, timed

_FINE = 4  # pixels of a rendered face per measured direction
_EAST = 4.4  # meters: images with a smaller x are in the east room


@dataclass(frozen=True)
class Arguments:
    folder: tyro.conf.Positional[Path]
    seed: int = 0
    steps: int = 350
    places: int = 30


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    config = BuildingConfig(arguments.seed, "small", people=False)
    root = arguments.folder / "p.nvsim"
    if not (root / "models").is_dir():
        generate(arguments.folder / "building", config)
        _one_sided(arguments.folder / "building" / "capture", arguments.folder / "capture")
        train = ["--train.steps", str(arguments.steps), "--train.image-size", "240"]
        command = [sys.executable, "-m", "nvsim", "run", arguments.folder / "capture", "--project", root, *train]
        subprocess.run(command, check=True)
    with Project.open(root) as project:
        report(_measured(project, make_scene(config), arguments.places), as_json=True)


def _one_sided(source: Path, folder: Path) -> None:
    """Copies a capture without its scan, and without the images of the east room that do not look west (-x)."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    capture = json.loads((source / "transforms.json").read_text())
    del capture["ply_file_path"]
    poses = [np.array(frame["transform_matrix"]) for frame in capture["frames"]]
    kept = [f for f, pose in zip(capture["frames"], poses, strict=True) if pose[0, 3] >= _EAST or -pose[0, 2] <= -0.5]
    for frame in kept:
        image = folder / frame["file_path"]
        if not image.exists():
            os.link(source / frame["file_path"], image)
    (folder / "transforms.json").write_text(json.dumps({**capture, "frames": kept}))


def _measured(project: Project, building: Scene, count: int) -> dict[str, float]:
    scene, alignment = project.scene(), project.need_capture().alignment
    assert scene is not None
    directions, seconds = PhotographedDirections(project, scene), 0.0
    textures, nobody = textures_of(building), (np.empty((0, 5)), np.empty((0, 3)))
    occupancy = true_occupancy(building).storeys[0].occupancy
    free = np.argwhere((occupancy.cells == FREE) & (clearance(occupancy) >= ROOM))
    places = occupancy.centers()[free[:, 0], free[:, 1]]
    offsets = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    angle = np.broadcast_to((1 + offsets**2 + offsets[:, None] ** 2) ** -1.5, (6, SIDE, SIDE))
    errors, masks, dense = [], [], []
    for x, y in places[_farthest_point_order(places, count, np.random.default_rng(0))]:
        eye = np.array([x, y, building.storeys[0].floor + CAMERA_HEIGHT])
        at = to_aligned_frame(eye, alignment)
        views = render_cube(scene, at, _FINE * SIDE)
        error = []
        for camera, view in zip(cube(at, _FINE * SIDE), views, strict=True):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = alignment.rotation.T @ camera.rotation, eye
            true = render(Camera(camera.intrinsics, pose), building.solids, textures, *nobody).color
            assert view.rgb is not None
            error.append(((np.clip(view.rgb, 0, 1) - np.clip(true, 0, 1)) ** 2).mean(axis=2))
        errors.append(np.array(error).reshape(6, SIDE, _FINE, SIDE, _FINE).mean(axis=(2, 4)))
        directions.photographed_mask(at)  # compiles, and renders the training images
        mask, spent = timed(lambda at=at: directions.photographed_mask(at), time.process_time)
        masks.append(mask)
        seconds += spent
        dense.append(share_of_sphere(photographed_directions(scene.model(scene.nearest(at)), at, None)))
        print(
            f"{x:6.2f} {y:6.2f}  share {share_of_sphere(masks[-1]):.3f}  {_decibels(errors[-1], angle):5.2f} dB",
            flush=True,
        )
    error, mask = np.array(errors), np.array(masks)
    quality = [_decibels(one, angle) for one in error]
    weight = np.broadcast_to(angle, error.shape)
    return {
        "places": len(quality),
        "correlation": round(float(np.corrcoef(quality, [share_of_sphere(one) for one in mask])[0, 1]), 3),
        "correlation_without_images": round(float(np.corrcoef(quality, dense)[0, 1]), 3),
        "psnr_photographed": round(_decibels(error, weight * mask), 2),
        "psnr_other": round(_decibels(error, weight * ~mask), 2),
        "seconds_per_viewpoint": round(seconds / len(quality), 3),
    }


def _decibels(error: NDArray[np.floating], weight: NDArray[np.floating]) -> float:
    return psnr(float((error * weight).sum() / weight.sum()))


if __name__ == "__main__":
    main()
