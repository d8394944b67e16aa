"""Renders the ensemble of submap models: the model nearest to the camera renders it (paper Algorithm 1, line 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.backends import Backend
from nvsim.render.model import render_model
from nvsim.render.types import RenderOutput
from nvsim.splats.scene import SceneModel


def render_scene(
    scene: SceneModel,
    camera: Camera,
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
    tiles: NDArray[np.bool_] | None = None,
    backend: Backend = "auto",
) -> tuple[int, RenderOutput]:
    """The index of the submap that rendered the view, and the view; only the given `tiles` (lines, columns) of it, as
    in `render_gaussians`.

    Raises InputError if that submap's files cannot be read or the backend cannot run here, ValueError for an unknown
    channel.
    """
    index, model = scene.model_at(camera.position)
    return index, render_model(model, camera, channels, tiles, backend)
