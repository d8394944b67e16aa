"""Draw the pictures of good and bad filming in resources/docs/how-to/film-a-building.md.

python tests/benchmarks/filming_pictures.py [FOLDER]
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from PIL import Image, ImageDraw, ImageFont

DOCS = Path(__file__).resolve().parents[2] / "resources" / "docs"
GOOD, BAD, INK, PALE = (29, 122, 80), (192, 53, 53), (58, 68, 79), (217, 222, 228)
FINE = 3  # supersampling factor of the drawings
TITLE = 30  # height of the title above a panel, pixels
HEIGHT, CEILING = 1.5, 2.6  # heights of the camera and of the ceiling, meters
Point = tuple[float, float]


@dataclass(frozen=True)
class Arguments:
    folder: tyro.conf.Positional[Path] = DOCS


def main() -> None:
    folder = tyro.cli(Arguments, description=__doc__).folder
    folder.mkdir(parents=True, exist_ok=True)
    beside(turns()).save(folder / "video-paths.png", optimize=True)
    beside(heights()).save(folder / "video-height.png", optimize=True)


class Panel:
    """A drawing with a title, in meters with y up."""

    def __init__(self, good: bool, title: str, low: Point, high: Point, width: int) -> None:
        self.scale, self.low, self.high = width / (high[0] - low[0]), low, high
        size = FINE * width, FINE * (TITLE + round(self.scale * (high[1] - low[1])))
        self.image = Image.new("RGB", size, "white")
        self.pen = ImageDraw.Draw(self.image, "RGBA")
        color, font = GOOD if good else BAD, ImageFont.load_default(FINE * 14)
        words = f"{'Good' if good else 'Bad'}: {title}"
        self.pen.text((FINE * 4, FINE * 6), words, fill=color, font=font)

    def at(self, place: Sequence[float]) -> Point:
        x, y = FINE * self.scale * (place[0] - self.low[0]), FINE * self.scale * (self.high[1] - place[1])
        return x, y + FINE * TITLE

    def line(self, places: Iterable[Sequence[float]], color: tuple[int, int, int], width: float = 3) -> None:
        self.pen.line([self.at(p) for p in places], fill=color, width=round(FINE * width), joint="curve")

    def area(self, places: Iterable[Sequence[float]], color: tuple[int, int, int], alpha: int) -> None:
        self.pen.polygon([self.at(p) for p in places], fill=(*color, alpha))

    def dot(self, place: Sequence[float], color: tuple[int, int, int], radius: float) -> None:
        (x, y), r = self.at(place), FINE * radius
        self.pen.ellipse((x - r, y - r, x + r, y + r), fill=color)

    def text(self, place: Sequence[float], words: str) -> None:
        self.pen.text(self.at(place), words, fill=INK, font=ImageFont.load_default(FINE * 13))


def beside(panels: list[Image.Image]) -> Image.Image:
    """The panels in one row, at the stored size."""
    gap = FINE * 16
    whole = Image.new("RGB", (sum(p.width + gap for p in panels) - gap, max(p.height for p in panels)), "white")
    left = 0
    for panel in panels:
        whole.paste(panel, (left, 0))
        left += panel.width + gap
    return whole.resize((whole.width // FINE, whole.height // FINE), Image.Resampling.LANCZOS)


# From above -----------------------------------------------------------------------------------------------------------


def turns() -> list[Image.Image]:
    """A turn in a curve and one in place; a trajectory that returns to its start and one that does not."""
    arc = np.radians(np.linspace(0, 90, 12))[1:]
    straight, up = np.linspace(-2.5, 0, 8), np.linspace(1.9, 4, 7)
    curve = [*[(x, 0.0) for x in straight], *[(1.5 * np.sin(a), 1.5 - 1.5 * np.cos(a)) for a in arc]]
    curve += [(1.5, y) for y in up]
    turned = np.concatenate([np.zeros(8), arc, np.full(7, np.pi / 2)])
    spot = [*[(x, 0.0) for x in np.linspace(-2.5, 1.5, 11)], *[(1.5, 0.0)] * 8]
    spot += [(1.5, y) for y in np.linspace(0.4, 4, 9)]
    at_once = np.concatenate([np.zeros(11), np.radians(np.linspace(10, 80, 8)), np.full(9, np.pi / 2)])
    t = np.linspace(0, 2 * np.pi, 60) - 2.2
    loop = np.stack([2.6 * np.cos(t), 1.7 * np.sin(t)], axis=1)
    return [
        corner(True, "turn in a curve", curve, turned),
        corner(False, "turn on the spot", spot, at_once),
        hall(True, "come back to the start", np.concatenate([loop, 0.86 * loop[:14]])),
        hall(False, "end far from the start", loop[:38]),
    ]


def corner(good: bool, title: str, places: Sequence[Point], heading: np.ndarray) -> Image.Image:
    """A panel of a walk around a corner. `places` are (x, y) in meters, `heading` (N,) is in radians."""
    panel, color = Panel(good, title, (-3, -1.4), (3, 4.4), 210), GOOD if good else BAD
    panel.line([(-2.9, -1.2), (2.7, -1.2), (2.7, 4.2)], INK)
    panel.line([(-2.9, 1.2), (0.3, 1.2), (0.3, 4.2)], INK)
    for (x, y), turn in zip(places, heading, strict=True):
        rays = [(x + 0.8 * np.cos(turn + a), y + 0.8 * np.sin(turn + a)) for a in np.radians(np.linspace(-28, 28, 7))]
        panel.area([(x, y), *rays], color, 40)
    panel.line(places, color, 1.5)
    for place in places:
        panel.dot(place, color, 2.2)
    return panel.image


def hall(good: bool, title: str, places: np.ndarray) -> Image.Image:
    """A panel of a walk around a block. `places` (N, 2) are in meters."""
    panel, color = Panel(good, title, (-3.7, -3.2), (3.7, 3.2), 230), GOOD if good else BAD
    panel.line([(-3.5, -2.6), (3.5, -2.6), (3.5, 2.6), (-3.5, 2.6), (-3.5, -2.6)], INK)
    block = [(-1.3, -0.6), (1.3, -0.6), (1.3, 0.6), (-1.3, 0.6)]
    panel.area(block, PALE, 255)
    panel.line([*block, block[0]], INK, 2)
    panel.line(places, color, 2.2)
    panel.dot(places[0], INK, 5)
    return panel.image


# From the side --------------------------------------------------------------------------------------------------------


def heights() -> list[Image.Image]:
    """A camera that looks slightly down and shows the floor, and one that shows the ceiling."""
    return [side(True, "1.5 m high, floor in the lower third", -12.0), side(False, "the floor is out of view", 30.0)]


def side(good: bool, title: str, tilt: float) -> Image.Image:
    panel, color, eye = Panel(good, title, (-0.8, -0.15), (6.2, 2.8), 430), GOOD if good else BAD, (0.35, HEIGHT)
    rays = [(np.cos(a), np.sin(a)) for a in np.radians([tilt + 27, tilt - 27])]
    ends = []
    for dx, dy in rays:
        reach = min((6 - eye[0]) / dx, (CEILING - HEIGHT) / dy if dy > 0 else HEIGHT / max(-dy, 1e-9))
        ends.append((eye[0] + reach * dx, eye[1] + reach * dy))
    corners = [(6.0, y) for (x, _), y in zip(ends, (CEILING, 0.0), strict=True) if x < 6 - 1e-6]
    panel.area([eye, ends[0], *corners, ends[1]], color, 60)
    panel.line([(-0.7, CEILING), (6, CEILING), (6, 0), (-0.7, 0)], INK)
    if good:
        panel.line([(ends[1][0], 0.0), (6, 0)], color, 6)
    panel.dot((-0.1, 1.66), INK, 7)
    for limb in ([(-0.1, 1.55), (-0.1, 0.85), (-0.25, 0)], [(-0.1, 0.85), (0.05, 0)], [(-0.1, 1.4), eye]):
        panel.line(limb, INK, 3)
    panel.line([(0.6, 0), (0.6, HEIGHT)], INK, 1)
    panel.text((0.68, 0.5), "1.5 m")
    return panel.image


if __name__ == "__main__":
    main()
