"""Exported scans of boxes, whose strips are exact: rays against boxes, without a renderer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import camera_pose
from nvsim.geometry.directions import face_rays
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.r2r.observations.layout import ScanPlaces

SIDE = 96
Triple = tuple[float, float, float]
WALL, BROWN, GRAY = (225, 222, 215), (140, 92, 55), (128, 128, 128)
BLUE, RED = (60, 85, 150), (150, 60, 50)
CEILING = 2.6


@dataclass(frozen=True)
class Block:
    lo: Triple
    hi: Triple
    color: tuple[int, int, int]

    def meters_to(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) meters of places (N, 2) from it, seen from above."""
        off = np.maximum(np.maximum(np.array(self.lo[:2]) - xy, xy - np.array(self.hi[:2])), 0)
        return np.hypot(*off.T)


def flat_house(door: float = 0.9) -> tuple[list[Block], NavGraph]:
    """A room of 5 by 5 m with a brown floor, a blue sofa and a tall red cabinet, and a door of so many meters into a
    gray corridor that runs east."""
    middle = 0.8
    low, high = middle - door / 2, middle + door / 2
    blocks = [
        Block((-0.2, -0.2, -0.2), (5.05, 5.2, 0.0), BROWN),
        Block((5.05, -0.2, -0.2), (15.2, 5.2, 0.0), GRAY),
        Block((-0.2, -0.2, CEILING), (15.2, 5.2, CEILING + 0.2), WALL),
        Block((-0.2, -0.2, 0), (0.0, 5.2, CEILING), WALL),
        Block((-0.2, -0.2, 0), (15.2, 0.0, CEILING), WALL),
        Block((-0.2, 5.0, 0), (5.1, 5.2, CEILING), WALL),
        Block((5.0, 1.6, 0), (15.2, 1.8, CEILING), WALL),
        Block((15.0, -0.2, 0), (15.2, 1.8, CEILING), WALL),
        Block((5.0, 0.0, 0), (5.1, low, CEILING), WALL),
        Block((5.0, high, 0), (5.1, 5.2, CEILING), WALL),
        Block((5.0, low, 2.05), (5.1, high, CEILING), WALL),
        Block((1.2, 4.0, 0), (3.2, 4.9, 0.42), BLUE),
        Block((1.2, 4.6, 0.42), (3.2, 4.9, 0.82), BLUE),
        Block((4.3, 2.6, 0), (4.95, 4.1, 1.8), RED),
    ]
    at = {
        "a": (1.0, 0.9),
        "b": (2.6, 0.9),
        "c": (4.1, 0.8),
        "d": (1.2, 2.6),
        "e": (2.8, 2.8),
        "f": (6.2, 0.8),
        "g": (8.2, 0.8),
        "h": (10.2, 0.8),
        "i": (12.2, 0.8),
    }
    pairs = ("ab", "bc", "ad", "de", "be", "ce", "cf", "fg", "gh", "hi")
    edges = [edge(*pair) for pair in pairs]
    return blocks, NavGraph(
        "boxes", {id: Viewpoint(id, (x, y, 1.5)) for id, (x, y) in at.items()}, {e.key: e for e in edges}
    )


def export_blocks(root: Path, blocks: list[Block], graph: NavGraph) -> Path:
    """Writes connectivity, strips and depth strips."""
    write_connectivity(graph, root / "connectivity")
    places = ScanPlaces(root, graph.scan)
    places.images.mkdir(parents=True)
    for v in graph.viewpoints.values():
        color, meters = seen_from(blocks, np.array(v.position))
        cv2.imwrite(str(places.skyboxes.strip(v.id)), color[..., ::-1])
        cv2.imwrite(str(places.skyboxes.depth(v.id)), np.minimum(np.rint(meters * 4000), 65535).astype(np.uint16))
    return root


def seen_from(blocks: list[Block], eye: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """(S, 6 S, 3) colors and (S, 6 S) distances in meters from a viewpoint; 0 in directions without a surface."""
    rays = np.concatenate(list(face_rays(SIDE) @ camera_pose(np.zeros(3), 0.0)[:3, :3].T), axis=1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    rays = np.where(np.abs(rays) < 1e-9, 1e-9, rays)
    nearest = np.full(rays.shape[:2], np.inf)
    color = np.zeros((*rays.shape[:2], 3), np.uint8)
    for block in blocks:
        one, two = (np.array(block.lo) - eye) / rays, (np.array(block.hi) - eye) / rays
        enter, leave = np.minimum(one, two).max(axis=-1), np.maximum(one, two).min(axis=-1)
        hit = (enter > 0) & (enter < leave) & (enter < nearest)
        nearest[hit], color[hit] = enter[hit], block.color
    return color, np.where(np.isfinite(nearest), nearest, 0.0)
