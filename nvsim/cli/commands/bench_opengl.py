"""Measure the milliseconds of an OpenGL frame and its parts, and frames per second, compared with the kernels, on a
splat file or a project."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import show
from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.project.work import lacks

_EYE, _AHEAD = (1.8, 1.6, 1.6), (4.2, 3.2, -0.6)  # camera position in a splat file in meters, and its direction
_FIELD = 70.0  # degrees


@dataclass(frozen=True)
class Arguments:
    scene: Path | None = None
    """A splat file (.ply, .spz, .splat, .sog), seen from a fixed position inside. Background and floor are added."""
    project: Path | None = None
    """A project with trained models, seen from the middle of its trajectory. Without --scene and --project, a hall made
    in memory."""
    size: tuple[str, ...] = ("640x480",)
    """Width and height in pixels. Several sizes are measured one after another."""
    rounds: int = 15
    """Number of frames per median."""
    json: bool = False
    """Print one JSON object, or a list of them for several sizes."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if an option is invalid, or if the project has no models."""
    import math

    import numpy as np

    from nvsim.benchmarks.panorama import furnished_hall
    from nvsim.geometry.camera import Camera, Intrinsics, look
    from nvsim.project.project import Project
    from nvsim.render.opengl.benchmark import furnished, measure
    from nvsim.splats.formats.choice import read_splats

    sizes = [_size(text) for text in arguments.size]
    if arguments.rounds < 1:
        raise InputError(f"--rounds {arguments.rounds} is out of range; give --rounds 1 or more.")
    heading, elevation = math.atan2(_AHEAD[0], _AHEAD[1]), math.atan2(_AHEAD[2], math.hypot(*_AHEAD[:2]))
    pose = look(np.array(_EYE), heading, elevation)
    if arguments.scene is not None and arguments.project is not None:
        raise InputError("Give --scene or --project, not both.")
    if arguments.project is not None:
        with Project.open(arguments.project) as project:
            scene, capture = project.scene(), project.need_capture()
        if scene is None:
            raise lacks(arguments.project, "train")
        pose = capture.frames[len(capture.frames) // 2].camera_to_world
        _, model = scene.model_at(pose[:3, 3])
    elif arguments.scene is not None:
        splats = read_splats(arguments.scene)
        show.notes(splats.notes)
        model = furnished(splats.gaussians, splats.antialiased is not False)
    else:
        model, _ = furnished_hall()
    found = []
    for width, height in sizes:
        camera = Camera(Intrinsics.from_fov(width, height, math.radians(_FIELD)), pose)
        found.append(measure(model, camera, arguments.rounds))
        if not arguments.json or len(sizes) == 1:
            show.figures(found[-1], arguments.json, f"an OpenGL frame of {width}x{height}")
    if arguments.json and len(sizes) > 1:
        say(show.as_json(found))
    return 0


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise InputError(f"The size {text!r} is not valid; write it as 640x480.")
    return int(width), int(height)
