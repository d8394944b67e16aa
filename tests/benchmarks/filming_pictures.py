"""Draw the pictures of good and bad filming in resources/docs/video.md (needs `pip install matplotlib`).

python tests/benchmarks/filming_pictures.py [FOLDER]
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from matplotlib import patches
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from nvsim.building.baking import textures_of
from nvsim.building.config import BuildingConfig
from nvsim.building.rendering import render
from nvsim.building.scene import make_scene
from nvsim.geometry.camera import Camera, look

matplotlib.use("Agg")
DOCS = Path(__file__).resolve().parents[2] / "resources" / "docs"
GOOD, BAD, INK = "#1d7a50", "#c03535", "#3a444f"
HEIGHT = 1.5  # meters of the camera


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS
    folder.mkdir(parents=True, exist_ok=True)
    draw_paths(folder / "video-paths.png")
    draw_height(folder / "video-height.png")
    draw_frames(folder / "video-frames.jpg")


# Paths from above -----------------------------------------------------------------------------------------------------


def draw_paths(path: Path) -> None:
    """A turn in a curve and on the spot; a walk that comes back and one that does not."""
    figure, axes = plt.subplots(1, 4, figsize=(11, 3.1), dpi=90)
    arc = np.radians(np.linspace(0, 90, 12))
    curve = np.array([*[(x, 0.0) for x in np.linspace(-2.5, 0, 8)],
                      *[(1.5 * np.sin(a), 1.5 - 1.5 * np.cos(a)) for a in arc[1:]],
                      *[(1.5, y) for y in np.linspace(1.9, 4, 7)]])  # fmt: skip
    heading = np.concatenate([np.zeros(8), arc[1:], np.full(7, np.pi / 2)])
    corner(axes[0], True, "Turn in a curve")
    show_walk(axes[0], curve, heading, GOOD)
    spot = np.array([*[(x, 0.0) for x in np.linspace(-2.5, 1.5, 11)], *[(1.5, 0.0)] * 8,
                     *[(1.5, y) for y in np.linspace(0.4, 4, 9)]])  # fmt: skip
    heading = np.concatenate([np.zeros(11), np.radians(np.linspace(10, 80, 8)), np.full(9, np.pi / 2)])
    corner(axes[1], False, "Turn on the spot")
    show_walk(axes[1], spot, heading, BAD)
    t = np.linspace(0, 2 * np.pi, 60)
    loop = np.stack([2.6 * np.cos(t - 2.2), 1.7 * np.sin(t - 2.2)], axis=1)
    rooms(axes[2], True, "Come back to the start")
    axes[2].plot(*loop.T, color=GOOD, lw=2)
    axes[2].plot(*(0.88 * loop[:12]).T, color=GOOD, lw=2)
    axes[2].plot([loop[-1, 0], 0.88 * loop[0, 0]], [loop[-1, 1], 0.88 * loop[0, 1]], color=GOOD, lw=2)
    axes[2].plot(*loop[0], "o", color=INK)
    rooms(axes[3], False, "End far from the start")
    axes[3].plot(*loop[:38].T, color=BAD, lw=2)
    axes[3].plot(*loop[0], "o", color=INK)
    save(figure, path)


def corner(axes: Axes, good: bool, words: str) -> None:
    axes.plot([-2.9, 2.7, 2.7], [-1.2, -1.2, 4.2], color=INK, lw=3)
    axes.plot([-2.9, 0.3, 0.3], [1.2, 1.2, 4.2], color=INK, lw=3)
    dress(axes, good, words)


def rooms(axes: Axes, good: bool, words: str) -> None:
    axes.add_patch(patches.Rectangle((-3.5, -2.6), 7, 5.2, fill=False, ec=INK, lw=3))
    axes.add_patch(patches.Rectangle((-1.5, -0.7), 3, 1.4, fc="#d9dee4", ec=INK, lw=2))
    dress(axes, good, words)


def show_walk(axes: Axes, places: np.ndarray, heading: np.ndarray, color: str) -> None:
    """Cameras as small wedges."""
    axes.plot(*places.T, color=color, lw=1.5)
    for (x, y), turn in zip(places, np.degrees(heading), strict=True):
        axes.add_patch(patches.Wedge((x, y), 0.75, turn - 28, turn + 28, fc=color, alpha=0.16))
    axes.plot(*places.T, ".", color=color, ms=5)


def dress(axes: Axes, good: bool, words: str) -> None:
    axes.set_title(f"{'✓' if good else '✗'} {words}", color=GOOD if good else BAD, fontsize=11, fontweight="bold")
    axes.set_aspect("equal")
    axes.axis("off")


def save(figure: plt.Figure, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, facecolor="white")
    plt.close(figure)


# Height and tilt from the side ----------------------------------------------------------------------------------------


def draw_height(path: Path) -> None:
    """A camera that looks slightly down and shows floor, and one that looks at the ceiling."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 2.7), dpi=90)
    for ax, good, tilt, words in (
        (axes[0], True, -12.0, "1.5 m high, the lower third shows floor"),
        (axes[1], False, 14.0, "The floor is out of view"),
    ):
        color = GOOD if good else BAD
        ax.plot([-0.6, 6, 6, -0.6], [0, 0, 2.6, 2.6], color=INK, lw=3)
        ax.add_patch(patches.Circle((-0.1, 1.62), 0.11, fc=INK))
        ax.plot([-0.1, -0.1, -0.25], [1.5, 0.8, 0], color=INK, lw=3)
        ax.plot([-0.1, 0.05], [0.8, 0], color=INK, lw=3)
        ax.plot([-0.1, 0.3], [1.35, HEIGHT], color=INK, lw=3)
        ends = [np.radians(tilt + half) for half in (27, -27)]
        reach = [min(6 / np.cos(e), (2.6 - HEIGHT if e > 0 else HEIGHT) / max(abs(np.sin(e)), 1e-6)) for e in ends]
        corners = [(0.35 + r * np.cos(e), HEIGHT + r * np.sin(e)) for e, r in zip(ends, reach, strict=True)]
        far = [(6.0, 2.6), (6.0, 0.0)]
        shape = [(0.35, HEIGHT), corners[0], *far[: 2 if corners[1][1] < 0.01 else 1], corners[1]]
        shape = [(min(x, 6.0), y) for x, y in shape]
        ax.add_patch(patches.Polygon(shape, fc=color, alpha=0.22))
        if good:
            ax.plot([corners[1][0], 6], [0, 0], color=color, lw=6, solid_capstyle="butt")
        ax.annotate("", (0.62, 0.02), (0.62, HEIGHT), arrowprops={"arrowstyle": "<->", "color": INK})
        ax.text(0.7, 0.35, "1.5 m", color=INK, fontsize=9)
        dress(ax, good, words)
    save(figure, path)


# Frames of the built-in building --------------------------------------------------------------------------------------


def draw_frames(path: Path) -> None:
    """A sharp frame beside a blurred one, a lit one beside a dark one, and a room beside a wall from near."""
    scene = make_scene(BuildingConfig(seed=1, width=400, height=300, people=False))
    textures = textures_of(scene)

    def shot(camera: Camera) -> np.ndarray:
        view = render(camera, scene.solids, textures, np.empty((0, 5)), np.empty((0, 3)))
        return np.asarray(np.rint(np.clip(view.color[..., ::-1], 0, 1) * 255), np.uint8)

    at = int(sys.argv[2]) if len(sys.argv) > 2 else 20
    camera = scene.camera(at)
    sharp = shot(camera)
    smear = np.zeros((1, 31))
    smear[0] = 1 / 31
    blurred = np.asarray(cv2.filter2D(sharp, -1, smear))
    noise = np.random.default_rng(0).normal(0, 7, sharp.shape)
    dark = np.clip(0.16 * sharp + noise, 0, 255).astype(np.uint8)
    depth = render(camera, scene.solids, textures, np.empty((0, 5)), np.empty((0, 3))).depth
    ahead = float(np.median(depth[130:150, 190:210]))
    x, y, z = camera.position + camera.rotation[:, 2] * max(ahead - 0.45, 0.0)
    heading = float(np.arctan2(camera.rotation[0, 2], camera.rotation[1, 2]))
    near = shot(replace(camera, camera_to_world=look(np.array([x, y, max(z, 1.6)]), heading, 0.15)))
    rows = (
        (("✓ Sharp, with texture and floor in view", sharp), ("✗ Blurred: turned too fast", blurred)),
        (
            ("✗ Dark: noise hides the texture", dark),
            ("✗ A wall from 0.5 m: nothing to track", near),
        ),
    )
    figure, axes = plt.subplots(2, 2, figsize=(8, 6.6), dpi=90)
    for ax, (words, image) in zip(axes.ravel(), (cell for row in rows for cell in row), strict=True):
        ax.imshow(image[..., ::-1])
        dress(ax, words.startswith("✓"), words[2:])
    figure.tight_layout()
    figure.savefig(path, facecolor="white", pil_kwargs={"quality": 82})
    plt.close(figure)


if __name__ == "__main__":
    main()
