"""Writes the floor plans of a scan: for each storey an image, one with the graph, and the world transform as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic
from nvsim.graph.exports.picture import Dot, Line, Picture
from nvsim.graph.exports.picture_files import write_png
from nvsim.graph.types import NavGraph
from nvsim.r2r.observations.encoding import png
from nvsim.r2r.observations.floor_plan import CUT, Frame, draw_plan
from nvsim.splats.scene import SceneModel
from nvsim.submaps.storeys import storeys_of
from nvsim.submaps.types import Submap

NAME = "floor_plans.json"
_EDGE, _NODE, _LEADING_AWAY = (25, 105, 200), (170, 30, 40), (150, 110, 190)
_RADIUS = 0.10  # radius of a viewpoint in meters
_BAR = 2  # length of the scale bar in meters


@dataclass(frozen=True, eq=False)
class Storey:
    """One storey.

    number     1 for the lowest
    positions  (N, 3) camera positions, meters, world; owners (N,) their submaps
    ids        its viewpoints
    """

    number: int
    positions: NDArray[np.float64]
    owners: NDArray[np.int64]
    ids: tuple[str, ...]


def storeys_with(graph: NavGraph, submaps: tuple[Submap, ...]) -> Iterator[Storey]:
    """Yields the storeys of the trajectory, from the lowest, with the viewpoints of `graph` nearest in height.

    `submaps` are those that have a model.
    """
    positions = np.concatenate([s.positions for s in submaps])
    owners = np.concatenate([np.full(len(s.positions), s.index, np.int64) for s in submaps])
    found = storeys_of(positions)
    heights = np.array([v.position[2] for v in graph.viewpoints.values()])
    nearest = found.nearest(heights)
    for k in range(len(found.levels)):
        on = found.on(k)
        ids = tuple(id for id, storey in zip(graph.viewpoints, nearest, strict=True) if storey == k)
        if on.any():
            yield Storey(k + 1, positions[on], owners[on], ids)


def write_plans(scene: SceneModel, graph: NavGraph, submaps: tuple[Submap, ...], folder: Path) -> list[Path]:
    """Writes storey_N.png, storey_N_graph.png and floor_plans.json into `folder` and returns their paths.

    Raises InputError if a model is unreadable or writing fails.
    """
    written, notes = [], []
    for storey in storeys_with(graph, submaps):
        frame = frame_of(graph, storey)
        image = draw_plan(scene, frame, storey.positions, storey.owners)
        plain, drawn = (folder / f"storey_{storey.number}{end}.png" for end in ("", "_graph"))
        atomic.write_bytes(plain, png(image))
        write_png(_with_graph(graph, storey, frame, image), drawn)
        written += [plain, drawn]
        notes.append(_note(graph, storey, frame, plain, drawn))
    about = {
        "scan": graph.scan,
        "pixels": "column, row = world_to_pixel @ (x, y, 1); (0.5, 0.5) is the center of the first pixel; +y is up",
        "cut": CUT,
        "storeys": notes,
    }
    path = folder / NAME
    atomic.write_text(path, json.dumps(about, indent=1) + "\n")
    return [*written, path]


def frame_of(graph: NavGraph, storey: Storey) -> Frame:
    """Returns the area that the plan of a storey shows."""
    places = np.array([graph.viewpoints[id].position for id in storey.ids], np.float64).reshape(-1, 3)
    return Frame.around(np.concatenate([storey.positions, places]))


def _note(graph: NavGraph, storey: Storey, frame: Frame, plain: Path, drawn: Path) -> dict[str, Any]:
    floors = [graph.viewpoints[id].position[2] - graph.viewpoints[id].height for id in storey.ids]
    return {
        "storey": storey.number,
        "plan": plain.name,
        "plan_with_graph": drawn.name,
        "width": frame.width,
        "height": frame.height,
        "metres_per_pixel": frame.metres,
        "world_to_pixel": frame.world_to_pixel,
        "floor": float(np.median(floors)) if floors else None,
        "viewpoints": {id: list(frame.pixel(*graph.viewpoints[id].position[:2])) for id in storey.ids},
    }


def _with_graph(graph: NavGraph, storey: Storey, frame: Frame, image: NDArray[np.uint8]) -> Picture:
    here = set(storey.ids)

    def at(id: str) -> tuple[float, float]:
        return frame.pixel(*graph.viewpoints[id].position[:2])

    radius = max(_RADIUS / frame.metres, 3.0)
    lines = tuple(
        Line(at(a), at(b), _EDGE if {a, b} <= here else _LEADING_AWAY, max(0.4 * radius, 1.0))
        for a, b in graph.edges
        if {a, b} & here
    )
    dots = tuple(Dot(at(id), radius, _NODE, graph.viewpoints[id].included, id) for id in storey.ids)
    bar = _BAR / frame.metres, f"{_BAR} m"
    return Picture(frame.width, frame.height, image, lines, dots, bar, graph.scan)
