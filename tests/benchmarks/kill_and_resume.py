"""Kill `nvsim run` with SIGKILL at random times, let a rerun finish, and compare its graph with an undisturbed run.

python tests/benchmarks/kill_and_resume.py [--kills 5] [--again 0] [--seed 0] [--steps 200] [--submaps 2] [--json]

With --again, all results of the finished project are then computed again with other settings, and these runs are
killed. After every kill, each result in use must be the complete and readable old or new one. Without --capture FOLDER,
the two-room building is generated. Exit code 1 if the graphs differ, or if a result is neither the old nor the new one.
"""

from __future__ import annotations

import hashlib
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
from nvsim.graph.store import encode_graph, same_graph
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments:
    kills: int = 5
    again: int = 0
    """Number of kills while everything is computed again."""
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


def in_use(path: Path) -> dict[str, str]:
    """Reads all results in use. Returns their hashes: the floors, each model, and the map."""
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
            scene.model(index)  # verifies the hashes of its files
            models.append(hashlib.sha256((layout.model(index) / "model.json").read_bytes()).hexdigest())
        cut = repr([(s.index, s.core) for s in project.submaps("train")])
        found |= {f"model {i} of {hashlib.sha256(cut.encode()).hexdigest()[:8]}": h for i, h in enumerate(models)}
    return found


def make_again(capture: Path, project: Path, kills: int, seed: int, steps: int, submaps: int) -> dict[str, object]:
    """Computes everything again in rounds with different settings, and kills the runs of every round except its last.
    A round with another split into submaps follows one with the previous split. Returns the observations."""
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
                wrong.append(f"round {round}, {stage}: the models belong to no split")
            for name, hash in state.items():
                kind = "old" if old.get(name) == hash else "new" if new.get(name) == hash else ""
                if not kind:
                    wrong.append(f"round {round}, {stage}: {name} is neither the old one nor the new one")
                else:
                    seen[kind].add(name.split(" of ")[0])
    counted = {name: sorted(values) for name, values in seen.items()}
    return {"kills_again": fell, "neither": wrong, "left_behind": left, "rounds": round, "seen": counted}


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
        if arguments.again:
            project = work / "house.nvsim"
            result |= make_again(capture, project, arguments.again, arguments.seed, arguments.steps, arguments.submaps)
    report(result, arguments.json)
    return 0 if result["same_graph"] and not result.get("neither") and not result.get("left_behind") else 1


if __name__ == "__main__":
    sys.exit(main())
