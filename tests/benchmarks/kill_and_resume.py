"""Kills `nvsim run` with SIGKILL at random moments, lets the rerun end, and compares the graph with that of a run that
was left alone.

python tests/benchmarks/kill_and_resume.py [--kills 5] [--seed 0] [--steps 200] [--capture FOLDER] [--json]

Without --capture it makes the two-room building itself. Exit code 1 when the graphs differ.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from nvsim.capture.building import BuildingConfig, generate
from nvsim.graph.store import same_graph
from nvsim.project.project import Project


def command(capture: Path, project: Path, steps: int) -> list[str]:
    return [sys.executable, "-m", "nvsim", "run", str(capture), "--project", str(project), "--json",
            "--train.steps", str(steps)]  # fmt: skip


def run_killed(argv: list[str], seconds: float, rng: random.Random, kills: int) -> list[str]:
    """Runs until it ends, killed `kills` times within `seconds` of undisturbed work; returns the stages it was in."""
    stages = []
    moments = sorted(rng.uniform(0.02, 0.98) * seconds for _ in range(kills))
    gaps = [b - a for a, b in zip([0.0, *moments], moments)]
    for gap in gaps:
        # A rerun first skips what is done; start-up takes about two seconds of it.
        process = subprocess.Popen(argv, stdout=subprocess.PIPE, text=True)
        time.sleep(gap + 2.0)
        process.send_signal(signal.SIGKILL)
        lines = (process.communicate()[0] or "").splitlines()
        events = [json.loads(line) for line in lines if line.endswith("}")]
        stages.append(next((e["stage"] for e in reversed(events) if e.get("stage")), "start"))
    subprocess.run(argv, check=True, stdout=subprocess.DEVNULL)
    return stages


def measure(capture: Path, work: Path, kills: int, seed: int, steps: int) -> dict[str, object]:
    """Whether the graph of the killed run is the graph of the quiet one, and where the kills fell."""
    quiet = work / "house.nvsim"
    started = time.perf_counter()
    subprocess.run(command(capture, quiet, steps), check=True, stdout=subprocess.DEVNULL)
    seconds = time.perf_counter() - started
    # The scan id comes from the project's name, and viewpoint ids from the scan id: both projects get one name.
    twin = work / "twin" / quiet.name
    stages = run_killed(command(capture, twin, steps), seconds, random.Random(seed), kills)
    with Project.open(quiet) as a, Project.open(twin) as b:
        equal = same_graph(a.need_graph(), b.need_graph())
        nodes = len(a.need_graph().viewpoints)
    return {"same_graph": equal, "killed_in": stages, "seconds": round(seconds, 1), "nodes": nodes}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--capture", type=Path)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        capture = arguments.capture
        if capture is None:
            generate(work / "building", BuildingConfig(size="small"))
            capture = work / "building" / "capture"
        result = measure(capture, work, arguments.kills, arguments.seed, arguments.steps)
    print(json.dumps(result) if arguments.json else "\n".join(f"{k}: {v}" for k, v in result.items()))
    return 0 if result["same_graph"] else 1


if __name__ == "__main__":
    sys.exit(main())
