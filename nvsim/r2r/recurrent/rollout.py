"""Runs a policy through a batch of episodes: along their paths, by its own actions, or by sampled actions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from nvsim.geometry.directions import STEP, VIEWS
from nvsim.r2r.features.candidates import ELEVATIONS, HEADINGS
from nvsim.r2r.metrics.submission import Pose
from nvsim.r2r.recurrent.model import FAR, MOVED, AgentInput, EncodedInstruction, RecurrentModel
from nvsim.r2r.recurrent.world import STOP, Float32, Int64, World
from nvsim.r2r.tasks.task import Task

Way = Literal["path", "sampled", "mixed", "best"]
"""path: along the path of the task. sampled: by actions sampled from the scores. mixed: every second agent along its
path, the others sampled. best: by the highest score."""


def angle_feature(
    heading: NDArray[np.floating],  # (...) radians, relative to the agent's heading; right is positive
    elevation: NDArray[np.floating],  # (...) radians above the horizon
    size: int = 4,
) -> NDArray[np.float32]:
    """Returns (..., size) sin and cos of the heading, then sin and cos of the elevation, repeated up to `size`.

    Source: EnvDrop and VLN↻BERT, whose size is 128; HAMT and VLN-DUET, 4.
    """
    four = np.stack([np.sin(heading), np.cos(heading), np.sin(elevation), np.cos(elevation)], axis=-1)
    return np.tile(four.astype(np.float32), size // 4)


@dataclass(frozen=True)
class Episode:
    """An instruction of a task, in the world.

    words   word numbers of the instruction
    path    rows of the viewpoints
    """

    instr_id: str
    task: Task
    words: tuple[int, ...]
    path: tuple[int, ...]


class AgentBatch:
    """A batch of agents, first at the starts of their episodes.

    Headings are exact: an agent faces the direction of its last move, not the nearest of twelve headings.

    rows      (B,) int64, current viewpoints
    heading   (B,) float32 radians
    """

    def __init__(self, world: World, episodes: Sequence[Episode], angle_size: int) -> None:
        self._world, self._angle_size = world, angle_size
        self.rows: Int64 = np.array([episode.path[0] for episode in episodes], np.int64)
        self.heading: Float32 = np.array([episode.task.heading for episode in episodes], np.float32)
        self._moved = np.zeros((len(episodes), MOVED), np.float32)
        self._moved[:, 4] = 1
        self.trajectories: list[list[Pose]] = [[self._pose(i)] for i in range(len(episodes))]

    def observe(self, who: Int64) -> AgentInput:
        """Returns what the agents `who` (n,) see, with as many slots as the largest number of candidates needs."""
        w, rows = self._world, self.rows[who]
        most = int((w.target[rows] >= 0).sum(axis=1).max(initial=0))
        target, seen_by = w.target[rows, :most], w.seen[rows, :most]
        count, facing = len(rows), self.heading[who, None]
        angles = np.zeros((count, most + 1, self._angle_size), np.float32)
        angles[:, 1:] = angle_feature(w.heading[rows, :most] - facing, w.elevation[rows, :most], self._angle_size)
        there = np.ones((count, most + 1), bool)
        there[:, 1:] = target >= 0
        angles[~there] = 0
        seen, distance = np.zeros((count, most + 1), np.int64), np.zeros((count, most + 1), np.float32)
        seen[:, 1:], distance[:, 1:] = seen_by, w.distance[rows, :most]
        values = (w.features[seen], angles, distance, there, self._moved[who])
        sight = AgentInput(*map(torch.from_numpy, values))
        if w.panorama is None:
            return sight
        around = angle_feature(HEADINGS - facing, np.broadcast_to(ELEVATIONS, (count, VIEWS)), self._angle_size)
        whole = torch.from_numpy(w.features[w.panorama[rows]])
        return sight._replace(around=whole, around_angles=torch.from_numpy(around))

    def move(self, who: Int64, slots: Int64) -> None:
        """Moves the agents `who` (n,) to the candidates of their slots (n,); agents with STOP stay."""
        w = self._world
        moving = slots != STOP
        for i, k in zip(who[moving].tolist(), (slots[moving] - 1).tolist()):
            at = self.rows[i]
            heading, meters = w.heading[at, k], w.distance[at, k]
            turn = (heading - self.heading[i] + np.pi) % (2 * np.pi) - np.pi
            since = meters / FAR + (self._moved[i, 5] if abs(turn) <= STEP else 0)
            self._moved[i] = np.sin(turn), np.cos(turn), np.sin(w.elevation[at, k]), meters / FAR, 0, since
            self.rows[i], self.heading[i] = w.target[at, k], heading
            self.trajectories[i].append(self._pose(i))

    def _pose(self, i: int) -> Pose:
        heading = float(self.heading[i]) % (2 * np.pi)
        return self._world.keys[int(self.rows[i])][1], round(heading, 6), 0.0


@dataclass(frozen=True, eq=False)
class RolloutStep:
    """A step of the n agents that have not stopped.

    agents          (n,) int64, indices in the batch
    rows            (n,) int64, viewpoints before the step
    scores          (n, K), -inf for slots that do not exist
    value           (n,) the critic's value of the previous state, or None
    selected_slots  (n,) int64, the selected slots
    """

    agents: Int64
    rows: Int64
    scores: Tensor
    value: Tensor | None
    selected_slots: Int64


@dataclass(eq=False)
class Rollout:
    """The steps of a batch of agents, and `walkers`, their state after the last step."""

    walkers: AgentBatch
    steps: list[RolloutStep] = field(default_factory=list)


def read_words(model: RecurrentModel, episodes: Sequence[Episode]) -> tuple[EncodedInstruction, Tensor]:
    """Encodes the instructions of B episodes and returns them with the first states (B, D)."""
    text, state = model.read(torch.from_numpy(_pad_rows([episode.words for episode in episodes])))
    return text, state


def _pad_rows(rows: Sequence[Sequence[int]]) -> NDArray[np.int64]:
    """Pads rows to (B, longest row) int64 with 0, the number of PAD."""
    found = np.zeros((len(rows), max(map(len, rows))), np.int64)
    for i, row in enumerate(rows):
        found[i, : len(row)] = row
    return found


def roll_out(
    model: RecurrentModel,
    world: World,
    episodes: Sequence[Episode],
    read: tuple[EncodedInstruction, Tensor],
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
    walkers = AgentBatch(world, episodes, model.config.angle_size)
    found = Rollout(walkers)
    who: Int64 = np.arange(len(episodes))
    longest = max(len(episode.path) for episode in episodes)
    for k in range(steps if way in ("sampled", "best") else max(longest, steps if way == "mixed" else 0)):
        value = model.value(state) if critic else None
        scores, state = model.step(state, text, walkers.observe(who))
        taken = _choose_slots(way, scores.detach(), world, episodes, who, k)
        found.steps.append(RolloutStep(who, walkers.rows[who], scores, value, taken))
        walkers.move(who, taken)
        going = np.flatnonzero(taken != STOP)
        if not len(going):
            break
        if len(going) < len(who):
            kept = torch.from_numpy(going)
            who, state, text = who[going], state[kept], text.of(kept)
    return found


_AT_ONCE = 128  # episodes of a batch


def run_greedily(
    model: RecurrentModel, world: World, episodes: Sequence[Episode], steps: int
) -> Iterator[tuple[str, list[Pose]]]:
    """Yields the instr_id and trajectory of every episode, with the best action in each step.

    An agent that has not stopped after `steps` steps ends at its viewpoint.
    """
    training = model.training
    model.eval()
    try:
        for begin in range(0, len(episodes), _AT_ONCE):
            part = episodes[begin : begin + _AT_ONCE]
            with torch.inference_mode():
                found = roll_out(model, world, part, read_words(model, part), "best", steps)
            yield from zip((episode.instr_id for episode in part), found.walkers.trajectories)
    finally:
        model.train(training)


def _choose_slots(way: Way, scores: Tensor, world: World, episodes: Sequence[Episode], who: Int64, k: int) -> Int64:
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
