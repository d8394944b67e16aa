"""Runs a policy through a batch of episodes: along their paths, by its own actions, or by sampled actions."""

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
"""path: along the path of the task. sampled: by actions sampled from the scores. mixed: every second agent along its
path, the others sampled. best: by the highest score."""


@dataclass(frozen=True, eq=False)
class Step:
    """A step of the n agents that have not stopped.

    who      (n,) int64, indices in the batch
    rows     (n,) int64, viewpoints before the step
    scores   (n, K), -inf for slots that do not exist
    value    (n,) the critic's value of the previous state, or None
    taken    (n,) int64, the selected slots
    """

    who: Int64
    rows: Int64
    scores: Tensor
    value: Tensor | None
    taken: Int64


@dataclass(eq=False)
class Rollout:
    """The steps of a batch of agents, and `walkers`, their state after the last step."""

    walkers: Walkers
    steps: list[Step] = field(default_factory=list)


def read_words(model: RecurrentModel, episodes: Sequence[Episode]) -> tuple[Text, Tensor]:
    """Encodes the instructions of B episodes and returns them with the first states (B, D)."""
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
    """Runs the agents until all have stopped.

    The limit is `steps` steps; for "path" it is the length of the longest path, and for "mixed" the larger of both.
    `read` is an encoded instruction with the first states (B, D), from `read_words`. Sampled actions use torch's global
    random generator.
    """
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
    """Yields the instr_id and trajectory of every episode, with the best action in each step.

    An agent that has not stopped after `steps` steps ends at its viewpoint.
    """
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
    """Returns (B,) int64: the slot that continues each path after its k-th viewpoint, STOP at its end."""
    slots = np.full(len(episodes), STOP, np.int64)
    for i, path in enumerate(episode.path for episode in episodes):
        if k + 1 < len(path):
            slots[i] = 1 + int(np.flatnonzero(world.target[path[k]] == path[k + 1])[0])
    return slots
