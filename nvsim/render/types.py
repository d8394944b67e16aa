"""The output that all backends share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nvsim.render.kernel_types import Float32


@dataclass(eq=False)
class RenderOutput:
    """A view. A channel that was not requested is None.

    rgb        (H, W, 3) float32, not clamped: Gaussians over the background, if there is one
    alpha      (H, W) float32, accumulated opacity of the Gaussians alone, 0 to 1
    depth      (H, W) float32, meters along the optical axis, alpha-weighted mean of the Gaussians' depths divided by
               alpha; 0 where alpha < 1e-3
    normal     (H, W, 3) float32, world, toward the camera: sum of weight * (the Gaussian's shortest axis); length <= 1
    """

    rgb: Float32 | None = None
    alpha: Float32 | None = None
    depth: Float32 | None = None
    normal: Float32 | None = None


ALPHA_OF_DEPTH = np.float32(1e-3)
"""Alpha below which a pixel has no depth."""


def expected_depth(weighted: Float32, alpha: Float32) -> Float32:
    """Weighted sum of depths over alpha, 0 where alpha is below ALPHA_OF_DEPTH; all (H, W)."""
    mean = weighted / np.maximum(alpha, ALPHA_OF_DEPTH)
    return np.where(alpha < ALPHA_OF_DEPTH, np.float32(0), mean)
