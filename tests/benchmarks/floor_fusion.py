"""Compare floor masks from geometry, from a semantic network, from both fused, and from the hybrid provider.

python -m tests.benchmarks.floor_fusion PROJECT --semantic NAME [--normals NAME] [--truth DIR | --judge PROJECT]
    [--every 1] [--as-it-is]

Each provider gets the original LiDAR scan and three degraded ones: with holes in the floor, without objects on the
floor, and with a tenth of the points. The project does not change. NAME is an installed model (`nvsim models`), or
bundled. Without a network of normals, the hybrid uses the normals of the point cloud. `--judge` names a project of the
same trajectory with a dense scan. Its certain labels are the ground truth, also for a project of images only.
`--as-it-is` skips the degraded scans.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.capture.images import read_image
from nvsim.capture.types import Cloud
from nvsim.cli import terminal
from nvsim.errors import InputError
from nvsim.evaluation.frame_truth import frame_truth
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.perception.fused import FusedFloor, calibrate
from nvsim.perception.geometric_roles import CloudNormals
from nvsim.perception.hybrid import HybridFloor
from nvsim.perception.normals_network import NormalsNetwork, installed_normals
from nvsim.perception.obstacles import BuildingObstacles
from nvsim.perception.regions import RegionGrowing
from nvsim.perception.roles import Float32, Mask
from nvsim.perception.segment import SegmentConfig, learnt_floor
from nvsim.perception.semantic_network import SemanticNetwork
from nvsim.project.config import FloorsConfig
from nvsim.project.floor_provider import choose
from nvsim.project.project import Project
from nvsim.project.stages.depths import depth_maps
from nvsim.project.work import missing_result_error

_RADIUS, _APART = 0.7, 2.0  # radius of a hole, and approximate distance between holes, meters
_LOW, _HIGH = 0.05, 1.0  # meters above the floor: range of the removed objects


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]
    semantic: str
    normals: str = "geometry"
    truth: Path | None = None
    judge: Path | None = None
    as_it_is: bool = False
    every: int = 1
    """Evaluate one in this many frames."""


def worlds(scan: Cloud, surface: FloorSurface) -> Iterator[tuple[str, Cloud]]:
    """Yields the scan and its degraded versions, each with a name."""
    rng = np.random.default_rng(0)
    points = scan.points
    height = points[:, 2] - surface.height_at(points[:, :2])
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    centers = rng.uniform(low, high, (int(np.prod((high - low) / _APART)), 2))
    near = cKDTree(centers).query(points[:, :2])[0] < _RADIUS
    yield "original", scan
    yield "holes in the floor", _only(scan, ~(near & (height < _LOW)))
    yield "objects missing", _only(scan, ~(near & (height > _LOW) & (height < _HIGH)))
    yield "a tenth of the points", _only(scan, rng.random(len(points)) < 0.1)


def _only(cloud: Cloud, kept: NDArray[np.bool_]) -> Cloud:
    colors, normals = (None if v is None else v[kept] for v in (cloud.colors, cloud.normals))
    return replace(cloud, points=cloud.points[kept], colors=colors, normals=normals)


class Remembered:
    """A semantic role that evaluates each image once and caches the result for all scans."""

    def __init__(self, network: SemanticNetwork) -> None:
        self._network, self._seen = network, dict[bytes, Float32]()

    def floor_probability(self, image, camera):  # type: ignore[no-untyped-def]
        key = camera.camera_to_world.tobytes()
        if key not in self._seen:
            self._seen[key] = self._network.floor_probability(image, camera)
        return self._seen[key]


class RememberedNormals:
    """A role of normals that evaluates each image once and caches the result for all scans."""

    def __init__(self, network: NormalsNetwork) -> None:
        self._network, self._seen = network, dict[bytes, Float32]()

    def normals(self, image, camera):  # type: ignore[no-untyped-def]
        key = camera.camera_to_world.tobytes()
        if key not in self._seen:
            self._seen[key] = self._network.normals(image, camera).astype(np.float16)
        return self._seen[key].astype(np.float32)


class Reliability:
    """The expected calibration error of probabilities: the mean difference of confidence and accuracy over 15 bins of
    confidence, weighted by their pixels (Guo et al. 2017)."""

    def __init__(self) -> None:
        self._sums = np.zeros((3, 15))  # pixels, confidence, and right pixels

    def add(self, probability: Float32, truth: Mask) -> None:
        """Adds pixels (N,)."""
        confidence = np.maximum(probability, 1 - probability).astype(float)
        bins = np.minimum((confidence - 0.5) * 30, 14).astype(int)
        for row, weights in enumerate((None, confidence, (probability > 0.5) == truth)):
            self._sums[row] += np.bincount(bins, weights, 15)

    @property
    def error(self) -> float:
        """0 to 1."""
        return float(np.abs(self._sums[1] - self._sums[2]).sum() / max(1, self._sums[0].sum()))


def scores(pairs: list[tuple[Mask, Mask]]) -> tuple[str, str, str, str]:
    """Mean IoU over frames with at least 1 % of true floor, precision and recall over all their pixels, and the mean
    share of pixels that are called floor in the other frames ("" if there are none). `pairs` has the predicted and the
    true mask of the counted pixels (N,) of each frame; frames without counted pixels are skipped."""
    pairs = [(m, t) for m, t in pairs if len(t)]
    counted = [(m, t) for m, t in pairs if t.mean() >= 0.01]
    without = [m.mean() for m, t in pairs if t.mean() < 0.01]
    hits = sum(int((m & t).sum()) for m, t in counted)
    found, true = (sum(int(pair[k].sum()) for pair in counted) for k in (0, 1))
    ious = [(m & t).sum() / max(1, (m | t).sum()) for m, t in counted]
    wrong = f"{np.mean(without):.3f}" if without else ""
    return f"{np.mean(ious):.3f}", f"{hits / max(1, found):.3f}", f"{hits / max(1, true):.3f}", wrong


def main() -> None:
    """Runs the comparison and prints its table. Raises InputError if the project has no LiDAR scan."""
    arguments = tyro.cli(Arguments, description=__doc__)
    a = arguments
    models = choose(FloorsConfig("fused", semantic=a.semantic), lambda: None).models
    looks = Remembered(SemanticNetwork(models["semantic"].open()))
    faces = None if a.normals == "geometry" else RememberedNormals(installed_normals(a.normals))
    with Project.open(a.project) as project, Project.open(a.judge or a.project) as judge:
        capture, scan, submaps = project.need_capture(), project.scan(), project.need_submaps()
        truth, depths = frame_truth(judge, a.truth, a.judge is not None), depth_maps(project)
        if scan is None:
            raise InputError(f"{a.project} has no LiDAR scan; choose a project with one.")
        surfaces: dict[int, FloorSurface] = {}
        for submap in submaps:
            surface = project.surface(submap.index)
            if surface is None:
                raise missing_result_error(a.project, "floors")
            surfaces[submap.index] = surface
        frames = range(0, len(capture.frames), a.every)
        true = set(frames) & set(truth.frames)
        rows = []
        for name, cloud in worlds(scan, surfaces[submaps[0].index]):
            if a.as_it_is and rows:
                break
            found: dict[str, list[tuple[Mask, Mask]]] = {}
            unsure, raw, tempered = list[bool](), Reliability(), Reliability()
            whole, how = replace(capture, cloud=cloud), SegmentConfig()
            owner = {i: surfaces[s.index] for s in submaps for i in s.core}
            obstacles = BuildingObstacles(whole, [owner[i] for i in range(len(owner))], how.geometric.obstacles)
            for submap in submaps:
                floor, around = learnt_floor(whole, list(submap.core), surfaces[submap.index], obstacles, how, depths)
                hybrid = HybridFloor(looks, faces or CloudNormals(floor, around.cloud()), RegionGrowing())
                calibrated = calibrate(looks, floor, around.views, around.threads)
                print(f"{name}, submap {submap.index}: temperature {calibrated.temperature:.2f}", flush=True)
                providers = {
                    "geometry": floor, "fused": FusedFloor(floor, calibrated, faces),
                    "fused uncalibrated": FusedFloor(floor, looks, faces), "hybrid": hybrid,
                }  # fmt: skip
                for i in submap.core:
                    if i not in true:
                        continue
                    frame = capture.frames[i]
                    size = frame.intrinsics.limited_to(SegmentConfig().longest_side)
                    camera, image = frame.camera.scaled(size.width, size.height), read_image(frame, size)
                    right, known = truth.floor(i, size.width, size.height)
                    depth = None if depths is None else depths(i)
                    for who, provider in providers.items():
                        made = provider.segment(camera, image, depth)
                        found.setdefault(who, []).append((made.mask[known], right[known]))
                        if who == "fused":
                            unsure.append(made.failure == "unsure")
                    likely = looks.floor_probability(image, camera)
                    raw.add(likely[known], right[known])
                    tempered.add(calibrated.floor_probability(image, camera)[known], right[known])
                    mask = likely > 0.5
                    found.setdefault("network alone", []).append((mask[known], right[known]))
                    if faces is not None:
                        flat = faces.normals(image, camera)[..., 2] >= 0.9
                        found.setdefault("normals alone", []).append((flat[known], right[known]))
            print(f"{name}: calibration error {raw.error:.3f}, calibrated {tempered.error:.3f}")
            for word, part in (("unsure", True), ("other", False)):
                pairs = [pair for pair, u in zip(found["fused"], unsure, strict=True) if u == part]
                print(f"{len(pairs)} {word} masks" + (f": IoU {scores(pairs)[0]}" if pairs else ""))
            rows += [(name, who, *scores(pairs)) for who, pairs in found.items()]
    terminal.table(("scan", "masks by", "IoU", "precision", "recall", "floor where none is"), rows, a.project.name)


if __name__ == "__main__":
    main()
