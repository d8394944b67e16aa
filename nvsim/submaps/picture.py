"""Draw a top view of the submaps: each core in its color, and rings around frames that submaps share."""

from __future__ import annotations

import colorsys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.figures import FAINT, PAPER, WIDTH, add_scale_bar, save_figure, style
from nvsim.submaps.split import Submap

_HALVES = np.array([-0.5, 0.5])


def submap_color(index: int) -> tuple[int, int, int]:
    """RGB, 0 to 255. Submaps with neighboring indices differ strongly in hue (steps of the golden ratio)."""
    red, green, blue = colorsys.hsv_to_rgb((0.58 + index * 0.6180339887) % 1.0, 0.75, 0.85 if index % 2 == 0 else 0.65)
    return int(red * 255), int(green * 255), int(blue * 255)


@style()
def draw_submaps(positions: NDArray[np.floating], submaps: tuple[Submap, ...], path: Path) -> None:
    """Write a PNG seen from above, with y pointing up.

    It shows the positions (N, 3) in meters, joined in frame order. Every frame has a disc in the color of its core.
    Every other submap that contains the frame as overlap adds a ring in its color. A bar shows the scale. Raises
    InputError if the file cannot be written."""
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke

    xy = np.asarray(positions, np.float64).reshape(-1, 3)[:, :2]
    low, high = (xy.min(axis=0), xy.max(axis=0)) if len(xy) else (np.zeros(2), np.ones(2))
    longest = max(float((high - low).max()), 1.0)
    middle, size = (low + high) / 2, np.maximum(high - low + 0.12 * longest, np.array([0.45, 0.3]) * longest)
    figure = Figure(WIDTH * size / size.max(), dpi=160)
    axes = figure.add_axes((0, 0, 1, 1), aspect="equal", xticks=(), yticks=(), frame_on=False)
    axes.set(xlim=middle[0] + size[0] * _HALVES, ylim=middle[1] + size[1] * _HALVES)
    axes.plot(*xy.T, color=FAINT, linewidth=0.6, zorder=1)
    rings = np.zeros(len(xy))
    for s in submaps:
        color = "#{:02x}{:02x}{:02x}".format(*submap_color(s.index))
        shared = sorted(set(s.frames) - set(s.core))
        x, y = xy[shared].T
        axes.scatter(x, y, (7.0 + 2.6 * rings[shared]) ** 2, facecolors="none", edgecolors=color, linewidths=0.6)
        rings[shared] += 1
        x, y = xy[list(s.core)].T
        axes.scatter(x, y, 4.5**2, color, linewidths=0, zorder=2)
        label = f"{s.index}: {len(s.core)}+{len(s.frames) - len(s.core)}"
        halo = [withStroke(linewidth=3, foreground=PAPER)]
        x, y = s.positions[:, :2].mean(axis=0)
        axes.text(x, y, label, ha="center", va="center", path_effects=halo, zorder=3)
    add_scale_bar(axes)
    save_figure(figure, path)
