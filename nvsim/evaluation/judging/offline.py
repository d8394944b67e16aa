"""Judges that are image metrics and not models, so that the table is never empty. Their names say so."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from nvsim.evaluation.judging.contestants import Shown, read_shown
from nvsim.evaluation.judging.verdicts import Judged, Verdict, pairs_of
from nvsim.evaluation.scores import Distance, Image

SAME_DISTANCE = 0.01
"""LPIPS: two images are equal if their distances from the photograph differ by less."""
SAME_SHARPNESS = 0.05
"""Two images are equally sharp if their sharpness differs by less than this share of the larger one."""
_BLUR = 1.0  # pixels; finer structures are noise of single pixels


def by_lpips(shown: Sequence[Shown], distance: Distance | None, why: str) -> Judged:
    """Prefers the image with the smaller LPIPS distance to the photograph. Views without a photograph are skipped."""
    what = "prefers the image nearer to the photograph; a metric, only for views with a photograph"
    photographed = [view for view in shown if view.photo is not None]
    if distance is None or not photographed:
        return Judged("LPIPS (offline)", what, why=why or "no view has a photograph")
    found = []
    for view in photographed:
        assert view.photo is not None
        photo = view.photo()
        far = {who: distance(_like(read_shown(path), photo), photo) for who, path in view.images.items()}
        found += _verdicts(view, far, lambda x, y: abs(x - y) < SAME_DISTANCE, lower=True)
    return Judged("LPIPS (offline)", what, found)


def by_sharpness(shown: Sequence[Shown]) -> Judged:
    """Prefers the sharper image. It uses no photograph, and counts floaters and noise as detail."""
    what = "prefers finer detail, which can be noise or floaters; a metric"
    found = []
    for view in shown:
        sharp = {who: sharpness(read_shown(path)) for who, path in view.images.items()}
        found += _verdicts(view, sharp, lambda x, y: abs(x - y) < SAME_SHARPNESS * max(x, y, 1e-9), lower=False)
    return Judged("sharpness (offline, no reference)", what, found)


def sharpness(image: Image) -> float:
    """The mean gradient magnitude of the brightness of an RGB image (H, W, 3) float32, after a blur that removes
    single-pixel noise.

    Source: the measure of Tenengrad, Krotkov 1988, Focusing, section 2, without its threshold."""
    grey = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (0, 0), _BLUR)
    across, down = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    return float(np.hypot(across, down).mean())


def _verdicts(
    view: Shown, figures: dict[str, float], same: Callable[[float, float], bool], lower: bool
) -> list[Verdict]:
    found = []
    for a, b in pairs_of(list(view.images)):
        x, y = figures[a], figures[b]
        won = "" if same(x, y) else a if (x < y) == lower else b
        found.append(Verdict(view.name, view.kind, a, b, won, said=(f"{a} {x:.4f}", f"{b} {y:.4f}")))
    return found


def _like(image: Image, other: Image) -> Image:
    height, width = other.shape[:2]
    if image.shape == other.shape:
        return image
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.float32)
