"""A policy walks a batch of episodes: along their paths, as it would itself, or as chance has it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from nvsim.r2r.metrics.submission import Pose
from nvsim.r2r.recurrent.model import RecurrentModel, Text
from nvsim.r2r.recurrent.walking import Episode, Walkers
from nvsim.r2r.recurrent.words import padded
from nvsim.r2r.recurrent.world import STOP, Int64, World

Way = Literal["path", "sampled", "mixed", "best"]
"""Along the path of the task; by actions sampled from the scores; every second agent along its path and the others
sampled; by the best of the scores."""


@dataclass(frozen=True, eq=False)
class Step:
    """A step of the n agents that had not stopped before it.

    who      (n,) int64, which of the batch
    rows     (n,) int64, where they stood
    scores   (n, K), -inf of slots that there are not
    value    (n,) what the critic says of the state before it; None where it was not asked
    taken    (n,) int64, the slot that was taken
    """

    who: Int64
    rows: Int64
    scores: Tensor
    value: Tensor | None
    taken: Int64


@dataclass(eq=False)
class Rollout:
    """walkers   after the last step"""

    walkers: Walkers
    steps: list[Step] = field(default_factory=list)


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
    """Walks until all have stopped, `steps` steps at most or, along paths, to the end of the longest. Sampled actions
    come from torch's own random numbers."""
    text, state = read
    walkers = Walkers(world, episodes, model.config.angle_size)
    found = Rollout(walkers)
    who: Int64 = np.arange(len(episodes))
    longest = max(len(episode.path) for episode in episodes)
    for k in range(steps if way in ("sampled", "best") else max(longest, steps if way == "mixed" else 0)):
        value = model.value(state) if critic else None
        scores, state = model.step(state, text, walkers.sight(who))
        taken = _taken(way, scores.detach(), world, episodes, who, k)
        found.steps.append(Step(who, walkers.rows[who], scores, value, taken))
        walkers.go(who, taken)
        going = np.flatnonzero(taken != STOP)
        if not len(going):
            break
        if len(going) < len(who):
            kept = torch.from_numpy(going)
            who, state, text = who[going], state[kept], text.of(kept)
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


def _taken(way: Way, scores: Tensor, world: World, episodes: Sequence[Episode], who: Int64, k: int) -> Int64:
    if way == "best":
        return np.asarray(scores.argmax(1).numpy(), np.int64)
    if way == "path":
        return along_the_paths(world, [episodes[i] for i in who.tolist()], k)
    taken = np.array(torch.multinomial(scores.softmax(1), 1)[:, 0].numpy(), np.int64)
    if way == "mixed":
        led = np.flatnonzero(who % 2 == 0)
        taken[led] = along_the_paths(world, [episodes[i] for i in who[led].tolist()], k)
    return taken


def along_the_paths(world: World, episodes: Sequence[Episode], k: int) -> Int64:
    """(B,) the slot by which each path goes on after its k-th viewpoint, STOP at its end."""
    slots = np.full(len(episodes), STOP, np.int64)
    for i, path in enumerate(episode.path for episode in episodes):
        if k + 1 < len(path):
            slots[i] = 1 + int(np.flatnonzero(world.target[path[k]] == path[k + 1])[0])
    return slots
