"""The training of the recurrent agent in memory, one batch at a time.

All random choices of a batch depend on the seed and the batch number. If the number of threads is equal, a training
that resumes from a checkpoint is therefore bit-identical to an uninterrupted one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from nvsim.errors import InputError
from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.metrics.scores import score
from nvsim.r2r.recurrent.config import LearningConfig, ModelConfig
from nvsim.r2r.recurrent.dataset import Dataset, episodes_of, held_out
from nvsim.r2r.recurrent.losses import actor_critic, imitation, rewards_of, teacher_of
from nvsim.r2r.recurrent.model import RecurrentModel
from nvsim.r2r.recurrent.rollout import read_words, roll_out, walked
from nvsim.r2r.recurrent.walking import Episode
from nvsim.r2r.recurrent.words import Vocabulary
from nvsim.r2r.recurrent.world_reading import read_world
from nvsim.training.checkpoint import Arrays, Checkpoint

_CLIP = 5.0  # largest norm of the gradient
_MOMENTS = ("step", "exp_avg", "exp_avg_sq")  # AdamW's state of a weight


@dataclass
class Standing:
    """The progress of a training.

    last       batch with which the phase ends
    step       finished batches
    phase      0 imitation, 1 A2C
    best       best success rate and SPL on the held-out tasks; best_step is their batch
    tries      evaluations since then
    loss       sum of the losses since the last report; losses is their number
    """

    last: int
    step: int = 0
    phase: int = 0
    best: tuple[float, float] = (-1.0, -1.0)
    best_step: int = 0
    tries: int = 0
    loss: float = 0.0
    losses: int = 0


class Trainer:
    """A training in memory, one batch at a time."""

    def __init__(self, dataset: Dataset, model: ModelConfig, learning: LearningConfig) -> None:
        """Raises InputError if data is missing or invalid."""
        self.learning, self.backbone = learning, dataset.backbone
        train, out = held_out(dataset.tasks, learning.held_out, learning.seed)
        self.words = Vocabulary.of(text for task in train for text in task.instructions)
        self.world = read_world(dataset.sources, model.panorama, dataset.closed)
        self.train = episodes_of(train, self.world, self.words, model.longest)
        self.out = episodes_of(out, self.world, self.words, model.longest)
        self.out_tasks = out
        graphs = {scan: graph for source in dataset.sources for scan, graph in source.graphs.items()}
        self._distances = {scan: Distances(graphs[scan]) for scan in {task.scan for task in out}}
        torch.manual_seed(learning.seed)
        self.model = RecurrentModel(model, len(self.words.words), self.world.width)
        self._new_optimizer()
        self.at = Standing(learning.iterations)
        self._epoch, self._order = -1, np.empty(0, np.int64)

    def batch(self) -> float:
        """Trains the next batch and returns its loss."""
        step, learning = self.at.step, self.learning
        torch.manual_seed((learning.seed << 32) + step + 1)
        episodes = self._next(step)
        self.model.train()
        for group in self.optimizer.param_groups:
            group["lr"] = self._rate()
        self.optimizer.zero_grad()
        loss = self._a2c(episodes) if self.at.phase else self._imitation(episodes)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), _CLIP)
        self.optimizer.step()
        self.at.step += 1
        return float(loss.detach())

    def try_out(self) -> tuple[float, float]:
        """Returns the success rate and SPL on the held-out tasks."""
        trajectories = dict(walked(self.model, self.world, self.out, self.learning.steps))
        found = score(self.out_tasks, trajectories, self._distances)
        return float(found.success.mean()), float(found.spl.mean())

    def begin_a2c(self, best: RecurrentModel) -> None:
        """Starts A2C from the weights of the `best` agent."""
        self.model.load_state_dict(best.state_dict())
        self._new_optimizer()
        self.at.phase, self.at.last, self.at.tries = 1, self.at.step + self.learning.a2c_iterations, 0

    def _new_optimizer(self) -> None:
        learning = self.learning
        self.optimizer = torch.optim.AdamW(self.model.parameters(), learning.rate, weight_decay=learning.weight_decay)

    def _imitation(self, episodes: Sequence[Episode]) -> torch.Tensor:
        way = self.learning.way
        read = read_words(self.model, episodes)
        found = roll_out(self.model, self.world, episodes, read, way, self.learning.own_steps)
        return imitation(found, teacher_of(found, self.world, episodes, way))

    def _a2c(self, episodes: Sequence[Episode]) -> torch.Tensor:
        learning, read = self.learning, read_words(self.model, episodes)
        own = roll_out(self.model, self.world, episodes, read, "sampled", learning.own_steps, critic=True)
        loss = actor_critic(own, rewards_of(own, self.world, episodes), learning)
        if learning.a2c_teacher:
            along = roll_out(self.model, self.world, episodes, read, "path", 0)
            loss = loss + learning.a2c_teacher * imitation(along, teacher_of(along, self.world, episodes, "path"))
        return loss

    def _next(self, step: int) -> list[Episode]:
        """Returns the episodes of a batch: each epoch has all episodes in a new random order."""
        size, count = self.learning.batch, len(self.train)
        return [self._episode(*divmod(place, count)) for place in range(step * size, (step + 1) * size)]

    def _episode(self, epoch: int, place: int) -> Episode:
        if epoch != self._epoch:
            self._epoch = epoch
            self._order = np.random.default_rng([self.learning.seed, epoch]).permutation(len(self.train))
        return self.train[int(self._order[place])]

    def _rate(self) -> float:
        learning, step = self.learning, self.at.step
        if self.at.phase:
            return learning.a2c_rate
        warm = min(1.0, (step + 1) / max(learning.warm_up, 1))
        return learning.rate * warm * (0.55 + 0.45 * math.cos(math.pi * step / max(learning.iterations, 1)))

    # Content of a checkpoint -------------------------------------------------------------------------------------

    def arrays(self) -> Arrays:
        """Returns the weights and the optimizer's state of each weight, by name."""
        found: Arrays = {f"weights/{name}": tensor.detach().numpy() for name, tensor in self.model.named_parameters()}
        for name, parameter in self.model.named_parameters():
            for key, value in self.optimizer.state[parameter].items():
                found[f"{key}/{name}"] = value.detach().numpy()
        return found

    def restore(self, checkpoint: Checkpoint) -> None:
        """Restores a checkpoint. Raises InputError if its arrays do not fit this training."""
        stored = checkpoint.arrays
        try:
            for name, parameter in self.model.named_parameters():
                parameter.data.copy_(torch.from_numpy(stored[f"weights/{name}"]).view_as(parameter))
                kept = {key: stored[f"{key}/{name}"] for key in _MOMENTS if f"{key}/{name}" in stored}
                if kept:
                    self.optimizer.state[parameter] = {key: torch.from_numpy(a.copy()) for key, a in kept.items()}
            self.at = Standing(**{**checkpoint.progress, "best": tuple(checkpoint.progress["best"])})
        except (KeyError, TypeError, RuntimeError) as error:
            raise InputError(
                f"The checkpoint does not fit this training ({error}); delete it to train from the start."
            ) from error

    @property
    def progress(self) -> dict[str, Any]:
        """Returns JSON-compatible progress, which `restore` needs in addition to the arrays."""
        return asdict(self.at)
