"""Write drawn episodes in the layout of LeRobot that InternNav's training reads, one folder for each scan.

`data/chunk-000/episode_000000.parquet` has a row for each frame, `meta/episodes.jsonl` the instructions, and
`videos/chunk-000/` the images: `observation.images.rgb.125cm_0deg`, and 30 degrees down
`observation.images.rgb.125cm_30deg` and `observation.images.depth.125cm_30deg` (16 bits, millimeters).

For each frame, InternNav learns a pixel of the view that looks down: the farthest place of the path that this view
shows. If it shows none, InternNav learns the next turns.

Source: github.com/InternRobotics/InternNav, internnav/dataset/internvla_n1_lerobot_dataset.py.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim import __version__
from nvsim.dataset.frames import HEIGHT, LOOK_DOWN, WIDTH, DrawnEpisode, read_drawn
from nvsim.dataset.parquet import parquet_bytes
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import read_bytes
from nvsim.geometry.camera import Camera

LEVEL, DOWN = "125cm_0deg", "125cm_30deg"
"""Names of the cameras: height above the floor, and angle downward."""
SEPARATOR = "<INSTRUCTION_SEP>"
IMAGES = {
    f"observation.images.rgb.{LEVEL}": "rgb",
    f"observation.images.rgb.{DOWN}": "rgb_down",
    f"observation.images.depth.{DOWN}": "depth_down",
}
"""Folder of images below `videos/chunk-000` -> folder of the drawn episode."""
CHUNK = 1000
"""Number of episodes in a chunk."""
_FPS = 30  # as in InternNav's own data; a frame is a step, not a time
_HIDDEN = 0.25  # a place is hidden if the surface before it is nearer by more than this, in meters


def rows_of(episode: DrawnEpisode, actions: Sequence[int], depths: Sequence[NDArray[np.uint16]]) -> dict[str, Any]:
    """Returns the columns of the table of an episode with N frames.

    actions  as in StreamVLN's annotations: the action before each frame, -1 for the first
    depths   N images (H, W) uint16, millimeters along the optical axis of the view that looks down

    action, relative_goal_frame_id (N,) int64; goal (N, 2) int64, row and column of the pixel; pose (N, 4, 4) float64,
    camera to world, x to the right, y down, z along the optical axis. Without a goal, its values are -1.
    """
    cameras = [episode.camera(i, -LOOK_DOWN) for i in range(len(episode.poses))]
    goals = np.full((len(cameras), 3), -1, np.int64)
    for i, (camera, depth) in enumerate(zip(cameras, depths, strict=True)):
        found = _goal(camera, depth, episode.poses[i + 1 :, :3])
        if found is not None:
            goals[i] = found
    return {
        "action": np.array(actions, np.int64),
        f"pose.{DOWN}": np.stack([camera.camera_to_world for camera in cameras]),
        f"goal.{DOWN}": goals[:, 1:],
        f"relative_goal_frame_id.{DOWN}": goals[:, 0],
    }


def _goal(camera: Camera, depth: NDArray[np.uint16], places: NDArray[np.float64]) -> tuple[int, int, int] | None:
    """The number of frames until the last of the first consecutive `places` (M, 3) that the camera shows, with row and
    column of its pixel; None if it shows no place."""
    local = (places - camera.position) @ camera.rotation
    ahead = np.maximum(local[:, 2], 1e-6)
    k = camera.intrinsics
    columns = np.floor(k.fx * local[:, 0] / ahead + k.cx).astype(np.int64)
    rows = np.floor(k.fy * local[:, 1] / ahead + k.cy).astype(np.int64)
    inside = (local[:, 2] > 0) & (rows >= 0) & (rows < k.height) & (columns >= 0) & (columns < k.width)
    surface = depth[rows.clip(0, k.height - 1), columns.clip(0, k.width - 1)] / 1000
    shown = np.r_[inside & ((surface == 0) | (surface > local[:, 2] - _HIDDEN)), False]
    if not shown.any():
        return None
    first = int(shown.argmax())
    last = first + int(shown[first:].argmin()) - 1
    return last + 1, int(rows[last]), int(columns[last])


def write_lerobot(trajectories: Sequence[Mapping[str, Any]], frames: Path, folder: Path) -> list[tuple[Path, Path]]:
    """Writes the tables and descriptions of a scan into `folder`.

    trajectories  StreamVLN annotations of the scan
    frames        contains the drawn episodes, under the last part of `video`

    Returns the images that belong into `folder`, as pairs of a drawn file and its path. Raises InputError if a frame
    is missing or damaged, or if writing fails.
    """
    images: list[tuple[Path, Path]] = []
    episodes, tasks, total = [], [], 0
    for number, trajectory in enumerate(trajectories):
        drawn = read_drawn(frames / Path(trajectory["video"]).name)
        length, chunk = len(drawn.poses), f"chunk-{number // CHUNK:03d}"
        if length != len(trajectory["actions"]):
            raise InputError(f"{drawn.folder} belongs to other actions; export the dataset again.")
        depths = [_depth(drawn.folder / "depth_down" / f"{i:03d}.png") for i in range(length)]
        frame = np.arange(length)
        columns = rows_of(drawn, trajectory["actions"], depths)
        columns |= {"timestamp": frame / _FPS, "frame_index": frame, "index": total + frame}
        columns |= {name: np.full(length, number) for name in ("episode_index", "task_index")}
        atomic.write_bytes(folder / "data" / chunk / f"episode_{number:06d}.parquet", parquet_bytes(columns))
        for name, source in IMAGES.items():
            end = ".png" if "depth" in name else ".jpg"
            target = folder / "videos" / chunk / name
            images += [
                (drawn.folder / source / f"{i:03d}{end}", target / f"episode_{number:06d}_{i}{end}")
                for i in range(length)
            ]
        text = SEPARATOR.join(trajectory["instructions"])
        episodes.append({"episode_index": number, "tasks": [text], "length": length})
        tasks.append({"task_index": number, "task": text})
        total += length
    meta = folder / "meta"
    atomic.write_text(meta / "episodes.jsonl", "".join(json.dumps(one) + "\n" for one in episodes))
    atomic.write_text(meta / "tasks.jsonl", "".join(json.dumps(one) + "\n" for one in tasks))
    atomic.write_text(meta / "info.json", json.dumps(_info(len(episodes), total), indent=1) + "\n")
    return images


def _depth(path: Path) -> NDArray[np.uint16]:
    image = cv2.imdecode(np.frombuffer(read_bytes(path), np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.shape != (HEIGHT, WIDTH) or image.dtype != np.uint16:
        raise InputError(f"{path} is damaged; remove its folder and export the dataset again.")
    return np.asarray(image, np.uint16)


def _info(episodes: int, frames: int) -> dict[str, Any]:
    image = {"dtype": "image", "shape": [HEIGHT, WIDTH, 3], "names": ["height", "width", "channel"]}
    depth = {**image, "shape": [HEIGHT, WIDTH, 1]}
    features: dict[str, Any] = {name: depth if "depth" in name else image for name in IMAGES}
    numbers = ("action", f"relative_goal_frame_id.{DOWN}", "frame_index", "index", "episode_index", "task_index")
    features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in numbers}
    features["timestamp"] = {"dtype": "float64", "shape": [1], "names": None}
    features[f"goal.{DOWN}"] = {"dtype": "int64", "shape": [2], "names": ["row", "column"]}
    features[f"pose.{DOWN}"] = {"dtype": "float64", "shape": [4, 4], "names": None}
    return {
        "codebase_version": "v2.1",
        "robot_type": f"nvsim {__version__}",
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": episodes,
        "total_videos": 0,
        "total_chunks": -(-episodes // CHUNK),
        "chunks_size": CHUNK,
        "fps": _FPS,
        "splits": {"train": f"0:{episodes}"},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": None,
        "features": features,
    }
