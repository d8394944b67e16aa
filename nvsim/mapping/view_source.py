"""Where the builder's views come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
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
        """The submap that renders `position` (3,) and a view with alpha and normal for every camera, and with depth
        where the criterion of that name asks. Each view needs to be right where its mask (H, W) is true only."""
        ...


@runtime_checkable
class Ensemble(ViewSource, Protocol):
    """A source of which single models can be asked: for a second opinion, and for the slice."""

    def another(self, position: NDArray[np.floating]) -> int | None:
        """Besides the submap that renders `position` (3,), the nearest that was trained on the same place; None where
        there is none."""
        ...

    def views_of(
        self, submap: int, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> list[RenderOutput]:
        """As `views`, from the model of one submap."""
        ...

    def gaussians(self, submap: int) -> Gaussians:
        """The Gaussians of a submap's model."""
        ...
