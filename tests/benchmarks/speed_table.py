"""Compare the CPU rasterizer with a prototype, alternating in one process.

python tests/benchmarks/speed_table.py [--shared FOLDER] [--rounds R] [--quick]

FOLDER contains bench/scene.py (random rooms, seed 7) and prototypes/numba_rasterizer.py. The default is the folder
`shared` next to the repository. Milliseconds are medians. Ratios compare medians from one period on one machine, so
only ratios apply to other machines. Forward is projection, sorting, and drawing. Backward ends at the 2D parameters of
the splats, as in the prototype. NVSim's rasterizer is antialiased. The prototype is not, and renders no depth and no
normals.
"""

from __future__ import annotations

import json
import statistics
import sys
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import tyro
from harness import times

from nvsim.geometry.camera import Camera, Intrinsics
from nvsim.render.workspace import RenderBuffers
from nvsim.splats.types import Gaussians

SHARED = Path(__file__).resolve().parents[3] / "shared"
CASES = (
    (10_000, 640, 480),
    (50_000, 640, 480),
    (100_000, 320, 240),
    (100_000, 640, 480),
    (100_000, 1280, 720),
    (500_000, 640, 480),
    (500_000, 1280, 720),
)
QUICK = ((100_000, 640, 480), (500_000, 1280, 720))
F = np.float32


@dataclass(frozen=True)
class Arguments:
    shared: Path = SHARED
    rounds: int = 11
    quick: bool = False
    """Measure two cases only."""


def main() -> None:
    options = tyro.cli(Arguments, description=__doc__)
    sys.path[:0] = [str(options.shared / "bench"), str(options.shared / "prototypes")]
    rows = [measure(*case, options.rounds) for case in (QUICK if options.quick else CASES)]
    print(f"{'':22}{'prototype':>22}{'ours':>18}{'with geometry':>15}{'ratio':>8}{'geometry':>10}{'frame':>8}")
    for row in rows:
        p, n = row["prototype"], row["ours"]
        print(
            f"{row['gaussians']:>9,} {row['size']:>9}  {p['forward']:>9.1f} / {p['backward']:<9.1f}"
            f" {n['forward']:>7.1f} / {n['backward']:<7.1f} {n['forward_geometry']:>10.1f}"
            f" {row['ratio']:>10.2f} {row['ratio_geometry']:>9.2f} {row['frame_ratio']:>7.2f}"
        )
    print(json.dumps(rows))


def measure(count: int, width: int, height: int, rounds: int) -> dict:
    """Medians over `rounds`. Each round runs every part of both rasterizers once."""
    from scene import camera, make_scene

    scene, view = make_scene(count), camera(width, height)
    parts = {**_prototype(scene, view), **_ours(scene, view)}
    taken: dict[str, list[float]] = {name: [] for name in parts}
    for _ in range(rounds + 1):
        for name, part in parts.items():
            taken[name] += times(lambda _, part=part: part(), 1)  # type: ignore[misc]
    ms = {name: statistics.median(values[1:]) for name, values in taken.items()}
    before = {"forward": ms["p.project"] + ms["p.sort"] + ms["p.raster"], "backward": ms["p.backward"]}
    ours = {
        "forward": ms["n.project"] + ms["n.sort"] + ms["n.raster"],
        "forward_geometry": ms["n.project"] + ms["n.sort"] + ms["n.geometry"],
        "backward": ms["n.backward"],
    }
    both = before["forward"] + before["backward"]
    return {
        "gaussians": count,
        "size": f"{width}x{height}",
        "threads": numba.get_num_threads(),
        "prototype": before,
        "ours": ours,
        "parts": ms,
        "ratio": both / (ours["forward"] + ours["backward"]),
        "ratio_geometry": both / (ours["forward_geometry"] + ours["backward"]),
        "frame_ratio": before["forward"] / ours["forward"],
    }


def _prototype(scene: dict, view: dict) -> dict:
    import numba_rasterizer as prototype

    n, width, height, k = len(scene["means"]), view["width"], view["height"], view["K"]
    mx, my, ca, cb, cc, opacity, depth = (np.zeros(n, F) for _ in range(7))
    color, box = np.zeros((n, 3), F), np.zeros((n, 4), np.int32)
    columns, lines = -(-width // 16), -(-height // 16)
    image, left, last = (
        np.zeros((height, width, 3), F),
        np.zeros((height, width), F),
        np.zeros(columns * lines, np.int64),
    )
    threads = numba.get_num_threads()
    found = np.zeros((threads, n, 9), F)
    d_image = np.random.default_rng(0).normal(size=(height, width, 3)).astype(F)
    d_alpha, lists = np.zeros((height, width), F), [np.zeros(0, np.int64), np.zeros(0, np.int32)]
    w2c, eye = view["w2c"].astype(F), view["eye"].astype(F)
    focal = F(k[0, 0]), F(k[1, 1]), F(k[0, 2]), F(k[1, 2])
    splats = mx, my, ca, cb, cc, opacity, color
    boxes = box[:, 0], box[:, 1], box[:, 2], box[:, 3]
    raw = tuple(scene[name] for name in ("means", "log_scales", "quats", "opacity_logits", "sh"))

    def sort() -> None:
        seen = np.flatnonzero(box[:, 1] > 0).astype(np.int32)
        by_depth = seen[np.argsort(depth[seen])]
        lists[0] = prototype.bin_count(*boxes, columns, lines, n)
        lists[1] = prototype.bin_fill(by_depth, *boxes, columns, lists[0])

    def backward() -> None:
        found[:] = 0
        given = (lists[1], lists[0], width, height, columns, lines, left, last, d_image, d_alpha, threads, found)
        prototype.backward(*splats, *given)

    return {
        "p.project": lambda: prototype.project(*raw, w2c, *focal, width, height, eye, *splats, depth, box),
        "p.sort": sort,
        "p.raster": lambda: prototype.forward(
            *splats, lists[1], lists[0], width, height, columns, lines, image, left, last
        ),
        "p.backward": backward,
    }


def _ours(scene: dict, view: dict) -> dict:
    width, height, k = view["width"], view["height"], view["K"]
    gaussians = Gaussians(*(scene[name] for name in ("means", "log_scales", "quats", "opacity_logits", "sh")))
    camera = Camera(Intrinsics(width, height, k[0, 0], k[1, 1], k[0, 2], k[1, 2]), view["c2w"])
    workspace, left = RenderBuffers(), [np.zeros(0, F)]
    d_image = np.random.default_rng(0).normal(size=(height, width, 3)).astype(F)
    zeros = np.zeros((height, width), F)

    def draw(geometry: bool) -> None:
        left[0] = workspace.draw(height, width, geometry)[1]

    return {
        "n.project": lambda: workspace.project(gaussians, camera, True),
        "n.sort": workspace.bin,
        "n.geometry": lambda: draw(True),
        "n.raster": lambda: draw(False),
        "n.backward": lambda: workspace.draw_gradient(left[0], d_image, zeros, zeros),
    }


if __name__ == "__main__":
    main()
