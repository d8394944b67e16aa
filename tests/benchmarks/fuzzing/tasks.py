"""Files of tasks and trajectories, which are read, compared with a graph, executed, and scored."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from recurrent_samples import SMALL, dataset

from fuzzing.graphs import row
from fuzzing.places import workshop
from fuzzing.reader import Files, Reader, Seed, each, files_in
from nvsim.evaluation.judging.compared_images import by_folders, read_shown
from nvsim.evaluation.navigation import figures_of, text_of
from nvsim.events import Metric, to_json
from nvsim.graph.connectivity import write_connectivity
from nvsim.r2r.agents.baselines import agent_of
from nvsim.r2r.agents.benchmark import Benchmark, run_agent
from nvsim.r2r.metrics.scores import score
from nvsim.r2r.metrics.submission import check_submission, read_submission
from nvsim.r2r.recurrent.dataset import SPECIAL, Vocabulary, held_out, read_dataset
from nvsim.r2r.recurrent.model import RecurrentModel
from nvsim.r2r.recurrent.saved_agent import (
    AgentDescription,
    read_agent_description,
    read_model,
    write_agent_description,
    write_weights,
)
from nvsim.r2r.recurrent.training import read_curves
from nvsim.r2r.recurrent.world import read_world
from nvsim.r2r.reviewing import FILE, FOLDER, Review, counts_of, read_folder

_TASKS, _WALKED = "R2R_val_unseen.json", "agent.json"


def readers() -> list[Reader]:
    return [
        Reader("tasks", _tasks, _walk, share=2),
        Reader("submission", _submission, _score, share=2),
        Reader("reviewed tasks", _reviewed, _review, share=2),
        Reader("dataset of an agent", _dataset, _learned),
        Reader("trained agent", _agents, _agent, share=2),
        Reader("curves of a training", _curves, _drawn),
        Reader("judged images", _judged, _shown),
    ]


def _files() -> dict[str, bytes]:
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
    """Runs an agent as `nvsim evaluate r2r --agents` does."""
    benchmark = Benchmark.read(path.parent, path)
    walked = run_agent(agent_of("shortest", benchmark.graphs, 0), benchmark.tasks, benchmark.folder)
    return score(benchmark.tasks, walked, benchmark.distances)


def _score(path: Path) -> object:
    """Scores trajectories as `nvsim evaluate r2r --submission` does."""
    benchmark = Benchmark.read(path.parent, path.parent / _TASKS)
    walked = read_submission(path)
    check_submission(walked, benchmark.tasks, benchmark.distances, path)
    return text_of({"agent": figures_of(score(benchmark.tasks, walked, benchmark.distances))})


def _reviewed() -> list[Seed]:
    review = Review()
    review.set_state(("R2R_val_unseen", 4, "row"), "accepted")
    review.set_instructions(("R2R_val_unseen", 5, "row"), ("walk on",))
    with workshop() as folder:
        review.write(folder / FOLDER / FILE)
        files = {_TASKS: _files()[_TASKS], **files_in(folder)}
    return each(files, "", {f"{FOLDER}/{FILE}": "json", _TASKS: "json"})


def _review(path: Path) -> object:
    """Reads tasks as `nvsim review` and the task page of the window do."""
    folder = read_folder(path)
    return counts_of(folder), folder.review.undo()


@cache
def _export() -> Files:
    with workshop() as folder:
        dataset(folder, scans=2, paths=6, width=4)
        return files_in(folder)


def _dataset() -> list[Seed]:
    files = _export()
    wanted = ("tasks/R2R_train.json", "scans.txt", "H0_connectivity.json", ".hdf5")
    forms = {".json": "json", ".txt": "text", ".hdf5": "binary"}
    return each(files, "", {n: forms[Path(n).suffix] for n in files if n.endswith(wanted)})


def _learned(path: Path) -> object:
    """Reads a dataset as `nvsim r2r train` does."""
    dataset = read_dataset([path])
    return dataset.backbone, held_out(dataset.tasks, 0.2, 0), read_world(dataset.sources, False, dataset.closed)


def _agents() -> list[Seed]:
    words = Vocabulary((*SPECIAL, "go", "left"))
    with workshop() as folder:
        write_agent_description(folder, AgentDescription(SMALL, words, 4, "chance", 10, {"steps": 3}, True))
        write_weights(folder, RecurrentModel(SMALL, len(words.words), 4))
        files = files_in(folder)
    return each(files, "", {"agent.json": "json", "weights.safetensors": "tensors"})


def _agent(path: Path) -> object:
    about = read_agent_description(path)
    return read_model(path, about).training


def _curves() -> list[Seed]:
    lines = "".join(to_json(Metric("r2r train", "loss", 1.0 / (k + 1), k)) + "\n" for k in range(5))
    return [Seed({"curves.jsonl": lines.encode()}, "curves.jsonl", "", "lines of json")]


def _drawn(path: Path) -> object:
    return read_curves(path)


def _judged() -> list[Seed]:
    image = cv2.imencode(".png", np.full((24, 32, 3), 99, np.uint8))[1].tobytes()
    files = {f"{who}/{name}.png": image for who in ("a", "b") for name in ("1", "novel/2")}
    return each(files, "", {"a/1.png": "picture", "b/novel/2.png": "picture"})


def _shown(path: Path) -> object:
    """Reads images as `nvsim evaluate judge` does with two folders."""
    shown = by_folders({"a": path / "a", "b": path / "b"}, None)
    return [read_shown(image).shape for view in shown for image in view.images.values()]
