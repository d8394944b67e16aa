"""Where the builder's views come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.sphere import Sphere
from nvsim.perception.roles import SurfaceNormals
from nvsim.render.types import RenderOutput
from nvsim.splats.types import Gaussians


class ViewSource(Protocol):
    """The ensemble of submap models, or another source of views."""

    def views(
        self,
        position: NDArray[np.floating],
        cameras: Sequence[Camera],
        masks: Sequence[NDArray[np.bool_]],
    ) -> tuple[int, list[RenderOutput]]:
        """The submap that renders `position` (3,) and a view with alpha and normal for every camera, with depth where
        the criterion of that name asks, and with colours where a network of normals looks at them. Each view needs to
        be right where its mask (H, W) is true only."""
        ...


@runtime_checkable
class Panoramas(ViewSource, Protocol):
    """A source that renders panoramas as well."""

    def panorama(self, sphere: Sphere, mask: NDArray[np.bool_], submap: int | None = None) -> tuple[int, RenderOutput]:
        """As `views`, one equirectangular image whose depth is the distance along the ray; with `submap` from the model
        of that one."""
        ...


@runtime_checkable
class SeesNormals(Protocol):
    """A source with a network that tells normals from the colours of its views."""

    @property
    def surface_normals(self) -> SurfaceNormals:
        """Raises InputError where none is installed."""
        ...


@runtime_checkable
class Ensemble(ViewSource, Protocol):
    """A source of which single models can be asked: for a second opinion, and for the slice."""

    def another(self, position: NDArray[np.floating]) -> int | None:
        """Besides the submap that renders `position` (3,), the nearest that was trained on the same place; None where
        there is none."""
        ...

    def trained_at(self, submap: int, positions: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(N,) whether the model of a submap was trained on the places `positions` (N, 3)."""
        ...

    def views_of(
        self, submap: int, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> list[RenderOutput]:
        """As `views`, from the model of one submap."""
        ...

    def gaussians(self, submap: int) -> Gaussians:
        """The Gaussians of a submap's model."""
        ...
