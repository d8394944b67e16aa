"""Views without color, only with geometry, from which the map is decided."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import count
from typing import TypeVar
from weakref import WeakKeyDictionary

import numba
import numpy as np

from nvsim.geometry.camera import Camera
from nvsim.kernel_threads import can_start_kernels_at_once
from nvsim.render.backends import RenderOutput, expected_depth
from nvsim.render.by_rays import draw_by_rays, is_wide
from nvsim.render.kernel_types import Float32, Mask
from nvsim.render.model import render_over
from nvsim.render.nearby import NeighborGroups, gray_gaussians
from nvsim.render.workspace import LOCK, RenderBuffers
from nvsim.splats.types import Gaussians, SubmapModel

T = TypeVar("T")
_own = threading.local()


def side_by_side(draw: Callable[[int, RenderBuffers], T], views: int) -> list[T]:
    """The results of `draw` for each of `views` views, in order. It is called with the index and a workspace, in as
    many threads as the kernels can use, each with single-threaded kernels. The views are drawn one after the other if
    several threads cannot start kernels."""
    threads = numba.get_num_threads()
    numbers, found = count(), dict[int, T]()

    def work() -> None:
        before = numba.get_num_threads()
        numba.set_num_threads(1)
        try:
            # A step of `count` is atomic in the interpreter, so no two threads get an equal number.
            while (i := next(numbers)) < views:
                found[i] = draw(i, _workspace())
        finally:
            numba.set_num_threads(before)

    with LOCK:
        others = min(threads, views) - 1 if can_start_kernels_at_once() else 0
        waiting = [_pool(threads).submit(work) for _ in range(others)]
        try:
            work()
        finally:
            for other in waiting:
                other.result()
    return [found[i] for i in range(views)]


def _workspace() -> RenderBuffers:
    if not hasattr(_own, "buffers"):
        _own.buffers = RenderBuffers()
    buffers: RenderBuffers = _own.buffers
    return buffers


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "view")


_nearby: WeakKeyDictionary[Gaussians, NeighborGroups] = WeakKeyDictionary()


def neighbor_groups(gaussians: Gaussians) -> NeighborGroups:
    """The groups of neighbors of Gaussians that do not change, computed once."""
    if gaussians not in _nearby:
        _nearby[gaussians] = NeighborGroups(gaussians)
    return _nearby[gaussians]


def render_geometry_views(
    models: Sequence[SubmapModel], views: Sequence[tuple[Camera, Mask]], channels: frozenset[str]
) -> list[RenderOutput]:
    """For each camera, the requested tiles (lines, columns) of its model's view, in the `channels` except color.
    Gaussians that are too wide to be splatted are drawn by rays, in front of all others."""
    for model in models:
        neighbor_groups(model.gaussians)  # before the threads, which would compute it several times

    def draw(i: int, workspace: RenderBuffers) -> RenderOutput:
        model, (camera, tiles) = models[i], views[i]
        # Few Gaussians are needed, and without colors they do not depend on the position.
        rows = neighbor_groups(model.gaussians).rows(camera, tiles)
        wide = is_wide(model.gaussians, rows, camera)
        splats, asked = gray_gaussians(model.gaussians, rows[~wide]), (channels | {"alpha"}) - {"rgb"}
        view = render_over(splats, camera, asked, model.antialiased, tiles, "numba", workspace=workspace)[0]
        if wide.any():
            _lay_over(view, *draw_by_rays(gray_gaussians(model.gaussians, rows[wide]), camera, tiles))
        if "alpha" not in channels:
            view.alpha = None
        return view

    return side_by_side(draw, len(views))


def _lay_over(view: RenderOutput, through: Float32, depth: Float32, normal: Float32) -> None:
    """Puts the transmittance (H, W) and the sums of `draw_by_rays` in front of a view, in place."""
    assert view.alpha is not None
    behind, view.alpha = through * view.alpha, 1 - through * (1 - view.alpha)
    if view.depth is not None:
        view.depth = expected_depth(depth + behind * view.depth, view.alpha)
    if view.normal is not None:
        view.normal = np.moveaxis(normal, 0, -1) + through[..., None] * view.normal
