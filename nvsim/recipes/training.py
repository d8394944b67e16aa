"""Trains the network with checkpoints. A killed training continues from its last checkpoint and ends with the weights
of an uninterrupted one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

from nvsim.errors import InputError
from nvsim.events import Listener, Metric, Progress, ignore_event
from nvsim.files.atomic import replacement_file
from nvsim.files.reading import reading
from nvsim.recipes.config import RecipeConfig
from nvsim.recipes.examples import Shards, batch
from nvsim.recipes.network import InteriorNetwork, exported_weights, prediction_loss

CHECKPOINT = "training.safetensors"
STAGE = "models train"
_AVERAGE = 0.998  # factor of the averaged weights in each step
_WARM = 0.03  # share of the steps in which the learning rate increases


class Training:
    """The state of a training: network, optimizer, averaged weights, and step."""

    def __init__(self, config: RecipeConfig) -> None:
        torch.manual_seed(config.seed)
        self.config, self.step = config, 0
        self.network = InteriorNetwork().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        trunk, rest = self.network.learning()
        groups = [
            {"params": list(trunk.values()), "rate": config.trunk_rate},
            {"params": list(rest.values()), "rate": config.rate},
        ]
        self._optimizer = torch.optim.AdamW(groups, lr=config.rate, weight_decay=1e-2)
        self._learning = trunk | rest
        self._averaged = {name: p.detach().clone() for name, p in self._learning.items()}

    def initialize_from(self, source: Path) -> None:
        """Copies the weights of another training (folder or ONNX file) as initial weights. Raises InputError if it has
        a different network."""
        weights = weights_of(source)
        if any(name not in weights or weights[name].shape != p.shape for name, p in self._learning.items()):
            raise InputError(f"{source} has a different network; name a training of this network, or its ONNX file.")
        with torch.no_grad():
            for name, parameter in self._learning.items():
                parameter.copy_(weights[name])
        self._averaged = {name: p.detach().clone() for name, p in self._learning.items()}

    def update(self, shards: Shards, shares: Sequence[float]) -> dict[str, float]:
        """Runs one step. Its random numbers depend only on the seed and the step. Returns the loss and its parts."""
        c = self.config
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([c.seed, self.step])))
        drawn = batch(shards, shares, c.batch, rng)
        images, rays, floor, normals, known = (torch.from_numpy(part) for part in drawn)
        for group in self._optimizer.param_groups:
            group["lr"] = group["rate"] * schedule(self.step, c.steps)
        found = self.network(images.contiguous(memory_format=torch.channels_last), rays)
        total, parts = prediction_loss(found, floor, normals, known)
        self._optimizer.zero_grad(set_to_none=True)
        total.backward()
        torch.nn.utils.clip_grad_norm_(list(self._learning.values()), 1.0)
        self._optimizer.step()
        self.step += 1
        keep = min(_AVERAGE, self.step / (self.step + 10))
        torch._foreach_lerp_(list(self._averaged.values()), [p.detach() for p in self._learning.values()], 1 - keep)
        return {"loss": float(total.detach()), **parts}

    def finished(self) -> InteriorNetwork:
        """The network with the averaged weights."""
        with torch.no_grad():
            for name, parameter in self._learning.items():
                parameter.copy_(self._averaged[name])
        return self.network.eval()

    def save(self, path: Path) -> None:
        """Writes a checkpoint. Raises InputError if the disk reports an error."""
        state = self._optimizer.state_dict()["state"]
        tensors: dict[str, Tensor] = {}
        for i, (name, parameter) in enumerate(self._learning.items()):
            tensors |= {f"weight/{name}": parameter.detach(), f"average/{name}": self._averaged[name]}
            if i in state:
                tensors |= {f"first/{name}": state[i]["exp_avg"], f"second/{name}": state[i]["exp_avg_sq"]}
        whole = {name: tensor.contiguous() for name, tensor in tensors.items()}
        with replacement_file(path) as temporary:
            save_file(whole, temporary, {"step": str(self.step), "seed": str(self.config.seed)})

    def restore(self, path: Path) -> None:
        """Continues from a checkpoint. Raises InputError if the file is not a checkpoint of this network and seed."""
        tensors = _read(path)
        with reading(path, "a checkpoint of this network", "delete it to begin again"), torch.no_grad():
            with safe_open(path, "pt") as file:
                about = file.metadata() or {}
            self.step = int(about["step"])
            for name, parameter in self._learning.items():
                parameter.copy_(tensors[f"weight/{name}"])
                self._averaged[name].copy_(tensors[f"average/{name}"])
            if self.step:
                state = self._optimizer.state_dict()
                step = torch.tensor(float(self.step))
                state["state"] = {
                    i: {"step": step.clone(), "exp_avg": tensors[f"first/{n}"], "exp_avg_sq": tensors[f"second/{n}"]}
                    for i, n in enumerate(self._learning)
                }
                self._optimizer.load_state_dict(state)
        if about.get("seed") != str(self.config.seed):
            raise InputError(f"{path} belongs to the seed {about.get('seed')}; delete it, or use that --seed.")


def _read(path: Path) -> dict[str, Tensor]:
    with reading(path, "a checkpoint of this network", "delete it to begin again"):
        return load_file(path)


def weights_of(source: Path) -> dict[str, Tensor]:
    """Name -> weights of a finished training, in their original shapes: the averaged weights in the checkpoint of a
    folder, or those of an ONNX file. Raises InputError if `source` contains no training."""
    if source.is_file():
        return exported_weights(source)
    checkpoint = source / CHECKPOINT
    if not checkpoint.is_file():
        raise InputError(f"{source} contains no training ({CHECKPOINT} is missing); name one, or its ONNX file.")
    found = _read(checkpoint)
    return {name.removeprefix("average/"): t for name, t in found.items() if name.startswith("average/")}


def schedule(step: int, steps: int) -> float:
    """Learning rate at a step, as a share of the highest: a linear increase, then a cosine decay."""
    warm = max(1, round(_WARM * steps))
    if step < warm:
        return (step + 1) / warm
    return 0.5 * (1 + math.cos(math.pi * (step - warm) / max(1, steps - warm)))


def train(
    folder: Path, shards: Shards, shares: Sequence[float], config: RecipeConfig, start: Path | None = None,
    listen: Listener = ignore_event,
) -> InteriorNetwork:  # fmt: skip
    """Trains a network on `shards`, drawn by their `shares`, and returns it.

    folder  folder of the checkpoint; an existing checkpoint is continued
    start   folder of another training, or its ONNX file, with the initial weights

    Raises InputError if the checkpoint or `start` cannot be used.
    """
    checkpoint = folder / CHECKPOINT
    training = Training(config)
    if checkpoint.is_file():
        training.restore(checkpoint)
    elif start is not None:
        training.initialize_from(start)
    recent: list[dict[str, float]] = []
    listen(Progress(STAGE, training.step, config.steps))
    while training.step < config.steps:
        recent.append(training.update(shards, shares))
        if training.step % config.save_every == 0 or training.step == config.steps:
            training.save(checkpoint)
            means = {name: float(np.mean([r[name] for r in recent])) for name in recent[0]}
            recent.clear()
            for name, value in means.items():
                listen(Metric(STAGE, name, round(value, 4), training.step))
            listen(Progress(STAGE, training.step, config.steps, f"loss {means['loss']:.3f}"))
    return training.finished()
