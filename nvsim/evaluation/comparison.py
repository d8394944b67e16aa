"""Draw side-by-side images of a table: the frame on the left, a column per row of the table, alpha below renders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.scores import Image
from nvsim.files import atomic

WIDTH = 320
"""Width of a tile in pixels."""
_GAP, _MARGIN, _HEAD, _CAPTION = 10, 16, 52, 22
_INK, _FAINT, _PAPER = (40, 40, 40), (110, 110, 110), 255
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Shown:
    """An image on which all rows are compared: its name, (h, WIDTH, 3) uint8 RGB, and a mask of equal shape with
    non-floor pixels white, or None."""

    name: str
    picture: Bytes
    not_floor: Bytes | None

    @staticmethod
    def of(name: str, image: Image, floor: NDArray[np.bool_] | None) -> Shown:
        """From an image (H, W, 3) float32, 0 to 1, and its floor mask (H, W)."""
        return Shown(name, _small(image), None if floor is None else _small(_grey((~floor).astype(np.float32))))


@dataclass(frozen=True, eq=False)
class Tile:
    """The result of one model for an image: render and alpha (h, WIDTH, 3) uint8, and the captions below them."""

    render: Bytes
    alpha: Bytes
    captions: tuple[str, str]

    @staticmethod
    def of(rgb: Image, alpha: Image, figures: Mapping[str, float]) -> Tile:
        """From a render (H, W, 3) and its alpha (H, W), float32, 0 to 1, and its metrics."""
        return Tile(_small(np.clip(rgb, 0, 1)), _small(_grey(np.clip(alpha, 0, 1))), _captions(figures))


def _captions(f: Mapping[str, float]) -> tuple[str, str]:
    if "novel_psnr" in f:
        words = _named((f["novel_psnr"], "", 1), (f["novel_psnr_down"], "steeply down ", 1))
        return words, _named((f["novel_alpha_floor"], "alpha on floor ", 3))
    words = _named((f["psnr"], "", 1), (f["psnr_nonfloor"], "without floor ", 1))
    return words, _named((f["alpha_floor"], "alpha on floor ", 3), (f["alpha_nonfloor"], "other ", 3))


def _named(*figures: tuple[float, str, int]) -> str:
    """Name and value of each metric with its number of decimals. One decimal means dB. NaN values are skipped."""
    return ", ".join(f"{n}{v:.{d}f}{' dB' if d == 1 else ''}" for v, n, d in figures if v == v)


def draw_comparison(path: Path, titles: Sequence[str], shown: Sequence[Shown], tiles: Sequence[Sequence[Tile]]) -> Path:
    """Writes a PNG: `titles` above the columns, then for each of `shown` its `tiles`, one per title. Raises InputError
    if the disk refuses."""
    columns = 1 + len(titles)
    heights = [s.picture.shape[0] for s in shown]
    block = 2 * _CAPTION + 4 * _GAP
    height = 2 * _MARGIN + _HEAD + sum(2 * h + block for h in heights)
    sheet = np.full((height, 2 * _MARGIN + columns * WIDTH + (columns - 1) * _GAP, 3), _PAPER, np.uint8)
    lefts = [_MARGIN + c * (WIDTH + _GAP) for c in range(columns)]
    for left, title in zip(lefts, ["frame", *titles], strict=True):
        _write(sheet, title, left, _MARGIN + _HEAD - 20, 0.62, _INK)
    cv2.line(sheet, (_MARGIN, _MARGIN + _HEAD - 6), (sheet.shape[1] - _MARGIN, _MARGIN + _HEAD - 6), _FAINT, 1)
    top = _MARGIN + _HEAD
    for one, row, h in zip(shown, tiles, heights, strict=True):
        low = top + h + _CAPTION + _GAP
        truth = np.full_like(one.picture, 235) if one.not_floor is None else one.not_floor
        words = "no ground truth of the floor" if one.not_floor is None else "ideal alpha: 0 on the true floor"
        first = (one.picture, truth, (one.name, words))
        for left, (picture, under, captions) in zip(
            lefts, [first, *((t.render, t.alpha, t.captions) for t in row)], strict=True
        ):
            _place(sheet, picture, left, top)
            _place(sheet, under, left, low)
            _write(sheet, captions[0], left, top + h + 16, 0.47, _INK)
            _write(sheet, captions[1], left, low + h + 16, 0.47, _INK)
        top += 2 * h + block
    data = cv2.imencode(".png", sheet[..., ::-1])[1]
    atomic.write_bytes(path, data.tobytes())
    return path


def _small(image: Image) -> Bytes:
    height, width = image.shape[:2]
    size = (WIDTH, max(round(height * WIDTH / width), 1))
    how = cv2.INTER_AREA if width > WIDTH else cv2.INTER_LINEAR
    return np.asarray(np.rint(cv2.resize(image, size, interpolation=how) * 255), np.uint8)


def _grey(plane: Image) -> Image:
    return np.repeat(plane[..., None], 3, axis=2)


def _place(sheet: Bytes, picture: Bytes, left: int, top: int) -> None:
    height, width = picture.shape[:2]
    sheet[top : top + height, left : left + width] = picture
    cv2.rectangle(sheet, (left, top), (left + width - 1, top + height - 1), (190, 190, 190), 1)


def _write(sheet: Bytes, text: str, left: int, baseline: int, scale: float, ink: tuple[int, int, int]) -> None:
    """Writes text, reduced in size if it is wider than a tile."""
    wide = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale, 1)[0][0]
    scale *= min(1.0, WIDTH / max(wide, 1))
    cv2.putText(sheet, text, (left, baseline), cv2.FONT_HERSHEY_DUPLEX, scale, ink, 1, cv2.LINE_AA)
