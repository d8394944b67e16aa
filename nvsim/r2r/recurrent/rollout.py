"""A policy walks a batch of episodes: along their paths, as it would itself, or as chance has it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from nvsim.r2r.metrics.submission import Pose
from nvsim.r2r.recurrent.model import RecurrentModel, Text
from nvsim.r2r.recurrent.walking import Episode, Walkers
from nvsim.r2r.recurrent.words import padded
from nvsim.r2r.recurrent.world import STOP, Int64, World

Way = Literal["path", "sampled", "mixed", "best"]
"""Along the path of the task; by actions sampled from the scores; every second along its path and the others sampled; by
the best of the scores."""


@dataclass(eq=False)
class Rollout:
    """scores    of each step (B, K), -inf of slots that there are not
    values     of each step (B,), what the critic says of the state before it
    going      of each step (B,) bool, who had not stopped before it
    taken      of each step (B,) the slot that was taken
    rows       of each step (B,) where the agent stood, and behind them where it ended
    walkers    after the last step
    """

    walkers: Walkers
    scores: list[Tensor] = field(default_factory=list)
    values: list[Tensor] = field(default_factory=list)
    going: list[NDArray[np.bool_]] = field(default_factory=list)
    taken: list[Int64] = field(default_factory=list)
    rows: list[Int64] = field(default_factory=list)


def read_words(model: RecurrentModel, episodes: Sequence[Episode]) -> tuple[Text, Tensor]:
    """The instructions of the episodes, and the first states."""
    text, state = model.read(torch.from_numpy(padded([episode.words for episode in episodes])))
    return text, state


def roll_out(
    model: RecurrentModel,
    world: World,
    episodes: Sequence[Episode],
    read: tuple[Text, Tensor],
    way: Way,
    steps: int,
    critic: bool = False,
) -> Rollout:
    """Walks until all have stopped, `steps` steps at most, or to the end of the longest path. Sampled actions come from torch's own random numbers."""
    text, state = read
    walkers = Walkers(world, episodes, model.config.angle_size)
    found = Rollout(walkers)
    going = np.ones(len(episodes), bool)
    longest = max(len(episode.path) for episode in episodes)
    for k in range(steps if way in ("sampled", "best") else max(longest, steps if way == "mixed" else 0)):
        if critic:
            found.values.append(model.value(state))
        scores, state = model.step(state, text, walkers.sight())
        taken = _taken(way, scores.detach(), world, episodes, k)
        found.rows.append(walkers.rows.copy())
        found.scores.append(scores)
        found.going.append(going)
        taken[~going] = STOP
        found.taken.append(taken)
        walkers.go(taken)
        going = going & (taken != STOP)
        if not going.any():
            break
    found.rows.append(walkers.rows.copy())
    return found


def walked(
    model: RecurrentModel, world: World, episodes: Sequence[Episode], steps: int, at_once: int = 128
) -> Iterator[tuple[str, list[Pose]]]:
    """instr_id and trajectory of every episode, by the best action of each step; one that has not stopped after `steps`
    ends where it is."""
    training = model.training
    model.eval()
    try:
        for begin in range(0, len(episodes), at_once):
            part = episodes[begin : begin + at_once]
            with torch.inference_mode():
                found = roll_out(model, world, part, read_words(model, part), "best", steps)
            yield from zip((episode.instr_id for episode in part), found.walkers.trajectories)
    finally:
        model.train(training)


def _taken(way: Way, scores: Tensor, world: World, episodes: Sequence[Episode], k: int) -> Int64:
    if way == "best":
        return np.asarray(scores.argmax(1).numpy(), np.int64)
    if way == "path":
        return along_the_paths(world, episodes, k)
    taken = np.array(torch.multinomial(scores.softmax(1), 1)[:, 0].numpy(), np.int64)
    if way == "mixed":
        taken[::2] = along_the_paths(world, episodes[::2], k)
    return taken


def along_the_paths(world: World, episodes: Sequence[Episode], k: int) -> Int64:
    """(B,) the slot by which each path goes on after its k-th viewpoint, STOP at its end."""
    slots = np.full(len(episodes), STOP, np.int64)
    for i, path in enumerate(episode.path for episode in episodes):
        if k + 1 < len(path):
            slots[i] = 1 + int(np.flatnonzero(world.target[path[k]] == path[k + 1])[0])
    return slots
