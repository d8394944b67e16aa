"""The scores of a rendered image against a frame: PSNR, SSIM and LPIPS over all pixels that count, over those that
are not floor, and over the floor; and how opaque the Gaussians are there.

PSNR      of the mean squared error over the pixels of the region
SSIM      Wang et al. 2004 (11x11 Gaussian window of sigma 1.5): its map is made of whole images and averaged over the
          region, so that the border of a mask is no edge in either image
corrected PSNR after the render's colours were fitted to the frame's over the pixels that count, by the one affine map
          (3 x 4) of least squares: what is left when a camera that meters as it goes is forgiven
LPIPS     of whole images; outside the region the render is replaced by the frame itself, so that it differs nowhere
          else. The network averages over all pixels: the figure of a region falls with its share of the image
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
"""Fewer pixels than this say nothing about a floor."""
REGIONS = {"": "with floor", "_nonfloor": "without floor", "_floor": "floor only"}
"""Suffix of a figure's name -> what a reader calls the region."""


def score(
    image: Image, rendered: Image, alpha: Image, floor: Mask, valid: Mask, distance: Distance | None = None
) -> Scores:
    """The figures of one frame; NaN where a region is missing or there is no `distance`.

    image, rendered   (H, W, 3) float32 in 0 to 1
    alpha             (H, W) of the Gaussians
    floor, valid      (H, W): the true floor, and the pixels that count

    psnr, psnr_corrected, ssim, lpips, each also with _nonfloor and _floor; psnr_floor_constant, what a floor of its one
    best colour would get; alpha_floor and alpha_nonfloor, mean alpha.
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
    """(H, W, 3) `rendered` under the affine map of colours that brings its valid pixels nearest to `image`; as it is
    when no pixel is valid."""
    if not valid.any():
        return rendered
    source = np.concatenate([rendered, np.ones_like(rendered[..., :1])], axis=2)
    known = source[valid].astype(np.float64)
    # The normal equations are 4 x 4; lstsq forgives an image of one colour.
    map, *_ = np.linalg.lstsq(known.T @ known, known.T @ image[valid].astype(np.float64), rcond=None)
    return np.asarray(np.clip(source @ map.astype(np.float32), 0, 1), np.float32)


def psnr(mean_square: float) -> float:
    """The PSNR in decibels of a mean squared error; NaN where that is NaN."""
    return float(-10 * np.log10(max(mean_square, 1e-10))) if np.isfinite(mean_square) else float("nan")


def ssim_map(a: Image, b: Image) -> Image:
    """(H, W) structural similarity of images (H, W, 3) in 0 to 1, mean over the channels."""

    def blur(x: Image) -> Image:
        return np.asarray(cv2.GaussianBlur(x, (11, 11), 1.5), np.float32)

    c1, c2 = 0.01**2, 0.03**2
    ma, mb = blur(a), blur(b)
    va, vb, vab = blur(a * a) - ma * ma, blur(b * b) - mb * mb, blur(a * b) - ma * mb
    index = (2 * ma * mb + c1) * (2 * vab + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
    return np.asarray(index.mean(axis=2), np.float32)


def mean_scores(rows: Iterable[Mapping[str, float]]) -> dict[str, float | None]:
    """The mean of every figure over the rows that have it; None where none has."""
    rows = list(rows)
    names = dict.fromkeys(name for row in rows for name in row)
    result: dict[str, float | None] = {}
    for name in names:
        finite = [row[name] for row in rows if np.isfinite(row.get(name, np.nan))]
        result[name] = round(float(np.mean(finite)), 4) if finite else None
    return result


def plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """Figures for JSON and CSV: rounded, None for NaN; other values as they are."""
    return {
        k: (round(v, 4) if np.isfinite(v) else None) if isinstance(v, float | np.floating) else v
        for k, v in row.items()
    }
