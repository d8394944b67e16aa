"""Panoramas of a submap model or of the scene from any place: six cube faces, or one equirectangular image.

Headings are those of the repository and of Matterport3DSimulator: 0 is +y, positive turns right. All views of one
panorama are of one submap, the nearest to the place.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.render.backends import Backend
from nvsim.render.equirectangular import face_intrinsics, half_angles, resample
from nvsim.render.model import render_model
from nvsim.render.types import Float32, RenderOutput, expected_depth
from nvsim.render.workspace import LOCK
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import SubmapModel

RGB_ALPHA = frozenset({"rgb", "alpha"})
_RIGHT = math.pi / 2


def ring(
    position: NDArray[np.floating],
    count: int,
    elevation: float = 0.0,
    size: tuple[int, int] = (640, 480),
    hfov: float = math.radians(60),
    offset: float = 0.0,
) -> list[Camera]:
    """`count` level cameras at `position` (3,) at equal steps of heading, clockwise seen from above.

    The first looks along heading `offset` (radians, 0 is +y), all at `elevation` (radians, positive up); `size` is
    width and height in pixels, `hfov` the horizontal field of view in radians.
    """
    intrinsics = Intrinsics.from_fov(size[0], size[1], hfov)
    headings = offset + 2 * math.pi * np.arange(count) / count
    return [Camera(intrinsics, look(np.asarray(position, np.float64), h, elevation)) for h in headings]


def cube(position: NDArray[np.floating], side: int, offset: float = 0.0) -> list[Camera]:
    """Six views of 90 degrees and `side` x `side` pixels: up, the four headings from `offset` on clockwise, down. The
    faces of up and down have heading `offset` at their lower and upper edge."""
    return _cube(position, Intrinsics.from_fov(side, side, _RIGHT), offset)


def _cube(position: NDArray[np.floating], intrinsics: Intrinsics, offset: float) -> list[Camera]:
    at = np.asarray(position, np.float64)
    turns = [(offset, _RIGHT), *((offset + k * _RIGHT, 0.0) for k in range(4)), (offset, -_RIGHT)]
    return [Camera(intrinsics, look(at, heading, elevation)) for heading, elevation in turns]


def render_cube(
    scene: SceneModel | SubmapModel,
    position: NDArray[np.floating],
    side: int,
    channels: frozenset[str] = RGB_ALPHA,
    heading: float = 0.0,
    backend: Backend = "auto",
) -> list[RenderOutput]:
    """The views of `cube` from `position` (3,), in its order; depth is along the optical axis of each face.

    Raises InputError when the submap's files cannot be read or the backend cannot run here, ValueError for an unknown
    channel.
    """
    model = model_of(scene, position)
    return [render_model(model, camera, channels, backend=backend) for camera in cube(position, side, heading)]


def skybox(faces: list[NDArray[np.generic]]) -> NDArray[np.generic]:
    """Six square images (S, S, ...) in the order of `cube` as one strip (S, 6 S, ...), in the order and orientation of
    Matterport's skyboxes for a viewpoint whose pose looks along the cube's heading: up, back, left, front, right, down,
    where the lower edge of up and the upper edge of down touch the back."""
    up, front, right, back, left, down = faces
    return np.concatenate([np.rot90(up, 2), back, left, front, right, np.rot90(down, 2)], axis=1)


def render_equirectangular(
    scene: SceneModel | SubmapModel,
    position: NDArray[np.floating],
    width: int,
    height: int,
    channels: frozenset[str] = RGB_ALPHA,
    heading: float = 0.0,
    backend: Backend = "auto",
) -> RenderOutput:
    """The whole sphere around `position` (3,): columns are headings, growing to the right, with `heading` (radians) in
    the middle of the image and -180 degrees at its left edge; rows are elevations from +90 degrees down to -90. For
    square pixels the width is twice the height.

    As RenderOutput, except that depth is the distance along the ray, in metres. Filtered from six faces that are drawn
    finer than the panorama (see nvsim.render.equirectangular).

    Raises InputError when the submap's files cannot be read or the backend cannot run here, ValueError for an unknown
    channel.
    """
    model = model_of(scene, position)
    # What a pixel of several things shows is the mean weighted by alpha, so both are resampled and divided after.
    wanted = channels | {"alpha"} if "depth" in channels else channels
    cameras = _cube(position, face_intrinsics(width), heading)
    outputs = [render_model(model, camera, wanted, backend=backend) for camera in cameras]
    result = RenderOutput()
    if wanted & {"rgb", "alpha"}:
        colours = _resampled([_stacked(o.rgb, o.alpha) for o in outputs], cameras[0], width, height)
        result.rgb = np.ascontiguousarray(colours[..., :3]) if "rgb" in channels else None
        alpha = np.ascontiguousarray(colours[..., 3])
        result.alpha = alpha if "alpha" in channels else None
    if channels & {"depth", "normal"}:
        lengths = _ray_lengths(cameras[0])
        along = [None if o.depth is None or o.alpha is None else o.depth * o.alpha * lengths for o in outputs]
        shapes = _resampled([_stacked(o.normal, d) for o, d in zip(outputs, along)], cameras[0], width, height)
        result.normal = np.ascontiguousarray(shapes[..., :3]) if "normal" in channels else None
        result.depth = expected_depth(shapes[..., 3], alpha) if "depth" in channels else None
    return result


def model_of(scene: SceneModel | SubmapModel, position: NDArray[np.floating]) -> SubmapModel:
    """The model that draws from `position` (3,). Raises InputError when its files cannot be read."""
    return scene if isinstance(scene, SubmapModel) else scene.model_at(np.asarray(position))[1]


def _stacked(three: Float32 | None, one: Float32 | None) -> Float32:
    """(S, S, 4); zeros for what was not asked for."""
    shape = three.shape[:2] if three is not None else one.shape if one is not None else ()
    stack = np.zeros((*shape, 4), np.float32)
    if three is not None:
        stack[..., :3] = three
    if one is not None:
        stack[..., 3] = one
    return stack


def _ray_lengths(camera: Camera) -> Float32:
    """(H, W) metres along the ray for each metre along the optical axis."""
    k = camera.intrinsics
    u, v = (np.arange(k.width) + 0.5 - k.cx) / k.fx, (np.arange(k.height) + 0.5 - k.cy) / k.fy
    return np.sqrt(1 + u[None, :] ** 2 + v[:, None] ** 2).astype(np.float32)


def _resampled(faces: list[Float32], camera: Camera, width: int, height: int) -> Float32:
    image = np.empty((height, width, 4), np.float32)
    azimuths, elevations = half_angles(width, height)
    with LOCK:
        resample(np.stack(faces), np.float32(camera.intrinsics.fx), azimuths, elevations, image)
    return image
