"""The losses of the recurrent agent, and its training in memory, one batch at a time.

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
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from nvsim.errors import InputError
from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.metrics.scores import NEAR, score
from nvsim.r2r.recurrent.config import LearningConfig, ModelConfig
from nvsim.r2r.recurrent.dataset import Dataset, Vocabulary, episodes_of, held_out
from nvsim.r2r.recurrent.model import RecurrentModel
from nvsim.r2r.recurrent.rollout import Episode, Rollout, Way, read_words, roll_out, run_greedily
from nvsim.r2r.recurrent.world import STOP, Int64, World, read_world
from nvsim.training.checkpoint import Arrays, Checkpoint

_NOBODY = -100
_ARRIVED = 2.0  # reward of a stop near the goal, and penalty of a stop elsewhere
_CLIP = 5.0  # largest norm of the gradient
_MOMENTS = ("step", "exp_avg", "exp_avg_sq")  # AdamW's state of a weight


def imitation_loss(rollout: Rollout, teacher: Sequence[Int64]) -> Tensor:
    """Returns the mean cross-entropy over all steps of all agents, a scalar.

    teacher   (n,) int64 for each step: the slot to take, -1 if the teacher knows no way
    """
    total, count = rollout.steps[0].scores.new_zeros(()), 0
    for step, slots in zip(rollout.steps, teacher):
        target = torch.from_numpy(np.where(slots >= 0, slots, _NOBODY))
        total = total + functional.cross_entropy(step.scores, target, ignore_index=_NOBODY, reduction="sum")
        count += int((slots >= 0).sum())
    return total / max(count, 1)


def teacher_actions(rollout: Rollout, world: World, episodes: Sequence[Episode], way: Way) -> list[Int64]:
    """Returns (n,) int64 for each step: the slot on the shortest path to the goal, from the agent's viewpoint.

    Agents that follow the path of the task get its next slot.
    """
    if way == "path":
        return [step.selected_slots for step in rollout.steps]
    goals = _goals(episodes)
    found = [world.shortest_path_slots(step.rows, goals[step.agents]) for step in rollout.steps]
    if way == "mixed":
        for slots, step in zip(found, rollout.steps):
            led = step.agents % 2 == 0
            slots[led] = step.selected_slots[led]
    return found


def rewards_of(rollout: Rollout, world: World, episodes: Sequence[Episode]) -> list[NDArray[np.float32]]:
    """Returns (n,) float32 for each step: 1 for a move closer to the goal along the graph, -1 for any other move.

    A stop within NEAR of the goal gives 2, a stop elsewhere -2.

    Source: EnvDrop (Tan et al. 2019, section 3.5).
    """
    goals, found = _goals(episodes), []
    for step in rollout.steps:
        mine = goals[step.agents]
        far = world.meters(step.rows, mine)
        nearer = np.where(world.meters(world.rows_after(step.rows, step.selected_slots), mine) < far, 1.0, -1.0)
        stopped = np.where(far < NEAR, _ARRIVED, -_ARRIVED)
        found.append(np.where(step.selected_slots == STOP, stopped, nearer).astype(np.float32))
    return found


def actor_critic(rollout: Rollout, rewards: Sequence[NDArray[np.float32]], config: LearningConfig) -> Tensor:
    """Returns A2C's loss, the mean over all steps of all agents, a scalar.

    It is the sum of the policy loss with the advantage, the critic's squared error, and the negative entropy. `rewards`
    is (n,) for each step. Agents that reach the step limit get no further reward.
    """
    gain = np.zeros(len(rewards[0]), np.float32)
    total, count = rollout.steps[0].scores.new_zeros(()), 0
    for step, reward in zip(reversed(rollout.steps), reversed(rewards)):
        assert step.value is not None
        gain[step.agents] = reward + np.float32(config.discount) * gain[step.agents]
        advantage = torch.from_numpy(gain[step.agents]) - step.value
        chances = step.scores.log_softmax(1)
        did = chances.gather(1, torch.from_numpy(step.selected_slots)[:, None])[:, 0]
        # The logarithm of 0 is -infinity, and 0 times it is NaN.
        entropy = -(chances.exp() * chances.masked_fill(chances.isinf(), 0.0)).sum(1)
        total = total + (-did * advantage.detach() + 0.5 * advantage.square() - config.entropy * entropy).sum()
        count += len(step.agents)
    return total / max(count, 1)


def _goals(episodes: Sequence[Episode]) -> Int64:
    return np.array([episode.path[-1] for episode in episodes], np.int64)


@dataclass
class TrainingState:
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
        self.at = TrainingState(learning.iterations)
        self._epoch, self._order = -1, np.empty(0, np.int64)

    def batch(self) -> float:
        """Trains the next batch and returns its loss."""
        step, learning = self.at.step, self.learning
        torch.manual_seed((learning.seed << 32) + step + 1)
        episodes = self._next_batch(step)
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
        trajectories = dict(run_greedily(self.model, self.world, self.out, self.learning.steps))
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
        return imitation_loss(found, teacher_actions(found, self.world, episodes, way))

    def _a2c(self, episodes: Sequence[Episode]) -> torch.Tensor:
        learning, read = self.learning, read_words(self.model, episodes)
        own = roll_out(self.model, self.world, episodes, read, "sampled", learning.own_steps, critic=True)
        loss = actor_critic(own, rewards_of(own, self.world, episodes), learning)
        if learning.a2c_teacher:
            along = roll_out(self.model, self.world, episodes, read, "path", 0)
            loss = loss + learning.a2c_teacher * imitation_loss(
                along, teacher_actions(along, self.world, episodes, "path")
            )
        return loss

    def _next_batch(self, step: int) -> list[Episode]:
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
            self.at = TrainingState(**{**checkpoint.progress, "best": tuple(checkpoint.progress["best"])})
        except (KeyError, TypeError, RuntimeError) as error:
            raise InputError(
                f"The checkpoint does not fit this training ({error}); delete it to train from the start."
            ) from error

    @property
    def progress(self) -> dict[str, Any]:
        """Returns JSON-compatible progress, which `restore` needs in addition to the arrays."""
        return asdict(self.at)
