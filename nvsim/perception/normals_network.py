"""The surface normal role, filled by a network that the user adds."""

from __future__ import annotations

from functools import partial
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, level_of
from nvsim.networks.chain import Chain
from nvsim.networks.description import Direction, NormalsResult
from nvsim.networks.folder import models_folder
from nvsim.networks.installed import InstalledModel, find_model
from nvsim.perception.roles import Float32, Image
from nvsim.perception.semantic_network import placed_rays

_SIGNS: dict[Direction, tuple[int, int]] = {
    "right": (0, 1), "left": (0, -1), "down": (1, 1), "up": (1, -1), "forward": (2, 1), "backward": (2, -1),
}  # fmt: skip
"""Direction -> axis of the camera (0 is x right, 1 is y down, 2 is z forward) and its sign."""
_TURNED = 0.2
"""Least mean of normal times ray at which normals point away from the camera. For visible surfaces it is below 0."""
assert set(_SIGNS) == set(get_args(Direction))


class NormalsNetwork:
    """A SurfaceNormals from an opened model, for images of any size."""

    def __init__(self, chain: Chain) -> None:
        assert isinstance(chain.description.result, NormalsResult)
        self._chain, self._result = chain, chain.description.result
        self._is_checked = False

    @property
    def takes_rays(self) -> bool:
        """Whether the network needs the rays of the camera, and therefore cannot process panoramas."""
        return self._chain.takes_rays

    def normals(self, image: Image, camera: Camera) -> Float32:
        """World normals (H, W, 3), see SurfaceNormals. Raises InputError if the normals of the first image point away
        from the camera."""
        found = self.camera_normals(image, camera)
        if not self._is_checked:
            self._check(found, camera)
            self._is_checked = True
        return np.asarray(found @ camera.rotation.T.astype(np.float32), np.float32)

    def camera_normals(self, image: Image, camera: Camera | None = None) -> Float32:
        """(H, W, 3) float32, unit length, in the camera's frame (x right, y down, z forward), toward the camera. Zero
        where the network finds no surface. `image` is (H, W, 3) uint8 RGB. Raises InputError without a camera if the
        network needs its rays."""
        shown = self._chain.show(image, None if camera is None else partial(placed_rays, camera))
        place, said = shown.placements[self._result.image], self._result
        planes = self._planes(self._chain.value(shown.values, said.value))
        if said.halved:
            planes = 2 * planes - 1
        turned = np.empty_like(planes)
        for plane, direction in zip(planes, said.axes, strict=True):
            axis, sign = _SIGNS[direction]
            turned[axis] = sign * plane
        normals = np.moveaxis(place.to_image_size(turned), 0, -1)
        if said.frame == "level" and camera is not None:
            normals = np.asarray(normals @ (level_of(camera) @ camera.rotation).astype(np.float32))
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        found = np.where(length > 1e-3, normals / np.maximum(length, 1e-3), 0).astype(np.float32)
        if said.there and said.there in shown.values:
            there = self._chain.value(shown.values, said.there)
            found[place.to_image_size(there.reshape(there.shape[-2:])) < said.least] = 0
        return found

    def _planes(self, found: NDArray[np.float32]) -> NDArray[np.float32]:
        """(3, h, w) without a fourth plane, which is a confidence. Raises InputError for another number of planes."""
        single = found[0] if found.ndim == 4 and len(found) == 1 else found
        planes = np.moveaxis(single, -1, 0) if self._result.channels_last else single
        if single.ndim != 3 or len(planes) not in (3, 4):
            path = next(iter(self._chain.paths.values()))
            raise InputError(
                f"{path} gives no normals (three or four values per pixel), but the shape {list(found.shape)}; correct "
                "the layout in its description, or export the normals too."
            )
        return planes[:3]

    def _check(self, found: Float32, camera: Camera) -> None:
        height, width = found.shape[:2]
        rays = camera.scaled(width, height).rays() @ camera.rotation  # in the camera's frame
        there = found.any(axis=-1)
        if not there.any():
            return
        facing = float(np.mean(np.sum(found * rays, axis=-1)[there]))
        if facing > _TURNED:
            path = next(iter(self._chain.paths.values()))
            raise InputError(
                f"{path}: the normals of the first image point away from the camera (normal times ray is {facing:.2f} "
                "on average, and should be below 0); reverse the axes in its description."
            )


def normals_model(name: str = "") -> InstalledModel | None:
    """The user's model of normals with this name, or the first one; None if there is none."""
    return find_model("normals", name)


def installed_normals(name: str = "") -> NormalsNetwork:
    """The user's model of normals, opened. Raises InputError if it is missing or not valid."""
    model = normals_model(name)
    if model is None:
        raise InputError(
            f"No network of surface normals is installed; add one to {models_folder()} (`nvsim models add`, or as "
            "normals.onnx), or use the normals of the Gaussians (--normal-source gaussians)."
        )
    return NormalsNetwork(model.open())
