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
    """The mean cross-entropy over the steps of agents that were going; `teacher` (B,) of each step, -1 where it knows
    no way."""
    total, count = rollout.scores[0].new_zeros(()), 0
    for scores, going, slots in zip(rollout.scores, rollout.going, teacher):
        counted = going & (slots >= 0)
        target = torch.from_numpy(np.where(counted, slots, _NOBODY))
        total = total + functional.cross_entropy(scores, target, ignore_index=_NOBODY, reduction="sum")
        count += int(counted.sum())
    return total / max(count, 1)


def teacher_of(rollout: Rollout, world: World, episodes: Sequence[Episode], way: Way) -> list[Int64]:
    """Of each step (B,) where the shortest path to the goal leads from where the agent stood; of those who were led
    along their paths, how these go on."""
    if way == "path":
        return rollout.taken
    goals = _goals(episodes)
    found = [world.teacher(rows, goals) for rows in rollout.rows[:-1]]
    if way == "mixed":
        for slots, taken in zip(found, rollout.taken):
            slots[::2] = taken[::2]
    return found


def rewards_of(rollout: Rollout, world: World, episodes: Sequence[Episode]) -> list[NDArray[np.float32]]:
    """Of each step (B,): 1 for a move that comes nearer to the goal along the graph, -1 for any other; 2 for a stop
    within NEAR of the goal, -2 for one elsewhere; 0 after it.

    Source: EnvDrop (Tan et al. 2019, section 3.5)."""
    goals = _goals(episodes)
    far = [world.metres(rows, goals) for rows in rollout.rows]
    found = []
    for k, (going, taken) in enumerate(zip(rollout.going, rollout.taken)):
        nearer = np.where(far[k + 1] < far[k], 1.0, -1.0)
        stopped = np.where(far[k] < NEAR, _ARRIVED, -_ARRIVED)
        found.append((going * np.where(taken == STOP, stopped, nearer)).astype(np.float32))
    return found


def actor_critic(rollout: Rollout, rewards: Sequence[NDArray[np.float32]], config: LearningConfig) -> Tensor:
    """A2C's loss, the mean over the steps of agents that were going: the advantage of what they did, what the critic is
    off, and the entropy of the policy. An agent that was cut off gains nothing more."""
    gain = np.zeros(len(rewards[0]), np.float32)
    total, count = rollout.scores[0].new_zeros(()), 0
    for k in reversed(range(len(rewards))):
        gain = rewards[k] + np.float32(config.discount) * gain
        going = torch.from_numpy(rollout.going[k])
        advantage = torch.from_numpy(gain) - rollout.values[k]
        chances = rollout.scores[k].log_softmax(1)
        did = chances.gather(1, torch.from_numpy(rollout.taken[k])[:, None])[:, 0]
        # The logarithm of no chance is infinite, and 0 times it no number.
        entropy = -(chances.exp() * chances.masked_fill(chances.isinf(), 0.0)).sum(1)
        loss = -did * advantage.detach() + 0.5 * advantage.square() - config.entropy * entropy
        total = total + (loss * going).sum()
        count += int(going.sum())
    return total / max(count, 1)


def _goals(episodes: Sequence[Episode]) -> Int64:
    return np.array([episode.path[-1] for episode in episodes], np.int64)
