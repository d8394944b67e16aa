"""Where the builder's views come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.types import RenderOutput


class ViewSource(Protocol):
    """The ensemble of submap models, or another source of views."""

    def views(
        self,
        position: NDArray[np.floating],
        cameras: Sequence[Camera],
        masks: Sequence[NDArray[np.bool_]],
    ) -> tuple[int, list[RenderOutput]]:
        """The submap that renders `position` (3,) and a view with alpha and normal for every camera. Each view needs to
        be right where its mask (H, W) is true only."""
        ...
