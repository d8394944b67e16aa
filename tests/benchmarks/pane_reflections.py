"""Test whether reflections tell glass panes from open doors: a table and one JSON line.

python tests/benchmarks/pane_reflections.py FOLDER [--seed N] [--style STYLE]

The built-in building is written to FOLDER. For each pane, and for open places that the trajectory crosses, the images
that look through are compared with the colored LiDAR scan behind the plane and with the scan mirrored in the plane. The
share of the mirrored color is the reflectance (built-in panes: 0.04, more at an angle). Depth, colors, and the position
of the plane are true, so the figures are an upper bound for images alone. --off moves the planes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent))
from harness import report

from nvsim.building import BuildingConfig, generate
from nvsim.building.scene import Scene, make_scene
from nvsim.capture.findings import Findings
from nvsim.capture.pointcloud import read_cloud
from nvsim.geometry.camera import Camera
from nvsim.geometry.splatting import SplatCloud, _splat

WIDTH, HEIGHT = 240, 180
RADIUS = 0.03  # meters: half of the distance between points of the scan
NEAR, FAR = 0.6, 4.0  # meters from a plane to the images that are compared
IMAGES = 8  # of a plane
FEW = 200  # pixels of an image
LIMIT = 0.018  # reflectance of a pane


@dataclass(frozen=True)
class Arguments:
    folder: tyro.conf.Positional[Path]
    seed: int = 53
    style: str = "glass"
    off: float = 0.0
    """Meters by which the planes are moved."""


@dataclass(frozen=True)
class UprightPlane:
    """The plane with coordinate `at` on `axis` (0 or 1), from `low` to `high` on the other axis, meters."""

    kind: str
    axis: int
    at: float
    low: float
    high: float


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    config = BuildingConfig(seed=arguments.seed, style=arguments.style)  # type: ignore[arg-type]
    generate(arguments.folder, config)
    scene, views = make_scene(config), CaptureViews(arguments.folder / "capture")
    found: dict[str, list[float]] = {"pane": [], "open": []}
    for plane in [*panes(scene), *open_places(scene)]:
        plane = UprightPlane(plane.kind, plane.axis, plane.at + arguments.off, plane.low, plane.high)
        reflectance, images = views.reflectance(scene, plane)
        if images >= 3:
            found[plane.kind].append(reflectance)
            print(f"{plane.kind} {reflectance:.4f} in {images} images", flush=True)
    figures: dict[str, Any] = {}
    for kind, values in found.items():
        figures[kind] = len(values)
        figures[f"{kind}_below_limit"] = sum(v < LIMIT for v in values)
        figures[f"{kind}_median"] = round(float(np.median(values)), 4) if values else None
    report(figures)


def panes(scene: Scene) -> Iterator[UprightPlane]:
    """The middle of each pane that reaches the floor."""
    for box in scene.boxes:
        axis = int(box.hi[0] - box.lo[0] > box.hi[1] - box.lo[1])
        low, high = box.lo[1 - axis] + 0.15, box.hi[1 - axis] - 0.15
        if box.glass and box.lo[2] < 0.1 and high - low > 0.5:
            middle = (low + high) / 2
            at = (box.lo[axis] + box.hi[axis]) / 2
            yield UprightPlane("pane", axis, at, max(low, middle - 0.75), min(high, middle + 0.75))


def open_places(scene: Scene) -> Iterator[UprightPlane]:
    """Planes of 0.9 m across the trajectory, at every ninth image."""
    for i in range(5, len(scene.walk) - 3, 9):
        before, after = scene.walk[i, :2], scene.walk[i + 2, :2]
        if np.hypot(*(after - before)) >= 0.4:
            axis = int(abs(after - before)[0] <= abs(after - before)[1])
            at = (before + after) / 2
            yield UprightPlane("open", axis, float(at[axis]), float(at[1 - axis] - 0.45), float(at[1 - axis] + 0.45))


class CaptureViews:
    """Images of a capture, and pictures of its LiDAR scan from their cameras."""

    def __init__(self, capture: Path) -> None:
        self._images, cloud = capture / "images", read_cloud(capture / "points.ply", Findings())
        self._points, self._colors = cloud.points, np.asarray(cloud.colors, np.float32) / 255
        self._seen: dict[int, tuple[NDArray[np.float32], ...]] = {}

    def reflectance(self, scene: Scene, plane: UprightPlane) -> tuple[float, int]:
        """The share of the mirrored color in the images that look through a plane, and the number of these images."""
        middle = np.zeros(3)
        middle[[plane.axis, 1 - plane.axis]] = plane.at, (plane.low + plane.high) / 2
        middle[2] = 1.2
        chosen = []
        for i in range(len(scene.walk)):
            camera = scene.camera(i).scaled(WIDTH, HEIGHT)
            there = middle - camera.position
            if NEAR < np.hypot(*there[:2]) < FAR and camera.rotation[:, 2] @ there > 0.7 * np.linalg.norm(there):
                chosen.append((i, camera))
        above, below, images = 0.0, 0.0, 0
        for i, camera in chosen[:: max(1, len(chosen) // IMAGES)][:IMAGES]:
            found = self._regressed(i, camera, plane)
            if found is not None:
                above, below, images = above + found[0], below + found[1], images + 1
        return above / max(below, 1e-9), images

    def _regressed(self, index: int, camera: Camera, plane: UprightPlane) -> tuple[float, float] | None:
        """Numerator and denominator of the reflectance in one image; None if it shows too little behind the plane."""
        if index not in self._seen:
            image = cv2.imread(str(self._images / f"{index:05d}.jpg"))[..., ::-1]
            small = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float32) / 255
            self._seen[index] = small, *drawn(self._points, self._colors, camera)
        image, depth, behind = self._seen[index]
        axis, rays, eye = plane.axis, camera.rays(), camera.position
        with np.errstate(divide="ignore"):
            ahead = (plane.at - eye[axis]) / rays[..., axis]
        along, height = (eye[c] + ahead * rays[..., c] for c in (1 - axis, 2))
        inside = (ahead > 0) & (along > plane.low) & (along < plane.high) & (height > 0.3) & (height < 2.0)
        inside &= np.isfinite(depth) & (depth > ahead * (rays @ camera.rotation[:, 2]) + 0.3)
        before = (self._points[:, axis] - plane.at) * np.sign(eye[axis] - plane.at) > 0.02
        mirrored = self._points[before].copy()
        mirrored[:, axis] = 2 * plane.at - mirrored[:, axis]
        far, reflection = drawn(mirrored, self._colors[before], camera)
        use = cv2.erode((inside & np.isfinite(far)).astype(np.uint8), np.ones((3, 3))) > 0
        if use.sum() < FEW:
            return None
        seen, through, mirror = (cv2.GaussianBlur(v, (0, 0), 1.0)[use] for v in (image, behind, reflection))
        above = below = 0.0
        for c in range(3):
            # The rest of the color may differ by a gain, an offset, and a slope across the image.
            others = np.stack([np.ones(use.sum()), through[:, c], rays[use] @ camera.rotation[:, 0]], axis=1)
            both = np.stack([mirror[:, c], seen[:, c]], axis=1) - through[:, c : c + 1]
            expected, left = (both - others @ np.linalg.lstsq(others, both, rcond=None)[0]).T
            usual = np.abs(left) < 2.5 * 1.48 * np.median(np.abs(left)) + 1e-4
            above += float((expected * left)[usual].sum())
            below += float((expected**2)[usual].sum())
        return above, below


def drawn(
    points: NDArray[np.float32], colors: NDArray[np.float32], camera: Camera
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Depth (H, W), meters, inf where unknown, and color (H, W, 3), 0 to 1, of points (N, 3) with colors (N, 3)."""
    cloud, k = SplatCloud.of(points, np.full(len(points), RADIUS, np.float32)), camera.intrinsics
    depth, extent = np.full((HEIGHT, WIDTH), np.inf, np.float32), np.empty((HEIGHT, WIDTH), np.float32)
    shown = np.zeros((HEIGHT, WIDTH), np.int32)
    pose = np.ascontiguousarray(camera.world_to_camera[:3], np.float32)
    lens = np.array([k.fx, k.fy, k.cx, k.cy], np.float32)
    reach, largest, farthest = np.float32(0.87 + 0.1), np.float32(24), np.float32(1e6)
    _splat(
        cloud.points, cloud.radii, cloud.order, cloud.first, cloud.middles, reach, pose, lens, largest, farthest, depth,
        extent, shown,
    )  # fmt: skip
    return depth, np.where(np.isfinite(depth)[..., None], colors[shown], 0).astype(np.float32)


if __name__ == "__main__":
    main()
