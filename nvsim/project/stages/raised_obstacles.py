"""Finds thin obstacles above the floor that estimated depth misses, together with the floor masks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.capture.masks import usable_pixels
from nvsim.events import Listener, Log, Progress
from nvsim.files.atomic import replacement_file
from nvsim.files.stored_arrays import read_arrays
from nvsim.project.project import Project

if TYPE_CHECKING:
    from nvsim.geometry.camera import Camera
    from nvsim.geometry.floor_surface import FloorSurface

_THREADS = 2


def find_thin_obstacles(project: Project, floors: dict[int, FloorSurface], listen: Listener, stage: str) -> None:
    """Writes the places of thin obstacles; an existing file is kept. `floors` has the floor surface around each frame.
    Raises InputError if an image cannot be read."""
    from nvsim.perception.raised_lines import LineConfig, raised_lines, thin_object_places

    path = project.layout.raised
    if path.exists():
        return
    capture, config = project.need_capture(), LineConfig()
    cameras: list[Camera] = []
    heights = np.full(len(capture.frames), np.nan)
    for i, frame in enumerate(capture.frames):
        k = frame.intrinsics.within(config.longest_side)
        cameras.append(frame.camera.scaled(k.width, k.height))
        if i in floors:
            heights[i] = floors[i].height_at(cameras[i].position[:2])
    done = 0

    def progress() -> None:
        nonlocal done
        done += 1
        if done % 10 == 0:
            listen(Progress(stage, 0, len(cameras), f"thin obstacles, {done} of {len(cameras)} frames"))

    lines = raised_lines(
        cameras,
        lambda i: read_image(capture.frames[i], cameras[i].intrinsics),
        heights,
        config,
        _THREADS,
        progress,
        lambda i: usable_pixels(capture.frames[i], cameras[i].intrinsics),
    )
    places = thin_object_places(lines, capture.positions, config)
    with replacement_file(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, places=places)
    if len(places):
        listen(Log(f"Image edges show thin obstacles above the floor along {len(places) * config.cell:.0f} m.", stage))


def thin_obstacle_places(project: Project) -> NDArray[np.float64] | None:
    """(K, 2) places of thin obstacles, meters, world, from `find_thin_obstacles`; None if there is no file.

    Raises InputError if the file is damaged."""
    path = project.layout.raised
    if not path.exists():
        return None
    return np.asarray(
        read_arrays(path, "thin obstacles", {"places": ("f", 2)}, "run `nvsim floors --project` again")["places"]
    )
