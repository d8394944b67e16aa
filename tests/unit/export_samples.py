"""Small exported scans, fabricated: a graph, and images whose colors say where they look."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from nvsim.geometry.directions import face_rays
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.types import NavGraph, Viewpoint, edge


def random_graph(scan: str, count: int, seed: int = 0, reach: float = 4.0) -> NavGraph:
    """Viewpoints in a hall of two storeys, joined where they are near; the second is not included."""
    positions = np.random.default_rng(seed).uniform((-6, -6, 0), (6, 6, 4), (count, 3))
    ids = [f"{scan.lower()}{i:03d}" for i in range(count)]
    viewpoints = {
        id: Viewpoint(id, tuple(float(v) for v in p), included=i != 1)  # type: ignore[arg-type]
        for i, (id, p) in enumerate(zip(ids, positions))
    }
    edges = {}
    for i in range(count):
        for j in range(i + 1, count):
            if np.linalg.norm(positions[i] - positions[j]) < reach:
                joined = edge(ids[i], ids[j])
                edges[joined.key] = joined
    return NavGraph(scan, viewpoints, edges)


def sky(directions: np.ndarray) -> np.ndarray:
    """Red, green, blue (..., 3) uint8 of world directions: smooth, and different everywhere."""
    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.asarray(127.5 + 120 * unit, np.uint8)


def strip(side: int = 64) -> np.ndarray:
    """(side, 6 side, 3) of `sky`, for the level pose that faces +y."""
    rotation = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
    return np.concatenate(list(sky(face_rays(side) @ rotation.T)), axis=1)


def save_jpeg(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444, cv2.IMWRITE_JPEG_QUALITY, 98]
    assert cv2.imwrite(str(path), image[..., ::-1], whole)


def export(root: Path, *graphs: NavGraph, views: bool = True, strips: bool = False, size: tuple[int, int] = (64, 48)):
    """Writes graphs and images of them; every view is of one color with a bar, which its index and place decide."""
    for graph in graphs:
        write_connectivity(graph, root / "connectivity")
        for n, viewpoint in enumerate(v for v in graph.viewpoints.values() if v.included):
            if strips:
                save_jpeg(root / graph.scan / "matterport_skybox_images" / f"{viewpoint.id}_skybox_small.jpg", strip())
            for i in range(36) if views else ():
                save_jpeg(root / "views" / graph.scan / viewpoint.id / f"{i}.jpg", pattern(n, i, size))
    return root


def pattern(n: int, i: int, size: tuple[int, int]) -> np.ndarray:
    width, height = size
    image = np.full((height, width, 3), (6 * i + 10, 20 * (n % 11) + 10, 128), np.uint8)
    image[:, (i * width) // 36 :][:, : width // 4] = 255 - image[0, 0]
    return image
