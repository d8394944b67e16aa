"""The alpha loss of Splatfacto-W, which the paper drops: it removes Gaussians from pixels that the background explains.

    L_alpha = mean over all pixels of E * alpha,   E: |background - image| < 0.003 in most of the 3x3 pixels around

Splatfacto-W averages over E alone; this implementation averages over the image, like every other term. For the
ablation.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

EXPLAINED = 0.003
"""Mean difference of the channels below which the background explains a pixel; colors are 0 to 1."""
MAJORITY = 0.6
Float32 = NDArray[np.float32]


def alpha_loss(
    alpha: Float32,
    background: Float32,
    image: NDArray[np.uint8],
    weight: float,
    d_alpha: Float32,
    usable: NDArray[np.bool_] | None = None,
) -> float:
    """The weighted term for `alpha` (H, W), `background` (3, H, W), and `image` (H, W, 3), over the pixels `usable`
    (H, W), None for all. Adds its gradient to `d_alpha` (H, W)."""
    off = np.abs(background - image.transpose(2, 0, 1) * np.float32(1 / 255)).mean(axis=0)
    around = cv2.blur((off < EXPLAINED).astype(np.float32), (3, 3), borderType=cv2.BORDER_CONSTANT)
    explained = around > MAJORITY
    if usable is not None:
        explained &= usable
    each = np.float32(weight / alpha.size)
    d_alpha[explained] += each
    return float(each * alpha[explained].sum())
