"""Train one submap of a rendered house, and measure held-out and novel views: a table and one JSON line.

python tests/benchmarks/house_walk.py [--data FOLDER] [--width N] [--pictures FOLDER] [--seed N] [--preset NAME]
    [any training flag]

The cameras are split into four clusters. The largest one (152 frames) is trained at 320x240 (--width) with the true
floor masks. Every 8th frame is held out. Novel views are at most 0.9 m from a camera of the trajectory and look 35 to
145 degrees off it. "down" is measured on rays more than about 20 degrees below the horizon. PSNR is the mean over
frames.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import tyro
from harness import report, timed

from nvsim.capture.images import read_image
from nvsim.capture.read import read
from nvsim.capture.types import Capture, Cloud
from nvsim.cli.arguments import Inline, value_of_flag
from nvsim.evaluation.scores import psnr
from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.model import render_model
from nvsim.splats.types import SubmapModel
from nvsim.training.config import TrainingConfig, preset
from nvsim.training.trainer import train_submap
from nvsim.training.views import TrainingView

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "house_walk"
ASPECT = 4 / 3
REACH = 6.0
NOVEL_REACH = 0.9
DOWN = -0.35
LEAST_SHARE = 0.0065


@dataclass(frozen=True)
class Arguments:
    data: Path = DATA
    width: int = 320
    pictures: Path | None = None
    seed: int = 0
    preset: str = "nvsim"
    config: Inline[TrainingConfig] = field(default_factory=TrainingConfig)


def main() -> None:
    name = value_of_flag(sys.argv[1:], "--preset", "nvsim")
    arguments = tyro.cli(Arguments, default=Arguments(preset=name, config=preset(name)), description=__doc__)
    capture = read(arguments.data / "kapture")
    members = largest_cluster(capture)
    held_out = members[::8]
    kept = [i for i in members if i not in set(held_out)]
    train = [view_of(arguments, capture, i) for i in kept]
    cloud = cloud_near(capture, members)
    warm_up = replace(arguments.config, steps=3)  # compiles every kernel before the time is measured
    train_submap(train[:4], cloud, FloorSurface.flat(0.0), warm_up, seed=arguments.seed)
    floor, config = FloorSurface.flat(0.0), arguments.config
    model, seconds = timed(lambda: train_submap(train, cloud, floor, config, seed=arguments.seed))
    figures = {"preset": arguments.preset, "seconds": round(seconds, 1), "gaussians": len(model.gaussians)}
    tested = [view_of(arguments, capture, i) for i in held_out]
    figures |= held_out_figures(model, tested)
    novel = novel_views(arguments, capture, members)
    figures |= novel_figures(model, novel)
    if arguments.pictures is not None:
        save_pictures(arguments.pictures, model, held_out=[(v.camera, v.image) for v in tested], novel=novel)
    report(figures)


def largest_cluster(capture: Capture) -> list[int]:
    from sklearn.cluster import AgglomerativeClustering

    places = np.array([f.camera.position for f in capture.frames])
    labels = AgglomerativeClustering(4).fit_predict(places[:, :2])
    return np.flatnonzero(labels == np.argmax(np.bincount(labels))).tolist()


def cloud_near(capture: Capture, members: list[int]) -> Cloud:
    """The points in the box around the cameras `members`, extended by `REACH` meters."""
    places = np.array([capture.frames[i].camera.position for i in members])
    points = capture.cloud.points
    inside = ((points > places.min(axis=0) - REACH) & (points < places.max(axis=0) + REACH)).all(axis=1)
    return Cloud(points[inside], capture.cloud.colors[inside])


def size_of(arguments: Arguments) -> tuple[int, int]:
    return arguments.width, round(arguments.width / ASPECT)


def view_of(arguments: Arguments, capture: Capture, index: int) -> TrainingView:
    width, height = size_of(arguments)
    frame = capture.frames[index]
    camera = frame.camera.scaled(width, height)
    mask = cv2.imread(str(arguments.data / "ground_truth" / "floor" / f"{index:06d}.png"), cv2.IMREAD_GRAYSCALE)
    floor = cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA) > 127
    return TrainingView(frame.name, camera, read_image(frame, camera.intrinsics), floor)


def novel_views(arguments: Arguments, capture: Capture, members: list[int]) -> list[tuple[Camera, np.ndarray]]:
    """Cameras and images (H, W, 3) uint8 of the novel views near the cameras `members`."""
    truth, (width, height) = arguments.data / "ground_truth", size_of(arguments)
    places = np.array([capture.frames[i].camera.position for i in members])
    intrinsics = capture.frames[0].camera.scaled(width, height).intrinsics
    found = []
    for line in (truth / "holdout_frames.txt").read_text().splitlines():
        if line.startswith("#") or not line.strip():
            continue
        name, *numbers = line.split()
        pose = np.array(numbers, float).reshape(4, 4)
        if np.linalg.norm(places - pose[:3, 3], axis=1).min() < NOVEL_REACH:
            picture = cv2.imread(str(truth / name))[..., ::-1]
            found.append((Camera(intrinsics, pose), cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)))
    return found


def drawn(model: SubmapModel, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """The rendered image (H, W, 3) from 0 to 1, and alpha (H, W)."""
    output = render_model(model, camera)
    return np.clip(output.rgb, 0, 1), output.alpha


def held_out_figures(model: SubmapModel, views: list[TrainingView]) -> dict[str, float]:
    rows = []
    for view in views:
        rgb, alpha = drawn(model, view.camera)
        error, floor = (rgb - view.image / np.float32(255)) ** 2, view.floor
        enough = floor.mean() > LEAST_SHARE
        rows.append(
            [
                psnr(error.mean()),
                psnr(error[~floor].mean()),
                psnr(error[floor].mean()) if enough else np.nan,
                alpha[floor].mean() if enough else np.nan,
                alpha[~floor].mean(),
            ]
        )
    names = ("psnr", "psnr_nonfloor", "psnr_floor", "alpha_floor", "alpha_nonfloor")
    return {name: round(float(value), 4) for name, value in zip(names, np.nanmean(rows, axis=0), strict=True)}


def novel_figures(model: SubmapModel, views: list[tuple[Camera, np.ndarray]]) -> dict[str, float]:
    """Metrics of the novel views. `views` are cameras with images (H, W, 3) uint8."""
    rows = []
    for camera, image in views:
        rgb, _ = drawn(model, camera)
        error = (rgb - image / np.float32(255)) ** 2
        rows.append([psnr(error.mean()), psnr(error[camera.rays()[..., 2] < DOWN].mean())])
    everything, down = np.mean(rows, axis=0)
    return {"novel": round(float(everything), 2), "novel_down": round(float(down), 2), "novel_views": len(rows)}


def save_pictures(folder: Path, model: SubmapModel, **kinds: list[tuple[Camera, np.ndarray]]) -> None:
    """Writes a sheet of six views for each kind, with image, rendering, and alpha side by side."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, views in kinds.items():
        rows = []
        for camera, image in views[:: max(len(views) // 6, 1)][:6]:
            rgb, alpha = drawn(model, camera)
            rows.append(np.concatenate([image / 255, rgb, np.repeat(alpha[..., None], 3, 2)], axis=1))
        if rows:
            cv2.imwrite(str(folder / f"{name}.png"), (np.concatenate(rows)[..., ::-1] * 255).astype(np.uint8))


if __name__ == "__main__":
    main()
