"""Commands that measure the cost of the library."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from nvsim.cli import terminal
from nvsim.cli.arguments import Inline, Memory, memory_budget
from nvsim.cli.terminal import print_lines
from nvsim.depth.config import DepthConfig
from nvsim.errors import InputError
from nvsim.networks.installed import BUNDLED
from nvsim.project.work import missing_result_error
from nvsim.training.config import Device, Preset


@dataclass(frozen=True)
class BenchRender:
    """Measure the milliseconds of a view of many Gaussians, part by part, forward and backward, on the CPU or a GPU."""

    scene: Path | None = None
    """A splat file (.ply, .spz, .splat, .sog), seen from (1.8, 1.6, 1.6) toward (6, 4.8, 1) with a field of view of 70
    degrees. Default: a room made in memory."""
    gaussians: int = 100_000
    """Gaussians of the room in memory."""
    size: str = "640x480"
    """Width and height in pixels."""
    rounds: int = 15
    """Number of rounds per median."""
    classic: bool = False
    """Render without opacity compensation."""
    device: Device = "auto"
    """Renderer: gsplat on a CUDA GPU, the CPU kernels, or auto for a GPU if there is one."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Runs the command. Raises InputError if an option is invalid."""
        from nvsim.benchmarks.random_room import random_room
        from nvsim.benchmarks.render import inside_view, measure
        from nvsim.splats.formats.choice import read_splats
        from nvsim.training.devices.choice import gpu_name

        width, height = _size(self.size)
        if self.rounds < 1 or self.gaussians < 1:
            raise InputError("A measurement needs at least one round and one Gaussian.")
        if self.scene is None:
            gaussians = random_room(self.gaussians)
        else:
            splats = read_splats(self.scene)
            gaussians = splats.gaussians
            terminal.print_notes(splats.notes)
        camera, place = inside_view(width, height), gpu_name(self.device)
        if place is None:
            figures = measure(gaussians, camera, not self.classic, self.rounds)
        else:
            from nvsim.benchmarks.render_card import measure as measure_card

            figures = measure_card(gaussians, camera, not self.classic, self.rounds, place)
        terminal.figures(figures, self.json, "a view")
        return 0


_EYE, _AHEAD = (1.8, 1.6, 1.6), (4.2, 3.2, -0.6)  # camera position in a splat file in meters, and its direction
_FIELD = 70.0  # degrees


@dataclass(frozen=True)
class BenchOpengl:
    """Measure the milliseconds of an OpenGL frame and its parts, and frames per second, compared with the kernels, on a
    splat file or a project."""

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

    def run(self) -> int:
        """Runs the command. Raises InputError if an option is invalid, or if the project has no models."""
        from nvsim.benchmarks.panorama import furnished_hall
        from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
        from nvsim.project.project import Project
        from nvsim.render.opengl.benchmark import measure, with_floor_and_background
        from nvsim.splats.formats.choice import read_splats

        sizes = [_size(text) for text in self.size]
        if self.rounds < 1:
            raise InputError(f"--rounds {self.rounds} is out of range; give --rounds 1 or more.")
        heading, elevation = math.atan2(_AHEAD[0], _AHEAD[1]), math.atan2(_AHEAD[2], math.hypot(*_AHEAD[:2]))
        pose = camera_pose(np.array(_EYE), heading, elevation)
        if self.scene is not None and self.project is not None:
            raise InputError("Give --scene or --project, not both.")
        if self.project is not None:
            with Project.open(self.project) as project:
                scene, capture = project.scene(), project.need_capture()
            if scene is None:
                raise missing_result_error(self.project, "train")
            pose = capture.frames[len(capture.frames) // 2].camera_to_world
            _, model = scene.model_at(pose[:3, 3])
        elif self.scene is not None:
            splats = read_splats(self.scene)
            terminal.print_notes(splats.notes)
            model = with_floor_and_background(splats.gaussians, splats.antialiased is not False)
        else:
            model, _ = furnished_hall()
        found = []
        for width, height in sizes:
            camera = Camera(Intrinsics.from_fov(width, height, math.radians(_FIELD)), pose)
            found.append(measure(model, camera, self.rounds))
            if not self.json or len(sizes) == 1:
                terminal.figures(found[-1], self.json, f"an OpenGL frame of {width}x{height}")
        if self.json and len(sizes) > 1:
            print_lines(terminal.as_json(found))
        return 0


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise InputError(f"The size {text!r} is not valid; write it as 640x480.")
    return int(width), int(height)


_PLACES = 8


@dataclass(frozen=True)
class BenchPanorama:
    """Measure the milliseconds of panoramas, complete and only the corridors' regions, on a project or a hall in
    memory."""

    project: Path | None = None
    """A project with trained models. Default: a furnished hall made in memory."""
    rounds: int = 5
    """Number of rounds per median."""
    backend: Literal["auto", "numba", "gsplat"] = "auto"
    """Renderer: gsplat if it is installed and there is a CUDA GPU, else the CPU kernels."""
    memory: Memory = None
    """GiB of memory for trained models. Default: a quarter of the machine's memory."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Runs the command. Raises InputError if an option is invalid, or if the project has no models."""
        from nvsim.benchmarks.panorama import furnished_hall, measure
        from nvsim.project.floor_heights import floor_of
        from nvsim.project.project import Project

        if self.rounds < 1:
            raise InputError(f"--rounds {self.rounds} is out of range; give --rounds 1 or more.")
        if self.project is None:
            model, places = furnished_hall()
            figures = measure(model, places, model.floor.height_at, self.rounds, self.backend)
        else:
            with Project.open(self.project) as project:
                scene = project.scene(memory_budget(self.memory))
                if scene is None:
                    raise missing_result_error(self.project, "train")
                positions, floor = project.need_capture().positions, floor_of(project)
            # Evenly spread along the trajectory and in its order, because the search visits neighbors in turn.
            places = positions[np.linspace(0, len(positions) - 1, _PLACES).round().astype(int)]
            figures = measure(scene, places, floor.height_at, self.rounds, self.backend)
        terminal.figures(figures, self.json, "panoramas")
        return 0


@dataclass(frozen=True)
class BenchTrain:
    """Measure the milliseconds of a training step and its parts, compared with rendering forward and backward, on a
    room made in memory."""

    gaussians: int = 100_000
    """Number of Gaussians."""
    size: str = "640x480"
    """Pixels of an image, WIDTHxHEIGHT."""
    sh_degree: int = 3
    """Degree of their spherical harmonics, 0 to 3."""
    preset: Preset = "nvsim"
    """Preset of losses and colors. The options above set the Gaussians and their harmonics."""
    device: Device = "auto"
    """Device: a CUDA GPU, where a plain step of gsplat and torch is measured too, the CPU, or auto for a GPU if there
    is one."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Runs the command. Raises InputError if an option is invalid."""
        from nvsim.benchmarks.train import measure

        width, height = _size(self.size)
        if self.gaussians < 1 or not 0 <= self.sh_degree <= 3:
            raise InputError("--gaussians must be positive, and --sh-degree 0 to 3.")
        figures = measure(self.gaussians, width, height, self.sh_degree, device=self.device, preset_name=self.preset)
        terminal.figures(figures, self.json, "a training step")
        return 0


@dataclass(frozen=True)
class BenchDepth:
    """Measure the milliseconds of the depth of a frame, on a trajectory through the built-in building, made in
    memory."""

    frames: int = 12
    """Number of images. Their depth is estimated, checked against other images, and fused."""
    json: bool = False
    """Print one JSON object."""
    config: Inline[DepthConfig] = field(default_factory=DepthConfig)

    def run(self) -> int:
        """Runs the command. Raises InputError if --frames is out of range."""
        from nvsim.benchmarks.depth import measure

        if not 2 <= self.frames <= 1000:
            raise InputError(f"--frames {self.frames} is out of range; give 2 to 1000.")
        terminal.figures(measure(self.frames, self.config), self.json, "depth")
        return 0


@dataclass(frozen=True)
class BenchPerception:
    """Measure the milliseconds of the floor and normals networks for an image."""

    width: int = 540
    """Width of the image in pixels."""
    height: int = 360
    """Height of the image in pixels."""
    images: int = 20
    """Number of runs of each network."""
    semantic: str = BUNDLED
    """The semantic network: a model's name (see nvsim models)."""
    normals: str = BUNDLED
    """The normals network."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Runs the command. Raises InputError if the image size or --images is out of range."""
        from nvsim.benchmarks.perception import measure

        if not (16 <= self.width <= 8192 and 16 <= self.height <= 8192 and 1 <= self.images <= 10_000):
            raise InputError("--width and --height must be 16 to 8192 pixels, and --images 1 to 10000.")
        terminal.figures(
            measure(self.width, self.height, self.images, self.semantic, self.normals), self.json, "perception"
        )
        return 0


@dataclass(frozen=True)
class BenchMap:
    """Measure the viewpoints per second of the map builder, on a model made in memory."""

    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        from nvsim.benchmarks.map_builder import measure

        terminal.figures(measure(), self.json, "map building")
        return 0


@dataclass(frozen=True)
class BenchSimulator:
    """Measure the states and images per second of the simulator: without images for 1 and 64 environments, from
    skyboxes at 640 x 480, and live from the trained models of a project if one is named."""

    project: Path | None = None
    """A project with trained models and a graph, whose views are rendered live."""
    seconds: float = 2.0
    """Duration of each measurement in seconds."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Runs the command. Raises InputError if --seconds is out of range."""
        from nvsim.benchmarks.simulator import measure

        if not 0 < self.seconds <= 600:
            raise InputError(f"--seconds {self.seconds:g} is out of range; give --seconds from 0.1 to 600.")
        terminal.figures(measure(self.project, self.seconds), self.json, "simulator")
        return 0
