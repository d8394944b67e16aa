"""Panoramas of a submap model or of the scene from any place: six cube faces or one equirectangular image, and their
files.

Headings are those of the repository and of Matterport3DSimulator: 0 is +y, positive turns right. All views of one
panorama show one submap, the nearest to the place.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.geometry.directions import cube
from nvsim.render.backends import Backend, RenderOutput, expected_depth, resolve_backend
from nvsim.render.equirectangular import axes_ahead, half_angles, pixels_seen, resample, tiles_seen, views_around
from nvsim.render.geometry_views import render_geometry_views
from nvsim.render.model import render_model
from nvsim.render.scene import model_of
from nvsim.render.workspace import LOCK, tiles_of
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
    """The views of `camera_rig.cube` from `position` (3,), meters, in its order; depth is along the optical axis of
    each face.

    Raises InputError if the submap's files cannot be read or the backend cannot run here, ValueError for an unknown
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
    """The whole sphere around `position` (3,), meters. Columns are headings, increasing to the right, with `heading`
    (radians) in the middle of the image and -180 degrees at its left edge. Rows are elevations from +90 degrees down to
    -90. For square pixels the width is twice the height.

    The channels are those of RenderOutput, except that depth is the distance along the ray in meters. The image is
    filtered from narrow views with a higher resolution (see nvsim.render.equirectangular). With `mask` (H, W), only its
    pixels are drawn, and the others are zero.

    Raises InputError if the submap's files cannot be read or the backend cannot run here, ValueError for an unknown
    channel.
    """
    # The depth of a pixel with several surfaces is the mean weighted by alpha: resample both, and divide afterward.
    needed = channels | {"alpha"} if "depth" in channels else channels
    cameras, model = views_around(position, width, heading), model_of(scene, position)
    if mask is None:
        wanted = np.ones((height, width), bool)
        tiles = tiles_seen(width, height)
    else:
        wanted = np.require(mask, bool, ["C", "A", "W"])
        tiles = tuple(map(tiles_of, pixels_seen(width, height, wanted)))
    side, lengths = cameras[0].intrinsics.width, cameras[0].intrinsics.ray_lengths()
    parts = [bool(needed & {"rgb", "alpha"}), bool(needed & {"depth", "normal"})]
    colors, shapes = (np.zeros((len(cameras) * part, side, side, 4), np.float32) for part in parts)
    wanted_views = list(zip(cameras, tiles, strict=True))
    if "rgb" in needed or resolve_backend(backend) != "numba":
        views: Iterable[RenderOutput] = (
            render_model(model, camera, needed, of, backend) for camera, of in wanted_views
        )
    else:
        views = render_geometry_views([model] * len(cameras), wanted_views, needed)
    for i, view in enumerate(views):
        if view.rgb is not None:
            colors[i, ..., :3] = view.rgb
        if view.alpha is not None:
            colors[i, ..., 3] = view.alpha
        if view.normal is not None:
            shapes[i, ..., :3] = view.normal
        if view.depth is not None and view.alpha is not None:
            shapes[i, ..., 3] = view.depth * view.alpha * lengths
    images = [np.empty((height * part, width, 4), np.float32) for part in parts]
    focal, angles = np.float32(cameras[0].intrinsics.fx), half_angles(width, height)
    with LOCK:
        resample(colors, shapes, axes_ahead(), focal, *angles, wanted, *images)
    result = RenderOutput()
    if "rgb" in channels:
        result.rgb = np.ascontiguousarray(images[0][..., :3])
    if "alpha" in channels:
        result.alpha = np.ascontiguousarray(images[0][..., 3])
    if "normal" in channels:
        result.normal = np.ascontiguousarray(images[1][..., :3])
    if "depth" in channels:
        result.depth = expected_depth(images[1][..., 3], images[0][..., 3])
    return result


_JPEG = (".jpg", ".jpeg")


def write_panorama(path: Path, image: RenderOutput, unseen: NDArray[np.bool_] | None = None) -> list[Path]:
    """Writes rgb (H, W, 3) to `path` (.jpg or .png), and the other channels that `image` has to files beside it:

    NAME_alpha.png   8 bits, 0 to 1
    NAME_depth.png   16 bits, millimeters, 65.535 m at most, 0 if there is none
    NAME_normal.png  8 bits, red is x, green y, blue z, each from -1 to 1
    NAME_unseen.png  8 bits, 255 where `unseen` (H, W) is True, which means that no training image shows the surface

    JPEG files have no chroma subsampling, which would bleed over the borders of a strip of faces.

    Returns the written paths. Raises InputError for another suffix, and if a file cannot be written.
    """
    if path.suffix.lower() not in (*_JPEG, ".png"):
        raise InputError(f"{path} is not the name of an image file; give it the suffix .jpg or .png.")
    written: list[Path] = []
    if image.rgb is not None:
        _write(path, _bytes(image.rgb)[..., ::-1])
        written.append(path)
    others: dict[str, NDArray[np.generic]] = {}
    if image.alpha is not None:
        others["alpha"] = _bytes(image.alpha)
    if image.depth is not None:
        others["depth"] = np.round(np.clip(image.depth * 1000, 0, 65535)).astype(np.uint16)
    if image.normal is not None:
        others["normal"] = _bytes(image.normal / 2 + 0.5)[..., ::-1]
    if unseen is not None:
        others["unseen"] = np.where(unseen, 255, 0).astype(np.uint8)
    for name, pixels in others.items():
        beside = path.with_name(f"{path.stem}_{name}.png")
        _write(beside, pixels)
        written.append(beside)
    return written


def _bytes(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.round(np.clip(values, 0, 1) * 255).astype(np.uint8)


def _write(path: Path, pixels: NDArray[np.generic]) -> None:
    import cv2

    options: list[int] = []
    if path.suffix.lower() in _JPEG:
        subsampling = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        options = [cv2.IMWRITE_JPEG_QUALITY, 95, *subsampling]
    encoded = cv2.imencode(path.suffix, np.ascontiguousarray(pixels), options)[1]
    atomic.write_bytes(path, encoded.tobytes())
