"""Finds for each neighbor of a viewpoint the one of the 36 views that shows it best, and its place in that view.

This is the closed form of the sweep that VLN-DUET, HAMT and Recurrent-VLN-BERT do with Matterport3DSimulator at 640x480
and 60 degrees. A view shows the neighbors within 40 degrees of its heading. This is the simulator's restricted
navigation, whose field of view grows linearly with the width. If several views show a neighbor, the view with the
smallest sqrt(heading² + elevation²) is selected, with both angles measured from the view's axis.

The JSON files are for agents that run without a simulator. They need only the graph. Sources: the loaders of VLN-DUET
(pretrain_src/data/dataset.py), NavGPT-2 (map_nav_src/r2r/env.py), SAME (src/tasks/datasets/mp3d_dataset.py and
mp3d_envs.py) and NavGPT (nav_src/env.py and agent.py). A key SCAN_VP is the scan id and the viewpoint id joined by "_".
Angles are in radians, distances in meters, positions [x, y, z] in meters.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic
from nvsim.geometry.directions import HEIGHT, VFOV, VIEWS, WIDTH, heading_and_elevation
from nvsim.r2r.features.exported_scan import ExportedScan

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

TIE = 1e-5
"""Radians. If the angles of two views differ by less, the lowest viewIndex is selected, as in exact arithmetic with the
agents' strict comparison. The simulator computes in 32 bits, so its choice in such ties depends on rounding."""
_SEEN = VFOV * WIDTH / HEIGHT / 2
HEADINGS, ELEVATIONS = np.array([heading_and_elevation(view) for view in range(VIEWS)]).T
"""(36,) radians, heading and elevation of the views, by viewIndex."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """The neighbors that the sweeps show, in the order of the sweep.

    They are sorted by viewpoint, then by the first view that shows them, then by the angle from that view's axis.

    source, target             (m,) indices of viewpoints
    view                       (m,) viewIndex, called "pointId" by the agents
    angle                      (m,) radians, sqrt(rel_heading² + rel_elevation²)
    rel_heading, rel_elevation (m,) radians from the view's axis; right and up are positive
    heading, elevation         (m,) radians, world: 0 is +y; heading is the view's plus rel_heading, from -15 to 345
                               degrees
    distance                   (m,) meters
    unseen                     (k, 2) edges that no sweep shows: straight up, straight down, or of zero length
    """

    source: Int64
    target: Int64
    view: Int64
    angle: Float64
    rel_heading: Float64
    rel_elevation: Float64
    heading: Float64
    elevation: Float64
    distance: Float64
    unseen: Int64


def candidates_of(positions: Float64, edges: Int64) -> Candidates:
    """Computes the candidates of directed `edges` (m, 2), indices of `positions` (n, 3), meters, world."""
    way = positions[edges[:, 1]] - positions[edges[:, 0]]
    level = np.hypot(way[:, 0], way[:, 1])
    unseen, edges = edges[level == 0], edges[level > 0]
    way, level = way[level > 0], level[level > 0]
    heading = np.arctan2(way[:, 0], way[:, 1])
    elevation = np.arctan2(way[:, 2], level)
    rel_heading = np.pi - np.mod(np.pi - (heading[:, None] - HEADINGS), 2 * np.pi)  # (m, 36), in (-pi, pi]
    rel_elevation = elevation[:, None] - ELEVATIONS
    shown = np.abs(rel_heading) <= _SEEN
    angle = np.hypot(rel_heading, rel_elevation)
    best = np.where(shown, angle, np.inf).min(axis=1, keepdims=True, initial=np.inf)
    view = np.argmax(shown & (angle <= best + TIE), axis=1)
    each = np.arange(len(edges))
    first = np.argmax(shown, axis=1)
    met = np.lexsort((edges[:, 1], np.rint(angle[each, first] / TIE), first, edges[:, 0]))
    each, view, edges = each[met], view[met], edges[met]
    return Candidates(
        source=edges[:, 0],
        target=edges[:, 1],
        view=view,
        angle=angle[each, view],
        rel_heading=rel_heading[each, view],
        rel_elevation=rel_elevation[each, view],
        heading=HEADINGS[view] + rel_heading[each, view],
        elevation=elevation[met],
        distance=np.linalg.norm(way[met], axis=1),
        unseen=unseen,
    )


def _relangles(scan: ExportedScan, found: Candidates, i: int, k: int) -> list[Any]:
    return [int(found.view[i]), *(float(v[i]) for v in (found.angle, found.rel_heading, found.rel_elevation))]


def _navgpt2(scan: ExportedScan, found: Candidates, i: int, k: int) -> list[Any]:
    return [int(found.view[i]), k, *_common_values(scan, found, i, k)[1:]]


def _common_values(scan: ExportedScan, found: Candidates, i: int, k: int) -> list[Any]:
    angles = float(found.distance[i]), float(found.heading[i]), float(found.elevation[i])
    return [int(found.view[i]), *angles, _position(scan, int(found.target[i]))]


def _navgpt(scan: ExportedScan, found: Candidates, i: int, k: int) -> dict[str, float]:
    # NavGPT assigns candidates to eight sectors from -22.5 degrees on, and drops candidates beyond the last sector.
    heading = float(found.heading[i])
    if heading >= math.radians(337.5):
        heading -= 2 * math.pi
    return {**_navigable(scan, found, i, k), "heading": heading}


def _navigable(scan: ExportedScan, found: Candidates, i: int, k: int) -> dict[str, float]:
    # Simulators that read this file compute the viewIndex from a heading, which must be between -15 and 345 degrees.
    return {
        "heading": float(found.heading[i]),
        "elevation": float(found.elevation[i]),
        "distance": float(found.distance[i]),
    }


Row = Callable[[ExportedScan, Candidates, int, int], Any]
"""Makes the entry of candidate number i, which is the k-th of its viewpoint: (scan, candidates, i, k) -> entry."""
_KEYED: Mapping[str, Row] = {
    "scanvp_candview_relangles.json": _relangles,
    "scanvp_candidates.json": _navgpt2,
    "mp3d_scanvp_candidates.json": _common_values,
}


@dataclass(frozen=True)
class WrittenCandidates:
    """The files and counts of one call of `write_candidates`.

    paths       the written files
    viewpoints  number of viewpoints
    candidates  number of directed edges in the files
    unseen      (scan, from, to) of the directed edges that no view shows
    """

    paths: list[Path]
    viewpoints: int
    candidates: int
    unseen: list[tuple[str, str, str]]


def write_candidates(scans: Iterable[ExportedScan], out: Path) -> WrittenCandidates:
    """Writes all candidate files of `scans` into the folder `out`. Raises InputError if writing fails."""
    keyed: dict[str, dict[str, Any]] = {name: {} for name in _KEYED}
    navigable: dict[str, Any] = {}
    places: dict[str, Any] = {}
    written = WrittenCandidates([], 0, 0, [])
    viewpoints = candidates = 0
    for scan in scans:
        found = candidates_of(scan.positions, scan.edges)
        viewpoints += len(scan.viewpoints)
        candidates += len(found.view)
        written.unseen.extend((scan.id, scan.viewpoints[a], scan.viewpoints[b]) for a, b in found.unseen)
        for name, row in _KEYED.items():
            keyed[name] |= {f"{scan.id}_{id}": rows for id, rows in _rows(scan, found, row).items()}
        navigable[scan.id] = _rows(scan, found, _navigable)
        places[scan.id] = {id: _position(scan, i) for i, id in enumerate(scan.viewpoints)}
        path = out / "navigable" / f"{scan.id}_navigable.json"
        written.paths.append(_write(path, _rows(scan, found, _navgpt)))
    whole = {**keyed, "navigable.json": navigable, "location.json": places, "mp3d_connectivity_graphs.json": places}
    written.paths.extend(_write(out / name, values) for name, values in whole.items())
    return WrittenCandidates(written.paths, viewpoints, candidates, written.unseen)


def _rows(scan: ExportedScan, found: Candidates, row: Row) -> dict[str, dict[str, Any]]:
    """Returns viewpoint -> neighbor -> entry; viewpoints without candidates have an empty dictionary."""
    rows: dict[str, dict[str, Any]] = {id: {} for id in scan.viewpoints}
    for i, (source, target) in enumerate(zip(found.source, found.target)):
        of = rows[scan.viewpoints[source]]
        of[scan.viewpoints[target]] = row(scan, found, i, len(of))
    return rows


def _position(scan: ExportedScan, index: int) -> list[float]:
    return [float(v) for v in scan.positions[index]]


def _write(path: Path, values: Any) -> Path:
    atomic.write_text(path, json.dumps(values, separators=(",", ":")))
    return path
