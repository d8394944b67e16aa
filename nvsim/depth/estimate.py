"""The stage: dense depth of every frame from its posed neighbours, and the cloud that the frames make together.

First every frame by itself, then what its neighbours confirm. Each result is written as it is found, so that a stopped
run goes on where it stopped.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Capture
from nvsim.depth.agreement import agreed
from nvsim.depth.config import DepthConfig
from nvsim.depth.files import read_confidence, read_depth, read_guess, write_depth, write_guess
from nvsim.depth.fusion import FusedCloud, Fusion
from nvsim.depth.neighbours import neighbours
from nvsim.depth.refinement import refine
from nvsim.depth.smoothing import smooth, winner
from nvsim.depth.sweep import sweep
from nvsim.depth.view import Views, Warp
from nvsim.events import Listener, Progress, silent
from nvsim.files.atomic import make_folder

STAGE = "depth"
_KEPT_VIEWS = 48
_KEPT_MAPS = 96


def estimate_depth(
    capture: Capture, folder: Path, config: DepthConfig | None = None, listen: Listener = silent
) -> FusedCloud:
    """Writes the depth and the confidence of every frame to `folder` (see `nvsim.depth.files`); returns the cloud that
    they make together, of no point where the images show no depth.

    Frames whose files exist are not done again. Raises InputError for an image that cannot be read and for a folder
    that cannot be written; what is written so far stays.
    """
    config = config or DepthConfig()
    guesses = folder / "guesses"
    make_folder(guesses)
    views = Views(capture.frames, config.longest_side, config.threshold, _KEPT_VIEWS)
    count = len(capture.frames)
    missing = [i for i in range(count) if not depth_exists(folder, i)]
    near = {i: neighbours(views.poses, i, config.others, config.baseline, 0.1) for i in missing}
    first = sorted({j for i in missing for j in (i, *near[i])})

    def guess(index: int) -> None:
        write_guess(guesses, index, *guess_depth(views, index, config))

    steps = count + len(first)
    _each([i for i in first if not (guesses / f"{i:06d}.npz").is_file()], guess, config, listen, 0, steps, capture)
    maps = lru_cache(maxsize=_KEPT_MAPS)(lambda i: read_guess(guesses, i))

    def confirm(index: int) -> None:
        found, weight = maps(index)
        camera = views.camera(index)
        others = [(*maps(j), Warp.between(camera, views.camera(j))) for j in near[index]]
        result = agreed(found, weight, others, config.share, config.plane)
        known = (result.views >= config.views) & (2 * result.through <= result.views)
        write_depth(folder, index, np.where(known, result.inverse, 0).astype(np.float32), result.views)

    _each(missing, confirm, config, listen, len(first), steps, capture)
    shutil.rmtree(guesses, ignore_errors=True)
    fusion = Fusion(config.voxel)
    for i in range(count):
        with np.errstate(divide="ignore"):
            depth = read_depth(folder, i)
            inverse = np.where(depth > 0, 1 / depth, 0).astype(np.float32)
        fusion.add(views.camera(i), inverse, views.at(i).image)
    listen(Progress(STAGE, steps, steps))
    return fusion.cloud(config.seen)


def guess_depth(views: Views, index: int, config: DepthConfig) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Two (H, W) float32 arrays of a frame by itself: inverse depth, 1 / metres, 0 where it cannot be told; and how
    much the images know about it, its inverse variance."""
    view = views.at(index)
    chosen = neighbours(views.poses, index, config.sources, config.baseline)
    if not chosen:
        return np.zeros_like(view.grey), np.zeros_like(view.grey)
    warps = [Warp.between(view.camera, views.camera(j)) for j in chosen]
    turned, shifts = np.stack([w.turned for w in warps]), np.stack([w.shift for w in warps])
    inverse = np.linspace(1 / config.farthest, 1 / config.nearest, config.planes)
    cost = sweep(view.census, [views.at(j).census for j in chosen], turned, shifts, inverse)
    total = smooth(cost, view.grey, config.small, config.large, config.fall)
    found, margin = winner(total, inverse.astype(np.float32))
    found[margin < config.margin] = 0
    knowledge = np.zeros_like(found)
    for _ in range(config.steps):
        found, knowledge, _ = refine(
            view.grey,
            [views.at(j).grey for j in chosen],
            turned,
            shifts,
            found,
            config.window,
            inverse[1] - inverse[0],
            config.noise,
        )
    return found, knowledge


def depth_exists(folder: Path, index: int) -> bool:
    """Whether the depth of a frame is there, with its confidence."""
    from nvsim.depth.files import confidence_path, depth_path

    return depth_path(folder, index).is_file() and confidence_path(folder, index).is_file()


def _each(
    todo: list[int],
    work: Callable[[int], None],
    config: DepthConfig,
    listen: Listener,
    done: int,
    total: int,
    capture: Capture,
) -> None:
    """Does the work of all frames, some at a time, and says how far it is."""
    done, last = done + 0, len(todo)
    with ThreadPoolExecutor(config.threads) as pool:
        jobs = {pool.submit(work, i): i for i in todo}
        try:
            for k, job in enumerate(as_completed(jobs)):
                job.result()
                listen(Progress(STAGE, done + k + 1, total, capture.frames[jobs[job]].name))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    assert last >= 0


__all__ = ["STAGE", "depth_exists", "estimate_depth", "guess_depth", "read_confidence", "read_depth"]
