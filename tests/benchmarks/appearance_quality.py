"""Measure the quality and cost of camera-dependent colors, with uniform and with changing light.

python tests/benchmarks/appearance_quality.py [--data FOLDER] [--steps N] [--cap N] [--gains 0 0.15]
   [--kinds none linear network] [--embedding index]

The protocol is that of house_walk.py. A gain g multiplies every image, also novel views, by 1 + g sin(2 pi x / 7 m + 1)
cos(2 pi y / 9 m) at the camera position x, y. Kinds are those of `appearance.kind`; "linear:8" has 8 features.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import house_walk
import numpy as np
import tyro
from harness import report, timed
from house_walk import DATA, cloud_near, held_out_figures, largest_cluster, novel_figures, novel_views, view_of

from nvsim.capture.read import read
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.training.config import TrainingConfig, preset
from nvsim.training.trainer import train_submap


@dataclass(frozen=True)
class Arguments:
    data: Path = DATA
    preset: str = "nvsim"
    steps: int = 1000
    cap: int = 40_000
    gains: tuple[float, ...] = (0.0, 0.15)
    kinds: tuple[str, ...] = ("none", "linear", "network")
    embedding: str = "position"
    seed: int = 0


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    capture = read(arguments.data / "kapture")
    members = largest_cluster(capture)
    cloud = cloud_near(capture, members)
    held_out = members[::8]
    protocol = house_walk.Arguments(data=arguments.data)
    views = {i: view_of(protocol, capture, i) for i in members}
    novel = novel_views(protocol, capture, members)
    floor = FloorSurface.flat(0.0)
    for gain in arguments.gains:
        lit = {i: replace(v, image=lighted(v.image, v.camera.position, gain)) for i, v in views.items()}
        unseen = [(camera, lighted(image, camera.position, gain)) for camera, image in novel]
        train = [lit[i] for i in members if i not in set(held_out)]
        for kind in arguments.kinds:
            config = configured(arguments, kind)
            train_submap(train[:4], cloud, floor, replace(config, steps=3), seed=arguments.seed)
            model, seconds = timed(partial(train_submap, train, cloud, floor, config, seed=arguments.seed))
            figures = {"kind": kind, "gain": gain, "seconds": round(seconds, 1), "gaussians": len(model.gaussians)}
            figures |= held_out_figures(model, [lit[i] for i in held_out])
            figures |= {f"novel_{k.removeprefix('novel_')}": v for k, v in novel_figures(model, unseen).items()}
            report(figures, as_json=True)


def configured(arguments: Arguments, kind: str) -> TrainingConfig:
    base = preset(arguments.preset)
    name, _, features = kind.partition(":")
    network = name == "network"
    appearance = replace(
        base.appearance,
        kind=name,
        embedding=arguments.embedding,
        features=int(features) if features else 32 if network else 6,
    )
    rate = replace(base.rate, features=2e-2, features_end=1e-3) if network else base.rate
    return replace(
        base,
        steps=arguments.steps,
        gaussian_cap=arguments.cap,
        image_size=320,
        appearance=appearance,
        rate=rate,
    )


def lighted(image: np.ndarray, position: np.ndarray, gain: float) -> np.ndarray:
    """The image (H, W, 3) uint8 with the gain of the camera position (3,), meters."""
    factor = 1 + gain * np.sin(2 * np.pi * position[0] / 7 + 1) * np.cos(2 * np.pi * position[1] / 9)
    return np.clip(np.round(image * factor), 0, 255).astype(np.uint8)


if __name__ == "__main__":
    main()
