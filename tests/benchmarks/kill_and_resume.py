"""Kill `nvsim run` with SIGKILL at random times, let a rerun finish, and compare its graph with an undisturbed run.

python tests/benchmarks/kill_and_resume.py [--kills 5] [--seed 0] [--steps 200] [--submaps 2] [--json]

Without --capture FOLDER, the two-room building is generated. Exit code 1 if the graphs differ.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import tyro
from harness import json_lines, report

from nvsim.building import BuildingConfig, generate
from nvsim.graph.store import same_graph
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments:
    kills: int = 5
    seed: int = 0
    steps: int = 200
    submaps: int = 2
    capture: Path | None = None
    json: bool = False


def command(capture: Path, project: Path, steps: int, submaps: int) -> list[str]:
    return [sys.executable, "-m", "nvsim", "run", str(capture), "--project", str(project), "--json",
            "--train.steps", str(steps), "--submaps.count", str(submaps)]  # fmt: skip


def run_watched(argv: list[str], stage: str = "", delay: float = 0.0) -> tuple[bool, dict[str, float]]:
    """Runs a command to its end, or kills it `delay` seconds after the first progress of `stage`. Returns whether it
    was killed, and the seconds of every stage."""
    process = subprocess.Popen(argv, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    first: dict[str, float] = {}
    last: dict[str, float] = {}
    timer: threading.Timer | None = None
    for event in json_lines(process.stdout):
        name, now = event.get("stage", ""), time.perf_counter()
        first.setdefault(name, now)
        last[name] = now
        if timer is None and name == stage and event["event"] == "progress":
            timer = threading.Timer(delay, process.send_signal, [signal.SIGKILL])
            timer.start()
    code = process.wait()
    if timer is not None:
        timer.cancel()
    if code not in (0, -signal.SIGKILL):
        raise SystemExit(f"{' '.join(argv)} failed with {code}")
    return code != 0, {name: last[name] - first[name] for name in first}


def run_killed(argv: list[str], seconds: dict[str, float], rng: random.Random, kills: int) -> list[str]:
    """Kills the run `kills` times, each in a random stage at a random time, then lets it finish. Returns the stages in
    which it was killed."""
    stages = ["import", "floors", "train", "map"]
    drawn = sorted(rng.choices(stages, [1, 3, 4, 3], k=kills), key=stages.index)
    fell = [s for s in drawn if run_watched(argv, s, rng.uniform(0.05, 0.7) * seconds.get(s, 0.0))[0]]
    run_watched(argv)
    return fell


def measure(capture: Path, work: Path, kills: int, seed: int, steps: int, submaps: int = 2) -> dict[str, object]:
    """Compares the graph of the killed run with that of the undisturbed run, and returns the stages of the kills."""
    quiet = work / "house.nvsim"
    _, seconds = run_watched(command(capture, quiet, steps, submaps))
    # The scan id depends on the project name, and viewpoint ids on the scan id. Both projects have one name.
    twin = work / "twin" / quiet.name
    stages = run_killed(command(capture, twin, steps, submaps), seconds, random.Random(seed), kills)
    with Project.open(quiet) as a, Project.open(twin) as b:
        equal = same_graph(a.need_graph(), b.need_graph())
        nodes = len(a.need_graph().viewpoints)
    return {"same_graph": equal, "killed_in": stages, "seconds": round(sum(seconds.values()), 1), "nodes": nodes}


def main() -> int:
    arguments = tyro.cli(Arguments, description=__doc__)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        capture = arguments.capture
        if capture is None:
            generate(work / "building", BuildingConfig(size="small"))
            capture = work / "building" / "capture"
        result = measure(capture, work, arguments.kills, arguments.seed, arguments.steps, arguments.submaps)
    report(result, arguments.json)
    return 0 if result["same_graph"] else 1


if __name__ == "__main__":
    sys.exit(main())
