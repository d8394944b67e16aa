"""Compare NVSim's simulator with a compiled Matterport3DSimulator: states of random actions, and images.

    python tests/benchmarks/mattersim_states.py FOLDER_OF_COMPILED_MODULE [--graphs CONNECTIVITY --dataset SCANS]

FOLDER contains MatterSim.so, built from github.com/peteanderson80/Matterport3DSimulator with -DOSMESA_RENDERING=ON.
Without a graph, a scan is made. Every field of every state is compared. --record FILE writes the states of the compiled
simulator as JSON.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from nvsim.benchmarks.simulator import write_made_scan
from nvsim.r2r import simulator as ours

ANGLES = ("rel_heading", "rel_elevation", "rel_distance")


@dataclass(frozen=True)
class Arguments:
    compiled: tyro.conf.Positional[Path]
    graphs: Path | None = None
    dataset: Path | None = None
    actions: int = 1000
    images: int = 200
    viewpoints: int = 40
    """Number of viewpoints of the scan that is made."""
    record: Path | None = None


def main() -> None:
    given = tyro.cli(Arguments, description=__doc__)
    sys.path.insert(0, str(given.compiled))
    import MatterSim as theirs

    with tempfile.TemporaryDirectory() as made:
        graphs, dataset = given.graphs, given.dataset
        if graphs is None:
            write_made_scan(Path(made), count=given.viewpoints, side=512 if given.images else 0)
            graphs, dataset = Path(made) / "connectivity", Path(made) / "scans"
        failures = 0
        recorded = []
        for discrete in (False, True):
            for restricted in (False, True):
                log: list[Any] = []
                wrong, worst = _states(theirs, graphs, dataset, given.actions, discrete, restricted, log)
                failures += wrong
                recorded.append({"discrete": discrete, "restricted": restricted, "steps": log})
                words = "discrete" if discrete else "continuous", "restricted" if restricted else "free"
                print(
                    f"{words[0]:>10} {words[1]:>10}: {given.actions} actions, {wrong} differ, worst angle {worst:.1e}"
                )
        failures += _random_episodes(theirs, graphs, dataset)
        if given.record is not None:
            scan = (graphs / "scans.txt").read_text().split()[0]
            graph = json.loads((graphs / f"{scan}_connectivity.json").read_text())
            given.record.write_text(json.dumps({"scan": scan, "graph": graph, "runs": recorded}, separators=(",", ":")))
        if dataset is not None and given.images:
            failures += _images(theirs, graphs, dataset, given.images)
    sys.exit(1 if failures else 0)


def opened(
    module: Any, graphs: Path, dataset: Path | None = None, discrete: bool = False, restricted: bool = True
) -> Any:
    """A simulator of the module without images, for views of 640x480."""
    sim = module.Simulator()
    sim.setNavGraphPath(str(graphs))
    if dataset is not None:  # in the compiled simulator, the first path of a process stays in use
        sim.setDatasetPath(str(dataset))
    sim.setRenderingEnabled(False)
    sim.setCameraResolution(640, 480)
    sim.setCameraVFOV(math.radians(60))
    sim.setDiscretizedViewingAngles(discrete)
    sim.setRestrictedNavigation(restricted)
    sim.initialize()
    return sim


def _states(
    theirs: Any, graphs: Path, dataset: Path | None, actions: int, discrete: bool, restricted: bool, log: list[Any]
) -> tuple[int, float]:
    """Number of states that differ, and the largest difference of angles and distances."""
    r = np.random.default_rng(7)
    pair = [opened(module, graphs, dataset, discrete, restricted) for module in (theirs, ours)]
    scans = (graphs / "scans.txt").read_text().split()
    wrong, worst = 0, 0.0
    for number in range(actions):
        if number % 50 == 0:
            scan = scans[r.integers(len(scans))]
            entries = json.loads((graphs / f"{scan}_connectivity.json").read_text())
            included = [e["image_id"] for e in entries if e["included"]]
            call = [[scan], [included[r.integers(len(included))]], [r.uniform(-9, 9)], [r.uniform(-1.5, 1.5)]]
            for sim in pair:
                sim.newEpisode(*call)
        else:
            index = int(r.integers(len(pair[0].getState()[0].navigableLocations)))
            call = [[index], [float(r.choice([0, r.normal()]))], [float(r.choice([0, r.normal(0, 0.4)]))]]
            for sim in pair:
                sim.makeAction(*call)
        a, b = (_plain(sim.getState()[0]) for sim in pair)
        log.append({"call": call, "state": a})
        off = np.abs(np.array(a[1]) - np.array(b[1])).max() if len(a[1]) == len(b[1]) else math.inf
        worst = max(worst, float(off))
        if a[0] != b[0] or off > 1e-4:
            wrong += 1
            if wrong <= 3:
                print("theirs", a, "ours", b, sep="\n")
    return wrong, worst


def _plain(state: Any) -> tuple[list[Any], list[float]]:
    """Fields of a state that must be equal, and fields that may have rounding errors."""
    places = [state.location, *state.navigableLocations]
    same = [state.scanId, state.step, state.viewIndex, *((p.viewpointId, p.ix, p.x, p.y, p.z) for p in places)]
    angles = [state.heading, state.elevation, *(getattr(p, name) for p in places for name in ANGLES)]
    return json.loads(json.dumps(same)), angles


def _random_episodes(theirs: Any, graphs: Path, dataset: Path | None) -> int:
    """Compares random episodes, once per process, because a seed of the compiled simulator applies to the process."""
    scans = (graphs / "scans.txt").read_text().split()
    pair = [opened(module, graphs, dataset) for module in (theirs, ours)]
    wrong = 0
    for _ in range(20):
        for sim in pair:
            sim.newRandomEpisode(scans[:1])
        a, b = (sim.getState()[0] for sim in pair)
        wrong += a.location.viewpointId != b.location.viewpointId or abs(a.heading - b.heading) > 1e-6
    print(f"20 random episodes of the seed: {wrong} differ")
    return wrong


def _images(theirs: Any, graphs: Path, dataset: Path, count: int) -> int:
    """Compares views from random viewpoints. Prints their PSNR, and returns how many are below 40 dB."""
    r = np.random.default_rng(3)
    pair = []
    for module in (theirs, ours):
        sim = module.Simulator()
        sim.setNavGraphPath(str(graphs))
        sim.setDatasetPath(str(dataset))
        sim.setCameraResolution(640, 480)
        sim.setCameraVFOV(math.radians(60))
        sim.setElevationLimits(-1.5, 1.5)
        sim.initialize()
        pair.append(sim)
    included = []
    for scan in (graphs / "scans.txt").read_text().split():
        entries = json.loads((graphs / f"{scan}_connectivity.json").read_text())
        included += [(scan, e["image_id"]) for e in entries if e["included"]]
    psnr = []
    for _ in range(count):
        scan, id = included[r.integers(len(included))]
        call = [scan], [id], [r.uniform(0, 6.28)], [r.uniform(-1.4, 1.4)]
        for sim in pair:
            sim.newEpisode(*call)
        a, b = (np.array(sim.getState()[0].rgb, copy=True).astype(float) for sim in pair)
        psnr.append(10 * math.log10(255**2 / max(float(np.mean((a - b) ** 2)), 1e-9)))
    print(f"{count} images: {min(psnr):.1f} dB at worst, {np.median(psnr):.1f} dB median")
    return sum(value < 40 for value in psnr)


if __name__ == "__main__":
    main()
