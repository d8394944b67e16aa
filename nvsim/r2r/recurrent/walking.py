"""Moves a batch of agents through the world and computes what they see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from nvsim.geometry.view_sweep import STEP, VIEWS, heading_and_elevation
from nvsim.r2r.metrics.submission import Pose
from nvsim.r2r.recurrent.angles import angle_feature
from nvsim.r2r.recurrent.model import MOVED, Sight
from nvsim.r2r.recurrent.world import STOP, Float32, Int64, World
from nvsim.r2r.tasks.task import Task

_HEADINGS, _ELEVATIONS = np.array([heading_and_elevation(view) for view in range(VIEWS)]).T
_FAR = 5.0  # meters; distances are divided by this in the features


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


class Walkers:
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

    def sight(self, who: Int64) -> Sight:
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
        sight = Sight(*map(torch.from_numpy, values))
        if w.panorama is None:
            return sight
        around = angle_feature(_HEADINGS - facing, np.broadcast_to(_ELEVATIONS, (count, VIEWS)), self._angle_size)
        whole = torch.from_numpy(w.features[w.panorama[rows]])
        return sight._replace(around=whole, around_angles=torch.from_numpy(around))

    def go(self, who: Int64, slots: Int64) -> None:
        """Moves the agents `who` (n,) to the candidates of their slots (n,); agents with STOP stay."""
        w = self._world
        moving = slots != STOP
        for i, k in zip(who[moving].tolist(), (slots[moving] - 1).tolist()):
            at = self.rows[i]
            heading, metres = w.heading[at, k], w.distance[at, k]
            turn = (heading - self.heading[i] + np.pi) % (2 * np.pi) - np.pi
            since = metres / _FAR + (self._moved[i, 5] if abs(turn) <= STEP else 0)
            self._moved[i] = np.sin(turn), np.cos(turn), np.sin(w.elevation[at, k]), metres / _FAR, 0, since
            self.rows[i], self.heading[i] = w.target[at, k], heading
            self.trajectories[i].append(self._pose(i))

    def _pose(self, i: int) -> Pose:
        heading = float(self.heading[i]) % (2 * np.pi)
        return self._world.keys[int(self.rows[i])][1], round(heading, 6), 0.0
