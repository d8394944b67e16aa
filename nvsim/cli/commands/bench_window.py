"""Commands that measure the cost of the window, and of the edits that it shows."""

from __future__ import annotations

import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.cli import terminal
from nvsim.cli.commands.app import has_display, is_window_installed, measured_by_window
from nvsim.errors import InputError
from nvsim.events import ignore_event


@dataclass(frozen=True)
class BenchStartup:
    """Measure the seconds until `nvsim --help` has answered and until an empty window is usable."""

    json: bool = False
    """Print one JSON object."""
    runs: int = 5
    """Number of runs per median."""

    def run(self) -> int:
        """Runs the command. Raises InputError if --runs is out of range."""
        if not 1 <= self.runs <= 1000:
            raise InputError(f"--runs {self.runs} is out of range; give 1 to 1000.")
        help_s = statistics.median(_seconds([sys.executable, "-P", "-m", "nvsim", "--help"]) for _ in range(self.runs))
        app_s = statistics.median(_window_seconds() for _ in range(self.runs))
        terminal.figures({"help_s": round(help_s, 3), "app_s": round(app_s, 3)}, self.json, "startup")
        return 0


def _seconds(command: list[str]) -> float:
    started = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - started


def _window_seconds() -> float:
    """Seconds from the start of the process to the first drawn, responsive window, as the window reports it."""
    return float(measured_by_window(["--bench"])["start_s"])


NICE = 10  # niceness of a job
_SCREEN = "2560x1440x24"
Kernels = Literal["kept", "installed", "none"]


@dataclass(frozen=True)
class BenchApp:
    """Measure the performance of the window: delays of its event loop while the camera moves and a submap trains,
    frames per second, time until the image is sharp, memory, and both views of a large graph. Uses a real window, or
    Xvfb if there is no display."""

    project: Path | None = None
    """A project with trained models. Default: a project of random rooms."""
    submaps: int = 3
    """Rooms of the generated project."""
    gaussians: int = 300_000
    """Gaussians in each of its submaps."""
    viewpoints: int = 10_000
    """Viewpoints of its graph. There are about four times as many edges."""
    train: bool = True
    """Measure a second time while a submap of the built-in building trains with low priority, as a job does."""
    kernels: Kernels = "kept"
    """Compiled kernels when the window opens: those that this machine has stored, those that an installation compiles,
    or none. The last two use an empty cache that is deleted afterward."""
    cycles: int = 0
    """Close and open the project so many times, and report the memory growth of the window."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        with tempfile.TemporaryDirectory(prefix="nvsim-bench-") as folder, _display() as environment:
            project = self.project or _project(Path(folder) / "rooms.nvsim", self)
            compiling = _begin_anew(self.kernels, environment, Path(folder) / "kernels")
            empty = measured_by_window(["--bench"], environment)
            command = [f"--project={project.resolve()}", f"--bench={self.cycles}"]
            figures = measured_by_window(command, environment)
            figures |= {name: empty[name] for name in ("start_s", "start_cpu_s")}
            figures |= compiling
            if self.train:
                with _training(Path(folder) / "trains.nvsim"):
                    busy = measured_by_window([f"--project={project.resolve()}", "--bench"], environment)
                figures |= {f"quiet_{name}": figures[name] for name in ("gap_p99_ms", "gap_max_ms")}
                figures |= {name: busy[name] for name in ("gap_p99_ms", "gap_max_ms")}
                figures |= {f"busy_{name}": busy[name] for name in ("fps_moving", "sharp_ms")}
        terminal.figures(figures, self.json, "the window")
        return 0


def _begin_anew(kernels: Kernels, environment: dict[str, str], cache: Path) -> dict[str, float]:
    """Makes windows in this environment store compiled kernels in the empty folder `cache`. With "installed", compiles
    the kernels of an installation there, and returns the seconds as compile_s."""
    if kernels == "kept":
        return {}
    cache.mkdir()
    environment["NUMBA_CACHE_DIR"] = str(cache)
    if kernels == "none":
        return {}
    begin = time.perf_counter()
    command = [sys.executable, "-P", "-m", "nvsim_app.drawing.compilation"]
    if subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, check=False).returncode != 0:
        raise InputError("The kernels could not be compiled ahead; see the message before this one for the reason.")
    return {"compile_s": round(time.perf_counter() - begin, 1)}


def _project(folder: Path, arguments: BenchApp) -> Path:
    from nvsim.benchmarks.window_project import ProjectSize, write_project

    if min(arguments.submaps, arguments.gaussians, arguments.viewpoints) < 1:
        raise InputError("A project to measure needs at least one submap, one Gaussian and one viewpoint.")
    return write_project(folder, ProjectSize(arguments.submaps, arguments.gaussians, arguments.viewpoints))


@contextmanager
def _display() -> Iterator[dict[str, str]]:
    """The environment of a window: this one's, or one with an own X server. Raises InputError without either."""
    if has_display():
        yield dict(os.environ)
        return
    server = shutil.which("Xvfb")
    if server is None:
        raise InputError("There is no display and no Xvfb; install xvfb, or run this on a desktop.")
    read, write = os.pipe()
    process = subprocess.Popen(
        [server, "-displayfd", str(write), "-screen", "0", _SCREEN, "-nolisten", "tcp"],
        pass_fds=(write,),
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    try:
        with os.fdopen(read) as answer:
            number = answer.readline().strip()  # written when the server accepts connections
        if not number:
            raise InputError("Xvfb ended before it was ready; check that it starts by itself.")
        yield {**os.environ, "DISPLAY": f":{number}", "QT_QPA_PLATFORM": "xcb"}
    finally:
        process.terminate()
        process.wait(10)


@contextmanager
def _training(folder: Path) -> Iterator[None]:
    """Runs the training of a submap of the small built-in building; starts when the first steps are done."""
    nvsim = [sys.executable, "-P", "-m", "nvsim.cli.main"]
    _prepare(folder)
    process = subprocess.Popen(
        [*nvsim, "train", "--project", str(folder), "--json", "--steps", "100000"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: os.nice(NICE),
    )
    try:
        assert process.stdout is not None
        if not any('"metric"' in line for line in process.stdout):
            raise InputError("The training did not begin; run `nvsim demo --small` to see the reason.")
        yield
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _prepare(folder: Path) -> None:
    """Processes the small built-in building up to its floor masks."""
    from nvsim.building import BuildingConfig, generate
    from nvsim.project.config import CaptureConfig, RunConfig
    from nvsim.project.project import Project
    from nvsim.project.stages import floors, imported, submaps

    with Project.create_or_open(folder) as project:
        generate(project.layout.root, BuildingConfig(seed=0, size="small"))
        imported.run(project, project.layout.built_in_capture, CaptureConfig(), ignore_event)
        submaps.run(project, RunConfig().submaps, ignore_event)
        floors.run(project, ignore_event)


@dataclass(frozen=True)
class BenchGraph:
    """Measure the milliseconds of an edit of a large navigation graph, including its findings, and until a window has
    drawn it. Also measures the seconds to open and save a file. Without a display the window is drawn in memory.
    Without Qt the window is skipped."""

    edits: int = 300
    """Number of random edits to time."""
    viewpoints: int = 10_000
    """Viewpoints of the graph. Each has four edges and eight pieces of evidence."""
    window: bool = True
    """Measure the drawing in a window as well."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Runs the command. Raises InputError if --edits or --viewpoints is out of range."""
        from nvsim.benchmarks.graph import measure

        if self.edits < 1 or self.viewpoints < 2:
            raise InputError("A measurement needs at least one edit and two viewpoints.")
        figures = measure(self.edits, self.viewpoints)
        if self.window and is_window_installed():
            painted = measured_by_window([f"--bench-edits={self.edits}", f"--viewpoints={self.viewpoints}"])
            figures = {
                "edit_p95_ms": figures.pop("edit_p95_ms"),
                "paint_p95_ms": painted.pop("paint_p95_ms"),
                **figures,
            }
            figures |= painted
        terminal.figures(figures, self.json, "graph editing")
        return 0
