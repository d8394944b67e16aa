"""Interfaces for sources of the builder's views."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.directions import Sphere
from nvsim.perception.roles import SurfaceNormals
from nvsim.render.types import RenderOutput
from nvsim.splats.types import Gaussians


class ViewSource(Protocol):
    """A source of rendered views, such as the ensemble of submap models."""

    def views(
        self,
        position: NDArray[np.floating],
        cameras: Sequence[Camera],
        masks: Sequence[NDArray[np.bool_]],
    ) -> tuple[int, list[RenderOutput]]:
        """Return the submap that renders `position` (3,), meters, and a view for every camera. Views have alpha and
        normals, depth if the criterion depth is used, and colors if a network needs them. A view must be valid where
        its mask (H, W) is true."""
        ...


@runtime_checkable
class Panoramas(ViewSource, Protocol):
    """A source that can also render panoramas."""

    def panorama(self, sphere: Sphere, mask: NDArray[np.bool_], submap: int | None = None) -> tuple[int, RenderOutput]:
        """Render one equirectangular image (H, W) as `views` does. Its depth is the distance along the ray, and it must
        be valid where `mask` (H, W) is true. `submap` selects the model."""
        ...


@runtime_checkable
class SeesNormals(Protocol):
    """A source with a network that predicts normals from the colors of its views."""

    @property
    def surface_normals(self) -> SurfaceNormals:
        """The network. Raises InputError if none is installed."""
        ...


@runtime_checkable
class Ensemble(ViewSource, Protocol):
    """A source of which single models can be used, for second opinions and for the slice."""

    def another(self, position: NDArray[np.floating]) -> int | None:
        """Return the nearest other submap that was also trained at `position` (3,), meters, besides the one that
        renders it. None if there is none."""
        ...

    def trained_at(self, submap: int, positions: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return (N,) bool: whether the model of a submap was trained at `positions` (N, 3), meters."""
        ...

    def views_of(
        self, submap: int, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> list[RenderOutput]:
        """Render views as `views` does, from the model of one submap; masks are (H, W)."""
        ...

    def gaussians(self, submap: int) -> Gaussians:
        """The Gaussians of a submap's model."""
        ...
