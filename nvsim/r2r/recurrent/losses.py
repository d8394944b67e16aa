"""The losses of the agent: imitation of a teacher, and rewards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from nvsim.r2r.metrics.scores import NEAR
from nvsim.r2r.recurrent.config import LearningConfig
from nvsim.r2r.recurrent.rollout import Rollout, Way
from nvsim.r2r.recurrent.walking import Episode
from nvsim.r2r.recurrent.world import STOP, Int64, World

_NOBODY = -100
_ARRIVED = 2.0  # reward of a stop near the goal, and penalty of a stop elsewhere


def imitation(rollout: Rollout, teacher: Sequence[Int64]) -> Tensor:
    """Returns the mean cross-entropy over all steps of all agents, a scalar.

    teacher   (n,) int64 for each step: the slot to take, -1 if the teacher knows no way
    """
    total, count = rollout.steps[0].scores.new_zeros(()), 0
    for step, slots in zip(rollout.steps, teacher):
        target = torch.from_numpy(np.where(slots >= 0, slots, _NOBODY))
        total = total + functional.cross_entropy(step.scores, target, ignore_index=_NOBODY, reduction="sum")
        count += int((slots >= 0).sum())
    return total / max(count, 1)


def teacher_of(rollout: Rollout, world: World, episodes: Sequence[Episode], way: Way) -> list[Int64]:
    """Returns (n,) int64 for each step: the slot on the shortest path to the goal, from the agent's viewpoint.

    Agents that follow the path of the task get its next slot.
    """
    if way == "path":
        return [step.taken for step in rollout.steps]
    goals = _goals(episodes)
    found = [world.teacher(step.rows, goals[step.who]) for step in rollout.steps]
    if way == "mixed":
        for slots, step in zip(found, rollout.steps):
            led = step.who % 2 == 0
            slots[led] = step.taken[led]
    return found


def rewards_of(rollout: Rollout, world: World, episodes: Sequence[Episode]) -> list[NDArray[np.float32]]:
    """Returns (n,) float32 for each step: 1 for a move closer to the goal along the graph, -1 for any other move.

    A stop within NEAR of the goal gives 2, a stop elsewhere -2.

    Source: EnvDrop (Tan et al. 2019, section 3.5).
    """
    goals, found = _goals(episodes), []
    for step in rollout.steps:
        mine = goals[step.who]
        far = world.metres(step.rows, mine)
        nearer = np.where(world.metres(world.after(step.rows, step.taken), mine) < far, 1.0, -1.0)
        stopped = np.where(far < NEAR, _ARRIVED, -_ARRIVED)
        found.append(np.where(step.taken == STOP, stopped, nearer).astype(np.float32))
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
        gain[step.who] = reward + np.float32(config.discount) * gain[step.who]
        advantage = torch.from_numpy(gain[step.who]) - step.value
        chances = step.scores.log_softmax(1)
        did = chances.gather(1, torch.from_numpy(step.taken)[:, None])[:, 0]
        # The logarithm of 0 is -infinity, and 0 times it is NaN.
        entropy = -(chances.exp() * chances.masked_fill(chances.isinf(), 0.0)).sum(1)
        total = total + (-did * advantage.detach() + 0.5 * advantage.square() - config.entropy * entropy).sum()
        count += len(step.who)
    return total / max(count, 1)


def _goals(episodes: Sequence[Episode]) -> Int64:
    return np.array([episode.path[-1] for episode in episodes], np.int64)
