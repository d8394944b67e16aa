"""Compare NVSim's candidates with those of a compiled Matterport3DSimulator, neighbor by neighbor.

    python tests/benchmarks/mattersim_candidates.py FOLDER_OF_COMPILED_MODULE [CONNECTIVITY]

FOLDER contains MatterSim.so, built from github.com/peteanderson80/Matterport3DSimulator. Without a folder of
connectivity files, a scan of 200 viewpoints at random positions is made. Different views of nearly equal distance are
counted separately.
"""

from __future__ import annotations

import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from mattersim_states import opened

from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.r2r.features.candidates import candidates_of
from nvsim.r2r.features.exported_scan import read_exported_scans


@dataclass(frozen=True)
class Arguments:
    compiled: tyro.conf.Positional[Path]
    connectivity: tyro.conf.Positional[Path | None] = None


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    sys.path.insert(0, str(arguments.compiled))
    import MatterSim

    with tempfile.TemporaryDirectory() as made:
        graphs = arguments.connectivity or Path(made)
        if arguments.connectivity is None:
            _write_random_scan(graphs)
        simulator = opened(MatterSim, graphs, discrete=True)
        total = views = ties = orders = 0
        worst = 0.0
        for scan in read_exported_scans(graphs):
            found = candidates_of(scan.positions, scan.edges)
            for n, id in enumerate(scan.viewpoints):
                theirs = _swept(simulator, scan.id, id)
                mine = np.flatnonzero(found.source == n)
                orders += [scan.viewpoints[k] for k in found.target[mine]] != list(theirs)
                assert len(mine) == len(theirs), (scan.id, id)
                for i in mine:
                    view, angle, heading, elevation, distance = theirs[scan.viewpoints[found.target[i]]]
                    total += 1
                    worst = max(worst, abs(found.distance[i] - distance), abs(found.angle[i] - angle))
                    if view != found.view[i]:
                        ties += abs(found.angle[i] - angle) < 1e-5
                        views += abs(found.angle[i] - angle) >= 1e-5
                        continue
                    worst = max(worst, abs(found.rel_heading[i] - heading), abs(found.rel_elevation[i] - elevation))
        print(
            f"{total} candidates: {views} other views, {ties} other views of equal distance, {orders} viewpoints whose "
            f"order differs; angles and distances differ by at most {worst:.1e}"
        )
        sys.exit(1 if views or worst > 1e-4 else 0)


def _swept(simulator: Any, scan: str, viewpoint: str) -> dict[str, tuple[int, float, float, float, float]]:
    """Neighbor -> view, angle, heading, elevation, distance, in the order in which the sweep finds the neighbors."""
    best: dict[str, tuple[int, float, float, float, float]] = {}
    for view in range(36):
        if view == 0:
            simulator.newEpisode([scan], [viewpoint], [0], [math.radians(-30)])
        else:
            simulator.makeAction([0], [1.0], [1.0 if view % 12 == 0 else 0])
        state = simulator.getState()[0]
        assert state.viewIndex == view
        for place in state.navigableLocations[1:]:
            angle = math.hypot(place.rel_heading, place.rel_elevation)
            if place.viewpointId not in best or angle < best[place.viewpointId][1]:
                best[place.viewpointId] = (view, angle, place.rel_heading, place.rel_elevation, place.rel_distance)
    return best


def _write_random_scan(folder: Path) -> None:
    places = np.random.default_rng(7).uniform((-12, -12, 0), (12, 12, 5), (200, 3))
    viewpoints = {
        f"{i:032x}": Viewpoint(f"{i:032x}", (float(x), float(y), float(z))) for i, (x, y, z) in enumerate(places)
    }
    ids = list(viewpoints)
    edges = {}
    for i in range(len(ids)):
        for j in range(i + 1, len(ids)):
            if np.linalg.norm(places[i] - places[j]) < 3.5:
                joined = edge(ids[i], ids[j])
                edges[joined.key] = joined
    write_connectivity(NavGraph("random", viewpoints, edges), folder)


if __name__ == "__main__":
    main()
