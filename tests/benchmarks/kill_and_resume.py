"""Kills `nvsim run` with SIGKILL at random moments, lets the rerun end, and compares the graph with that of a run that
was left alone.

python tests/benchmarks/kill_and_resume.py [--kills 5] [--seed 0] [--steps 200] [--submaps 2] [--json]

Without --capture FOLDER it makes the two-room building itself. Exit code 1 when the graphs differ.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from nvsim.capture.building import BuildingConfig, generate
from nvsim.graph.store import same_graph
from nvsim.project.project import Project


def command(capture: Path, project: Path, steps: int, submaps: int) -> list[str]:
    return [sys.executable, "-m", "nvsim", "run", str(capture), "--project", str(project), "--json",
            "--train.steps", str(steps), "--submaps.count", str(submaps)]  # fmt: skip


def run_watched(argv: list[str], stage: str = "", delay: float = 0.0) -> tuple[bool, dict[str, float]]:
    """Runs until it ends, or is killed `delay` seconds after the first sign of `stage`; returns whether it was
    killed, and the seconds that every stage took."""
    process = subprocess.Popen(argv, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    first: dict[str, float] = {}
    last: dict[str, float] = {}
    timer: threading.Timer | None = None
    for line in process.stdout:
        if not line.endswith("}\n"):
            continue  # cut off by the kill
        event = json.loads(line)
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
    """Kills the run `kills` times, each in a stage drawn at random and at a random moment of it, then lets it end;
    returns the stages it was killed in."""
    stages = ["import", "floors", "train", "map"]
    drawn = sorted(rng.choices(stages, [1, 3, 4, 3], k=kills), key=stages.index)
    fell = [s for s in drawn if run_watched(argv, s, rng.uniform(0.05, 0.7) * seconds.get(s, 0.0))[0]]
    run_watched(argv)
    return fell


def measure(capture: Path, work: Path, kills: int, seed: int, steps: int, submaps: int = 2) -> dict[str, object]:
    """Whether the graph of the killed run is the graph of the quiet one, and where the kills fell."""
    quiet = work / "house.nvsim"
    _, seconds = run_watched(command(capture, quiet, steps, submaps))
    # The scan id comes from the project's name, and viewpoint ids from the scan id: both projects get one name.
    twin = work / "twin" / quiet.name
    stages = run_killed(command(capture, twin, steps, submaps), seconds, random.Random(seed), kills)
    with Project.open(quiet) as a, Project.open(twin) as b:
        equal = same_graph(a.need_graph(), b.need_graph())
        nodes = len(a.need_graph().viewpoints)
    return {"same_graph": equal, "killed_in": stages, "seconds": round(sum(seconds.values()), 1), "nodes": nodes}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--submaps", type=int, default=2)
    parser.add_argument("--capture", type=Path)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        capture = arguments.capture
        if capture is None:
            generate(work / "building", BuildingConfig(size="small"))
            capture = work / "building" / "capture"
        result = measure(capture, work, arguments.kills, arguments.seed, arguments.steps, arguments.submaps)
    print(json.dumps(result) if arguments.json else "\n".join(f"{k}: {v}" for k, v in result.items()))
    return 0 if result["same_graph"] else 1


if __name__ == "__main__":
    sys.exit(main())
