"""Measure the loss in the images of an exported scan, by method: `python tests/benchmarks/scan_images.py PROJECT
[TRUTH]`.

JPEG strips of 512 pixels per face, sampled as in the simulator, are compared with views rendered directly in random
directions. The strips come from six views of 90 degrees, from an equirectangular image, and from narrow views. TRUTH is
a folder of `ground_truth/depth` PNGs (16 bits, millimeters along the axis) named like the frames. With it, errors of
depth along the ray are measured for several treatments of thin Gaussians.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tyro

from nvsim.evaluation.scan_files import sample_strip, seam_steps
from nvsim.evaluation.scores import psnr
from nvsim.geometry.camera import Camera, camera_pose
from nvsim.geometry.directions import skybox, sweep
from nvsim.project.project import Project
from nvsim.r2r.observations.layout import jpeg
from nvsim.r2r.observations.skybox import as_bytes, distances, face_cameras, focal_of, skybox_of
from nvsim.r2r.observations.surround import draw_surround
from nvsim.render.model import render_model
from nvsim.render.panorama import render_cube, render_equirectangular

SIDE, PLACES, VIEWS = 512, 12, 4


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]
    truth: tyro.conf.Positional[Path | None] = None


def from_equirectangular(model, at, width):
    """The strip, sampled bilinearly from an equirectangular image."""
    image = render_equirectangular(model, at, width, width // 2).rgb
    faces = []
    for camera in face_cameras(at, SIDE):
        x, y, z = np.moveaxis(camera.rays().astype(np.float64), -1, 0)
        column = (np.arctan2(x, y) / (2 * np.pi) + 0.5) * width - 0.5
        row = (0.5 - np.arcsin(np.clip(z, -1, 1)) / np.pi) * width / 2 - 0.5
        around = cv2.copyMakeBorder(image, 0, 0, 1, 1, cv2.BORDER_WRAP)
        at_pixels = [(column + 1).astype(np.float32), row.astype(np.float32)]
        faces.append(cv2.remap(around, *at_pixels, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    return as_bytes(np.concatenate(faces, axis=1))


def narrow(model, at, finer, samples):
    surround = draw_surround(model, at, finer * SIDE / 2)
    return as_bytes(np.concatenate([surround.color(c, samples) for c in face_cameras(at, SIDE)], axis=1))


WAYS = {
    "six views of 90 degrees": lambda m, at: as_bytes(skybox([v.rgb for v in render_cube(m, at, SIDE)])),
    "equirectangular, 2048 wide": lambda m, at: from_equirectangular(m, at, 2048),
    "narrow, 1.2 times as fine": lambda m, at: narrow(m, at, 1.2, 2),
    "narrow, as exported": lambda m, at: skybox_of(draw_surround(m, at, focal_of(SIDE)), m.floor, SIDE).color,
}


def images(project):
    scene, viewpoints = project.scene(), list(project.need_graph().viewpoints.values())
    random, found = np.random.default_rng(5), {name: ([], []) for name in WAYS}
    intrinsics = sweep(np.zeros(3))[0].intrinsics
    for i in random.choice(len(viewpoints), PLACES, replace=False):
        at = np.array(viewpoints[i].position)
        model = scene.model_at(at)[1]
        poses = [
            camera_pose(at, random.uniform(0, 2 * np.pi), random.integers(-1, 2) * np.pi / 6) for _ in range(VIEWS)
        ]
        cameras = [Camera(intrinsics, pose) for pose in poses]
        direct = [render_model(model, camera).rgb for camera in cameras]
        for name, way in WAYS.items():
            strip = way(model, at)
            found[name][1].append(seam_steps(strip))
            strip = cv2.imdecode(np.frombuffer(jpeg(strip, 95, True), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
            pairs = [(sample_strip(strip, c.rays()) / 255, np.clip(d, 0, 1)) for c, d in zip(cameras, direct)]
            found[name][0].extend(psnr(float(np.mean((a - b) ** 2))) for a, b in pairs)
    for name, (values, steps) in found.items():
        over, beside = np.mean(steps, axis=0)
        print(f"{name:28} {np.median(values):5.1f} dB median {min(values):5.1f} worst, steps {over:.2f} / {beside:.2f}")


def depth(project, truth):
    scene, found = project.scene(), {}
    frames = [f for f in project.need_capture().frames if (truth / f"{Path(f.name).stem}.png").is_file()]
    for frame in frames[:: max(1, len(frames) // 14)]:
        true = cv2.imread(str(truth / f"{Path(frame.name).stem}.png"), cv2.IMREAD_UNCHANGED) / 1000.0
        camera = frame.camera.scaled(true.shape[1], true.shape[0])
        rays = camera.rays()
        true = true / (rays @ camera.rotation[:, 2])
        model = scene.model_at(camera.position)[1]
        _, solid = draw_surround(model, camera.position, focal_of(SIDE)).color_and_solid(camera)
        floor = model.floor.distance_along_rays(camera.position, rays)
        alpha, weighted = solid[..., 0], solid[..., 1]
        behind = np.where(np.isfinite(floor), floor, 0)
        ways = {
            "Gaussians alone": weighted / np.maximum(alpha, 1e-3),
            "mean with the floor by alpha": weighted + (1 - alpha) * behind,
            "either, as exported": distances(solid, camera, model.floor),
        }
        known = (true > 0) & (true < 16)
        on_floor = known & (np.abs(true - floor) < 0.03)
        for name, way in ways.items():
            error = np.abs(way - true)
            row = error[known].mean(), (error[known] < 0.05).mean(), (error[on_floor] > 0.1).mean()
            found.setdefault(name, []).append(row)
    for name, rows in found.items():
        mean, near, off = np.mean(rows, axis=0)
        print(f"{name:30} mean error {mean:.3f} m, {near:.3f} within 5 cm; floor more than 10 cm off {off:.3f}")


if __name__ == "__main__":
    arguments = tyro.cli(Arguments, description=__doc__)
    with Project.open(arguments.project) as opened:
        images(opened)
        if arguments.truth is not None:
            depth(opened, arguments.truth)
