"""Draw a top view of the submaps: each core in its color, and rings around frames that submaps share."""

from __future__ import annotations

import colorsys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.files.atomic import write_bytes
from nvsim.submaps.types import Submap

_SIDE = 1000
_MARGIN = 60


def submap_color(index: int) -> tuple[int, int, int]:
    """RGB, 0 to 255. Submaps with neighboring indices differ strongly in hue (steps of the golden ratio)."""
    red, green, blue = colorsys.hsv_to_rgb((0.58 + index * 0.6180339887) % 1.0, 0.75, 0.85 if index % 2 == 0 else 0.65)
    return int(red * 255), int(green * 255), int(blue * 255)


def draw_submaps(positions: NDArray[np.floating], submaps: tuple[Submap, ...], path: Path) -> None:
    """Write a PNG seen from above, with y pointing up.

    It shows the positions (N, 3) in meters, joined in frame order. Every frame has a disc in the color of its core.
    Every other submap that contains the frame as overlap adds a ring in its color. A bar shows the scale. Raises
    InputError if the file cannot be written."""
    import cv2

    xy = np.asarray(positions, np.float64).reshape(-1, 3)[:, :2]
    low, high = (xy.min(axis=0), xy.max(axis=0)) if len(xy) else (np.zeros(2), np.ones(2))
    scale = _SIDE / max(float((high - low).max()), 1.0)
    size = np.ceil((high - low) * scale).astype(int) + 2 * _MARGIN
    width, height = max(int(size[0]), 400), max(int(size[1]), 240)
    picture = np.full((height, width, 3), 255, np.uint8)

    def place(point: NDArray[np.float64]) -> tuple[int, int]:
        return (
            int(_MARGIN + (point[0] - low[0]) * scale),
            int(height - _MARGIN - (point[1] - low[1]) * scale),
        )

    for a, b in zip(xy[:-1], xy[1:]):
        cv2.line(picture, place(a), place(b), (215, 215, 215), 1, cv2.LINE_AA)
    rings = np.zeros(len(xy), np.int64)
    for s in submaps:
        for frame in sorted(set(s.frames) - set(s.core)):
            cv2.circle(picture, place(xy[frame]), 8 + 3 * int(rings[frame]), submap_color(s.index), 1, cv2.LINE_AA)
            rings[frame] += 1
    for s in submaps:
        for frame in s.core:
            cv2.circle(picture, place(xy[frame]), 5, submap_color(s.index), -1, cv2.LINE_AA)
    for s in submaps:
        column, row = place(s.positions[:, :2].mean(axis=0))
        label = f"{s.index}: {len(s.core)}+{len(s.frames) - len(s.core)}"
        for color, thickness in (((255, 255, 255), 5), ((30, 30, 30), 1)):
            cv2.putText(
                picture, label, (column - 30, row), cv2.FONT_HERSHEY_SIMPLEX, 0.6, color, thickness, cv2.LINE_AA
            )
    metres = next(m for m in (100, 50, 20, 10, 5, 2, 1, 0) if m * scale <= width / 3)
    end = (_MARGIN + int(metres * scale), height - 20)
    cv2.line(picture, (_MARGIN, height - 20), end, (30, 30, 30), 2)
    cv2.putText(picture, f"{metres} m", (end[0] + 8, height - 15), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (30, 30, 30), 1)
    write_bytes(path, cv2.imencode(".png", picture[..., ::-1])[1].tobytes())
