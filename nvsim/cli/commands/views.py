"""Commands that render trained models: a panorama, or the frames of a video."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from nvsim.cli.arguments import Memory, ProjectArguments, memory_budget
from nvsim.cli.console import event_listener
from nvsim.cli.terminal import print_lines
from nvsim.errors import InputError
from nvsim.events import Done, Progress
from nvsim.project.work import missing_result_error

if TYPE_CHECKING:
    from nvsim.project.project import Project


@dataclass(frozen=True)
class Panorama(ProjectArguments):
    """Render a panorama of the trained models: equirectangular, or the six faces of a skybox.

    Equirectangular: the heading is at the center of the image, 0 degrees is +y, and angles increase clockwise to the
    right. Faces: one strip in the order and orientation of Matterport's skyboxes (up, back, left, front, right, down).
    Depth is the distance along the ray to the Gaussians, so the floor has none. `nvsim export scan` writes skyboxes
    without seams, whose depth includes the floor.
    """

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

    def run(self) -> int:
        """Runs the command. Raises InputError if the position or the size is invalid, or if there are no models."""
        import numpy as np

        from nvsim.geometry.directions import Sphere, cube, face_rays, skybox
        from nvsim.mapping.views.photographed import along_rays
        from nvsim.project.photographed import PhotographedDirections
        from nvsim.project.project import Project
        from nvsim.render.backends import RenderOutput
        from nvsim.render.panorama import render_cube, render_equirectangular, write_panorama

        if self.size is not None and not 1 <= self.size <= 4096:
            raise InputError(f"A panorama cannot be {self.size} pixels high; give --size from 1 to 4096.")
        with Project.open(self.project) as project:
            position = np.array(_place(self, project))
            scene = project.scene(memory_budget(self.memory))
            if scene is None:
                raise missing_result_error(self.project, "train")
            photographed = None
            if "unseen" in self.also:
                photographed = PhotographedDirections(project, scene, self.backend).photographed_mask(position)
        heading, channels = math.radians(self.heading), frozenset({"rgb", *self.also}) - {"unseen"}
        if self.faces:
            side = self.size or 512
            views = render_cube(scene, position, side, channels, heading, self.backend)
            lengths = np.linalg.norm(face_rays(side)[0], axis=-1).astype(
                np.float32
            )  # ray length per meter along the axis
            for view in views:
                view.depth = None if view.depth is None else view.depth * lengths
            image = RenderOutput()
            for channel in channels:
                setattr(image, channel, skybox([getattr(view, channel) for view in views]))
            rays = skybox([camera.rays() for camera in cube(position, side, heading)])
        else:
            height = self.size or 1024
            image = render_equirectangular(scene, position, 2 * height, height, channels, heading, self.backend)
            rays = Sphere(position, 2 * height, height, heading).rays()
        unseen = None if photographed is None else ~np.stack([along_rays(photographed, row) for row in rays])
        for path in write_panorama(self.out, image, unseen):
            print_lines(path)
        return 0


def _place(arguments: Panorama, project: Project) -> tuple[float, float, float]:
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


_MOST = 20_000  # frames


@dataclass(frozen=True)
class Video(ProjectArguments):
    """Render a camera path as video frames: numbered PNG files, and an MP4 next to them."""

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

    def run(self) -> int:
        """Runs the command. Raises InputError if the size or duration is out of range, or if there are no models."""
        import cv2
        import numpy as np

        from nvsim.files.atomic import as_input_error, make_folder, move_into_place, private_folder, write_bytes
        from nvsim.geometry.camera_path import read_camera_path
        from nvsim.project.project import Project
        from nvsim.render.model import render_model

        duration = self.seconds * self.fps
        if not math.isfinite(duration):
            raise InputError(f"--seconds {self.seconds} is not a duration; give a number of seconds.")
        count = round(duration)
        if not (16 <= self.width <= 8192 and 16 <= self.height <= 8192):
            raise InputError(f"A frame cannot be {self.width}x{self.height}; give sides from 16 to 8192 pixels.")
        if not 2 <= count <= _MOST:
            raise InputError(f"{self.seconds} s at {self.fps} fps are {count} frames; give 2 to {_MOST:,}.")
        poses = read_camera_path(self.path).frames(count)
        # The project is opened read-only, so a video can be rendered while a submap trains.
        with Project.open(self.project) as project, event_listener(self.json) as listen:
            scene = project.scene(memory_budget(self.memory))
            if scene is None:
                raise missing_result_error(self.project, "train")
            path = make_folder(self.out) / "video.mp4"
            with private_folder(path) as folder:
                film = cv2.VideoWriter(
                    _film_path(folder / path.name),
                    cv2.VideoWriter.fourcc(*"mp4v"),
                    self.fps,
                    (self.width, self.height),
                )
                has_film = film.isOpened()  # without the codec only the frames are written
                try:
                    for number, pose in enumerate(poses):
                        camera = pose.camera(self.width, self.height)
                        _, model = scene.model_at(camera.position)
                        view = render_model(model, camera, frozenset({"rgb"}))
                        assert view.rgb is not None
                        pixels = (255 * np.clip(view.rgb[..., ::-1], 0, 1)).round().astype(np.uint8)
                        _, data = cv2.imencode(".png", pixels)
                        write_bytes(self.out / f"frame_{number:05d}.png", data.tobytes())
                        if has_film:
                            film.write(pixels)
                        listen(Progress("video", number + 1, count, f"{self.out}"))
                finally:
                    film.release()
                if has_film:
                    try:
                        move_into_place(folder / path.name, path)
                    except OSError as error:
                        raise as_input_error(path, error) from error
            listen(Done("video", f"{count} frames in {self.out}"))
        if not self.json:
            print_lines(self.out)
        return 0


def _film_path(path: Path) -> str:
    """The path, or "" if it is not UTF-8. OpenCV crashes for such a path; then only the frames are written."""
    return str(path) if os.fsencode(path) == str(path).encode(errors="replace") else ""
