"""Draw side-by-side images of a table: the frame on the left, a column per row of the table, alpha below renders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.scores import Image
from nvsim.figures import FAINT, LETTERS, save_figure, style
from nvsim.plain_text import printable

WIDTH = 320
"""Width of a tile in pixels."""
_GAP, _LINE = 12, 24
_DPI = 160
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class ComparedImage:
    """An image on which all rows are compared: its name, (h, WIDTH, 3) uint8 RGB, and a mask of equal shape with
    non-floor pixels white, or None."""

    name: str
    picture: Bytes
    not_floor: Bytes | None

    @staticmethod
    def of(name: str, image: Image, floor: NDArray[np.bool_] | None) -> ComparedImage:
        """From an image (H, W, 3) float32, 0 to 1, and its floor mask (H, W)."""
        return ComparedImage(
            name, _tile_bytes(image), None if floor is None else _tile_bytes(_gray((~floor).astype(np.float32)))
        )


@dataclass(frozen=True, eq=False)
class Tile:
    """The result of one model for an image: render and alpha (h, WIDTH, 3) uint8, and the captions below them."""

    render: Bytes
    alpha: Bytes
    captions: tuple[str, str]

    @staticmethod
    def of(rgb: Image, alpha: Image, figures: Mapping[str, float]) -> Tile:
        """From a render (H, W, 3) and its alpha (H, W), float32, 0 to 1, and its metrics."""
        return Tile(_tile_bytes(np.clip(rgb, 0, 1)), _tile_bytes(_gray(np.clip(alpha, 0, 1))), _captions(figures))


def _captions(f: Mapping[str, float]) -> tuple[str, str]:
    if "novel_psnr" in f:
        words = _metric_labels((f["novel_psnr"], "", 1), (f["novel_psnr_down"], "steeply down ", 1))
        return words, _metric_labels((f["novel_alpha_floor"], "alpha on floor ", 3))
    words = _metric_labels((f["psnr"], "", 1), (f["psnr_nonfloor"], "without floor ", 1))
    return words, _metric_labels((f["alpha_floor"], "alpha on floor ", 3), (f["alpha_nonfloor"], "other ", 3))


def _metric_labels(*figures: tuple[float, str, int]) -> str:
    """Name and value of each metric with its number of decimals. One decimal means dB. NaN values are skipped."""
    return ", ".join(f"{n}{v:.{d}f}{' dB' if d == 1 else ''}" for v, n, d in figures if v == v)


@style()
def draw_comparison(
    path: Path, titles: Sequence[str], shown: Sequence[ComparedImage], tiles: Sequence[Sequence[Tile]]
) -> Path:
    """Writes a PNG: `titles` above the columns, then for each of `shown` its `tiles`, one per title. Raises InputError
    if the disk refuses."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = 1 + len(titles)
    width = columns * WIDTH + (columns + 1) * _GAP
    height = _LINE + sum(2 * (s.picture.shape[0] + _LINE) + _GAP for s in shown)
    figure = Figure((width / _DPI * (1 + 1e-12), height / _DPI * (1 + 1e-12)), _DPI)
    renderer = FigureCanvasAgg(figure).get_renderer()

    def write(text: str, left: int, middle: float) -> None:
        """Writes text, reduced in size if it is wider than a tile."""
        label = figure.text(left / width, 1 - middle / height, printable(text), va="center")
        label.set_fontsize(LETTERS * min(1.0, WIDTH / max(label.get_window_extent(renderer).width, 1)))

    lefts = [_GAP + c * (WIDTH + _GAP) for c in range(columns)]
    for left, title in zip(lefts, ["frame", *titles], strict=True):
        write(title, left, _LINE / 2)
    top = _LINE
    for one, row in zip(shown, tiles, strict=True):
        truth = np.full_like(one.picture, 235) if one.not_floor is None else one.not_floor
        words = "no ground truth of the floor" if one.not_floor is None else "ideal alpha: 0 on the true floor"
        first = Tile(one.picture, truth, (one.name, words))
        for part in range(2):
            for left, tile in zip(lefts, [first, *row], strict=True):
                image = (tile.render, tile.alpha)[part]
                high = image.shape[0]
                box = (left / width, 1 - (top + high) / height, WIDTH / width, high / height)
                axes = figure.add_axes(box, xticks=(), yticks=(), label=f"{left} {top}")
                axes.imshow(image, aspect="auto", interpolation="nearest")
                axes.spines[:].set(color=FAINT, linewidth=72 / _DPI)
                write(tile.captions[part], left, top + high + _LINE / 2)
            top += one.picture.shape[0] + _LINE
        top += _GAP
    return save_figure(figure, path)


def _tile_bytes(image: Image) -> Bytes:
    height, width = image.shape[:2]
    size = (WIDTH, max(round(height * WIDTH / width), 1))
    how = cv2.INTER_AREA if width > WIDTH else cv2.INTER_LINEAR
    return np.asarray(np.rint(cv2.resize(image, size, interpolation=how) * 255), np.uint8)


def _gray(plane: Image) -> Image:
    return np.repeat(plane[..., None], 3, axis=2)
