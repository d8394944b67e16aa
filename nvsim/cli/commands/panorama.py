"""Render a panorama of the trained models: equirectangular, or the six faces of a skybox.

Equirectangular: the heading is at the center of the image, 0 degrees is +y, and angles increase clockwise to the right.
Faces: one strip in the order and orientation of Matterport's skyboxes (up, back, left, front, right, down). Depth is
the distance along the ray to the Gaussians, so the floor has none. `nvsim export scan` writes skyboxes without seams,
whose depth includes the floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.cli.arguments import Memory, ProjectArguments, memory_budget
from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.project.project import Project
from nvsim.project.work import lacks


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    out: Path = Path("panorama.jpg")
    """The image, .jpg or .png. Other channels are written next to it as PNG files."""
    at: tuple[float, float, float] | None = None
    """Position X Y Z in meters, in the project's frame."""
    viewpoint: str | None = None
    """Id of a viewpoint of the navigation graph, instead of --at."""
    heading: float = 0.0
    """Degrees: heading of the image center or of the front face."""
    faces: bool = False
    """Render six faces instead of the equirectangular image."""
    size: int | None = None
    """Height in pixels: of the equirectangular image, which is twice as wide (1024), or of a face (512)."""
    also: tuple[Literal["alpha", "depth", "normal", "unseen"], ...] = ()
    """Other channels to write: alpha (8 bits), depth (16 bits, millimeters along the ray), normal (8 bits), unseen (a
    mask, 255 for surfaces that no training image shows)."""
    backend: Literal["auto", "numba", "gsplat"] = "auto"
    """Renderer: gsplat if it is installed and there is a CUDA GPU, else the CPU kernels."""
    memory: Memory = None
    """GiB of memory for trained models. Default: a quarter of the machine's memory."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if the position or the size is invalid, or if there are no models."""
    import numpy as np

    from nvsim.geometry.skybox_faces import face_rays
    from nvsim.geometry.sphere import Sphere
    from nvsim.mapping.photographed import along_rays
    from nvsim.project.photographed import PhotographedDirections
    from nvsim.render.camera_rig import cube, skybox
    from nvsim.render.panorama import render_cube, render_equirectangular
    from nvsim.render.panorama_files import write_panorama
    from nvsim.render.types import RenderOutput

    if arguments.size is not None and not 1 <= arguments.size <= 4096:
        raise InputError(f"A panorama cannot be {arguments.size} pixels high; give --size from 1 to 4096.")
    with Project.open(arguments.project) as project:
        position = np.array(_place(arguments, project))
        scene = project.scene(memory_budget(arguments.memory))
        if scene is None:
            raise lacks(arguments.project, "train")
        photographed = None
        if "unseen" in arguments.also:
            photographed = PhotographedDirections(project, scene, arguments.backend).at(position)
    heading, channels = math.radians(arguments.heading), frozenset({"rgb", *arguments.also}) - {"unseen"}
    if arguments.faces:
        side = arguments.size or 512
        views = render_cube(scene, position, side, channels, heading, arguments.backend)
        lengths = np.linalg.norm(face_rays(side)[0], axis=-1).astype(np.float32)  # ray length per meter along the axis
        for view in views:
            view.depth = None if view.depth is None else view.depth * lengths
        image = RenderOutput()
        for channel in channels:
            setattr(image, channel, skybox([getattr(view, channel) for view in views]))
        rays = skybox([camera.rays() for camera in cube(position, side, heading)])
    else:
        height = arguments.size or 1024
        image = render_equirectangular(scene, position, 2 * height, height, channels, heading, arguments.backend)
        rays = Sphere(position, 2 * height, height, heading).rays()
    unseen = None if photographed is None else ~np.stack([along_rays(photographed, row) for row in rays])
    for path in write_panorama(arguments.out, image, unseen):
        say(path)
    return 0


def _place(arguments: Arguments, project: Project) -> tuple[float, float, float]:
    if (arguments.at is None) == (arguments.viewpoint is None):
        raise InputError("A panorama needs a position: give either --at X Y Z or --viewpoint ID.")
    if arguments.at is not None:
        if not all(map(math.isfinite, arguments.at)):
            raise InputError("The position of a panorama must be three finite numbers; give --at X Y Z in meters.")
        return arguments.at
    found = project.need_graph().viewpoints.get(arguments.viewpoint or "")
    if found is None:
        raise InputError(f"The graph of {arguments.project} has no viewpoint {arguments.viewpoint}; check the id.")
    return found.position
