"""The metrics of every instruction, as the reference evaluation computes them.

Sources: Matterport3DSimulator tasks/R2R/eval.py (PL, NE, SR, OSR); Anderson et al. 2018, On Evaluation of Embodied
Navigation Agents (SPL); Ilharco et al. 2019 (nDTW, SDTW); Jain et al. 2019 (CLS).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.metrics.submission import Trajectories
from nvsim.r2r.tasks.task import Task

NEAR = 3.0
"""Meters: an agent that stops closer than this to the goal is successful."""
_LEAST = 0.01  # meters, avoids division by 0
_AT_ONCE = 1 << 22  # largest number of elements in an array

Floats = NDArray[np.float64]


def dtw_cost(
    cost: NDArray[np.float64],  # (B, P, R) meters between step p of a trajectory and step r of its reference
    steps: NDArray[np.int64],  # (B,) number of valid steps in P, 1 or more
    reference: NDArray[np.int64],  # (B,) number of valid steps in R, 1 or more
) -> NDArray[np.float64]:
    """Returns (B,) the smallest sum of costs over the monotone alignments of both paths, each from end to end.

    Source: Ilharco et al. 2019, General Evaluation for Instruction Conditioned Navigation, section 4.
    """
    pairs, most, width = cost.shape
    found = np.zeros(pairs)
    row = np.full((pairs, width + 1), np.inf)
    row[:, 0] = 0.0
    for p in range(most):
        above, row = row, np.full((pairs, width + 1), np.inf)
        diagonal_or_above = np.minimum(above[:, :-1], above[:, 1:])
        for r in range(width):
            row[:, r + 1] = cost[:, p, r] + np.minimum(diagonal_or_above[:, r], row[:, r])
        ends = np.flatnonzero(steps == p + 1)
        found[ends] = row[ends, reference[ends]]
    return found


@dataclass(frozen=True, eq=False)
class Scores:
    """The metrics of n instructions, in the order of the tasks; float64.

    instr_ids        (n)
    path_ids         (n,) int64
    pl               (n,) meters, length of the trajectory
    ne               (n,) meters from the end of the trajectory to the goal
    success          (n,) 1 if `ne` is under NEAR, else 0
    oracle_success   (n,) 1 if any step of the trajectory is closer than NEAR to the goal, else 0
    spl              (n,) success times (shortest path / the longer of it and `pl`), as in R2R's own evaluation
    spl_path         (n,) success times (reference path / the longer of it and `pl`), as in HAMT, DUET and MapGPT; it
                     differs from `spl` if the reference path is not a shortest path
    ndtw, sdtw, cls  (n,) 0 to 1
    steps            (n,) number of steps of the trajectory, including turns on the spot
    """

    instr_ids: tuple[str, ...]
    path_ids: NDArray[np.int64]
    pl: Floats
    ne: Floats
    success: Floats
    oracle_success: Floats
    spl: Floats
    spl_path: Floats
    ndtw: Floats
    sdtw: Floats
    cls: Floats
    steps: Floats


METRICS = ("pl", "ne", "success", "oracle_success", "spl", "spl_path", "ndtw", "sdtw", "cls", "steps")


def score(tasks: Sequence[Task], trajectories: Trajectories, distances: Mapping[str, Distances]) -> Scores:
    """Scores trajectories that passed `check_submission`, of tasks that passed `check_tasks`."""
    episodes = [(id, task) for task in tasks for id in task.instr_ids]
    values = {name: np.zeros(len(episodes)) for name in METRICS}
    for of in distances:
        mine = [i for i, (_, task) in enumerate(episodes) if task.scan == of]
        row = distances[of].row
        walked = [[row[pose[0]] for pose in trajectories[episodes[i][0]]] for i in mine]
        reference = [[row[id] for id in episodes[i][1].path] for i in mine]
        for part in _parts(walked, reference):
            found = _score_paths(distances[of].meters, [walked[k] for k in part], [reference[k] for k in part])
            for name, numbers in found.items():
                values[name][[mine[k] for k in part]] = numbers
    ids = tuple(id for id, _ in episodes)
    return Scores(ids, np.array([task.path_id for _, task in episodes], np.int64), **values)


def _parts(walked: list[list[int]], reference: list[list[int]]) -> Iterator[list[int]]:
    """Yields indices of trajectories of similar length, to limit padding and memory."""
    part: list[int] = []
    widest = max((len(path) for path in reference), default=1)
    for i in sorted(range(len(walked)), key=lambda i: len(walked[i])):
        if part and (len(part) + 1) * len(walked[i]) * widest > _AT_ONCE:
            yield part
            part = []
        part.append(i)
    if part:
        yield part


def _score_paths(meters: Floats, walked: list[list[int]], reference: list[list[int]]) -> dict[str, Floats]:
    # Paths are padded with their last viewpoint, which adds no length and no new position.
    steps, path = _pad_paths(walked), _pad_paths(reference)
    counts = np.array([len(rows) for rows in walked], np.int64)
    lengths = np.array([len(rows) for rows in reference], np.int64)
    goal = path[:, -1]
    pl = meters[steps[:, :-1], steps[:, 1:]].sum(axis=1)
    path_length = meters[path[:, :-1], path[:, 1:]].sum(axis=1)
    ne = meters[steps[:, -1], goal]
    success = (ne < NEAR).astype(np.float64)
    shortest = meters[path[:, 0], goal]
    apart = meters[steps[:, :, None], path[:, None, :]]  # (B, P, R)
    ndtw = np.exp(-dtw_cost(apart, counts, lengths) / (NEAR * lengths))
    counted = np.arange(path.shape[1]) < lengths[:, None]
    coverage = (np.exp(-apart.min(axis=1) / NEAR) * counted).sum(axis=1) / lengths
    expected = coverage * path_length
    return {
        "pl": pl,
        "ne": ne,
        "success": success,
        "oracle_success": (meters[steps, goal[:, None]].min(axis=1) < NEAR).astype(np.float64),
        "spl": success * shortest / np.maximum(np.maximum(pl, shortest), _LEAST),
        "spl_path": success * path_length / np.maximum(np.maximum(pl, path_length), _LEAST),
        "ndtw": ndtw,
        "sdtw": success * ndtw,
        "cls": coverage * expected / (expected + np.abs(expected - pl)),
        "steps": counts - 1.0,
    }


def _pad_paths(paths: list[list[int]]) -> NDArray[np.int64]:
    """Pads paths to (B, longest) int64."""
    longest = max(map(len, paths))
    return np.array([rows + rows[-1:] * (longest - len(rows)) for rows in paths], np.int64)
