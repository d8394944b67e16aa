"""A task together with the actions that follow its path, and its formats: VLN-CE and StreamVLN.

VLN-CE: `SPLIT/SPLIT.json.gz` (R2RVLN-v1), and `SPLIT/SPLIT_gt.json.gz` with the actions, as in habitat-lab's VLN
dataset and VLN-CE's R2R_VLNCE_v1-3. In VLN-CE's frame, y is up and an unrotated camera looks along -z. The point
(x, y, z) of NVSim is (x, z, -y) in VLN-CE. NVSim's heading is 0 along +y and grows to the right; VLN-CE's angle has the
opposite sign. Positions are on the floor.

StreamVLN: `annotations.json`, an array of {id, video, instructions, actions}, as in InternRobotics' trajectory data.
actions[i] is the action that leads to frame i, and -1 for the first frame; 1 is 0.25 m forward, 2 and 3 are 15 degrees
left and right. The loader adds a stop after the last action. `video` is the folder that contains the frames as
rgb/000.jpg and so on.
"""

from __future__ import annotations

import gzip
import io
import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.events import Listener, Progress, ignore_event
from nvsim.files import atomic
from nvsim.graph.types import NavGraph
from nvsim.r2r.episodes.episode_actions import FORWARD, TURN, ActionPath, FreeSpace, walk_along
from nvsim.r2r.surroundings.layers import Layers
from nvsim.r2r.tasks.splitting import Impassable
from nvsim.r2r.tasks.task import Task

STAGE = "episodes"


@dataclass(frozen=True, eq=False)
class Episode:
    """A task as a continuous episode.

    path     (M, 3) meters, world: the floor under the task's viewpoints
    walk     the actions and the poses before them
    floors   (N,) meters, world z of the floor before each action
    """

    task: Task
    path: NDArray[np.float64]
    walk: ActionPath
    floors: NDArray[np.float64]


class Scene:
    """A scan in which robots move. Paths between storeys have no episodes."""

    def __init__(self, graph: NavGraph, storeys: Sequence[Layers], cloud: NDArray[np.floating] | None = None) -> None:
        """`cloud` is (N, 3), meters, world, or None; see `FreeSpace.of`."""
        self._graph = graph
        self._spaces: dict[str, FreeSpace] = {}
        for layers in storeys:
            space = FreeSpace.of(layers, graph, cloud)
            self._spaces |= {one.viewpoint.id: space for one in layers.seen}

    def uses_stairs(self, path: Sequence[str]) -> bool:
        """Returns True if a path uses stairs. Obstacles on stairs cannot be found in a level slice."""
        return len({self._spaces.get(id) for id in path}) > 1 or path[0] not in self._spaces

    def impassable(self) -> Impassable:
        """Returns the edges and viewpoints that no episode can use, because of stairs or a lack of room."""
        at = {id: np.array(v.position[:2]) for id, v in self._graph.viewpoints.items() if v.included}
        edges = [key for key in self._graph.edges if key[0] in at and key[1] in at]
        return Impassable(
            tuple(k for k in edges if self.uses_stairs(k) or not self._spaces[k[0]].joins(at[k[0]], at[k[1]])),
            tuple(id for id in at if id not in self._spaces or not self._spaces[id].is_free(at[id])),
        )

    def episode(self, task: Task, turn: int = TURN) -> Episode | None:
        """Returns the episode of a task with turns of `turn` degrees, or None if the robot has no room along the path
        or would have to climb."""
        if self.uses_stairs(task.path):
            return None
        viewpoints = [self._graph.viewpoints[id] for id in task.path]
        space = self._spaces[task.path[0]]
        path = np.array([(*v.position[:2], v.position[2] - v.height) for v in viewpoints], np.float64)
        walk = walk_along(space, path, task.heading, turn)
        return None if walk is None else Episode(task, path, walk, _floors(path, walk.places))


def episodes_of(
    splits: Mapping[str, Iterable[Task]], scenes: Mapping[str, Scene], listen: Listener = ignore_event, turn: int = TURN
) -> dict[str, list[Episode]]:
    """Returns split -> episodes with turns of `turn` degrees, without the tasks that have none; `scenes` is by scan."""
    all_tasks = [(name, task) for name, tasks in splits.items() for task in tasks]
    found: dict[str, list[Episode]] = {name: [] for name in splits}
    for i, (name, task) in enumerate(all_tasks):
        episode = scenes[task.scan].episode(task, turn)
        if episode is not None:
            found[name].append(episode)
        listen(Progress(STAGE, i + 1, len(all_tasks)))
    return found


def instruction_id(task: Task, number: int) -> int:
    """Returns the id of an instruction that is unique over all paths: 100 * path_id + number."""
    return 100 * task.path_id + number


def number_instructions(episodes: Sequence[Episode]) -> Iterator[tuple[int, Episode, str]]:
    """Yields (`instruction_id`, episode, text) for every instruction."""
    for episode in episodes:
        for k, text in enumerate(episode.task.instructions):
            yield instruction_id(episode.task, k), episode, text


def _floors(path: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns (N,) the height of the nearest point of the path, for places (N, 2)."""
    a, b = path[:-1], path[1:]
    along = b[:, :2] - a[:, :2]
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((places[:, None] - a[:, :2]) * along).sum(axis=2) / square, 0, 1)
    off = np.linalg.norm(a[:, :2] + share[..., None] * along - places[:, None], axis=2)
    best, rows = off.argmin(axis=1), np.arange(len(places))
    return np.asarray(a[best, 2] + share[rows, best] * (b[best, 2] - a[best, 2]))


GOAL = 3.0
"""Distance to the goal in meters that counts as success, as in R2R."""
_PAD, _UNKNOWN = "<pad>", "<unk>"
_LONGEST = 200  # tokens of an instruction; shorter instructions are padded with zeros
_RARE = 2  # smallest number of occurrences of a known word
_BEGIN = -1


def write_vlnce(episodes: Mapping[str, Sequence[Episode]], folder: Path) -> list[Path]:
    """Writes both files of every split and returns the paths. Raises InputError if writing fails."""
    texts = [text for split in episodes.values() for _, _, text in number_instructions(split)]
    words = vocabulary(texts)
    files: dict[Path, dict[str, Any]] = {}
    for name, split in episodes.items():
        items = [_episode(id, episode, text, words) for id, episode, text in number_instructions(split)]
        files[folder / name / f"{name}.json.gz"] = {"episodes": items, "instruction_vocab": {"word_list": words}}
        files[folder / name / f"{name}_gt.json.gz"] = {
            str(id): ground_truth_actions(one) for id, one, _ in number_instructions(split)
        }
    for path, data in files.items():
        atomic.write_bytes(path, gzip_bytes(data))
    return list(files)


def vocabulary(texts: Sequence[str]) -> list[str]:
    """Returns the padding token, the unknown token, and then the words of all texts in alphabetical order.

    Words that occur only once are not included.
    """
    counts = Counter(word for text in texts for word in tokens(text))
    return [_PAD, _UNKNOWN, *sorted(word for word, count in counts.items() if count >= _RARE)]


def tokens(text: str) -> list[str]:
    """Splits a text into lower-case words and punctuation marks."""
    return re.findall(r"[a-z0-9]+(?:['.-][a-z0-9]+)*|[^\sa-z0-9]", text.lower())


def in_habitat(places: NDArray[np.floating]) -> list[list[float]]:
    """Converts places (N, 3), meters, world, to VLN-CE's frame, in meters rounded to millimeters."""
    x, y, z = np.asarray(places, np.float64).T
    return np.round(np.stack([x, z, -y], axis=1) + 0.0, 3).tolist()


def rotation_of(heading: float) -> list[float]:
    """Returns the VLN-CE rotation (x, y, z, w) of an agent with this heading (radians)."""
    return [0.0, round(-math.sin(heading / 2), 6) + 0.0, 0.0, round(math.cos(heading / 2), 6)]


def _episode(id: int, episode: Episode, text: str, words: Sequence[str]) -> dict[str, Any]:
    index = {word: i for i, word in enumerate(words)}
    numbers = [index.get(word, index[_UNKNOWN]) for word in tokens(text)][:_LONGEST]
    tokens_of = numbers + [0] * (_LONGEST - len(numbers))
    about = {"instruction_text": text, "instruction_tokens": tokens_of}
    return {"episode_id": id, "trajectory_id": episode.task.path_id, **episode_fields(episode), "instruction": about}


def episode_fields(episode: Episode) -> dict[str, Any]:
    """Returns the scene, the start, the goal, and the path of an episode with the keys of VLN-CE."""
    task, path = episode.task, in_habitat(episode.path)
    return {
        "scene_id": scene_id(task.scan),
        "start_position": path[0],
        "start_rotation": rotation_of(task.heading),
        "info": {"geodesic_distance": round(_length(episode.path), 3)},
        "goals": [{"position": path[-1], "radius": GOAL}],
        "reference_path": path,
    }


def scene_id(scan: str) -> str:
    """Returns the file that Habitat opens for a scan, below its folder of scenes."""
    return f"nvsim/{scan}/{scan}.glb"


def ground_truth_actions(episode: Episode) -> dict[str, Any]:
    """Returns the actions of an episode and the places before them, as VLN-CE reads them."""
    walk = episode.walk
    places = in_habitat(np.column_stack([walk.places, episode.floors]))
    return {
        "locations": places,
        "forward_steps": walk.actions.count(FORWARD),
        "actions": list(walk.actions),
    }


def _length(path: NDArray[np.floating]) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def gzip_bytes(data: Mapping[str, Any]) -> bytes:
    """Compresses data as gzip without a time stamp, so that equal data gives equal bytes."""
    buffer = io.BytesIO()
    with gzip.GzipFile(fileobj=buffer, mode="wb", mtime=0) as file:
        file.write(json.dumps(data, separators=(",", ":")).encode())
    return buffer.getvalue()


def write_streamvln(episodes: Mapping[str, Sequence[Episode]], folder: Path) -> list[Path]:
    """Writes `SPLIT/annotations.json` for every split and returns the paths. Raises InputError if writing fails."""
    written = []
    for name, split in episodes.items():
        lines = ",\n".join(json.dumps(_trajectory(episode)) for episode in split)
        written.append(folder / name / "annotations.json")
        atomic.write_text(written[-1], f"[\n{lines}\n]\n" if lines else "[]\n")
    return written


def _trajectory(episode: Episode) -> dict[str, Any]:
    task = episode.task
    return {
        "id": task.path_id,
        "video": f"images/{video_name(task)}",
        "instructions": list(task.instructions),
        "actions": [_BEGIN, *episode.walk.actions[:-1]],
    }


def video_name(task: Task) -> str:
    """Returns the name of the folder with the frames of a task."""
    return f"{task.scan}_r2r_{task.path_id:06d}"
