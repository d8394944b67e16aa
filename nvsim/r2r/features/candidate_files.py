"""Writes the JSON files of agents that run without a simulator. They need only the graph.

Sources: the loaders of VLN-DUET (pretrain_src/data/dataset.py), NavGPT-2 (map_nav_src/r2r/env.py), SAME
(src/tasks/datasets/mp3d_dataset.py and mp3d_envs.py) and NavGPT (nav_src/env.py and agent.py). A key SCAN_VP is the
scan id and the viewpoint id joined by "_". Angles are in radians, distances in meters, positions [x, y, z] in meters.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nvsim.files import atomic
from nvsim.r2r.features.candidates import Candidates, candidates_of
from nvsim.r2r.features.exported_scan import ExportedScan

Row = Callable[[ExportedScan, Candidates, int, int], Any]
"""Makes the entry of candidate number i, which is the k-th of its viewpoint: (scan, candidates, i, k) -> entry."""


def _relangles(scan: ExportedScan, found: Candidates, i: int, k: int) -> list[Any]:
    return [int(found.view[i]), *(float(v[i]) for v in (found.angle, found.rel_heading, found.rel_elevation))]


def _navgpt2(scan: ExportedScan, found: Candidates, i: int, k: int) -> list[Any]:
    return [int(found.view[i]), k, *_same(scan, found, i, k)[1:]]


def _same(scan: ExportedScan, found: Candidates, i: int, k: int) -> list[Any]:
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


@dataclass(frozen=True)
class Written:
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


def write_candidates(scans: Iterable[ExportedScan], out: Path) -> Written:
    """Writes all candidate files of `scans` into the folder `out`. Raises InputError if writing fails."""
    keyed: dict[str, dict[str, Any]] = {name: {} for name in _KEYED}
    navigable: dict[str, Any] = {}
    places: dict[str, Any] = {}
    written = Written([], 0, 0, [])
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
    return Written(written.paths, viewpoints, candidates, written.unseen)


_KEYED: Mapping[str, Row] = {
    "scanvp_candview_relangles.json": _relangles,
    "scanvp_candidates.json": _navgpt2,
    "mp3d_scanvp_candidates.json": _same,
}


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
