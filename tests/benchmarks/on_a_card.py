"""Measure everything relevant on a machine with a CUDA GPU in ten minutes, as one JSON object.

python tests/benchmarks/on_a_card.py [--data FOLDER] [--steps N] [--minutes N] [--quick]

about          versions and the GPU
agreement      images and gradients of gsplat's kernels compared with NVSim's, for several views of random rooms
render         milliseconds and frames per second by number of Gaussians and image size, and GPU memory
step           a training step by number of Gaussians and image size, its parts, and the plain step of gsplat and torch
opengl         frames of the window's renderer
house_walk     one submap trained on the GPU and on the CPU with the protocol of house_walk.py, if its data exists

If a part fails, its error is recorded and the next part begins. Parts for which --minutes leave no time are listed in
left_out. Exit code 2 without a GPU, and 1 if a part failed.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
import tyro

from nvsim.benchmarks.random_room import random_room
from nvsim.benchmarks.render import inside_view, turn_camera_stepwise
from nvsim.render import autograd, gsplat_backend
from nvsim.render.backends import missing_for_gsplat
from nvsim.splats.types import Gaussians

HERE = Path(__file__).resolve().parent
DATA = HERE.parents[2] / "shared" / "data" / "house_walk"
COUNTS, SIZES = (10_000, 100_000, 500_000, 1_000_000), ((320, 240), (640, 480), (1280, 720), (1920, 1080))
FIELDS = ("means", "log_scales", "quats", "opacity_logits", "sh")


@dataclass(frozen=True)
class Arguments:
    data: Path = DATA
    steps: int = 2000
    """Steps of the house_walk trainings."""
    minutes: float = 10.0
    quick: bool = False
    """Run only the smallest sizes, without training, to test whether everything works."""


def main() -> int:
    arguments = tyro.cli(Arguments, description=__doc__)
    missing = missing_for_gsplat()
    if missing is not None:
        print(f"There is no GPU to measure: {missing}.", file=sys.stderr)
        return 2
    end = time.monotonic() + 60 * arguments.minutes
    counts, sizes = (COUNTS[:1], SIZES[:1]) if arguments.quick else (COUNTS, SIZES)
    pairs = sorted(
        {(c, SIZES[min(1, len(sizes) - 1)]) for c in counts} | {(counts[min(1, len(counts) - 1)], s) for s in sizes}
    )
    tasks: list[tuple[str, Callable[[], Any]]] = [
        ("about", describe_device),
        ("agreement", agreement),
        *((f"render {c} {w}x{h}", lambda c=c, w=w, h=h: render(c, w, h)) for c, (w, h) in pairs),
        *((f"step {c} {w}x{h}", lambda c=c, w=w, h=h: step(c, w, h)) for c, (w, h) in pairs),
        *((f"step {p} 100000 640x480", lambda p=p: step(100_000, 640, 480, p)) for p in ("splatfacto-i", "3dgs")),
        ("opengl", opengl),
    ]
    if not arguments.quick and (arguments.data / "kapture").is_dir():
        for preset in ("nvsim", "splatfacto-i"):
            for device in ("cuda", "cpu"):
                work = lambda p=preset, d=device: house_walk(arguments, p, d, end)  # noqa: E731
                tasks.append((f"house_walk {preset} {device}", work))
    found, failed, left = measured(tasks, end)
    print(json.dumps({**found, "failed": failed, "left_out": left}, indent=1))
    return 1 if failed else 0


def measured(
    tasks: list[tuple[str, Callable[[], Any]]], end: float
) -> tuple[dict[str, Any], dict[str, str], list[str]]:
    """Runs the tasks. Returns their results by name, the errors of failed tasks, and the tasks skipped after `end`."""
    found: dict[str, Any] = {}
    failed: dict[str, str] = {}
    left: list[str] = []
    for name, work in tasks:
        if time.monotonic() > end:
            left.append(name)
            continue
        print(name, file=sys.stderr, flush=True)
        try:
            found[name] = work()
        except Exception as error:
            traceback.print_exc()
            failed[name] = f"{type(error).__name__}: {error}"
    return found, failed, left


def describe_device() -> dict[str, Any]:
    """Versions of the software, and the properties of the GPU if there is one."""
    import importlib.metadata as metadata
    import platform

    found: dict[str, Any] = {
        "python": platform.python_version(),
        "torch": torch.__version__,
        "cuda": torch.version.cuda,
    }
    for package in ("nvsim", "gsplat", "numba"):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = None
    if torch.cuda.is_available():
        card = torch.cuda.get_device_properties(0)
        found |= {"card": card.name, "memory_gib": round(card.total_memory / (1 << 30), 1)}
        found["capability"] = f"{card.major}.{card.minor}"
    return found


def agreement(device: str = "cuda", count: int = 20_000, width: int = 320, height: int = 240) -> list[dict[str, float]]:
    """For each view: PSNR of the images, and relative errors of all gradients and of the densification statistics."""
    from nvsim.benchmarks.render_card import agreement as images

    room = random_room(count)
    rows = []
    for antialiased in (True, False):
        for camera in turn_camera_stepwise(inside_view(width, height), 101)[::50]:
            row: dict[str, float] = {"antialiased": antialiased, **images(room, camera, antialiased, device)}
            row |= gradients(room, camera, antialiased, device)
            rows.append(row)
    return rows


def gradients(room: Gaussians, camera: Any, antialiased: bool, device: str) -> dict[str, float]:
    arrays = [getattr(room, name) for name in FIELDS]
    ours = [torch.tensor(a, requires_grad=True) for a in arrays]
    theirs = [torch.tensor(a, requires_grad=True, device=device) for a in arrays]
    statistics = autograd.Statistics.zeros(len(room))
    rgb, alpha = autograd.rasterize(*ours, camera, antialiased=antialiased, statistics=statistics)
    drawn = gsplat_backend.rasterize(*theirs, camera=camera, antialiased=antialiased)
    draw = torch.Generator().manual_seed(0)
    by_rgb, by_alpha = torch.randn(rgb.shape, generator=draw), torch.randn(alpha.shape, generator=draw)
    torch.autograd.backward([rgb, alpha], [by_rgb, by_alpha])
    torch.autograd.backward([drawn.rgb, drawn.transmittance], [by_rgb.to(device), -by_alpha.to(device)])
    row = {}
    for name, a, b in zip(FIELDS, ours, theirs, strict=True):
        assert a.grad is not None and b.grad is not None
        row[f"{name}_error"] = float((a.grad - b.grad.cpu()).norm() / a.grad.norm())
    found, expected = drawn.statistics().cpu(), torch.from_numpy(statistics.sums)
    seen = expected[:, 1] > 0
    row["seen_share"] = float(found[seen, 1].mean())
    for column, name in ((0, "shift_error"), (2, "radius_error")):
        row[name] = float((found[seen, column] - expected[seen, column]).norm() / expected[seen, column].norm())
    return row


def render(count: int, width: int, height: int) -> dict[str, Any]:
    from nvsim.benchmarks.render_card import measure

    return measure(random_room(count), inside_view(width, height))


def step(count: int, width: int, height: int, preset: str = "nvsim") -> dict[str, Any]:
    from nvsim.benchmarks.train import measure

    return measure(count, width, height, device="cuda", preset_name=preset)


def opengl() -> Any:
    sizes = [f"{w}x{h}" for w, h in SIZES[1:]]
    return last_json([sys.executable, "-m", "nvsim.cli.main", "bench", "opengl", "--size", *sizes, "--json"], 120)


def house_walk(arguments: Arguments, preset: str, device: str, end: float) -> Any:
    command = [sys.executable, str(HERE / "house_walk.py"), "--data", str(arguments.data), "--preset", preset]
    more = ["--device", device, "--steps", str(arguments.steps), "--image-size", "320", "--gaussian-cap", "60000"]
    return last_json([*command, *more], max(end - time.monotonic(), 1))


def last_json(command: list[str], seconds: float) -> Any:
    """Runs a command and parses the last line of its output as JSON. Raises RuntimeError if the command fails."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=seconds)
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"exit {done.returncode}")
    return json.loads(done.stdout.strip().splitlines()[-1])


if __name__ == "__main__":
    sys.exit(main())
