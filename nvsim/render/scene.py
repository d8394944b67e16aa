"""Renders the ensemble of submap models by the model nearest to the camera (paper Algorithm 1, line 4): whole views,
or some pixels.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.backends import Backend, RenderOutput, resolve_backend
from nvsim.render.geometry_views import render_geometry_views
from nvsim.render.model import render_model
from nvsim.render.workspace import tiles_of
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import SubmapModel


def render_scene(
    scene: SceneModel,
    camera: Camera,
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
) -> tuple[int, RenderOutput]:
    """The index of the submap that rendered the view, and the view. Raises InputError if that submap's files cannot be
    read, ValueError for an unknown channel."""
    index, model = scene.model_at(camera.position)
    return index, render_model(model, camera, channels)


def render_regions(
    scene: SceneModel | SubmapModel,
    cameras: Sequence[Camera],
    masks: Sequence[NDArray[np.bool_]],
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
    backend: Backend = "auto",
) -> list[RenderOutput]:
    """A view for each camera, limited to its mask (H, W). Inside the mask it is bit-identical to `render_model`, with
    one exception: Gaussians that are wide relative to their depth are drawn by rays (see `by_rays`), except in "rgb".
    Other pixels are as in `render_model` or zero, by tiles. A view with an empty mask is not drawn.

    Raises InputError if the submap's files cannot be read or the backend cannot run here, ValueError for an unknown
    channel or masks that do not fit the cameras.
    """
    wanted = []
    for camera, mask in zip(cameras, masks, strict=True):
        size = (camera.intrinsics.height, camera.intrinsics.width)
        if mask.shape != size:
            raise ValueError(f"a mask has shape {mask.shape}, but its view {size}")
        wanted.append((camera, tiles_of(mask)) if mask.any() else None)
    seen = [view for view in wanted if view is not None]
    models = [model_of(scene, camera.position) for camera, _ in seen]
    splatted = channels if resolve_backend(backend) != "numba" else channels & {"rgb"}
    drawn = render_geometry_views(models, seen, channels) if splatted != channels else [RenderOutput() for _ in seen]
    if splatted:
        for view, model, (camera, tiles) in zip(drawn, models, seen, strict=True):
            colored = render_model(model, camera, splatted, tiles, backend)
            for channel in splatted:
                setattr(view, channel, getattr(colored, channel))
    found = iter(drawn)
    sizes = ((c.intrinsics.height, c.intrinsics.width) for c in cameras)
    return [_empty_output(size, channels) if w is None else next(found) for w, size in zip(wanted, sizes, strict=True)]


def model_of(scene: SceneModel | SubmapModel, position: NDArray[np.floating]) -> SubmapModel:
    """The model that renders views from `position` (3,), meters. Raises InputError if its files cannot be read."""
    return scene if isinstance(scene, SubmapModel) else scene.model_at(np.asarray(position))[1]


def _empty_output(size: tuple[int, int], channels: frozenset[str]) -> RenderOutput:
    view = RenderOutput()
    for channel in channels:
        shape = (*size, 3) if channel in ("rgb", "normal") else size
        setattr(view, channel, np.zeros(shape, np.float32))
    return view
