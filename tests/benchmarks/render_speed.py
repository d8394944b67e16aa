"""Milliseconds of each part of the rasteriser on a random room, as one JSON object.

python tests/benchmarks/render_speed.py [--gaussians N] [--size W H] [--rounds R] [--cold]

The room is 10 x 8 x 3 m with furniture; Gaussians lie on its surfaces, their size shrinks with their number. `--cold`
compiles everything anew in a temporary cache and reports the seconds.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gaussians", type=int, default=60_000)
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240), metavar=("W", "H"))
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--classic", action="store_true", help="without opacity compensation")
    parser.add_argument("--cold", action="store_true")
    options = parser.parse_args()
    if not options.cold:
        print(json.dumps(measure(options.gaussians, *options.size, options.rounds, not options.classic)))
        return
    with tempfile.TemporaryDirectory() as folder:
        os.environ["NUMBA_CACHE_DIR"] = folder
        print(json.dumps(compile_seconds()))


def room(count: int, seed: int = 7):
    """Gaussians on the surfaces of a room and its furniture, and a few in the air."""
    import numpy as np

    from nvsim.splats.types import Gaussians

    r = np.random.default_rng(seed)
    boxes = [((0, 0, 0), (10, 8, 3)), ((3.5, 3, 0), (5.5, 4.2, 0.75)), ((0.3, 0.3, 0), (1, 2.3, 2))]
    boxes += [((7.5, 5.5, 0), (9.7, 7.7, 0.5)), ((8.8, 1, 0), (9.9, 3, 0.9)), ((2, 6.8, 0), (4.5, 7.8, 0.8))]
    low, size = np.array([b[0] for b in boxes], float), np.array([np.subtract(b[1], b[0]) for b in boxes])
    area = np.stack([size[:, (a + 1) % 3] * size[:, (a + 2) % 3] for a in range(3)], 1).repeat(2, 1)
    area[1:] *= 2.5
    face = r.choice(area.size, count, p=(area / area.sum()).ravel())
    box, side = np.divmod(face, 6)
    axis, end = np.divmod(side, 2)
    at = r.random((count, 3))
    at[np.arange(count), axis] = end + r.normal(0, 0.002, count)
    air = r.random(count) < 0.03
    means = np.where(air[:, None], r.random((count, 3)) * [10, 8, 3], low[box] + at * size[box])
    spread = np.clip(0.035 * (100_000 / count) ** 0.5, 0.012, 0.08)
    scales = np.exp(r.normal(np.log(spread), 0.4, (count, 3))).clip(0.003, 0.25)
    scales[np.arange(count), axis] *= 0.25
    spin, quats = r.uniform(0, np.pi, count), np.zeros((count, 4))
    quats[:, 0], quats[np.arange(count), 1 + axis] = np.cos(spin), np.sin(spin)
    opacity = np.where(r.random(count) < 0.85, r.uniform(0.3, 0.99, count), r.uniform(0.02, 0.3, count))
    arrays = (means, np.log(scales), quats, np.log(opacity / (1 - opacity)), r.normal(0, 0.2, (count, 16, 3)))
    return Gaussians(*(np.ascontiguousarray(a, np.float32) for a in arrays))


def view(width: int, height: int):
    """From a corner of the room towards its middle, 70 degrees."""
    import numpy as np

    from nvsim.geometry.camera import Camera, Intrinsics, look

    return Camera(Intrinsics.from_fov(width, height, np.radians(70)), look(np.array([1.8, 1.6, 1.6]), 0.92, -0.1))


def measure(count: int, width: int, height: int, rounds: int, antialiased: bool, gaussians=None, camera=None):
    """Medians over `rounds`, milliseconds."""
    import numba
    import numpy as np
    import torch

    from nvsim.render.autograd import Statistics, rasterize
    from nvsim.render.workspace import Workspace
    from nvsim.splats.types import Gaussians

    g = gaussians or room(count)
    camera = camera or view(width, height)
    arrays = (g.means, g.log_scales, g.quats, g.opacity_logits, g.sh)
    gradients = Gaussians(*(np.empty_like(a) for a in arrays))
    statistics = Statistics.zeros(count)
    r = np.random.default_rng(0)
    d_rgb, d_alpha = r.normal(size=(height, width, 3)).astype("f4"), r.normal(size=(height, width)).astype("f4")
    d_depth = np.zeros_like(d_alpha)
    workspace = Workspace()
    image = {}

    def draw(geometry: bool) -> None:
        image["rgb"], image["t"], *_ = workspace.draw(height, width, geometry)

    parts = {
        "project": lambda: workspace.project(g, camera, antialiased),
        "bin": workspace.bin,
        "raster_geometry": lambda: draw(True),
        "raster": lambda: draw(False),
        "raster_backward": lambda: workspace.draw_gradient(image["t"], d_rgb, d_alpha, d_depth),
        "project_backward": lambda: workspace.project_gradient(g, gradients, statistics.sums),
    }
    times: dict[str, list[float]] = {name: [] for name in (*parts, "torch_forward", "torch_backward")}
    leaves = [torch.from_numpy(a).requires_grad_() for a in arrays]
    d_outputs = [torch.from_numpy(d_rgb), torch.from_numpy(d_alpha)]
    for _ in range(rounds + 1):
        for name, part in parts.items():
            start = time.perf_counter()
            part()
            times[name].append(time.perf_counter() - start)
        start = time.perf_counter()
        outputs = rasterize(*leaves, camera, antialiased=antialiased, statistics=statistics)
        middle = time.perf_counter()
        torch.autograd.grad(outputs, leaves, d_outputs)
        times["torch_forward"].append(middle - start)
        times["torch_backward"].append(time.perf_counter() - middle)
    medians = {name: round(float(np.median(t[1:])) * 1e3, 2) for name, t in times.items()}
    return {
        "gaussians": count,
        "size": [width, height],
        "threads": numba.get_num_threads(),
        "visible": workspace.visible,
        "intersections": workspace.intersections,
        "alpha_mean": round(float(1 - image["t"].mean()), 4),
        **{f"{name}_ms": value for name, value in medians.items()},
        "forward_ms": round(medians["project"] + medians["bin"] + medians["raster"], 2),
        "backward_ms": round(medians["raster_backward"] + medians["project_backward"], 2),
    }


def compile_seconds():
    """Seconds until everything that training and rendering need has run once, from an empty cache."""
    import numpy as np

    start = time.perf_counter()
    from nvsim.geometry.floor_surface import FloorSurface
    from nvsim.render.background import render_background
    from nvsim.splats.types import FloorTexture, SubmapModel

    imported = time.perf_counter()
    measure(100, 32, 32, 1, True)
    rasterised = time.perf_counter()
    texture = FloorTexture((np.zeros((2, 2, 3), np.float32),), (0.0, 0.0), (1.0, 1.0))
    render_background(SubmapModel(room(10), None, texture, FloorSurface.flat(0)), view(32, 32))
    return {
        "import_s": round(imported - start, 2),
        "rasteriser_s": round(rasterised - imported, 2),
        "background_s": round(time.perf_counter() - rasterised, 2),
    }


if __name__ == "__main__":
    sys.exit(main())
