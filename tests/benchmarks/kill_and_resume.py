"""Kills `nvsim run` with SIGKILL at random moments, lets the rerun end, and compares the graph with that of a run that
was left alone. With --again it then makes everything of the finished project again, with other settings, and kills
that: after every kill each result in use must be the old one or the new one, whole, and readable.

python tests/benchmarks/kill_and_resume.py [--kills 5] [--again 0] [--seed 0] [--steps 200] [--submaps 2] [--json]

Without --capture FOLDER it makes the two-room building itself. Exit code 1 when the graphs differ, or when a result was
neither the old one nor the new one.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from nvsim.building import BuildingConfig, generate
from nvsim.graph.store import encode_graph, same_graph
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


def in_use(path: Path) -> dict[str, str]:
    """A hash of every result that readers get: of the floors, of each model, of the map. Reads them all."""
    with Project.open(path) as project:
        scene, graph, layout = project.scene(), project.need_graph(), project.layout
        if scene is None or project.support() is None:
            raise SystemExit(f"{path} has no model or no floor")
        found = {"map": hashlib.sha256(encode_graph(graph)).hexdigest()}
        cut = repr([(s.index, s.core) for s in project.submaps("floors")])
        floors = hashlib.sha256(cut.encode())
        for submap in project.submaps("floors"):
            if project.surface(submap.index) is None:
                raise SystemExit(f"{path} has no floor of submap {submap.index}")
        for file in [*sorted(layout.masks.glob("*.png")), *sorted(layout.floor.glob("surface_*.npz"))]:
            floors.update(file.name.encode() + file.read_bytes())
        found["floors"] = floors.hexdigest()
        models = []
        for index in scene.indices:
            scene.model(index)  # checks the hashes of its files
            models.append(hashlib.sha256((layout.model(index) / "model.json").read_bytes()).hexdigest())
        cut = repr([(s.index, s.core) for s in project.submaps("train")])
        found |= {f"model {i} of {hashlib.sha256(cut.encode()).hexdigest()[:8]}": h for i, h in enumerate(models)}
    return found


def make_again(capture: Path, project: Path, kills: int, seed: int, steps: int, submaps: int) -> dict[str, object]:
    """Makes everything again in rounds, each with other settings, and kills it in every round but at the end; a round
    with another cut follows one with the same. Returns what was seen."""
    rng = random.Random(seed)
    fell: list[str] = []
    wrong: list[str] = []
    seen: dict[str, set[str]] = {"old": set(), "new": set()}
    left: list[str] = []
    cuts = (submaps, submaps + 1)
    round = 0
    while len(fell) < kills:
        round += 1
        argv = command(capture, project, steps + 5 * round, cuts[round // 2 % 2])
        old, states = in_use(project), []
        for _ in range(4):
            stage = rng.choices(["floors", "train", "map"], [2 if round % 2 == 0 else 0, 5, 2])[0]
            killed, _ = run_watched(argv, stage, rng.uniform(0.0, 0.9) * (6.0 if stage == "train" else 2.0))
            states.append((stage, in_use(project)))
            if not killed:
                break
            fell.append(stage)
        run_watched(argv)
        new = in_use(project)
        with Project.open(project) as opened:
            left += [p.name for p in opened.layout.checkpoints.iterdir()]
        for stage, state in states:
            models = {k for k in state if k.startswith("model")}
            if models not in ({k for k in old if k.startswith("model")}, {k for k in new if k.startswith("model")}):
                wrong.append(f"round {round}, {stage}: the models of no cut")
            for name, hash in state.items():
                kind = "old" if old.get(name) == hash else "new" if new.get(name) == hash else ""
                if not kind:
                    wrong.append(f"round {round}, {stage}: {name} is neither the old one nor the new one")
                else:
                    seen[kind].add(name.split(" of ")[0])
    counted = {name: sorted(values) for name, values in seen.items()}
    return {"kills_again": fell, "neither": wrong, "left_behind": left, "rounds": round, "seen": counted}


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
    parser.add_argument("--again", type=int, default=0, help="kills while everything is made again")
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
        if arguments.again:
            project = work / "house.nvsim"
            result |= make_again(capture, project, arguments.again, arguments.seed, arguments.steps, arguments.submaps)
    print(json.dumps(result) if arguments.json else "\n".join(f"{k}: {v}" for k, v in result.items()))
    return 0 if result["same_graph"] and not result.get("neither") and not result.get("left_behind") else 1


if __name__ == "__main__":
    sys.exit(main())
