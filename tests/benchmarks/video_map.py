"""Evaluate the graph of a project from a video on the true map of the building.

python tests/benchmarks/video_map.py PROJECT TRUTH [--capture FOLDER]

TRUTH is a folder with poses.txt, camera.txt, and map.yaml, in the format of hand_held.py. The graph is moved to the
true frame by the rotation and shift that fit the cameras best. The scale of the project is kept, and its error is
printed. With --capture, the frames of the project are written with their true poses to FOLDER as transforms.json and
images. A project of that capture shows the map without pose errors.
"""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from harness import report
from numpy.typing import NDArray
from video import truth_of_folder

from nvsim.evaluation.graph import evaluate_graph
from nvsim.geometry.rotation import fitted_similarity
from nvsim.occupancy.read import read_map
from nvsim.occupancy.types import Heights
from nvsim.project.project import Project

_SHOWN = (
    *("nodes", "edges", "node_validity", "edge_validity", "node_validity_robot", "edge_validity_robot"),
    *("coverage", "coverage_seen", "components"),
)


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]
    truth: tyro.conf.Positional[Path]
    capture: Path | None = None


def main() -> int:
    a = tyro.cli(Arguments, description=__doc__)
    truth = truth_of_folder(a.truth)
    with Project.open(a.project) as project:
        frames = [f for f in project.need_capture().frames if Path(f.name).stem in truth.poses]
        true = np.array([truth.poses[Path(f.name).stem] for f in frames])
        if a.capture is not None:
            write_capture(a.capture, a.truth, [f.image_path for f in frames], true)
            return 0
        graph, support = project.need_graph(), project.support()
    ours = np.array([f.camera_to_world[:3, 3] for f in frames])
    scale, turn, _ = fitted_similarity(ours, true[:, :3, 3])
    center, true_center = ours.mean(axis=0), true[:, :3, 3].mean(axis=0)

    def moved(points: NDArray[np.floating]) -> NDArray[np.float64]:
        return (np.asarray(points, float) - center) @ turn.T + true_center

    def seen(places: NDArray[np.floating]) -> NDArray[np.bool_]:
        places = np.asarray(places, float)
        flat = np.concatenate([places[..., :2], np.full((*places.shape[:-1], 1), moved(feet)[..., 2].mean())], axis=-1)
        back = (flat - true_center) @ turn + center
        return np.asarray(support.is_supported(back[..., :2]), bool)

    feet = np.array([v.position for v in graph.viewpoints.values()])
    moved_viewpoints = {
        id: replace(v, position=tuple(moved(np.array(v.position)).tolist())) for id, v in graph.viewpoints.items()
    }
    result = evaluate_graph(
        replace(graph, viewpoints=moved_viewpoints),
        read_map(a.truth / "map.yaml", Heights()),
        moved(ours)[:, :2],
        seen=None if support is None else seen,
    )
    figures = {name: result[name] for name in _SHOWN if name in result}
    off = np.linalg.norm(moved(ours) - true[:, :3, 3], axis=1)
    figures |= {
        "frames": len(frames),
        "scale_error_percent": round(100 * (1 / scale - 1), 2),
        "tilt_deg": round(float(np.degrees(np.arccos(np.clip(turn[2, 2], -1, 1)))), 2),
        "position_median_cm": round(100 * float(np.median(off)), 1),
        "position_max_cm": round(100 * float(off.max()), 1),
    }
    report(figures)
    return 0


def write_capture(out: Path, truth: Path, images: list[Path], poses: NDArray[np.float64]) -> None:
    """Writes transforms.json and images to `out`. `poses` (N, 4, 4) are camera to world with OpenCV axes, meters."""
    model, width, height, focal, cx, cy, *distortion = (truth / "camera.txt").read_text().split()
    if model != "SIMPLE_RADIAL":
        raise SystemExit(f"{truth / 'camera.txt'} has a {model} camera, but only SIMPLE_RADIAL is supported.")
    (out / "images").mkdir(parents=True)
    camera = {"fl_x": float(focal), "fl_y": float(focal), "cx": float(cx), "cy": float(cy), "k1": float(distortion[0])}
    frames = []
    for image, pose in zip(images, poses, strict=True):
        shutil.copyfile(image, out / "images" / image.name)
        opengl = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
        frames.append({"file_path": f"images/{image.name}", "transform_matrix": opengl.tolist()})
    about = {"camera_model": "OPENCV", "w": int(width), "h": int(height), **camera}
    (out / "transforms.json").write_text(json.dumps({**about, "frames": frames}))


if __name__ == "__main__":
    sys.exit(main())
