"""Makes a panorama, pictures of floor masks, and two clips for resources/docs from a demo project:

python packaging/clips.py demo.nvsim [--out resources/docs]
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Iterator
from itertools import chain, pairwise
from pathlib import Path

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from PIL import Image

import nvsim
from nvsim.project.project import Project
from nvsim.render.scene import SceneModel

WALK = (432, 288)  # pixels of the clip
FIELD_OF_VIEW = 80.0  # degrees
FRAMES_PER_SECOND = 12
SPEED, TURN = 1.1, 60.0  # meters and degrees in a second
LENGTH = (9.0, 14.0)  # meters of the path of the clip
MASKED = (40, 110, 190, 330)  # frames whose masks are shown
CLIP_OF_MASKS = range(342, 392)  # frames of the clip of masks
FLOOR = np.array((0.16, 0.62, 0.56))  # color of the masks


def panorama(project: Project, scene: SceneModel, path: Path) -> None:
    """Writes the panorama of the viewpoint with the most neighbors."""
    graph = project.need_graph()
    neighbors = Counter(chain.from_iterable(graph.edges))
    viewpoint = graph.viewpoints[max(graph.viewpoints, key=lambda id: neighbors[id])]
    view = nvsim.render_panorama(scene, np.array(viewpoint.position), 1440, 720)
    assert view.rgb is not None
    _image(view.rgb).save(path, quality=85)


def floor_masks(project: Project, path: Path) -> None:
    """Writes frames with their floor masks, side by side."""
    last = len(project.need_capture().frames) - 1
    shown = [_masked(project, min(number, last)) for number in MASKED]
    _image(np.concatenate(shown, axis=1)).save(path, quality=85)


def floor_mask_clip(project: Project, path: Path) -> None:
    """Writes a clip of consecutive frames with their floor masks."""
    last = len(project.need_capture().frames) - 1
    _save_clip([_image(_masked(project, min(i, last))) for i in CLIP_OF_MASKS], path, 250)


def _masked(project: Project, index: int) -> NDArray[np.float64]:
    """(270, 360, 3) color of a frame, 0 to 1, with its floor mask in green."""
    image = Image.open(project.need_capture().frames[index].image_path).convert("RGB").resize((360, 270))
    mask = Image.open(project.mask_path(index)).convert("L").resize((360, 270))
    color, inside = np.asarray(image) / 255, np.asarray(mask)[..., None] > 127
    return np.where(inside, 0.45 * color + 0.55 * FLOOR, color)


def _save_clip(images: list[Image.Image], path: Path, duration: int) -> None:
    """Writes a WebP that repeats. `duration` of a frame in milliseconds."""
    images[0].save(path, save_all=True, append_images=images[1:], duration=duration, loop=0, quality=60)


def agents_walk(project: Project, scene: SceneModel, path: Path) -> None:
    """Writes a clip along a shortest path with turns."""
    lens = nvsim.Intrinsics.from_fov(*WALK, math.radians(FIELD_OF_VIEW))
    images = []
    for position, heading in _poses(_route(project)):
        _, view = nvsim.render_scene(scene, nvsim.Camera(lens, nvsim.camera_pose(position, heading=heading)))
        assert view.rgb is not None
        images.append(_image(view.rgb))
    _save_clip(images, path, round(1000 / FRAMES_PER_SECOND))


def _route(project: Project) -> NDArray[np.float64]:
    """(N, 3) positions along a shortest path of `LENGTH`: with few viewpoints, and about half a turn in all."""
    viewpoints = project.need_graph().viewpoints
    graph = nx.Graph()
    for a, b in project.need_graph().edges:
        apart = float(np.linalg.norm(np.subtract(viewpoints[a].position, viewpoints[b].position)))
        graph.add_edge(a, b, weight=apart)
    best, least = np.zeros((0, 3)), math.inf
    for start, (lengths, paths) in nx.all_pairs_dijkstra(graph):
        for end, path in paths.items():
            if start < end and LENGTH[0] <= lengths[end] <= LENGTH[1]:
                places = np.array([viewpoints[id].position for id in path])
                turned = float(np.abs(_turns(_headings(places))).sum())
                cost = len(path) + 2 * abs(turned - np.pi)
                if cost < least:
                    best, least = places, cost
    if not len(best):
        raise SystemExit("The graph has no path of the length of the clip.")
    return best


def _headings(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N - 1,) radians, directions from each position to the next."""
    steps = np.diff(places, axis=0)
    return np.arctan2(steps[:, 0], steps[:, 1])


def _turns(headings: NDArray[np.float64]) -> NDArray[np.float64]:
    return (np.diff(headings) + np.pi) % (2 * np.pi) - np.pi


def _poses(places: NDArray[np.float64]) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Positions and headings of the frames: the agent turns at a viewpoint, then goes straight to the next."""
    headings = _headings(places)
    turns = np.append(_turns(headings), 0.0)
    for (here, there), heading, turn in zip(pairwise(places), headings, turns, strict=True):
        moving = max(1, round(float(np.linalg.norm(there - here)) / SPEED * FRAMES_PER_SECOND))
        for k in range(moving):
            yield here + (there - here) * k / moving, float(heading)
        turning = round(abs(math.degrees(turn)) / TURN * FRAMES_PER_SECOND)
        for k in range(turning):
            yield there, float(heading + turn * k / turning)


def _image(color: NDArray[np.floating]) -> Image.Image:
    """An image from colors (H, W, 3), 0 to 1."""
    return Image.fromarray((255 * color.clip(0, 1)).astype(np.uint8))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("project", type=Path)
    parser.add_argument("--out", type=Path, default=Path("resources/docs"))
    given = parser.parse_args()
    with nvsim.open_project(given.project) as project:
        scene = project.scene()
        if scene is None:
            raise SystemExit(f"{given.project} has no trained models.")
        panorama(project, scene, given.out / "panorama.jpg")
        floor_masks(project, given.out / "floor-masks.jpg")
        floor_mask_clip(project, given.out / "floor-masks-clip.webp")
        agents_walk(project, scene, given.out / "agent-walk.webp")


if __name__ == "__main__":
    main()
