"""Render a camera path as video frames: numbered PNG files, and an MP4 next to them."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Memory, ProjectArguments, memory_budget
from nvsim.cli.console import listening
from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.project.work import lacks

_MOST = 20_000  # frames


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    path: Path = Path("camera_path.json")
    """The camera path file, as the window saves it."""
    out: Path = Path("video")
    """The folder for the frames and video.mp4."""
    width: int = 1280
    """Width in pixels."""
    height: int = 720
    """Height in pixels."""
    seconds: float = 10.0
    """Duration of the whole path in seconds."""
    fps: int = 30
    """Frames per second."""
    memory: Memory = None
    """GiB of memory for trained models. Default: a quarter of the machine's memory."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if the size or the duration is out of range, or if there are no models."""
    import cv2
    import numpy as np

    from nvsim.events import Done, Progress
    from nvsim.files.atomic import as_input_error, make_folder, move_into_place, private_folder, write_bytes
    from nvsim.geometry.camera_path import read_camera_path
    from nvsim.project.project import Project
    from nvsim.render.model import render_model

    duration = arguments.seconds * arguments.fps
    if not math.isfinite(duration):
        raise InputError(f"--seconds {arguments.seconds} is not a duration; give a number of seconds.")
    count = round(duration)
    if not (16 <= arguments.width <= 8192 and 16 <= arguments.height <= 8192):
        raise InputError(f"A frame cannot be {arguments.width}x{arguments.height}; give sides from 16 to 8192 pixels.")
    if not 2 <= count <= _MOST:
        raise InputError(f"{arguments.seconds} s at {arguments.fps} fps are {count} frames; give 2 to {_MOST:,}.")
    poses = read_camera_path(arguments.path).frames(count)
    # The project is opened read-only, so a video can be rendered while a submap trains.
    with Project.open(arguments.project) as project, listening(arguments.json) as listen:
        scene = project.scene(memory_budget(arguments.memory))
        if scene is None:
            raise lacks(arguments.project, "train")
        path = make_folder(arguments.out) / "video.mp4"
        with private_folder(path) as folder:
            film = cv2.VideoWriter(
                _film_path(folder / path.name),
                cv2.VideoWriter.fourcc(*"mp4v"),
                arguments.fps,
                (arguments.width, arguments.height),
            )
            has_film = film.isOpened()  # without the codec only the frames are written
            try:
                for number, pose in enumerate(poses):
                    camera = pose.camera(arguments.width, arguments.height)
                    _, model = scene.model_at(camera.position)
                    view = render_model(model, camera, frozenset({"rgb"}))
                    assert view.rgb is not None
                    pixels = (255 * np.clip(view.rgb[..., ::-1], 0, 1)).round().astype(np.uint8)
                    _, data = cv2.imencode(".png", pixels)
                    write_bytes(arguments.out / f"frame_{number:05d}.png", data.tobytes())
                    if has_film:
                        film.write(pixels)
                    listen(Progress("video", number + 1, count, f"{arguments.out}"))
            finally:
                film.release()
            if has_film:
                try:
                    move_into_place(folder / path.name, path)
                except OSError as error:
                    raise as_input_error(path, error) from error
        listen(Done("video", f"{count} frames in {arguments.out}"))
    if not arguments.json:
        say(arguments.out)
    return 0


def _film_path(path: Path) -> str:
    """The path, or "" if it is not UTF-8. OpenCV crashes for such a path; then only the frames are written."""
    return str(path) if os.fsencode(path) == str(path).encode(errors="replace") else ""
