"""Build an occupancy map from what a capture has: its scans, its depth images, the depth of its images, or, weaker, the
rendered depth of the trained models.

Rays free what they pass and occupy where they end, as in OctoMap; the map is written as a ROS map_server pair.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from nvsim.capture import formats
from nvsim.cli.arguments import Inline
from nvsim.cli.console import listening
from nvsim.cli.session import working
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log
from nvsim.occupancy.heights import Heights
from nvsim.occupancy.read import ROS

if TYPE_CHECKING:
    from nvsim.project.project import Project

VERB = "occupancy build"

_CAPTURE = f"A folder or file: {formats.names()}; or name a project with --project."


@dataclass(frozen=True)
class Arguments:
    capture: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(help=_CAPTURE)] = None
    project: Path | None = None
    """The project folder, NAME.nvsim, in place of a capture."""
    source: Literal["auto", "lidar", "depth", "images", "trained"] = "auto"
    """What rays are cast from; the best that there is when left out. A map of trained models never
    judges the project that they belong to."""
    out: Path | None = None
    """The map's file, NAME.yaml; its image lies beside it. In the project when left out, which then takes it for its
    map."""
    resolution: float = 0.05
    """Metres per cell."""
    heights: Inline[Heights] = field(default_factory=Heights)
    reach: float | None = None
    """Metres after which rays end; 12 of a scan, 4 of the depth of images, 5 of other depth when left out."""
    walked: float = 0.1
    """Metres to either side of the trajectory that are free whatever rays say: who carried the camera
    there was not stopped by what moved, or was never seen; 0 for what rays say alone."""
    camera_height: float | None = None
    """Metres of the cameras above the floor, for a capture that has no scale or shows no floor."""
    scale: float | None = None
    """Metres per unit, for a capture that has no scale."""
    json: bool = False
    """Print typed events, and the result, as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.project.project import Project

    _check(arguments)
    if arguments.project is None:
        with listening(arguments.json) as listen:
            return _build(arguments, None, listen)
    if arguments.out is None:  # written into the project, which a window that shows it notices by the job
        with working(arguments.project, VERB, arguments.json) as (project, listen):
            return _build(arguments, project, listen)
    with Project.open(arguments.project) as project, listening(arguments.json) as listen:
        return _build(arguments, project, listen)


def _check(arguments: Arguments) -> None:
    if (arguments.capture is None) == (arguments.project is None):
        raise InputError("A map is built from a capture or from a project; give either CAPTURE or --project.")
    if arguments.project is not None and arguments.scale is not None:
        raise InputError("A project has its scale; leave out --scale.")
    if arguments.out is None and arguments.project is None:
        raise InputError("A map of a capture needs a place; name a file with --out NAME.yaml.")
    if arguments.out is None and arguments.source == "trained":
        raise InputError("A map of trained models cannot be the project's own; name a file with --out NAME.yaml.")
    if arguments.out is not None and arguments.out.suffix.lower() not in ROS:
        raise InputError(f"A map cannot be written to {arguments.out}; name a file that ends in .yaml.")


def _build(arguments: Arguments, project: Project | None, listen: Listener) -> int:
    from nvsim.capture.read import read
    from nvsim.occupancy.ros import write_ros_map
    from nvsim.occupancy.types import FREE, OCCUPIED
    from nvsim.project.occupancy_build import build_occupancy
    from nvsim.project.occupancy_sources import STAGE, capture_with_ranges, find_rays
    from nvsim.project.stages.imported import capture_config

    started = time.monotonic()
    height = arguments.camera_height
    if project is not None:
        measured = arguments.source not in ("images", "trained")
        capture = capture_with_ranges(project, listen) if measured else project.need_capture()
        height = height or capture_config(project).camera_height
    else:
        assert arguments.capture is not None  # `_check`
        capture = read(arguments.capture, scale=arguments.scale, camera_height=height)
        if not capture.alignment.scale_known:
            raise InputError(
                f"{arguments.capture} has no metric scale: give --camera-height METRES above the floor, or --scale."
            )
    rays = find_rays(capture, project, arguments.source)
    if arguments.out is None and rays.source == "trained":
        raise InputError(
            f"{arguments.project} has nothing but its models to build a map from, which cannot be its own map; name a "
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
