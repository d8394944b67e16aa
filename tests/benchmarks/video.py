"""Score the camera poses that `nvsim poses` computes against true ones: a table and one JSON line.

python tests/benchmarks/video.py SOURCE TRUTH OUT [--reuse] [--truth-capture PATH] [--every N]

SOURCE is a video, or a folder of videos or photos. TRUTH is a folder with poses.txt and camera.txt, in the format of
hand_held.py, for the frames of the first video. With --truth-capture, the poses of that capture (COLMAP,
transforms.json, ...) are the truth, matched by file name, and TRUTH is not read. With --reuse, the existing OUT is
scored. With --every N, frame k of SOURCE is frame N * k of TRUTH. For panoramas, the first view is scored, which has
the pose of the camera.

Positions are compared after the best similarity. If the unit of a true capture is unknown, read "cm" as hundredths of
that unit and compare `position_percent`, a percentage of the extent of the trajectory.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import tyro
from harness import report
from numpy.typing import NDArray
from trajectory_scores import FAR, read_poses, score

from nvsim.capture.read import read

_MEASURED = "benchmark.json"


@dataclass(frozen=True)
class Arguments:
    source: tyro.conf.Positional[Path]
    truth: tyro.conf.Positional[Path]
    out: tyro.conf.Positional[Path]
    reuse: bool = False
    truth_capture: Path | None = None
    every: int = 1


@dataclass(frozen=True, eq=False)
class Truth:
    """poses   camera-to-world matrices (4, 4) float64, by image name without its suffix
    focal   focal length, pixels
    width   width of the images to which the focal length belongs, pixels
    """

    poses: dict[str, NDArray[np.float64]]
    focal: float
    width: int


def main() -> int:
    arguments = tyro.cli(Arguments, description=__doc__)
    measured = arguments.out / _MEASURED
    if not arguments.reuse:
        figures = compute_poses(arguments.source, arguments.out)
        if figures is None:
            return 1
        measured.write_text(json.dumps(figures))
    cost: dict[str, float] = json.loads(measured.read_text()) if measured.is_file() else {}
    given = arguments.truth_capture
    truth = truth_of_folder(arguments.truth, arguments.every) if given is None else truth_of_capture(given)
    result = {**scored(arguments.out, truth), **cost}
    if "cpu_seconds" in cost:
        result["cpu_seconds_per_frame"] = round(cost["cpu_seconds"] / max(result["chosen_frames"], 1), 3)
    report(result)
    return 0


def compute_poses(source: Path, out: Path) -> dict[str, float] | None:
    """Runs `nvsim poses`. Returns wall seconds, CPU seconds, and the peak memory of its largest process in MB. If it
    fails, prints its last lines and returns None."""
    command = [sys.executable, "-m", "nvsim", "poses", str(source), "--out", str(out), "--json"]
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        print("\n".join(done.stdout.splitlines()[-12:]), file=sys.stderr)
        print(json.dumps({"failed": done.returncode}))
        return None
    return {
        "wall_seconds": round(time.perf_counter() - started, 1),
        "cpu_seconds": round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1),
        "memory_mb": round(after.ru_maxrss / 1024, 1),
    }


def truth_of_folder(folder: Path, every: int = 1) -> Truth:
    """The poses and the camera of a video that consists of every `every`-th frame of the folder."""
    _, width, _, focal, *_ = (folder / "camera.txt").read_text().split()
    read = read_poses(folder / "poses.txt")
    poses = {f"0_{number // every:06d}": pose for number, pose in read.items() if number % every == 0}
    return Truth(poses, float(focal), int(width))


def truth_of_capture(path: Path) -> Truth:
    """The poses of a capture, and the lens of its first frame."""
    frames = read(path).frames
    lens = frames[0].lens
    return Truth({Path(f.name).stem: f.camera_to_world for f in frames}, float(np.mean(lens.focal)), lens.width)


def scored(out: Path, truth: Truth) -> dict[str, Any]:
    """Metrics of the model in `out`/sparse/0. Raises ValueError if fewer than three of its images have a true pose."""
    model = pycolmap.Reconstruction(str(out / "sparse" / "0"))
    report = out / "poses.json"
    told: dict[str, Any] = json.loads(report.read_text()) if report.is_file() else {}
    views = int(told.get("views", 1))
    registered = [model.images[i] for i in model.reg_image_ids()]
    found = {Path(image.name).stem: image for image in registered if views == 1 or image.name.startswith("side0/")}
    names = sorted(name for name in found if name in truth.poses)
    if len(names) < 3:
        raise ValueError(f"Only {len(names)} of {len(found)} images with a pose have a true pose of the same name.")
    estimated = np.array([camera_to_world(found[name].cam_from_world().matrix()) for name in names])
    scores = score(estimated, np.array([truth.poses[name] for name in names]))
    camera = model.cameras[found[names[0]].camera_id]
    focal = float(np.mean([camera.focal_length_x, camera.focal_length_y])) * truth.width / camera.width
    chosen = int(told.get("frames", len(found)))
    if views > 1:
        focal = truth.focal  # the focal length is given; it is not that of the true camera
    return {
        "chosen_frames": chosen,
        "registered": len(found),
        "registered_images": len(registered),
        "registered_percent": round(100 * len(found) / max(chosen, 1), 1),
        "compared": len(names),
        "position_median_cm": round(100 * scores.position_median, 2),
        "position_max_cm": round(100 * scores.position_max, 2),
        "position_percent": round(100 * scores.position_median / max(scores.extent, 1e-9), 3),
        "rotation_median_deg": round(scores.rotation_median, 3),
        "relative_median_deg": round(scores.relative_median, 4),
        "relative_max_deg": round(scores.relative_max, 3),
        "focal_error_percent": round(100 * (focal / truth.focal - 1), 2),
        f"over_{FAR:g}_m_off": scores.far,
        "pieces": told.get("pieces"),
        "loops": told.get("loops"),
        "residual_px": round(float(model.compute_mean_reprojection_error()), 3),
    }


def camera_to_world(world_to_camera: NDArray[np.floating]) -> NDArray[np.float64]:
    """The inverse (4, 4) of a rigid (3, 4) matrix."""
    rotation, shift = world_to_camera[:, :3], world_to_camera[:, 3]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.T, -rotation.T @ shift
    return pose


if __name__ == "__main__":
    sys.exit(main())
