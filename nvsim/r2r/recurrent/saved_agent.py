"""Reads, writes and runs a trained agent, which is a folder.

`agent.json` describes the agent and its training data, and `weights.safetensors` has the best weights so far. Training
adds `training.npz` and `curves.jsonl`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import torch

from nvsim import __version__
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import read_bytes, read_json
from nvsim.files.reading import reading
from nvsim.files.records import record_of
from nvsim.r2r.agents.benchmark import Benchmark
from nvsim.r2r.features.feature_files import backbone_of_file
from nvsim.r2r.metrics.submission import Pose
from nvsim.r2r.recurrent.config import ModelConfig
from nvsim.r2r.recurrent.dataset import SPECIAL, Vocabulary, episodes_of
from nvsim.r2r.recurrent.model import RecurrentModel
from nvsim.r2r.recurrent.rollout import run_greedily
from nvsim.r2r.recurrent.world import ExportFiles, read_world

ABOUT, WEIGHTS = "agent.json", "weights.safetensors"
FORMAT = 1
_LARGEST = 1 << 30
_THEN = "name the folder that `nvsim r2r train` wrote"


@dataclass(frozen=True, eq=False)
class AgentDescription:
    """The description of an agent.

    model      options of the network
    words      the vocabulary
    features   numbers per view
    backbone   name of the features' backbone, "" if unknown
    steps      largest number of steps of a trajectory
    trained    JSON-compatible: options, data, progress, and scores on the held-out tasks
    finished   whether the training is complete
    """

    model: ModelConfig
    words: Vocabulary
    features: int
    backbone: str
    steps: int
    trained: Mapping[str, Any]
    finished: bool


def write_agent_description(folder: Path, about: AgentDescription) -> None:
    """Writes agent.json. Raises InputError if writing fails."""
    values = {
        "format": FORMAT,
        "version": __version__,
        "agent": "recurrent",
        "model": asdict(about.model),
        "features": about.features,
        "backbone": about.backbone,
        "steps": about.steps,
        "finished": about.finished,
        "trained": dict(about.trained),
        "words": list(about.words.words),
    }
    atomic.write_text(folder / ABOUT, json.dumps(values, indent=1) + "\n")


def write_weights(folder: Path, model: RecurrentModel) -> None:
    """Writes the weights. Raises InputError if writing fails."""
    from safetensors.torch import save

    atomic.write_bytes(folder / WEIGHTS, save({name: t.contiguous() for name, t in model.state_dict().items()}))


def read_agent_description(folder: Path) -> AgentDescription:
    """Reads agent.json. Raises InputError if the folder has no agent, or its description is invalid."""
    path = folder / ABOUT
    values = read_json(path, "a trained agent", _THEN)
    with reading(path, "a trained agent", _THEN):
        if not isinstance(values, dict) or values.get("agent") != "recurrent" or values.get("format") != FORMAT:
            raise InputError(f"{path} is not a recurrent agent of this version; {_THEN}.")
        stored = values["model"]
        if not isinstance(stored, dict) or set(stored) != {field.name for field in fields(ModelConfig)}:
            raise ValueError("its model has other settings than this version")
        words = values["words"]
        if not isinstance(words, list) or not all(isinstance(w, str) for w in words) or tuple(words[:4]) != SPECIAL:
            raise ValueError("its words are not a vocabulary")
        for name in ("features", "steps"):
            if type(values[name]) is not int or not 1 <= values[name] <= 1 << 20:
                raise ValueError(f"{name} is {str(values[name])[:40]!r}")
        if not isinstance(values["trained"], dict) or type(values["finished"]) is not bool:
            raise ValueError("it does not say how it was trained")
        return AgentDescription(
            record_of(ModelConfig, stored),
            Vocabulary(tuple(words)),
            values["features"],
            str(values["backbone"]),
            values["steps"],
            values["trained"],
            values["finished"],
        )


def read_model(folder: Path, about: AgentDescription) -> RecurrentModel:
    """Returns the network with its best weights. Raises InputError if they are unreadable or do not fit."""
    from safetensors.torch import load

    path = folder / WEIGHTS
    with reading(path, "the weights of the agent", _THEN):
        weights = load(read_bytes(path, _LARGEST))
        # Builds the model without memory, so that wrong sizes in agent.json cannot allocate more than the weights have.
        with torch.device("meta"):
            model = RecurrentModel(about.model, len(about.words.words), about.features)
        model.load_state_dict(weights, strict=True, assign=True)
        if any(not torch.isfinite(t).all() or t.dtype != torch.float32 for t in weights.values()):
            raise ValueError("they are not finite numbers of 32 bits")
    return model.eval()


def run_recurrent(folder: Path, benchmark: Benchmark, features: Path) -> dict[str, list[Pose]]:
    """Returns the trajectory of every episode of the benchmark by instr_id, for the agent in `folder`.

    Raises InputError if the agent is unreadable, or the features differ from those of its training.
    """
    about = read_agent_description(folder)
    backbone = backbone_of_file(features)
    if about.backbone and backbone and backbone != about.backbone:
        raise InputError(
            f"The agent was trained on features of {about.backbone}, but {features} has features of {backbone}; write "
            "features of the first with `nvsim export features`."
        )
    world = read_world([ExportFiles(benchmark.graphs, features)], about.model.panorama)
    if world.width != about.features:
        raise InputError(
            f"The agent reads {about.features} numbers per view, but {features} has {world.width}; name a file in the "
            "layout of its training."
        )
    model = read_model(folder, about)
    episodes = episodes_of(benchmark.tasks, world, about.words, about.model.longest)
    return dict(run_greedily(model, world, episodes, about.steps))
