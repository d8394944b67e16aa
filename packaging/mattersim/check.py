"""Checks the installed module `MatterSim` in any Python from 3.8. With --speed, measures its speed too.

    python packaging/mattersim/check.py [--speed]

It compares states with those recorded from Matterport3DSimulator, looks around in a scan with images, and exits with 1
if anything differs. Speed is in states per second of processor time, the best of twenty time slices.
"""

from __future__ import annotations

import json
import math
import platform
import sys
import tempfile
import time
from operator import attrgetter
from pathlib import Path
from typing import Any

import cv2
import MatterSim
import numpy as np

RECORD = json.loads((Path(__file__).resolve().parents[2] / "tests" / "data" / "mattersim_states.json").read_text())
ROUNDING = 5e-7  # radians and meters: the last digit of a float32 below 8 depends on the processor
SIDE, QUARTERS = 64, 8000  # pixels per face, and the distance of all pixels in 0.25 mm

LOCATION = attrgetter("viewpointId", "ix", "x", "y", "z", "rel_heading", "rel_elevation", "rel_distance")
STATE = attrgetter("scanId", "step", "heading", "elevation", "viewIndex")


def opened(folder: Path, discrete: bool, restricted: bool, batch: int = 1, images: bool = False) -> Any:
    """Returns a simulator of the recorded graph."""
    sim = MatterSim.Simulator()
    sim.setNavGraphPath(str(folder))
    sim.setDatasetPath(str(folder))
    sim.setRenderingEnabled(images)
    sim.setDepthEnabled(images)
    sim.setCameraResolution(640, 480)
    sim.setCameraVFOV(math.radians(60))
    sim.setDiscretizedViewingAngles(discrete)
    sim.setRestrictedNavigation(restricted)
    sim.setBatchSize(batch)
    sim.initialize()
    return sim


def different_states(folder: Path) -> int:
    """Returns the number of states that differ from the recorded ones."""
    different = 0
    for run in RECORD["runs"]:
        sim = opened(folder, run["discrete"], run["restricted"])
        for step in run["steps"]:
            (sim.newEpisode if len(step["call"]) == 4 else sim.makeAction)(*step["call"])
            s = sim.getState()[0]
            places = [list(LOCATION(p)) for p in [s.location, *s.navigableLocations]]
            same = [s.scanId, s.step, s.viewIndex, *(place[:5] for place in places)]
            angles = [s.heading, s.elevation, *(angle for place in places for angle in place[5:])]
            equal = same == step["state"][0] and np.allclose(angles, step["state"][1], rtol=0, atol=ROUNDING)
            different += not equal
    return different


def seen_faces(folder: Path, start: str) -> int:
    """Returns the number of skybox faces, each in one color, that 36 views from `start` show at the right depth."""
    images = folder / RECORD["scan"] / "matterport_skybox_images"
    images.mkdir(parents=True)
    strip = np.repeat(np.arange(6, dtype=np.uint8) * 40, SIDE)
    cv2.imwrite(str(images / (start + "_skybox_small.jpg")), np.tile(strip[None, :, None], (SIDE, 1, 3)))
    cv2.imwrite(str(images / (start + "_skybox_depth_small.png")), np.full((SIDE, 6 * SIDE), QUARTERS, np.uint16))
    sim = opened(folder, discrete=True, restricted=True, images=True)
    sim.newEpisode([RECORD["scan"]], [start], [0.0], [-math.radians(30)])
    faces = set()
    for view in range(36):
        s = sim.getState()[0]
        if s.viewIndex == view and abs(int(s.depth[240, 320, 0]) - QUARTERS) <= 1:
            faces.update(int(round(s.rgb[row, 320].mean() / 40)) for row in (0, 240, 479))
        sim.makeAction([0], [1.0], [float(view % 12 == 11)])
    return len(faces)


def speed(folder: Path, starts: list[str], batch: int, read: bool) -> int:
    """Returns the states per second of random turns with a move in every fourth action, in discrete views.

    With `read`, every field of every location is read too.
    """
    random = np.random.RandomState(1)
    sim = opened(folder, discrete=True, restricted=True, batch=batch)
    chosen = [starts[i] for i in random.randint(0, len(starts), batch)]
    sim.newEpisode([RECORD["scan"]] * batch, chosen, [0.0] * batch, [0.0] * batch)
    turns = [random.choice([-1.0, 0.0, 1.0], batch).tolist() for _ in range(64)]
    best, number = 0.0, 0
    for _ in range(20):
        begin, done = time.process_time(), 0
        while time.process_time() - begin < 0.1:
            moves = [min(1, len(s.navigableLocations) - 1) if number % 4 == 0 else 0 for s in sim.getState()]
            sim.makeAction(moves, turns[number % 64], [0.0] * batch)
            for s in sim.getState() if read else []:
                for p in [s.location, *s.navigableLocations]:
                    LOCATION(p)
                STATE(s)
            number, done = number + 1, done + 1
        best = max(best, batch * done / (time.process_time() - begin))
    return round(best)


def main() -> None:
    print(f"Python {platform.python_version()}, numpy {np.__version__}, OpenCV {cv2.__version__}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scans.txt").write_text(RECORD["scan"] + "\n")
        (folder / (RECORD["scan"] + "_connectivity.json")).write_text(json.dumps(RECORD["graph"]))
        starts = [entry["image_id"] for entry in RECORD["graph"] if entry["included"]]
        different = different_states(folder)
        print(f"{sum(len(run['steps']) for run in RECORD['runs'])} recorded states: {different} differ")
        faces = seen_faces(folder, starts[0])
        print(f"36 views show {faces} of 6 faces")
        for batch in (1, 8, 64) if "--speed" in sys.argv else ():
            figures = [speed(folder, starts, batch, read) for read in (False, True)]
            print(f"batch of {batch}: {figures[0]} states/s; with every field of every location {figures[1]}")
    sys.exit(1 if different or faces < 6 else 0)


if __name__ == "__main__":
    main()
