"""Measure the cost of camera-dependent colors: per training step, and per camera position in a viewer.

python tests/benchmarks/appearance_speed.py [--gaussians 100000] [--sh-degree 3]

Gaussians fill a room of 6 x 4.5 x 2.6 m, seen from its center at 640x480. "forward" and "backward" are the times that a
training step adds, medians in milliseconds. They exclude the tint of the linear form, which is part of the projection.
"place" is the numpy evaluation of all Gaussians at a new camera position.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass

import numba
import numpy as np
import torch
import tyro

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.splats.types import Gaussians
from nvsim.training.appearance import LinearColours, NetworkColours
from nvsim.training.config import AppearanceConfig
from nvsim.training.networks import PositionEmbedding

KINDS = (("linear", 6), ("network", 32))


@dataclass(frozen=True)
class Arguments:
    gaussians: int = 100_000
    sh_degree: int = 3
    repeats: int = 9


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    rng, n, count = np.random.default_rng(0), arguments.gaussians, (arguments.sh_degree + 1) ** 2
    means = (rng.random((n, 3)) * [6, 4.5, 2.6]).astype(np.float32)
    quats = np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1))
    sh = rng.normal(size=(n, count, 3)).astype(np.float32)
    gaussians = Gaussians(means, np.full((n, 3), -4, np.float32), quats, np.zeros(n, np.float32), sh)
    camera = Camera(Intrinsics.from_fov(640, 480, 1.4), camera_pose(np.array([3, 2.2, 1.2]), 0.3, -0.1))
    slopes = rng.normal(size=sh.shape).astype(np.float32)
    for kind, width in KINDS:
        config = AppearanceConfig(kind=kind, features=width)
        network = kind == "network"
        torch.set_num_threads(numba.get_num_threads() if network else 1)
        colours = NetworkColours(config, 0, count) if network else LinearColours(config, 0)
        features = rng.normal(size=(n, width)).astype(np.float32)
        d_features, d_matrix = np.empty_like(features), rng.normal(size=(3, width)).astype(np.float32)
        laps: dict[str, list[float]] = {"forward": [], "backward": [], "place": []}
        appearance = colours.exported(PositionEmbedding(config, 0).exported(), features, np.zeros(3))
        for repeat in range(arguments.repeats + 2):
            times = [time.perf_counter()]
            colours.shown(gaussians, features, torch.randn(config.size, requires_grad=True), camera)
            times.append(time.perf_counter())
            colours.collect(slopes, d_matrix, d_features)
            times.append(time.perf_counter())
            appearance.coloured(gaussians, np.array([repeat, 0.0, 0.0]))
            times.append(time.perf_counter())
            if repeat >= 2:  # the first ones compile and allocate
                for name, lap in zip(laps, np.diff(times), strict=True):
                    laps[name].append(1e3 * lap)
        text = ", ".join(f"{name} {statistics.median(values):.1f} ms" for name, values in laps.items())
        print(f"{kind}, {width} features: {text}")


if __name__ == "__main__":
    main()
