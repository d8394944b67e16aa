"""Files of tasks and of trajectories, read, held against a graph, walked and scored."""

from __future__ import annotations

import json
from pathlib import Path

from fuzzing.places import workshop
from fuzzing.reader import Reader, Seed, each, files_in

_TASKS, _WALKED = "R2R_val_unseen.json", "agent.json"


def readers() -> list[Reader]:
    return [
        Reader("tasks", _tasks, _walk, share=2),
        Reader("submission", _submission, _score, share=2),
    ]


def _files() -> dict[str, bytes]:
    from fuzzing.graphs import row
    from nvsim.graph.connectivity import write_connectivity

    path = ["v0", "v1", "v2", "v3"]
    task = {"distance": 6.2, "scan": "row", "path_id": 4, "path": path, "heading": 1.5, "instructions": ["go", "walk"]}
    other = {**task, "path_id": 5, "path": path[::-1]}
    walked = [{"instr_id": f"{t['path_id']}_{k}", "trajectory": [[v, 0.5, 0.0] for v in t["path"]]}
              for t in (task, other) for k in range(2)]  # fmt: skip
    with workshop() as folder:
        write_connectivity(row(), folder)
        files = files_in(folder)
    return {**files, _TASKS: json.dumps([task, other]).encode(), _WALKED: json.dumps(walked).encode()}


def _tasks() -> list[Seed]:
    return each(_files(), _TASKS, {_TASKS: "json"})


def _submission() -> list[Seed]:
    return each(_files(), _WALKED, {_WALKED: "json"})


def _walk(path: Path) -> object:
    """As `nvsim evaluate r2r --agents` does."""
    from nvsim.r2r.agents.benchmark import Benchmark
    from nvsim.r2r.agents.running import run_agent
    from nvsim.r2r.agents.table import agent_of
    from nvsim.r2r.metrics.scores import score

    benchmark = Benchmark.read(path.parent, path)
    walked = run_agent(agent_of("shortest", benchmark.graphs, 0), benchmark.tasks, benchmark.folder)
    return score(benchmark.tasks, walked, benchmark.distances)


def _score(path: Path) -> object:
    """As `nvsim evaluate r2r --submission` does."""
    from nvsim.evaluation.navigation import figures_of, text_of
    from nvsim.r2r.agents.benchmark import Benchmark
    from nvsim.r2r.metrics.scores import score
    from nvsim.r2r.metrics.submission import check_submission, read_submission

    benchmark = Benchmark.read(path.parent, path.parent / _TASKS)
    walked = read_submission(path)
    check_submission(walked, benchmark.tasks, benchmark.distances, path)
    return text_of({"agent": figures_of(score(benchmark.tasks, walked, benchmark.distances))})
