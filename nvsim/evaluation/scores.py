"""Score a rendered image against a frame: PSNR, SSIM, LPIPS, and the mean alpha of the Gaussians. Each is measured over
all valid pixels, over those that are not floor, and over the floor.

PSNR      of the mean squared error over the pixels of the region
SSIM      Wang et al. 2004 (11x11 Gaussian window of sigma 1.5). The map is computed on whole images and averaged over
          the region, so that the border of a mask is not an edge in either image
corrected PSNR after the render's colors were fitted to the frame's over the valid pixels, by one affine map (3 x 4,
          least squares). It ignores differences caused by the camera's automatic exposure and white balance
LPIPS     of whole images. Outside the region the render is replaced by the frame, so that they differ only inside. The
          network averages over all pixels, so the value of a region decreases with its share of the image
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Distance = Callable[[Image, Image], float]
Scores = dict[str, float]

LEAST_PIXELS = 500
"""Floor regions with fewer pixels are not scored."""


def score(
    image: Image, rendered: Image, alpha: Image, floor: Mask, valid: Mask, distance: Distance | None = None
) -> Scores:
    """Metrics of one frame. A metric is NaN if its region is missing or if there is no `distance`.

    image, rendered   (H, W, 3) float32, 0 to 1
    alpha             (H, W) float32 of the Gaussians
    floor, valid      (H, W) bool: the true floor, and the pixels that count
    distance          an LPIPS function

    Returns psnr, psnr_corrected, ssim, lpips, each also with _nonfloor and _floor; psnr_floor_constant, the PSNR of a
    floor in its single best color; alpha_floor and alpha_nonfloor, mean alpha.
    """
    rendered = np.clip(rendered, 0, 1)
    error = ((image - rendered) ** 2).mean(axis=2)
    similar = ssim_map(image, rendered)
    corrected = ((image - color_corrected(rendered, image, valid)) ** 2).mean(axis=2)
    result: Scores = {}
    for suffix, region in (("", valid), ("_nonfloor", valid & ~floor), ("_floor", valid & floor)):
        enough = int(region.sum()) >= (LEAST_PIXELS if suffix == "_floor" else 1)
        result["psnr" + suffix] = psnr(float(error[region].mean())) if enough else np.nan
        result["psnr_corrected" + suffix] = psnr(float(corrected[region].mean())) if enough else np.nan
        result["ssim" + suffix] = float(similar[region].mean()) if enough else np.nan
        result["lpips" + suffix] = np.nan
        if distance is not None and enough:
            result["lpips" + suffix] = distance(image, np.where(region[..., None], rendered, image))
        if suffix:
            result["alpha" + suffix] = float(alpha[region].mean()) if enough else np.nan
        if suffix == "_floor":
            spread = ((image[region] - image[region].mean(axis=0)) ** 2).mean() if enough else np.nan
            result["psnr_floor_constant"] = psnr(float(spread))
    return result


def color_corrected(rendered: Image, image: Image, valid: Mask) -> Image:
    """(H, W, 3) float32: `rendered` after the affine color map that best fits its valid pixels to `image`. Unchanged if
    no pixel is valid. rendered and image (H, W, 3), valid (H, W)."""
    if not valid.any():
        return rendered
    source = np.concatenate([rendered, np.ones_like(rendered[..., :1])], axis=2)
    known = source[valid].astype(np.float64)
    # The normal equations are 4 x 4. lstsq also handles an image of a single color.
    map, *_ = np.linalg.lstsq(known.T @ known, known.T @ image[valid].astype(np.float64), rcond=None)
    return np.asarray(np.clip(source @ map.astype(np.float32), 0, 1), np.float32)


def psnr(mean_square: float) -> float:
    """The PSNR in decibels of a mean squared error; NaN for NaN."""
    return float(-10 * np.log10(max(mean_square, 1e-10))) if np.isfinite(mean_square) else float("nan")


def ssim_map(a: Image, b: Image) -> Image:
    """(H, W) float32 structural similarity of images (H, W, 3), 0 to 1, mean over the channels."""

    def blur(x: Image) -> Image:
        return np.asarray(cv2.GaussianBlur(x, (11, 11), 1.5), np.float32)

    c1, c2 = 0.01**2, 0.03**2
    ma, mb = blur(a), blur(b)
    va, vb, vab = blur(a * a) - ma * ma, blur(b * b) - mb * mb, blur(a * b) - ma * mb
    index = (2 * ma * mb + c1) * (2 * vab + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
    return np.asarray(index.mean(axis=2), np.float32)


def mean_scores(rows: Iterable[Mapping[str, float]]) -> dict[str, float | None]:
    """The mean of every metric over the rows that have it; None if no row has it."""
    rows = list(rows)
    names = dict.fromkeys(name for row in rows for name in row)
    result: dict[str, float | None] = {}
    for name in names:
        finite = [row[name] for row in rows if np.isfinite(row.get(name, np.nan))]
        result[name] = round(float(np.mean(finite)), 4) if finite else None
    return result


def plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """Metrics for JSON and CSV: numbers are rounded, NaN becomes None, other values are unchanged."""
    return {
        k: (round(v, 4) if np.isfinite(v) else None) if isinstance(v, float | np.floating) else v
        for k, v in row.items()
    }
