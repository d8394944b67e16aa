"""Write tasks as goals: points and objects for Habitat, images of objects, and remote objects of REVERIE and SOON.

Starts, headings, and point goals are those of the tasks. An object is a goal of a task if the last viewpoint of its
path sees it within 3 m. Positions are in Habitat's frame, see `nvsim.r2r.episodes.episode`.

Sources: habitat-lab, habitat/datasets (PointNav-v1, ObjectNav-v1, InstanceImageNav-v1) and habitat/tasks/nav; REVERIE,
README and tasks/REVERIE/eval_release.py; VLN-DUET, map_nav_src/reverie/data_utils.py, and data_utils.py and env.py of
map_nav_src/soon.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic
from nvsim.graph.paths import PathGraph
from nvsim.graph.types import NavGraph
from nvsim.r2r.episodes.episode import gzip_bytes, in_habitat, rotation_of, scene_id
from nvsim.r2r.episodes.targets import HEIGHT, HFOV, WIDTH, Targets, angles_of, box_in, camera_at
from nvsim.r2r.instructions.phrases import plain_name
from nvsim.r2r.surroundings.naming import VAGUE, Shape
from nvsim.r2r.tasks.exporting import BOXES, reverie_file, soon_file
from nvsim.r2r.tasks.task import Task

CATEGORIES: tuple[Shape, ...] = (
    "chair", "plant", "sofa", "desk", "table", "low table", "bookshelf", "cabinet", "box", "platform",
)  # fmt: skip
"""Categories of object goals. The number of a category is its index. The names of a network follow."""
_WHOLE = 0.5  # smallest share of an object that its image contains


@dataclass(frozen=True, eq=False)
class GoalScene:
    """A scan and its objects."""

    graph: NavGraph
    targets: Targets

    @cached_property
    def _path_graph(self) -> PathGraph:
        return PathGraph.of(self.graph)

    @cached_property
    def _lengths(self) -> NDArray[np.float64]:
        return self._path_graph.lengths(np.arange(len(self._path_graph.ids)))

    def meters(self, start: str, end: str) -> float:
        """Returns the length of the shortest path between two viewpoints in meters."""
        return float(self._lengths[self._path_graph.ids.index(start), self._path_graph.ids.index(end)])

    def floor_at(self, id: str) -> NDArray[np.float64]:
        """Returns (3,) the floor under a viewpoint, meters, world."""
        v = self.graph.viewpoints[id]
        return np.array([*v.position[:2], v.position[2] - v.height], np.float64)

    def objects_at(self, id: str) -> list[int]:
        """Returns the objects with boxes in the views of a viewpoint."""
        return list(self.targets.boxes.get(id, ()))

    def name(self, thing: int) -> str:
        one = self.targets.things[thing]
        return plain_name(one.shape, one.color)


def write_goals(splits: Mapping[str, Sequence[Task]], scenes: Mapping[str, GoalScene], folder: Path) -> list[Path]:
    """Writes the files of all splits and returns their paths, without those of single viewpoints. `scenes` are by scan.

    Raises InputError if writing fails.
    """
    written = []
    for split, tasks in splits.items():
        data = {"pointnav": points_of(tasks, scenes), "objectnav": objects_of(tasks, scenes)}
        data["instance_imagenav"] = images_of(tasks, scenes)
        for name, content in data.items():
            written.append(folder / name / split / f"{split}.json.gz")
            atomic.write_bytes(written[-1], gzip_bytes(content))
        remote = list(remote_objects(tasks, scenes))
        written.append(folder / reverie_file(split))
        atomic.write_text(written[-1], json.dumps(remote, indent=1) + "\n")
        written.append(folder / soon_file(split))
        atomic.write_text(written[-1], "".join(json.dumps(outlined(item, scenes)) + "\n" for item in remote))
    boxes, single = boxes_of(scenes), folder / "reverie" / "BBox"
    atomic.make_folder(single)
    names = {f"{key}.json" for key in boxes}
    atomic.remove_others(single, names, lambda one: one.suffix == ".json" and one.name.partition("_")[0] in scenes)
    written.append(folder / BOXES)
    atomic.write_text(written[-1], json.dumps(boxes) + "\n")
    for key, found in boxes.items():
        id = key.partition("_")[2]
        atomic.write_text(single / f"{key}.json", json.dumps({id: found}) + "\n")
    return written


def _start(task: Task, number: int, scene: GoalScene) -> dict[str, Any]:
    return {
        "episode_id": str(number),
        "scene_id": scene_id(task.scan),
        "start_position": in_habitat(scene.floor_at(task.path[0])[None])[0],
        "start_rotation": rotation_of(task.heading),
        "start_room": None,
        "shortest_paths": None,
    }


def points_of(tasks: Sequence[Task], scenes: Mapping[str, GoalScene]) -> dict[str, Any]:
    """Returns the content of a PointNav-v1 file. The goal is the floor under the last viewpoint of each path."""
    episodes = []
    for i, task in enumerate(tasks):
        scene = scenes[task.scan]
        start, goal = scene.floor_at(task.path[0]), scene.floor_at(task.path[-1])
        info = {
            "geodesic_distance": round(scene.meters(task.path[0], task.path[-1]), 3),
            "euclidean_distance": round(float(np.linalg.norm(goal - start)), 3),
        }
        goals = [{"position": in_habitat(goal[None])[0], "radius": None}]
        episodes.append({**_start(task, i, scene), "info": info, "goals": goals})
    return {"episodes": episodes}


def _goal_tasks(tasks: Sequence[Task], scenes: Mapping[str, GoalScene]) -> Iterator[tuple[Task, GoalScene, int]]:
    """Yields the tasks whose last viewpoint sees an object with a category and places, and that object."""
    for task in tasks:
        scene = scenes[task.scan]
        for thing in scene.objects_at(task.path[-1]):
            if thing in scene.targets.places and scene.targets.things[thing].shape not in VAGUE:
                yield task, scene, thing
                break


def _goal(scene: GoalScene, thing: int) -> dict[str, Any]:
    """Returns an object as ObjectGoal."""
    one, places = scene.targets.things[thing], scene.targets.places[thing]
    middle = np.array([*one.middle, scene.targets.bottoms[thing] + one.top / 2])
    headings = np.arctan2(*(one.middle - places[:, :2]).T)
    views = [
        {"agent_state": {"position": at, "rotation": rotation_of(heading)}, "iou": None}
        for at, heading in zip(in_habitat(places), headings.tolist())
    ]
    return {
        "position": in_habitat(middle[None])[0],
        "radius": None,
        "object_id": thing,
        "object_name": f"{one.shape.replace(' ', '_')}_{thing}",
        "object_name_id": None,
        "object_category": one.shape,
        "room_id": None,
        "room_name": None,
        "view_points": views,
    }


def objects_of(tasks: Sequence[Task], scenes: Mapping[str, GoalScene]) -> dict[str, Any]:
    """Returns the content of an ObjectNav-v1 file. Every object of the category in the scan is a goal."""
    goals: dict[str, list[dict[str, Any]]] = {}
    episodes = []
    for i, (task, scene, thing) in enumerate(_goal_tasks(tasks, scenes)):
        shape, targets = scene.targets.things[thing].shape, scene.targets
        same = [k for k in targets.places if targets.things[k].shape == shape]
        goals.setdefault(f"{task.scan}.glb_{shape}", [_goal(scene, k) for k in same])
        nearest, meters = min(((k, _meters_to(scene, task.path[0], k)) for k in same), key=lambda found: found[1])
        start = scene.floor_at(task.path[0])
        straight = min(float(np.linalg.norm(targets.places[k] - start, axis=1).min()) for k in same)
        info = {
            "geodesic_distance": round(meters, 3),
            "euclidean_distance": round(straight, 3),
            "closest_goal_object_id": nearest,
        }
        episodes.append({**_start(task, i, scene), "info": info, "goals": [], "object_category": shape})
    named = {thing.shape for scene in scenes.values() for thing in scene.targets.things} - {*CATEGORIES, *VAGUE}
    numbers: dict[str, int] = {shape: i for i, shape in enumerate((*CATEGORIES, *sorted(named)))}
    return {
        "episodes": episodes,
        "goals_by_category": goals,
        "category_to_task_category_id": numbers,
        "category_to_scene_annotation_category_id": numbers,
    }


def _meters_to(scene: GoalScene, start: str, thing: int) -> float:
    """Returns meters along the graph to a viewpoint that sees an object, and from there straight to a place at it."""
    places = scene.targets.places[thing]
    found = [math.inf]
    for id, objects in scene.targets.boxes.items():
        if thing in objects:
            found.append(scene.meters(start, id) + float(np.linalg.norm(places - scene.floor_at(id), axis=1).min()))
    return min(found)


def images_of(tasks: Sequence[Task], scenes: Mapping[str, GoalScene]) -> dict[str, Any]:
    """Returns the content of an InstanceImageNav-v1 file. The images are views from viewpoints, turned to an object."""
    goals: dict[str, dict[str, Any]] = {}
    episodes: list[dict[str, Any]] = []
    for task, scene, thing in _goal_tasks(tasks, scenes):
        key = f"{task.scan}_{thing}"
        if key not in goals:
            goals[key] = {**_goal(scene, thing), "object_id": str(thing), "image_goals": _images(scene, thing)}
        images = goals[key]["image_goals"]
        if not images:
            continue
        info = {
            "geodesic_distance": round(_meters_to(scene, task.path[0], thing), 3),
            "euclidean_distance": round(
                math.dist(scene.floor_at(task.path[0])[:2], scene.targets.things[thing].middle), 3
            ),
        }
        episodes.append(
            {
                **_start(task, len(episodes), scene),
                "info": info,
                "goals": [],
                "goal_object_id": str(thing),
                "goal_image_id": task.path_id % len(images),
                "object_category": scene.targets.things[thing].shape,
            }
        )
    return {"episodes": episodes, "goals": {key: goal for key, goal in goals.items() if goal["image_goals"]}}


def _images(scene: GoalScene, thing: int) -> list[dict[str, Any]]:
    found = []
    one = scene.targets.things[thing]
    for id, objects in scene.targets.boxes.items():
        if thing not in objects:
            continue
        position = scene.graph.viewpoints[id].position
        x, y = (one.middle - position[:2]).tolist()
        heading = math.atan2(x, y)
        shown = box_in(camera_at(position, heading), one, scene.targets.bottoms[thing])
        if shown is None or shown[1] < _WHOLE:
            continue
        found.append(
            {
                "position": in_habitat(np.array([position]))[0],
                "rotation": rotation_of(heading),
                "hfov": round(math.degrees(HFOV), 3),
                "image_dimensions": [HEIGHT, WIDTH],
                "frame_coverage": round(shown[0][2] * shown[0][3] / (WIDTH * HEIGHT), 4),
                "object_coverage": round(shown[1], 4),
            }
        )
    return found


def remote_objects(tasks: Sequence[Task], scenes: Mapping[str, GoalScene]) -> Iterator[dict[str, Any]]:
    """Yields the items of REVERIE_SPLIT.json: paths to a viewpoint that sees an object with a name of its own there."""
    for i, task in enumerate(tasks):
        scene = scenes[task.scan]
        here = scene.objects_at(task.path[-1])
        names = [scene.name(thing) for thing in here]
        for thing, name in zip(here, names):
            if names.count(name) == 1:
                yield {
                    "distance": task.distance,
                    "ix": i,
                    "scan": task.scan,
                    "heading": task.heading,
                    "path_id": task.path_id,
                    "objId": thing,
                    "id": f"{task.path_id}_{thing}",
                    "instructions": [f"{text} Find the {name}.".strip() for text in task.instructions or ("",)],
                    "path": list(task.path),
                    "instructions_l": list(task.instructions),
                }
                break


def outlined(item: Mapping[str, Any], scenes: Mapping[str, GoalScene]) -> dict[str, Any]:
    """Returns an item of REVERIE as one of SOON: the outline of the object from each viewpoint that sees it, radians.

    The path id is a text, because VLN-DUET reads it from the id of an instruction. `pseudo_label` has the place of the
    object among those of the viewpoint in BBoxes.json.
    """
    scene, thing = scenes[item["scan"]], item["objId"]
    seen = {id: list(objects).index(thing) for id, objects in scene.targets.boxes.items() if thing in objects}
    return {
        "scan": item["scan"],
        "path_id": str(item["path_id"]),
        "path": item["path"],
        "instructions": [{"full": text} for text in item["instructions"]],
        "bboxes": [
            {
                "image_id": id,
                "target": _outline_from(scene, id, thing),
                "pseudo_label": {"idx": i, "obj_id": str(thing)},
            }
            for id, i in seen.items()
        ],
    }


def _outline_from(scene: GoalScene, id: str, thing: int) -> dict[str, dict[str, float]]:
    """Returns the center and the corners of an object from a viewpoint, as headings and elevations."""
    one, bottom = scene.targets.things[thing], scene.targets.bottoms[thing]
    left, right, low, high = angles_of(scene.graph.viewpoints[id].position, one, bottom)
    places = {
        "center": ((left + right) / 2, (low + high) / 2),
        "left_top": (left, high),
        "right_top": (right, high),
        "left_bottom": (left, low),
        "right_bottom": (right, low),
    }
    return {name: {"heading": round(h, 4), "elevation": round(e, 4)} for name, (h, e) in places.items()}


def boxes_of(scenes: Mapping[str, GoalScene]) -> dict[str, dict[str, dict[str, Any]]]:
    """Returns SCAN_VIEWPOINT -> object -> name, visible_pos, and bbox2d of BBoxes.json."""
    return {
        f"{scan}_{id}": {
            str(thing): {
                "name": scene.name(thing),
                "visible_pos": list(found),
                "bbox2d": [list(b) for b in found.values()],
            }
            for thing, found in objects.items()
        }
        for scan, scene in scenes.items()
        for id, objects in scene.targets.boxes.items()
    }
