"""Run all stages on a capture without its LiDAR scan, and print their cost and the scores of the results.

python tests/benchmarks/images_only.py PROJECT [--capture FOLDER | --seed N] [--truth FOLDER] [--occupancy MAP]

Without --capture, the built-in building of that seed is used. The capture is copied with links to its images and
without its scan. --truth contains depth/ and floor/ like the ground_truth folder of house_walk. --shaken simulates a
hand-held nerfstudio capture with poses from structure from motion: errors of 1 cm and 0.2 degrees, changing exposure,
motion blur, and JPEG.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parent))
from harness import cost, report

_STAGES = ("submaps", "depth", "floors", "train", "map")
_OFF, _TURNED, _EXPOSURE, _BLUR = 0.01, 0.2, 0.06, 4
"""Of a shaken capture: pose errors in meters and degrees, steps of the log exposure, and blur in pixels."""


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]
    capture: Path | None = None
    seed: int = 32
    size: str = "full"
    style: str = "furnished"
    shaken: bool = False
    truth: Path | None = None
    occupancy: Path | None = None
    camera_height: float | None = None
    images: int | None = None
    """Use only the first images of a kapture capture."""
    train: tuple[str, ...] = ()
    """Options of `nvsim train`, each as one word with its value: --train steps=500."""


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    capture, truth = arguments.capture, arguments.truth
    beside = arguments.project.with_suffix(".images")
    if capture is None:
        from nvsim.building import BuildingConfig, generate

        made = arguments.project.with_suffix(".building")
        generate(made, BuildingConfig(seed=arguments.seed, size=arguments.size, style=arguments.style))  # type: ignore[arg-type]
        capture, truth = made / "capture", made / "ground_truth"
    occupancy = arguments.occupancy or (None if truth is None else truth / "map.yaml")
    without_scan(capture, beside)
    if arguments.images is not None:
        keep_first(beside / "sensors", arguments.images)
    if arguments.shaken:
        shake(beside)
    height = [] if arguments.camera_height is None else ["--camera-height", str(arguments.camera_height)]
    project = ["--project", str(arguments.project)]
    figures: dict[str, Any] = {}

    def add(name: str, found: dict[str, Any]) -> None:
        figures[name] = found
        print(name, found, flush=True)

    add("import", cost("import", str(beside), *height, *project))
    for stage in _STAGES:
        options = [word for o in arguments.train for word in f"--{o}".split("=")] if stage == "train" else []
        add(stage, cost(stage, *options, *project))
    if truth is not None:
        add("evaluate depth", scored("depth", *project, "--truth", str(truth / "depth")))
        add("evaluate floor", scored("floor", *project, "--truth", str(truth)))
    if occupancy is not None:
        add("evaluate graph", scored("graph", *project, "--occupancy", str(occupancy)))
    add("evaluate views", scored("views", *project))
    report(figures, as_json=True)


def without_scan(capture: Path, folder: Path) -> None:
    """Copies a kapture or nerfstudio capture to `folder`: its poses and links to its images, without its scan."""
    folder.mkdir(parents=True, exist_ok=True)
    if (capture / "transforms.json").is_file():
        tree = json.loads((capture / "transforms.json").read_text())
        if tree.pop("ply_file_path", None) is not None:
            tree.setdefault("unit", "meter")  # the unit came from the scan
        for frame in tree["frames"]:
            frame["file_path"] = str((capture / frame["file_path"]).resolve())
        (folder / "transforms.json").write_text(json.dumps(tree))
        return
    sensors = folder / "sensors"
    (sensors / "records_data").mkdir(parents=True, exist_ok=True)
    for name in ("sensors.txt", "trajectories.txt", "records_camera.txt", "rigs.txt"):
        if (capture / "sensors" / name).is_file():
            lines = (capture / "sensors" / name).read_text().splitlines(keepends=True)
            (sensors / name).write_text("".join(line for line in lines if "lidar" not in line))
    for images in (capture / "sensors" / "records_data").iterdir():
        link = sensors / "records_data" / images.name
        if "lidar" not in images.name and not link.exists():
            link.symlink_to(images.resolve())


def shake(folder: Path) -> None:
    """Adds hand-held errors to the poses and images of a nerfstudio capture without scan. Its images become new
    files."""
    rng = np.random.default_rng(5)
    tree = json.loads((folder / "transforms.json").read_text())
    (folder / "shaken").mkdir(exist_ok=True)
    gain = np.zeros(3)
    for number, frame in enumerate(tree["frames"]):
        pose = np.array(frame["transform_matrix"])
        pose[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(np.radians(rng.normal(0, _TURNED, 3))).as_matrix()
        pose[:3, 3] += rng.normal(0, _OFF, 3)
        frame["transform_matrix"] = pose.tolist()
        gain = 0.9 * gain + rng.normal(0, _EXPOSURE) + rng.normal(0, _EXPOSURE / 4, 3)
        image = np.asarray(cv2.imread(frame["file_path"]), np.float32) * np.exp(gain)
        length = int(rng.integers(1, _BLUR + 1))
        image = cv2.blur(image, (length, 1)) if rng.random() < 0.5 else cv2.blur(image, (1, length))
        path = folder / "shaken" / f"{number:05d}.jpg"
        cv2.imwrite(str(path), np.clip(image + rng.normal(0, 2, image.shape), 0, 255), [cv2.IMWRITE_JPEG_QUALITY, 85])
        frame["file_path"] = str(path.resolve())
    (folder / "transforms.json").write_text(json.dumps(tree))


def keep_first(sensors: Path, images: int) -> None:
    """Removes the records of a kapture capture after its first images."""
    records = (sensors / "records_camera.txt").read_text().splitlines(keepends=True)
    records = [line for line in records if not line.startswith("#")][:images]
    (sensors / "records_camera.txt").write_text("# kapture format: 1.1\n" + "".join(records))


def scored(what: str, *words: str) -> dict[str, Any]:
    """The figures of an evaluation, and its cost."""
    with tempfile.TemporaryFile("w+") as printed:
        try:
            used = cost("evaluate", what, *words, "--json", output=printed)
            printed.seek(0)
            found = json.loads(printed.read().splitlines()[-1])
        except (subprocess.CalledProcessError, ValueError, IndexError) as error:
            return {"failed": str(error)}
    return used | {key: value for key, value in found.items() if not isinstance(value, dict | list)}


if __name__ == "__main__":
    main()
