"""Draw what a robot sees before each action of an episode, as StreamVLN and other video agents train on it.

The camera is level, 1.25 m above the floor, with 640x480 pixels and 79 degrees horizontally. The files are
FOLDER/SPLIT/SCAN_r2r_ID/rgb/000.jpg and so on, one for each action. On request, `rgb_down` and `depth_down` have the
views that look 30 degrees down. `frames.json` beside them is written last, so an interrupted run continues with the
first incomplete episode. Episodes are drawn in parallel processes with one thread each.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numba
import numpy as np
import psutil
from numpy.typing import NDArray

from nvsim.cluster.local import LocalPool
from nvsim.cluster.piece import Caller, WorkCall, WorkItem
from nvsim.errors import InputError
from nvsim.events import Listener, Progress
from nvsim.files import atomic
from nvsim.files.opening import read_json
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.kernel_threads import allowed_threads
from nvsim.project.stages.training_pool import BASE_BYTES, GAUSSIAN_BYTES, count_that_fit
from nvsim.r2r.episodes.episode import Episode, video_name
from nvsim.r2r.observations.drawing import ScanModels
from nvsim.r2r.observations.layout import jpeg, png
from nvsim.r2r.observations.record import key_of
from nvsim.r2r.observations.skybox import as_bytes, distances
from nvsim.render.model import render_model
from nvsim.splats.files import gaussian_count, load_model
from nvsim.splats.types import SubmapModel

STAGE = "frames"
CAMERA_HEIGHT = 1.25  # meters above the floor
WIDTH, HEIGHT, HFOV = 640, 480, math.radians(79)
LOOK_DOWN = math.radians(30)
_MADE = 3
"""Version of the files. Those of an earlier version are drawn again."""
_QUALITY = 95
_RECORD = "frames.json"
_WORTHWHILE = 200
"""Number of frames from which another process is faster: starting it takes about as long as drawing half of them."""


@dataclass(frozen=True, eq=False)
class DrawnEpisode:
    """The frames of an episode.

    folder     contains rgb/, and on request rgb_down/ and depth_down/
    poses      (N, 4) position on the floor in meters, world, and heading in radians before each action
    """

    folder: Path
    poses: NDArray[np.float64]

    def camera(self, number: int, elevation: float = 0.0) -> Camera:
        """The camera of a frame. `elevation` is in radians: positive looks up."""
        x, y, floor, heading = self.poses[number].tolist()
        intrinsics = Intrinsics.from_fov(WIDTH, HEIGHT, HFOV)
        return Camera(intrinsics, camera_pose(np.array([x, y, floor + CAMERA_HEIGHT]), heading, elevation))


@dataclass(frozen=True, eq=False)
class _Order:
    """An episode to draw: the model folder of each frame, the key of the record, and whether to look down too."""

    episode: DrawnEpisode
    models: tuple[Path, ...]
    key: str
    look_down: bool


def read_drawn(folder: Path) -> DrawnEpisode:
    """Reads the record of a drawn episode. Raises InputError if it is missing or damaged."""
    found = read_json(folder / _RECORD, "a record of frames", "export the dataset again")
    try:
        poses = np.array(found["poses"], np.float64).reshape(-1, 4)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder / _RECORD} is damaged; remove it and export the dataset again.") from error
    return DrawnEpisode(folder, poses)


def write_frames(
    sources: Mapping[str, ScanModels],
    episodes: Mapping[str, Sequence[Episode]],
    folder: Path,
    listen: Listener,
    look_down: bool = False,
) -> None:
    """Draws the frames of all episodes, split -> episodes. `sources` are the models by scan. Complete episodes with
    the same poses and models are kept, and folders of other episodes are removed.

    Raises InputError if a model is damaged or the disk refuses.
    """
    todo: list[_Order] = []
    count = sum(len(episode.walk.actions) for split in episodes.values() for episode in split)
    for name, split in episodes.items():
        atomic.make_folder(folder / name)
        names = {video_name(episode.task) for episode in split}
        atomic.remove_others(folder / name, names, lambda one: (one / _RECORD).is_file())
        for episode in split:
            order = _order(sources[episode.task.scan], episode, folder / name, look_down)
            if not _is_finished(order):
                todo.append(order)
    left = sum(len(order.models) for order in todo)
    done = count - left
    listen(Progress(STAGE, done, count))
    gaussians = max((gaussian_count(one) for order in todo for one in set(order.models)), default=0)
    room = count_that_fit(psutil.virtual_memory().available, BASE_BYTES + gaussians * GAUSSIAN_BYTES)
    for drawn in _draw_all(todo, max(1, min(allowed_threads(), room, left // _WORTHWHILE))):
        done += drawn
        listen(Progress(STAGE, done, count))


def _order(source: ScanModels, episode: Episode, folder: Path, look_down: bool) -> _Order:
    walk = episode.walk
    poses = np.column_stack([walk.places, episode.floors, walk.headings])
    drawn = DrawnEpisode(folder / video_name(episode.task), poses)
    submaps = [source.scene.nearest(drawn.camera(i).position) for i in range(len(poses))]
    key = key_of(_MADE, {i: source.keys[i] for i in sorted(set(submaps))}, poses.tolist())
    return _Order(drawn, tuple(source.folders[i] for i in submaps), key, look_down)


def _draw_all(todo: Sequence[_Order], processes: int) -> Iterator[int]:
    """Draws episodes and yields the number of frames of each."""
    if processes == 1:
        for order in todo:
            _draw(order)
            yield len(order.models)
        return
    # The longest episodes first, each to the process that has the fewest frames.
    parts: list[list[_Order]] = [[] for _ in range(processes)]
    for order in sorted(todo, key=lambda one: -len(one.models)):
        min(parts, key=lambda part: sum(len(one.models) for one in part)).append(order)
    pieces = [WorkItem(STAGE, i, f"{len(part)} episodes", 1, 0) for i, part in enumerate(parts)]
    with closing(LocalPool().run(pieces, lambda piece: WorkCall(_draw_part, (parts[piece.part],)))) as messages:
        for _, message in messages:
            if isinstance(message, Progress):
                yield message.done


def _draw_part(caller: Caller, part: Sequence[_Order]) -> None:
    """Runs in a process of its own: draws episodes with one thread."""
    numba.set_num_threads(1)
    caller.wait_for_kernels()
    for order in sorted(part, key=lambda one: str(one.models[0])):  # episodes of a model one after the other
        _draw(order)
        caller.send_event(Progress(STAGE, len(order.models), len(order.models)))


_model = lru_cache(maxsize=2)(load_model)


def _draw(order: _Order) -> None:
    episode, folder = order.episode, order.episode.folder
    for i, path in enumerate(order.models):
        model = _model(path)
        # Drawn as one view. The narrow views of a skybox would take five times as long at each new position.
        rgb = render_model(model, episode.camera(i), frozenset({"rgb"})).rgb
        assert rgb is not None
        atomic.write_bytes(folder / "rgb" / f"{i:03d}.jpg", jpeg(as_bytes(rgb), _QUALITY, whole_chroma=False))
        if order.look_down:
            color, depth = _render_looking_down(model, episode.camera(i, -LOOK_DOWN))
            atomic.write_bytes(folder / "rgb_down" / f"{i:03d}.jpg", jpeg(color, _QUALITY, whole_chroma=False))
            atomic.write_bytes(folder / "depth_down" / f"{i:03d}.png", png(depth))
    for stale in folder.glob("*/*.*"):
        if int(stale.stem) >= len(order.models):
            stale.unlink(missing_ok=True)
    about = {"key": order.key, "look_down": order.look_down, "poses": episode.poses.tolist()}
    atomic.write_text(folder / _RECORD, json.dumps(about) + "\n")


def _render_looking_down(model: SubmapModel, camera: Camera) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Colors (H, W, 3) uint8, and millimeters along the optical axis (H, W) uint16, 0 if there is no surface."""
    view = render_model(model, camera, frozenset({"rgb", "alpha", "depth"}))
    assert view.rgb is not None and view.alpha is not None and view.depth is not None
    along = camera.intrinsics.ray_lengths()
    solid = np.stack([view.alpha, view.alpha * view.depth * along], axis=2)
    millimeters = distances(solid, camera, model.floor) / along * np.float32(1000)
    return as_bytes(view.rgb), np.clip(np.rint(millimeters), 0, 65535).astype(np.uint16)


def _is_finished(order: _Order) -> bool:
    path = order.episode.folder / _RECORD
    if not path.is_file():
        return False
    try:
        found = read_json(path, "a record of frames", "remove it")
    except InputError:
        return False
    complete = isinstance(found, dict) and found.get("key") == order.key
    return complete and (found.get("look_down") is True or not order.look_down)
