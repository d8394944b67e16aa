"""A trained agent as a folder: `agent.json` says what it is and what it was trained on, `weights.safetensors` holds the
best weights so far. Training keeps `training.npz` and `curves.jsonl` beside them."""

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
from nvsim.files.reading import reading
from nvsim.files.regular import read_bytes, read_json
from nvsim.r2r.recurrent.config import ModelConfig
from nvsim.r2r.recurrent.model import RecurrentModel
from nvsim.r2r.recurrent.words import SPECIAL, Vocabulary

ABOUT, WEIGHTS = "agent.json", "weights.safetensors"
FORMAT = 1
_LARGEST = 1 << 30
_THEN = "name the folder that `nvsim r2r train` wrote"


@dataclass(frozen=True, eq=False)
class About:
    """model      the network
    words      the vocabulary
    features   numbers of a view
    backbone   what made the features, "" where their file does not say
    steps      of a trajectory, at most
    trained    JSON-able: how, on what, how far, and how well on what was held out
    finished   whether the training came to its end
    """

    model: ModelConfig
    words: Vocabulary
    features: int
    backbone: str
    steps: int
    trained: Mapping[str, Any]
    finished: bool


def write_about(folder: Path, about: About) -> None:
    """Raises InputError when the disk refuses."""
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
    """Raises InputError when the disk refuses."""
    from safetensors.torch import save

    atomic.write_bytes(folder / WEIGHTS, save({name: t.contiguous() for name, t in model.state_dict().items()}))


def read_about(folder: Path) -> About:
    """Raises InputError where the folder holds no agent, or not as it was written."""
    path = folder / ABOUT
    values = read_json(path, "a trained agent", _THEN)
    with reading(path, "a trained agent", _THEN):
        if not isinstance(values, dict) or values.get("agent") != "recurrent" or values.get("format") != FORMAT:
            raise InputError(f"{path} is not a recurrent agent of this version; {_THEN}.")
        known = {field.name: field.type for field in fields(ModelConfig)}
        told = values["model"]
        if set(told) != set(known):
            raise ValueError("its model has other settings than this version")
        for name, kind in known.items():
            allowed = (float, int) if kind == "float" else {"int": int, "bool": bool}[str(kind)]
            if not isinstance(told[name], allowed) or (kind != "bool" and isinstance(told[name], bool)):
                raise ValueError(f"model.{name} is {str(told[name])[:40]!r}")
        words = values["words"]
        if not isinstance(words, list) or not all(isinstance(w, str) for w in words) or tuple(words[:4]) != SPECIAL:
            raise ValueError("its words are not a vocabulary")
        for name in ("features", "steps"):
            if type(values[name]) is not int or not 1 <= values[name] <= 1 << 20:
                raise ValueError(f"{name} is {str(values[name])[:40]!r}")
        if not isinstance(values["trained"], dict) or type(values["finished"]) is not bool:
            raise ValueError("it does not say how it was trained")
        return About(
            ModelConfig(**told),
            Vocabulary(tuple(words)),
            values["features"],
            str(values["backbone"]),
            values["steps"],
            values["trained"],
            values["finished"],
        )


def read_model(folder: Path, about: About) -> RecurrentModel:
    """The network with its best weights. Raises InputError where they cannot be read or are those of another."""
    from safetensors.torch import load

    path = folder / WEIGHTS
    with reading(path, "the weights of the agent", _THEN):
        weights = load(read_bytes(path, _LARGEST))
        # The sizes of the settings are believed only as far as the weights have them.
        with torch.device("meta"):
            model = RecurrentModel(about.model, len(about.words.words), about.features)
        model.load_state_dict(weights, strict=True, assign=True)
        if any(not torch.isfinite(t).all() or t.dtype != torch.float32 for t in weights.values()):
            raise ValueError("they are not finite numbers of 32 bits")
    return model.eval()
