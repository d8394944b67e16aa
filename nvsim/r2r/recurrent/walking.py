"""A batch of agents in the world: what they see, and where they go."""

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
_FAR = 5.0  # metres that are 1


@dataclass(frozen=True)
class Episode:
    """An instruction of a task, in the world.

    words   numbers of its words
    path    rows of its viewpoints
    """

    instr_id: str
    task: Task
    words: tuple[int, ...]
    path: tuple[int, ...]


class Walkers:
    """Agents at the starts of their episodes. Angles are exact: an agent looks where its last move led, and not to the
    nearest of twelve headings.

    rows      (B,) int64, where they stand
    heading   (B,) float32 radians, where they look
    """

    def __init__(self, world: World, episodes: Sequence[Episode], angle_size: int) -> None:
        self._world, self._angle_size = world, angle_size
        self.rows: Int64 = np.array([episode.path[0] for episode in episodes], np.int64)
        self.heading: Float32 = np.array([episode.task.heading for episode in episodes], np.float32)
        self._moved = np.zeros((len(episodes), MOVED), np.float32)
        self._moved[:, 4] = 1
        self.trajectories: list[list[Pose]] = [[self._pose(i)] for i in range(len(episodes))]

    def sight(self) -> Sight:
        """What they see now."""
        w, rows = self._world, self.rows
        count, most = len(rows), w.target.shape[1] + 1
        angles = np.zeros((count, most, self._angle_size), np.float32)
        relative = w.heading[rows] - self.heading[:, None]
        angles[:, 1:] = angle_feature(relative, w.elevation[rows], self._angle_size)
        there = np.ones((count, most), bool)
        there[:, 1:] = w.target[rows] >= 0
        seen, distance = np.zeros((count, most), np.int64), np.zeros((count, most), np.float32)
        seen[:, 1:], distance[:, 1:] = w.seen[rows], w.distance[rows]
        angles[~there] = 0
        values = (w.features[seen], angles, distance, there, self._moved.copy())
        sight = Sight(*map(torch.from_numpy, values))
        if w.panorama is None:
            return sight
        around = angle_feature(
            _HEADINGS - self.heading[:, None], np.broadcast_to(_ELEVATIONS, (count, VIEWS)), self._angle_size
        )
        whole = torch.from_numpy(w.features[w.panorama[rows]])
        return sight._replace(around=whole, around_angles=torch.from_numpy(around))

    def go(self, slots: Int64) -> None:
        """Each goes to the candidate of its slot (B,); those at STOP stay."""
        w = self._world
        for i in np.flatnonzero(slots != STOP).tolist():
            at, k = self.rows[i], slots[i] - 1
            heading, metres = w.heading[at, k], w.distance[at, k]
            turn = (heading - self.heading[i] + np.pi) % (2 * np.pi) - np.pi
            since = metres / _FAR + (self._moved[i, 5] if abs(turn) <= STEP else 0)
            self._moved[i] = np.sin(turn), np.cos(turn), np.sin(w.elevation[at, k]), metres / _FAR, 0, since
            self.rows[i], self.heading[i] = w.target[at, k], heading
            self.trajectories[i].append(self._pose(i))

    def _pose(self, i: int) -> Pose:
        heading = float(self.heading[i]) % (2 * np.pi)
        return self._world.keys[int(self.rows[i])][1], round(heading, 6), 0.0
