"""Views of which only some pixels are wanted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.backends import Backend
from nvsim.render.model import render_model
from nvsim.render.types import RenderOutput
from nvsim.render.workspace import tiles_of
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import SubmapModel


def render_regions(
    scene: SceneModel | SubmapModel,
    cameras: Sequence[Camera],
    masks: Sequence[NDArray[np.bool_]],
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
    backend: Backend = "auto",
) -> list[RenderOutput]:
    """A view for each camera that is, where its mask (H, W) is true, what `render_model` gives there to the last bit;
    the rest is as that or zero, by tiles. A view whose mask is empty is not drawn at all.

    Raises InputError when the submap's files cannot be read or the backend cannot run here, ValueError for an unknown
    channel or masks that do not fit the cameras.
    """
    views = []
    for camera, mask in zip(cameras, masks, strict=True):
        size = (camera.intrinsics.height, camera.intrinsics.width)
        if mask.shape != size:
            raise ValueError(f"a mask of {mask.shape} for a view of {size}")
        if mask.any():
            views.append(render_model(model_of(scene, camera.position), camera, channels, tiles_of(mask), backend))
        else:
            views.append(_nothing(size, channels))
    return views


def model_of(scene: SceneModel | SubmapModel, position: NDArray[np.floating]) -> SubmapModel:
    """The model that draws from `position` (3,). Raises InputError when its files cannot be read."""
    return scene if isinstance(scene, SubmapModel) else scene.model_at(np.asarray(position))[1]


def _nothing(size: tuple[int, int], channels: frozenset[str]) -> RenderOutput:
    view = RenderOutput()
    for channel in channels:
        shape = (*size, 3) if channel in ("rgb", "normal") else size
        setattr(view, channel, np.zeros(shape, np.float32))
    return view
