"""A project of two submaps with small models of Gaussians, and a graph of a few viewpoints, ready to be exported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from nvsim.benchmarks.panorama import furnished_hall
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.project.project import Project
from nvsim.splats.files import save_model
from nvsim.splats.types import SubmapModel
from nvsim.submaps.split import Submap

IDS = ["b" * 32, "a" * 32, "c" * 32, "d" * 32, "e" * 32]


def graph() -> NavGraph:
    """Five viewpoints in a row, the last one left out of navigation."""
    viewpoints = {id: Viewpoint(id, (2.0 + 2.2 * i, 3.0 + 0.1 * i, 1.5)) for i, id in enumerate(IDS)}
    viewpoints[IDS[-1]] = replace(viewpoints[IDS[-1]], included=False)
    return NavGraph("hall", viewpoints, {(min(p), max(p)): edge(*p) for p in zip(IDS, IDS[1:], strict=False)})


def small_model(shade: float) -> SubmapModel:
    """Every 20th Gaussian of a furnished hall, larger, and brighter by `shade`."""
    model, _ = furnished_hall()
    g = model.gaussians
    sh = g.sh[::20, :4].copy()
    sh[:, 0] += shade
    parts = (g.means[::20], g.log_scales[::20] + 1.0, g.quats[::20], g.opacity_logits[::20], sh)
    return replace(model, gaussians=type(g)(*(np.ascontiguousarray(part) for part in parts)))


def scan_project(folder: Path) -> Path:
    """Writes the project; returns its folder."""
    root = folder / "hall.nvsim"
    with Project.create_or_open(root) as project:
        halves = [
            np.column_stack([np.linspace(*ends, 6), np.full(6, 3.0), np.full(6, 1.5)]) for ends in ((1, 5), (6, 11))
        ]
        frames = [tuple(range(6)), tuple(range(6, 12))]
        submaps = tuple(Submap(i, frames[i], frames[i], halves[i]) for i in range(2))
        project.set_submaps(submaps)
        project.set_graph(graph())
        for i in range(2):
            save_model(small_model(0.3 * i), project.layout.model(i))
    return root


def two_rooms(first: int, second: int) -> NavGraph:
    """Two cliques of so many viewpoints in the hall, the ids of which begin with 0 and 1, joined by one edge."""
    rooms = [[f"{room}{i:031d}" for i in range(count)] for room, count in enumerate((first, second))]
    viewpoints = {
        id: Viewpoint(id, (3.0 + 6.0 * room + 0.7 * (i % 3), 2.0 + 1.3 * (i // 3), 1.5))
        for room, ids in enumerate(rooms)
        for i, id in enumerate(ids)
    }
    pairs = [(a, b) for ids in rooms for a in ids for b in ids if a < b] + [(rooms[0][0], rooms[1][0])]
    return NavGraph("hall", viewpoints, {pair: edge(*pair) for pair in pairs})
