"""What the agent learns from: imitation of a teacher, and rewards."""

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
_ARRIVED = 2.0  # the reward of a stop near the goal, and what one elsewhere costs


def imitation(rollout: Rollout, teacher: Sequence[Int64]) -> Tensor:
    """The mean cross-entropy over all steps of all agents; `teacher` (n,) of each step, -1 where it knows no way."""
    total, count = rollout.steps[0].scores.new_zeros(()), 0
    for step, slots in zip(rollout.steps, teacher):
        target = torch.from_numpy(np.where(slots >= 0, slots, _NOBODY))
        total = total + functional.cross_entropy(step.scores, target, ignore_index=_NOBODY, reduction="sum")
        count += int((slots >= 0).sum())
    return total / max(count, 1)


def teacher_of(rollout: Rollout, world: World, episodes: Sequence[Episode], way: Way) -> list[Int64]:
    """Of each step (n,) where the shortest path to the goal leads from where the agent stood; of those who were led
    along their paths, how these go on."""
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
    """Of each step (n,): 1 for a move that comes nearer to the goal along the graph, -1 for any other; 2 for a stop
    within NEAR of the goal, -2 for one elsewhere.

    Source: EnvDrop (Tan et al. 2019, section 3.5)."""
    goals, found = _goals(episodes), []
    for step in rollout.steps:
        mine = goals[step.who]
        far = world.metres(step.rows, mine)
        nearer = np.where(world.metres(world.after(step.rows, step.taken), mine) < far, 1.0, -1.0)
        stopped = np.where(far < NEAR, _ARRIVED, -_ARRIVED)
        found.append(np.where(step.taken == STOP, stopped, nearer).astype(np.float32))
    return found


def actor_critic(rollout: Rollout, rewards: Sequence[NDArray[np.float32]], config: LearningConfig) -> Tensor:
    """A2C's loss, the mean over all steps of all agents: the advantage of what they did, what the critic is off, and
    the entropy of the policy. An agent that was cut off gains nothing more."""
    gain = np.zeros(len(rewards[0]), np.float32)
    total, count = rollout.steps[0].scores.new_zeros(()), 0
    for step, reward in zip(reversed(rollout.steps), reversed(rewards)):
        assert step.value is not None
        gain[step.who] = reward + np.float32(config.discount) * gain[step.who]
        advantage = torch.from_numpy(gain[step.who]) - step.value
        chances = step.scores.log_softmax(1)
        did = chances.gather(1, torch.from_numpy(step.taken)[:, None])[:, 0]
        # The logarithm of no chance is infinite, and 0 times it no number.
        entropy = -(chances.exp() * chances.masked_fill(chances.isinf(), 0.0)).sum(1)
        total = total + (-did * advantage.detach() + 0.5 * advantage.square() - config.entropy * entropy).sum()
        count += len(step.who)
    return total / max(count, 1)


def _goals(episodes: Sequence[Episode]) -> Int64:
    return np.array([episode.path[-1] for episode in episodes], np.int64)
