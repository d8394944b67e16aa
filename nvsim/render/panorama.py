"""Panoramas of a submap model or of the scene from any place: six cube faces, or one equirectangular image.

Headings are those of the repository and of Matterport3DSimulator: 0 is +y, positive turns right. All views of one
panorama are of one submap, the nearest to the place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.around import cube, cube_of
from nvsim.render.backends import Backend
from nvsim.render.equirectangular import face_intrinsics, half_angles, mark_seen, resample
from nvsim.render.model import render_model
from nvsim.render.regions import model_of, render_regions
from nvsim.render.types import Float32, RenderOutput, expected_depth
from nvsim.render.workspace import LOCK
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import SubmapModel

RGB_ALPHA = frozenset({"rgb", "alpha"})


def render_cube(
    scene: SceneModel | SubmapModel,
    position: NDArray[np.floating],
    side: int,
    channels: frozenset[str] = RGB_ALPHA,
    heading: float = 0.0,
    backend: Backend = "auto",
) -> list[RenderOutput]:
    """The views of `around.cube` from `position` (3,), in its order; depth is along the optical axis of each face.

    Raises InputError when the submap's files cannot be read or the backend cannot run here, ValueError for an unknown
    channel.
    """
    model = model_of(scene, position)
    return [render_model(model, camera, channels, backend=backend) for camera in cube(position, side, heading)]


def render_equirectangular(
    scene: SceneModel | SubmapModel,
    position: NDArray[np.floating],
    width: int,
    height: int,
    channels: frozenset[str] = RGB_ALPHA,
    heading: float = 0.0,
    backend: Backend = "auto",
    mask: NDArray[np.bool_] | None = None,
) -> RenderOutput:
    """The whole sphere around `position` (3,): columns are headings, growing to the right, with `heading` (radians) in
    the middle of the image and -180 degrees at its left edge; rows are elevations from +90 degrees down to -90. For
    square pixels the width is twice the height.

    As RenderOutput, except that depth is the distance along the ray, in metres. Filtered from six faces that are drawn
    finer than the panorama (see nvsim.render.equirectangular). With `mask` (H, W) only its pixels are drawn, and the
    others are zero.

    Raises InputError when the submap's files cannot be read or the backend cannot run here, ValueError for an unknown
    channel.
    """
    # What a pixel of several things shows is the mean weighted by alpha, so both are resampled and divided after.
    needed = channels | {"alpha"} if "depth" in channels else channels
    cameras = cube_of(position, face_intrinsics(width), heading)
    side, focal = cameras[0].intrinsics.width, np.float32(cameras[0].intrinsics.fx)
    angles = half_angles(width, height)
    model = model_of(scene, position)
    if mask is None:
        wanted = np.ones((height, width), bool)
        outputs = [render_model(model, camera, needed, backend=backend) for camera in cameras]
    else:
        wanted = np.require(mask, bool, ["C", "A", "W"])
        seen = np.zeros((6, side, side), bool)
        mark_seen(focal, *angles, wanted, seen)
        outputs = render_regions(model, cameras, list(seen), needed, backend)

    def resampled(stacked: Float32) -> Float32:
        image = np.empty((height, width, 4), np.float32)
        with LOCK:
            resample(stacked, focal, *angles, wanted, image)
        return image

    result = RenderOutput()
    if needed & {"rgb", "alpha"}:
        colours = resampled(_stacked([o.rgb for o in outputs], [o.alpha for o in outputs], side))
        alpha = np.ascontiguousarray(colours[..., 3])
        result.rgb = np.ascontiguousarray(colours[..., :3]) if "rgb" in channels else None
        result.alpha = alpha if "alpha" in channels else None
    if channels & {"depth", "normal"}:
        lengths = _ray_lengths(cameras[0])
        along = [None if o.depth is None or o.alpha is None else o.depth * o.alpha * lengths for o in outputs]
        shapes = resampled(_stacked([o.normal for o in outputs], along, side))
        result.normal = np.ascontiguousarray(shapes[..., :3]) if "normal" in channels else None
        result.depth = expected_depth(shapes[..., 3], alpha) if "depth" in channels else None
    return result


def _stacked(three: list[Float32 | None], one: list[Float32 | None], side: int) -> Float32:
    """(6, S, S, 4); zeros for what was not asked for."""
    stack = np.zeros((6, side, side, 4), np.float32)
    for face, first, last in zip(stack, three, one, strict=True):
        if first is not None:
            face[..., :3] = first
        if last is not None:
            face[..., 3] = last
    return stack


def _ray_lengths(camera: Camera) -> Float32:
    """(H, W) metres along the ray for each metre along the optical axis."""
    k = camera.intrinsics
    u, v = (np.arange(k.width) + 0.5 - k.cx) / k.fx, (np.arange(k.height) + 0.5 - k.cy) / k.fy
    return np.sqrt(1 + u[None, :] ** 2 + v[:, None] ** 2).astype(np.float32)
