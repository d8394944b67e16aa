"""Score a rendered image against a frame: PSNR, SSIM, LPIPS, and the mean alpha of the Gaussians. Each is measured over
all valid pixels, over those that are not floor, and over the floor.

PSNR      of the mean squared error over the pixels of the region
SSIM      Wang et al. 2004 (11x11 Gaussian window of sigma 1.5). The map is computed on whole images and averaged over
          the region, so that the border of a mask is not an edge in either image
corrected PSNR after the render's colors were fitted to the frame's over the valid pixels, by one affine map (3 x 4,
          least squares). It ignores differences caused by the camera's automatic exposure and white balance
LPIPS     of whole images. Outside the region the render is replaced by the frame, so that they differ only inside. The
          network averages over all pixels, so the value of a region decreases with its share of the image

LPIPS uses a network that the user provides: any ONNX export with two images as input and a distance as output. The file
contains the whole metric (Zhang et al. 2018: AlexNet or VGG features, unit-normalized, squared differences weighted and
averaged). Exports use various input names, so the inputs are passed by position.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.networks.folder import find_file, models_folder
from nvsim.networks.onnx_session import DoesNotRun, Session

Range = Literal["auto", "-1..1", "0..1"]
Image = NDArray[np.float32]
METADATA = "input_range"
"""Key of the ONNX metadata that gives the range of input values: "-1..1" or "0..1"."""
_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_MOST = 4096  # pixels of an image's side
_EQUAL = 1e-3  # a distance must be smaller than this for equal images


class Lpips:
    """An opened network. Called with two images (H, W, 3) float32, 0 to 1, it returns their distance.

    values   range of the network's input: "-1..1" as in the original, "0..1" if the export scales by itself, "auto" as
             the file's metadata `input_range` says, else "-1..1"

    Raises InputError if the file cannot be loaded or is not a distance of two images.
    """

    def __init__(self, path: Path, values: Range = "auto") -> None:
        if not path.is_file():
            raise InputError(f"There is no LPIPS model {path}; give an ONNX file with --lpips FILE.onnx.")
        self._session = Session(path)
        self.path = path
        inputs = self._session.inputs
        if len(inputs) != 2 or any(len(i.shape) != 4 or i.type not in _TYPES for i in inputs):
            found = ", ".join(f"{i.name} {i.type} {list(i.shape)}" for i in inputs)
            raise InputError(f"{path} takes {found}; LPIPS takes two float images of shape (1, 3, H, W).")
        self._inputs = inputs
        said = self._session.metadata.get(METADATA, "-1..1")
        self.values = said if values == "auto" else values
        if self.values not in ("-1..1", "0..1"):
            raise InputError(f"{path} says {METADATA} = {said!r}; it must be -1..1 or 0..1 (or use --lpips-range).")
        self._try()

    def __call__(self, a: Image, b: Image) -> float:
        """The distance of two images (H, W, 3) float32, 0 to 1. Raises InputError if the network does not accept their
        size."""
        feeds = {i.name: self._tensor(x, i.type) for i, x in zip(self._inputs, (a, b), strict=True)}
        try:
            found = self._session.run(None, feeds)[0]
        except DoesNotRun as error:
            height, width = a.shape[:2]
            raise InputError(
                f"{self.path} does not accept images of {width}x{height} pixels ({error.reason}); "
                "export it with dynamic height and width."
            ) from error
        return float(np.mean(found))

    def _tensor(self, image: Image, kind: str) -> NDArray[Any]:
        planes = np.ascontiguousarray(np.clip(image, 0, 1).transpose(2, 0, 1)[None])
        return (planes * 2 - 1 if self.values == "-1..1" else planes).astype(_TYPES[kind])

    def _try(self) -> None:
        """Checks that equal images have distance 0 and different images do not. Raises InputError."""
        height, width = (size if isinstance(size, int) else 64 for size in self._inputs[0].shape[2:])
        if not (0 < height <= _MOST and 0 < width <= _MOST):
            raise InputError(f"{self.path} takes images of {width} x {height} pixels; export it with dynamic size.")
        rng = np.random.default_rng(0)
        a, b = rng.random((2, height, width, 3), np.float32)
        same, other = self(a, a), self(a, b)
        if not (abs(same) < _EQUAL and np.isfinite(other) and other > _EQUAL):
            raise InputError(
                f"{self.path} is not an image distance: it gives {same:.3g} for equal, {other:.3g} for other images; "
                "choose an LPIPS export."
            )


def open_lpips(path: Path | None, values: Range = "auto") -> tuple[Lpips | None, str]:
    """The network at `path`, or `lpips.onnx` in the user's models folder. None and the reason if there is none.

    Raises InputError if a named file is missing or is not an LPIPS network.
    """
    found = path or find_file("lpips")
    if found is None:
        return None, f"no LPIPS model: give --lpips FILE.onnx (or copy lpips.onnx into {models_folder()})"
    return Lpips(found, values), ""


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


def rounded_metrics(row: Mapping[str, Any]) -> dict[str, Any]:
    """Metrics for JSON and CSV: numbers are rounded, NaN becomes None, other values are unchanged."""
    return {
        k: (round(v, 4) if np.isfinite(v) else None) if isinstance(v, float | np.floating) else v
        for k, v in row.items()
    }
