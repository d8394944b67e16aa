"""Commands on occupancy maps: build one, compare two."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from nvsim.capture import formats
from nvsim.cli import terminal
from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.console import event_listener
from nvsim.cli.session import project_job
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log
from nvsim.files.atomic import refuse_unwritable_file
from nvsim.occupancy.read import ROS, read_map
from nvsim.occupancy.types import Heights

if TYPE_CHECKING:
    from nvsim.project.project import Project


VERB = "occupancy build"
_CAPTURE = f"A folder or file: {formats.names()}; or name a project with --project."


@dataclass(frozen=True)
class OccupancyBuild:
    """Build an occupancy map from the data of a capture: its scans, its depth images, the depth estimated from its
    images, or, less reliably, the rendered depth of the trained models.

    Cells along a ray become free, and cells at its end become occupied, as in OctoMap. The map is written as a ROS
    map_server pair.
    """

    capture: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(help=_CAPTURE)] = None
    project: Path | None = None
    """The project folder, NAME.nvsim, instead of a capture."""
    source: Literal["auto", "lidar", "depth", "images", "trained"] = "auto"
    """Source of the rays. auto: the best available. A map of trained models is never used to evaluate the project of
    these models."""
    out: Path | None = None
    """The map file, NAME.yaml; its image is written next to it. Default: in the project, as the project's map."""
    resolution: float = 0.05
    """Meters per cell."""
    heights: Inline[Heights] = field(default_factory=Heights)
    reach: float | None = None
    """Maximum length of rays in meters. Default: 12 for a LiDAR scan, 4 for depth estimated from images, 5 for other
    depth."""
    walked: float = 0.1
    """Meters on each side of the trajectory that are free even if rays say otherwise. The person with the camera passed
    there, so obstacles in it moved away, or the area was never seen. 0 uses only the rays."""
    camera_height: float | None = None
    """Height of the cameras above the floor in meters, for a capture that has no scale or shows no floor."""
    scale: float | None = None
    """Meters per unit, for a capture without a scale."""
    json: bool = False
    """Print events and the result as JSON."""

    def run(self) -> int:
        from nvsim.project.project import Project

        _check(self)
        if self.project is None:
            with event_listener(self.json) as listen:
                return _build(self, None, listen)
        if self.out is None:  # the map goes into the project; a window that shows it notices the job
            with project_job(self.project, VERB, self.json) as (project, listen):
                return _build(self, project, listen)
        with Project.open(self.project) as project, event_listener(self.json) as listen:
            return _build(self, project, listen)


def _check(arguments: OccupancyBuild) -> None:
    if (arguments.capture is None) == (arguments.project is None):
        raise InputError("A map is built from a capture or from a project; give either CAPTURE or --project.")
    if arguments.project is not None and arguments.scale is not None:
        raise InputError("A project already has a scale; drop --scale.")
    if arguments.out is None and arguments.project is None:
        raise InputError("A map of a capture needs an output file; name one with --out NAME.yaml.")
    if arguments.out is None and arguments.source == "trained":
        raise InputError("A map of trained models cannot be the project's own; name a file with --out NAME.yaml.")
    if arguments.out is not None and arguments.out.suffix.lower() not in ROS:
        raise InputError(f"A map cannot be written to {arguments.out}; name a file that ends in .yaml.")
    if arguments.out is not None:
        refuse_unwritable_file(arguments.out)


def _build(arguments: OccupancyBuild, project: Project | None, listen: Listener) -> int:
    from nvsim.capture.read import read
    from nvsim.occupancy.ros import write_ros_map
    from nvsim.occupancy.types import FREE, OCCUPIED
    from nvsim.project.occupancy_maps import build_occupancy
    from nvsim.project.occupancy_sources import STAGE, find_capture_with_ranges, find_rays
    from nvsim.project.stages.imported import capture_config

    started = time.monotonic()
    height = arguments.camera_height
    if project is not None:
        measured = arguments.source not in ("images", "trained")
        capture = find_capture_with_ranges(project, listen) if measured else project.need_capture()
        height = height or capture_config(project).camera_height
    else:
        assert arguments.capture is not None  # `_check`
        capture = read(arguments.capture, scale=arguments.scale, camera_height=height)
        if not capture.alignment.scale_known:
            raise InputError(
                f"{arguments.capture} has no metric scale: give --camera-height METERS above the floor, or --scale."
            )
    rays = find_rays(capture, project, arguments.source)
    if arguments.out is None and rays.source == "trained":
        raise InputError(
            f"{arguments.project} has only its models to build a map from, and such a map cannot be its own; name a "
            "file with --out NAME.yaml, or run `nvsim depth --project` first."
        )
    built = build_occupancy(
        capture,
        project,
        rays,
        arguments.resolution,
        arguments.heights,
        reach=arguments.reach,
        walked=arguments.walked,
        camera_height=height,
        listen=listen,
    )
    out = arguments.out or (project.layout.occupancy if project is not None else Path("map.yaml"))
    image = write_ros_map(built.occupancy, out, built.provenance)
    rows, columns = built.occupancy.cells.shape
    figures = {
        "map": str(out),
        "image": str(image),
        "source": rays.source,
        "note": built.provenance.note,
        "cells": [columns, rows],
        "free_m2": built.area(FREE),
        "occupied_m2": built.area(OCCUPIED),
        "unseen_points": built.unseen,
        "cells_met": built.cells_met,
        "seconds": round(time.monotonic() - started, 1),
    }
    area = f"{built.area(FREE):.1f} m² free, {built.area(OCCUPIED):.1f} m² occupied"
    listen(Log(built.provenance.note, STAGE))
    listen(Done(STAGE, f"{area}, written to {out}", figures))
    return 0


@dataclass(frozen=True)
class OccupancyCompare:
    """Compare an occupancy map with a true one: the shares of true free and true occupied cells that are free, occupied
    and unknown in it."""

    found: Positional[Path]
    """The map to test: a ROS map.yaml or an OctoMap .bt or .ot."""
    true: Positional[Path]
    """The true map, in one of these formats and in the frame of the first."""
    heights: Inline[Heights] = field(default_factory=Heights)
    json: bool = False
    """Print the results as JSON."""

    def run(self) -> int:
        from nvsim.occupancy.types import compare_maps

        found, true = (read_map(path, self.heights) for path in (self.found, self.true))
        terminal.print_notes((*found.notes, *true.notes))
        terminal.figures(compare_maps(found, true), self.json, "occupancy map")
        return 0
