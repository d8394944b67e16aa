"""Draw what a robot sees before each action of an episode, as StreamVLN and other video agents train on it.

The camera is level, 1.25 m above the floor, with 640x480 pixels and 79 degrees horizontally. The files are
FOLDER/SPLIT/SCAN_r2r_ID/rgb/000.jpg and so on, one for each action. `frames.json` beside them is written last, so an
interrupted run continues with the first incomplete episode.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.events import Listener, Progress
from nvsim.files import atomic
from nvsim.files.opening import read_json
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.r2r.episodes.episode import Episode, video_name
from nvsim.r2r.observations.drawing import ScanModels
from nvsim.r2r.observations.layout import jpeg
from nvsim.r2r.observations.record import key_of
from nvsim.r2r.observations.skybox import as_bytes
from nvsim.render.model import render_model

STAGE = "frames"
CAMERA_HEIGHT = 1.25  # meters above the floor
WIDTH, HEIGHT, HFOV = 640, 480, math.radians(79)
_MADE = 2
"""Version of the images. Images of an earlier version are drawn again."""
_QUALITY = 95
_RECORD = "frames.json"


def write_frames(
    sources: Mapping[str, ScanModels], episodes: Mapping[str, Sequence[Episode]], folder: Path, listen: Listener
) -> None:
    """Draws the frames of all episodes, split -> episodes. `sources` are the models by scan. Complete episodes with
    the same poses and models are kept, and folders of other episodes are removed.

    Raises InputError if a model is damaged or the disk refuses.
    """
    done, count = 0, sum(len(episode.walk.actions) for split in episodes.values() for episode in split)
    for name, split in episodes.items():
        atomic.make_folder(folder / name)
        names = {video_name(episode.task) for episode in split}
        atomic.remove_others(folder / name, names, lambda one: (one / _RECORD).is_file())
        for episode in split:
            _draw(sources[episode.task.scan], episode, folder / name / video_name(episode.task))
            done += len(episode.walk.actions)
            listen(Progress(STAGE, done, count, episode.task.scan))


def _draw(source: ScanModels, episode: Episode, folder: Path) -> None:
    walk = episode.walk
    poses = [walk.places.tolist(), walk.headings.tolist(), episode.floors.tolist()]
    key = key_of(_MADE, dict(source.keys), poses)
    if _finished(folder, key):
        return
    intrinsics = Intrinsics.from_fov(WIDTH, HEIGHT, HFOV)
    for i, (place, heading, floor) in enumerate(zip(walk.places, walk.headings, episode.floors, strict=True)):
        camera = Camera(intrinsics, camera_pose(np.array([*place, floor + CAMERA_HEIGHT]), float(heading), 0.0))
        # Drawn as one view. The narrow views of a skybox would take five times as long at each new position.
        view = render_model(source.scene.model_at(camera.position)[1], camera, frozenset({"rgb"}))
        assert view.rgb is not None
        image = as_bytes(view.rgb)
        atomic.write_bytes(folder / "rgb" / f"{i:03d}.jpg", jpeg(image, _QUALITY, whole_chroma=False))
    for stale in folder.glob("rgb/*.jpg"):
        if int(stale.stem) >= len(walk.actions):
            stale.unlink(missing_ok=True)
    atomic.write_text(folder / _RECORD, json.dumps({"key": key, "frames": len(walk.actions)}) + "\n")


def _finished(folder: Path, key: str) -> bool:
    if not (folder / _RECORD).is_file():
        return False
    try:
        found = read_json(folder / _RECORD, "a record of frames", "remove it")
    except InputError:
        return False
    return isinstance(found, dict) and found.get("key") == key
