"""Write tasks as Room-Across-Room (RxR): guide annotations, and pose traces of a guide who speaks along the path.

`rxr_SPLIT_guide.jsonl.gz` has an object for each instruction. Its words have times: a guide speaks a word in WORD
seconds and pauses for PAUSE seconds after a sentence. `pose_traces/rxr_SPLIT/ID_guide_pose_trace.npz` has the camera
every SNAPSHOT seconds. The camera is at the viewpoint that the words describe, and turns from the direction of arrival
to the direction of departure. With episodes, `RxR_VLNCE_v0/SPLIT/SPLIT_guide.json.gz` has them as RxR-VLN-CE-v1, with
turns of 30 degrees.

The arrays have the shapes that RxR's viewer expects, which differ from those in its README.

Source: github.com/google-research-datasets/RxR, README and visualizations; VLN-CE, habitat_extensions/task.py.
"""

from __future__ import annotations

import gzip
import io
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.events import Listener, Progress
from nvsim.files import atomic
from nvsim.graph.types import NavGraph
from nvsim.r2r.episodes.episode import Episode, episode_fields, ground_truth_actions, gzip_bytes, instruction_id
from nvsim.r2r.instructions.generating import InstructedDataset
from nvsim.r2r.instructions.ground import wrap_angle
from nvsim.r2r.tasks.task import Task

STAGE = "rxr"
TURN = 30
"""Degrees of a turn in RxR-VLN-CE."""
LANGUAGE = "en-US"
FIRST, WORD, PAUSE, SNAPSHOT = 0.4, 0.4, 0.4, 0.1  # seconds
_TURNING = 0.7  # share of the time at a viewpoint after which the camera looks to the next one
VFOV, ASPECT, NEAR, FAR = math.radians(60), 4 / 3, 0.1, 100.0  # camera of the guide
ROWS, COLUMNS = 128, 256  # pixels of a panorama mask
_TRACE = re.compile(r"\d{6,}_guide_pose_trace\.npz")


@dataclass(frozen=True, eq=False)
class TimedInstruction:
    """An instruction with the times of its words.

    task    the path
    number  of the instruction among those of the path
    places  for each word, the index of a viewpoint of the path, not decreasing
    starts  (words,) seconds at which each word begins
    """

    task: Task
    number: int
    places: tuple[int, ...]
    starts: NDArray[np.float64]

    @property
    def words(self) -> list[str]:
        return self.task.instructions[self.number].split()

    @property
    def id(self) -> int:
        return instruction_id(self.task, self.number)


def guide_of(task: Task, number: int, places: Sequence[int] = ()) -> TimedInstruction:
    """Returns the guide of an instruction. Without `places`, the words are spread evenly over the path."""
    words = task.instructions[number].split()
    if len(places) != len(words):
        places = [i * len(task.path) // len(words) for i in range(len(words))]
    starts, now = [], FIRST
    for word in words:
        starts.append(now)
        now += WORD + PAUSE * word.endswith((".", "!", "?"))
    return TimedInstruction(task, number, tuple(places), np.array(starts, np.float64))


def annotation_of(guide: TimedInstruction, split: str) -> dict[str, Any]:
    """Returns the guide annotation with the keys of RxR."""
    task = guide.task
    return {
        "path_id": task.path_id,
        "split": split,
        "scan": task.scan,
        "heading": task.heading,
        "path": list(task.path),
        "instruction_id": guide.id,
        "annotator_id": 0,
        "language": LANGUAGE,
        "instruction": task.instructions[guide.number],
        "timed_instruction": _with_times(guide),
        "edit_distance": 0.0,
    }


def _with_times(guide: TimedInstruction) -> list[dict[str, Any]]:
    return [
        {"start_time": round(start, 2), "word": word, "end_time": round(start + WORD, 2)}
        for word, start in zip(guide.words, guide.starts.tolist())
    ]


def pose_trace_of(guide: TimedInstruction, positions: NDArray[np.floating]) -> dict[str, NDArray[Any]]:
    """Returns the arrays of a pose trace with n snapshots, k viewpoints, and m words.

    positions  (k, 3) meters, world, of the cameras along the path

    pano (n,) str, time (n,) float64 seconds; extrinsic_matrix (n, 4, 4) float64, camera to world with y up, and
    intrinsic_matrix (n, 4, 4) float64, OpenGL projection; image_mask (k, 128, 256) bool, heading 0 in the middle;
    text_masks (k, m) bool; feature_weights (k, 36) float32, in the order of MatterSim's view index.
    """
    k = len(positions)
    arrivals, turns = _headings(np.asarray(positions, np.float64), guide.task.heading)
    begins = [0.0]
    for i in range(1, k):
        later = [s for place, s in zip(guide.places, guide.starts.tolist()) if place >= i]
        begins.append(max(begins[-1] + SNAPSHOT, min(later, default=0.0)))
    last = float(guide.starts[-1]) + WORD if len(guide.starts) else 0.0
    ends = np.array([*begins[1:], max(last, begins[-1] + SNAPSHOT)])
    time = np.arange(round(ends[-1] / SNAPSHOT) + 1) * SNAPSHOT
    at = np.clip(np.searchsorted(np.array(begins), time + SNAPSHOT / 2, side="right") - 1, 0, k - 1)
    share = np.clip((time - np.array(begins)[at]) / (ends - np.array(begins))[at] / _TURNING, 0, 1)
    cameras = np.stack([_camera(positions[i], arrivals[i] + s * turns[i]) for i, s in zip(at, share)])
    masks = np.stack([_pixels_seen(a, t) for a, t in zip(arrivals, turns)])
    return {
        "pano": np.array([guide.task.path[i] for i in at]),
        "time": time,
        "extrinsic_matrix": cameras,
        "intrinsic_matrix": np.tile(_projection(), (len(time), 1, 1)),
        "image_mask": masks,
        "text_masks": np.array(guide.places)[None] == np.arange(k)[:, None],
        "feature_weights": masks.reshape(k, -1)[:, _pixels_of_views()].mean(axis=2).astype(np.float32),
    }


def _headings(positions: NDArray[np.float64], first: float) -> tuple[list[float], list[float]]:
    """Returns the heading at the arrival at each viewpoint, and the turn to the next one, in radians."""
    arrivals, turns = [first], []
    for a, b in zip(positions, positions[1:]):
        x, y = (b - a)[:2].tolist()
        ahead = math.atan2(x, y) if math.hypot(x, y) > 1e-6 else arrivals[-1]
        turns.append(wrap_angle(ahead - arrivals[-1]))
        arrivals.append(ahead)
    return arrivals, [*turns, 0.0]


def _camera(position: NDArray[np.floating], heading: float) -> NDArray[np.float64]:
    """Returns (4, 4) camera to world with y up. In the camera, x is right, y is up, and -z is ahead."""
    sin, cos = math.sin(heading), math.cos(heading)
    x, y, z = (float(v) for v in position)
    return np.array([[cos, 0, -sin, x], [0, 1, 0, z], [sin, 0, cos, -y], [0, 0, 0, 1]])


def _projection() -> NDArray[np.float64]:
    f = 1 / math.tan(VFOV / 2)
    depth = [(NEAR + FAR) / (NEAR - FAR), 2 * NEAR * FAR / (NEAR - FAR)]
    return np.array([[f / ASPECT, 0, 0, 0], [0, f, 0, 0], [0, 0, *depth], [0, 0, -1, 0]])


def _pixels_seen(start: float, turn: float) -> NDArray[np.bool_]:
    """Returns (ROWS, COLUMNS) the pixels of a panorama that the camera shows while it turns."""
    headings = ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5) * 2 * math.pi
    slopes = np.abs(np.tan((0.5 - (np.arange(ROWS) + 0.5) / ROWS) * math.pi)) / math.tan(VFOV / 2)
    limits = np.minimum(math.atan(math.tan(VFOV / 2) * ASPECT), np.arccos(np.minimum(slopes, 1)))
    off = np.abs((headings - start - turn / 2 + math.pi) % (2 * math.pi) - math.pi) - abs(turn) / 2
    return np.asarray((off[None] <= limits[:, None]) & (slopes <= 1)[:, None])


@cache
def _pixels_of_views() -> NDArray[np.int64]:
    """Returns (36, samples) the pixels of a panorama mask that MatterSim's 36 views of 640x480 and 60 degrees show."""
    t = math.tan(VFOV / 2)
    x, y = np.meshgrid((np.arange(32) - 15.5) / 16 * t * ASPECT, (11.5 - np.arange(24)) / 12 * t)
    found = []
    for view in range(36):
        heading, up = math.radians(30 * (view % 12)), math.radians(30 * (view // 12 - 1))
        ahead, z = math.cos(up) - y * math.sin(up), math.sin(up) + y * math.cos(up)
        azimuth, elevation = heading + np.arctan2(x, ahead), np.arctan2(z, np.hypot(x, ahead))
        columns = np.floor((azimuth / (2 * math.pi) + 0.5) % 1 * COLUMNS).astype(np.int64) % COLUMNS
        rows = np.clip(np.floor((0.5 - elevation / math.pi) * ROWS).astype(np.int64), 0, ROWS - 1)
        found.append((rows * COLUMNS + columns).ravel())
    return np.stack(found)


def write_rxr(
    instructed: InstructedDataset,
    graphs: Sequence[NavGraph],
    episodes: Mapping[str, Sequence[Episode]],
    folder: Path,
    listen: Listener,
) -> list[Path]:
    """Writes the files of all splits into `folder` and returns their paths, without those of the pose traces.

    `episodes` have turns of TURN degrees; {} writes none. Pose traces of other tasks are removed. Raises InputError if
    writing fails.
    """
    by_scan = {graph.scan: graph for graph in graphs}
    splits = instructed.dataset.splits
    done, count = 0, sum(len(task.instructions) for tasks in splits.values() for task in tasks)
    written: list[Path] = []
    for split, tasks in splits.items():
        guides = list(_guides(tasks, instructed.places))
        traces = folder / "pose_traces" / f"rxr_{split}"
        atomic.make_folder(traces)
        names = {guide.id: f"{guide.id:06}_guide_pose_trace.npz" for guide in guides}
        atomic.remove_others(traces, set(names.values()), lambda one: bool(_TRACE.fullmatch(one.name)))
        for guide in guides:
            viewpoints = by_scan[guide.task.scan].viewpoints
            positions = np.array([viewpoints[id].position for id in guide.task.path], np.float64)
            buffer = io.BytesIO()
            np.savez_compressed(buffer, allow_pickle=False, **pose_trace_of(guide, positions))
            atomic.write_bytes(traces / names[guide.id], buffer.getvalue())
            done += 1
            listen(Progress(STAGE, done, count))
        lines = "".join(json.dumps(annotation_of(guide, split)) + "\n" for guide in guides)
        written.append(folder / f"rxr_{split}_guide.jsonl.gz")
        atomic.write_bytes(written[-1], gzip.compress(lines.encode(), mtime=0))
    for split, some in episodes.items():
        words = {guide.id: guide for guide in _guides([one.task for one in some], instructed.places)}
        ids = {
            id: one
            for one in some
            for k in range(len(one.task.instructions))
            if (id := instruction_id(one.task, k)) in words
        }
        place = folder / "RxR_VLNCE_v0" / split
        items = [_episode(one, words[id]) for id, one in ids.items()]
        for name, data in (
            ("guide", {"episodes": items}),
            ("guide_gt", {str(id): ground_truth_actions(ids[id]) for id in ids}),
        ):
            written.append(place / f"{split}_{name}.json.gz")
            atomic.write_bytes(written[-1], gzip_bytes(data))
    return written


def _guides(tasks: Sequence[Task], places: Mapping[int, Sequence[Sequence[int]]]) -> Iterator[TimedInstruction]:
    for task in tasks:
        known = places.get(task.path_id, ())
        for k, text in enumerate(task.instructions):
            if text.split():  # a text from an endpoint can be empty
                yield guide_of(task, k, known[k] if k < len(known) else ())


def _episode(episode: Episode, guide: TimedInstruction) -> dict[str, Any]:
    about = {
        "instruction_id": str(guide.id),
        "instruction_text": episode.task.instructions[guide.number],
        "language": LANGUAGE,
        "annotator_id": "0",
        "edit_distance": 0.0,
        "timed_instruction": _with_times(guide),
    }
    ids = {"episode_id": str(guide.id), "trajectory_id": str(episode.task.path_id)}
    return {**episode_fields(episode), **ids, "instruction": about}
