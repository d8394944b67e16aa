"""Compare presets on the built-in building with equal steps, image size, and Gaussian budget, in paired runs.

python tests/benchmarks/train_quality.py [--presets NAME ...] [--seeds N ...] [--steps N] [--cap N] [--width N]
    [--no-cloud] [--resume] [--pictures]

Seed s is the largest submap of building s, trained with seed s and the true floor masks. All presets get equal data. A
preset may be changed: `nvsim:densify.strategy=mcmc:loss.fill=0`. Finished runs are stored as JSON in a folder; --resume
reuses them. The output has means and standard deviations over the seeds, of each preset and of the paired differences
from the first preset. PSNR in dB is the mean over frames; alpha is the mean accumulated alpha.

held_*     every 8th frame of the trajectory, without the pixels of people
novel_*    views off the trajectory that look 35 to 145 degrees off it and up to 25 degrees down, without people
glass_*    pixels behind a glass pane, in held-out and novel views
ghost      pixels where a training image shows a person: the rendering compared with the building without the person
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from building_truth import TrueView, Walk, walk_through
from harness import timed
from house_walk import drawn, save_pictures

from nvsim.evaluation import scores
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.types import SubmapModel
from nvsim.training.config import PRESETS, TrainingConfig, preset
from nvsim.training.trainer import train_submap

LEAST_PIXELS = 300


@dataclasses.dataclass(frozen=True)
class Arguments:
    presets: tuple[str, ...] = PRESETS
    seeds: tuple[int, ...] = (0, 1, 2)
    steps: int = 1500
    cap: int = 60_000
    width: int = 320
    runs: Path = Path("build") / "train_quality"
    """Folder of buildings and finished runs."""
    cloud: bool = True
    """Use the LiDAR scan for training. Without it, seeds come from image features and guesses."""
    resume: bool = False
    pictures: bool = False
    """Write truth, rendering, and alpha of some held-out and novel views next to the runs."""


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    table: dict[str, list[dict[str, float]]] = {}
    for seed in arguments.seeds:
        for name in arguments.presets:
            table.setdefault(name, []).append(figures_of(arguments, name, seed))
    print_table("mean and standard deviation over seeds", table)
    first = table[arguments.presets[0]]
    differences = {
        name: [{k: row[k] - base[k] for k in row if k in base} for row, base in zip(rows, first, strict=True)]
        for name, rows in table.items()
        if name != arguments.presets[0]
    }
    print_table(f"paired differences from {arguments.presets[0]}", differences)


def configured(name: str, arguments: Arguments) -> TrainingConfig:
    """The preset with the changes that follow its name."""
    base, *changes = name.split(":")
    config: Any = dataclasses.replace(
        preset(base), steps=arguments.steps, gaussian_cap=arguments.cap, image_size=arguments.width
    )
    for change in changes:
        path, value = change.split("=")
        config = changed(config, path.split("."), value)
    return config


def changed(config: Any, path: list[str], value: str) -> Any:
    old = getattr(config, path[0])
    if len(path) > 1:
        return dataclasses.replace(config, **{path[0]: changed(old, path[1:], value)})
    new = value if isinstance(old, str) else type(old)(json.loads(value))
    return dataclasses.replace(config, **{path[0]: new})


def figures_of(arguments: Arguments, name: str, seed: int) -> dict[str, float]:
    config = configured(name, arguments)
    settings = json.dumps([dataclasses.asdict(config), seed, arguments.cloud], sort_keys=True)
    path = arguments.runs / f"{hashlib.blake2b(settings.encode(), digest_size=8).hexdigest()}.json"
    if arguments.resume and path.exists():
        return json.loads(path.read_text())["figures"]
    walk = walk_through(seed, arguments.width, arguments.runs)
    floor, cloud = FloorSurface.flat(0.0), walk.cloud if arguments.cloud else None
    warm = dataclasses.replace(config, steps=2)
    train_submap(walk.training[:3], cloud, floor, warm, seed=seed)  # compiles the kernels
    model, seconds = timed(lambda: train_submap(walk.training, cloud, floor, config, seed=seed))
    figures = {"seconds": seconds, "gaussians": float(len(model.gaussians)), **judge(model, walk)}
    path.write_text(json.dumps({"name": name, "seed": seed, "figures": figures, "config": dataclasses.asdict(config)}))
    if arguments.pictures:
        folder = arguments.runs / "pictures" / name.replace(":", "_").replace("/", "_") / str(seed)
        views = {"held_out": walk.held_out, "novel": walk.novel, "haunted": walk.haunted}
        save_pictures(folder, model, **{kind: [(v.camera, v.image) for v in of] for kind, of in views.items()})
    print(f"{name}, seed {seed}: " + ", ".join(f"{k} {v:.3f}" for k, v in figures.items()), flush=True)
    return figures


def judge(model: SubmapModel, walk: Walk) -> dict[str, float]:
    rows: dict[str, list[float]] = {}
    for kind, views in (("held", walk.held_out), ("novel", walk.novel)):
        for view in views:
            error, alpha = compared(model, view)
            on, off = view.floor & view.counted, ~view.floor & view.counted
            regions = {"all": view.counted, "off": off, "floor": on}
            for name, where in regions.items():
                record(rows, f"{kind}_{name}", psnr(error, where))
            record(rows, f"{kind}_alpha_floor", mean(alpha, on))
            record(rows, f"{kind}_alpha_off", mean(alpha, off))
            pane = view.glass & off
            record(rows, "glass", psnr(error, pane))
            record(rows, "glass_alpha", mean(alpha, pane))
            record(rows, "glass_alpha_floor", mean(alpha, view.glass & on))
    for view in walk.haunted:
        error, _ = compared(model, view)
        record(rows, "ghost", psnr(error, view.counted))
    return {name: float(np.mean(values)) for name, values in rows.items()}


def compared(model: SubmapModel, view: TrueView) -> tuple[np.ndarray, np.ndarray]:
    """Squared error (H, W) and alpha (H, W) of a view."""
    rgb, alpha = drawn(model, view.camera)
    return ((rgb - view.image / np.float32(255)) ** 2).mean(axis=2), alpha


def record(rows: dict[str, list[float]], name: str, value: float | None) -> None:
    if value is not None:
        rows.setdefault(name, []).append(value)


def psnr(error: np.ndarray, where: np.ndarray) -> float | None:
    """PSNR in dB of squared errors (H, W) over the mask `where` (H, W). None if the mask is too small."""
    square = mean(error, where)
    return None if square is None else scores.psnr(square)


def mean(values: np.ndarray, where: np.ndarray) -> float | None:
    """Mean of values (H, W) over the mask `where` (H, W). None if the mask has fewer than `LEAST_PIXELS` pixels."""
    return float(values[where].mean(dtype=np.float64)) if where.sum() >= LEAST_PIXELS else None


def print_table(title: str, table: dict[str, list[dict[str, float]]]) -> None:
    if not table:
        return
    names = list(dict.fromkeys(k for rows in table.values() for row in rows for k in row))
    width = max(len(n) for n in names)
    print(f"\n{title}")
    for number, name in enumerate(table):
        print(f"  [{number}] {name}")
    print(" " * width + "".join(f"{f'[{i}]':>17}" for i in range(len(table))))
    for name in names:
        line = f"{name:{width}}"
        for rows in table.values():
            values = [row[name] for row in rows if name in row]
            line += f"{np.mean(values):10.3f} ±{np.std(values):5.3f}" if values else " " * 17
        print(line)


if __name__ == "__main__":
    main()
