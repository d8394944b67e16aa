"""Compare three ways of rendering views with the true images of a built-in building from `nvsim demo`.

python tests/benchmarks/live_images.py P [COUNT]

The views have random directions at random viewpoints. Narrow views are rendered as the simulator renders them live.
Wide views are one splat image. Straight views are composed of patches that are each rendered straight ahead.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from nvsim.building.config import BuildingConfig
from nvsim.building.rendering import render
from nvsim.building.scene import make_scene, textures_of
from nvsim.evaluation.scan import straight_view
from nvsim.evaluation.scores import psnr
from nvsim.geometry.camera import Camera, camera_pose
from nvsim.geometry.directions import STEP, sweep
from nvsim.project.project import Project
from nvsim.r2r.observations.incremental_surround import PlacesSeen
from nvsim.render.model import render_model


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]
    count: tyro.conf.Positional[int] = 60


def measure(root: Path, count: int) -> None:
    record = json.loads((root / "building.json").read_text())
    building = make_scene(BuildingConfig(**{k: v for k, v in record.items() if k != "version"}))
    textures, nobody = textures_of(building), (np.empty((0, 5)), np.empty((0, 3)))
    with Project.open(root) as project:
        scene, graph = project.scene(memory_budget=0), project.need_graph()
    assert scene is not None
    places = [np.array(v.position) for v in graph.viewpoints.values() if v.included]
    intrinsics, r = sweep(np.zeros(3))[0].intrinsics, np.random.default_rng(3)
    chosen = [(places[int(r.integers(len(places)))], r.uniform(0, 2 * np.pi), r.integers(-1, 2)) for _ in range(count)]
    found: dict[str, list[float]] = {}
    seen = PlacesSeen(0)
    for at, heading, row in sorted(chosen, key=lambda c: scene.nearest(c[0])):
        model, camera = scene.model_at(at)[1], Camera(intrinsics, camera_pose(at, heading, row * STEP))
        wide = render_model(model, camera).rgb
        assert wide is not None
        images = {
            "truth": render(camera, building.solids, textures, *nobody).color,
            "narrow": seen.image(model, camera, False)[0] / 255,
            "wide": np.clip(wide, 0, 1),
            "straight": np.clip(straight_view(model, camera), 0, 1),
        }
        for a, b in (("narrow", "truth"), ("wide", "truth"), ("straight", "truth"), ("narrow", "straight")):
            found.setdefault(f"{a} against {b}", []).append(psnr(float(((images[a] - images[b]) ** 2).mean())))
    for name, values in found.items():
        print(f"{name:24} median {np.median(values):.2f} dB, mean {np.mean(values):.2f}, worst {min(values):.2f}")


if __name__ == "__main__":
    arguments = tyro.cli(Arguments, description=__doc__)
    measure(arguments.project, arguments.count)
