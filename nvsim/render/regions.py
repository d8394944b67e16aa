"""Views of which only some pixels are wanted."""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.backends import Backend, chosen
from nvsim.render.gaussians import render_over
from nvsim.render.model import render_model
from nvsim.render.nearby import Nearby, uncoloured
from nvsim.render.types import RenderOutput
from nvsim.render.workspace import tiles_of
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import Gaussians, SubmapModel

_nearby: WeakKeyDictionary[Gaussians, Nearby] = WeakKeyDictionary()


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
            views.append(_view(model_of(scene, camera.position), camera, channels, tiles_of(mask), backend))
        else:
            views.append(_nothing(size, channels))
    return views


def _view(
    model: SubmapModel, camera: Camera, channels: frozenset[str], tiles: NDArray[np.bool_], backend: Backend
) -> RenderOutput:
    if "rgb" in channels or chosen(backend) != "numba":
        return render_model(model, camera, channels, tiles, backend)
    # Without colours few Gaussians count, and these do not change with the position.
    if model.gaussians not in _nearby:
        _nearby[model.gaussians] = Nearby(model.gaussians)
    gaussians = uncoloured(model.gaussians, _nearby[model.gaussians].rows(camera, tiles))
    return render_over(gaussians, camera, channels, model.antialiased, tiles, "numba")[0]


def model_of(scene: SceneModel | SubmapModel, position: NDArray[np.floating]) -> SubmapModel:
    """The model that draws from `position` (3,). Raises InputError when its files cannot be read."""
    return scene if isinstance(scene, SubmapModel) else scene.model_at(np.asarray(position))[1]


def _nothing(size: tuple[int, int], channels: frozenset[str]) -> RenderOutput:
    view = RenderOutput()
    for channel in channels:
        shape = (*size, 3) if channel in ("rgb", "normal") else size
        setattr(view, channel, np.zeros(shape, np.float32))
    return view
