"""Samples tasks in splits: train and val_seen share regions but no path, and val_unseen is in separate regions.

The regions are cut at places with few edges, such as doors. Paths are spread over the building. Two paths can be joined
as in R4R: the first path ends near the start of the second, and the shortest path connects them.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import islice
from random import Random
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.connectivity import scan_choices
from nvsim.graph.paths import PathGraph
from nvsim.graph.types import EdgeKey, NavGraph
from nvsim.r2r.observations.parts import LEAST, split
from nvsim.r2r.tasks.shortest import EligiblePaths, PathBounds, ShortestPaths, ShortestPathTree, eligible_paths
from nvsim.r2r.tasks.task import JoinedTask, Task

SPLITS = ("train", "val_seen", "val_unseen")
NEAR = 3.0
"""Largest distance in meters along the graph from the goal of the first path to the start of the second (Jain et al.
2019, section 4)."""


@dataclass(frozen=True)
class Impassable:
    """The parts of a graph that a robot cannot use.

    edges  edges along which it cannot move
    ends   included viewpoints at which it has no room, so that it can neither start nor stop there
    """

    edges: tuple[EdgeKey, ...] = ()
    ends: tuple[str, ...] = ()


def unseen_viewpoints(graph: NavGraph, paths: EligiblePaths, share: float) -> NDArray[np.bool_]:
    """Returns (N,) bool: which of the included viewpoints are unseen.

    They are regions of up to `share` of all viewpoints. Regions with the most paths are added first, as long as the
    total gets closer to the share. All are False if no region contains a path. The result is deterministic.
    """
    count = len(paths.ids)
    want = share * count
    kept = set(paths.ids)
    included = replace(
        graph,
        viewpoints={id: v for id, v in graph.viewpoints.items() if id in kept},
        edges={key: edge for key, edge in graph.edges.items() if kept.issuperset(key)},
        evidence={},
    )
    row = {id: i for i, id in enumerate(paths.ids)}
    held = []
    for part in split(included, max(LEAST, math.ceil(want))):
        region = np.zeros(count, bool)
        region[[row[id] for id in part.viewpoints]] = True
        held.append((int(paths.inside(region).sum()), region))
    unseen = np.zeros(count, bool)
    for paths_inside, region in sorted(held, key=lambda of: -of[0]):
        with_it = int((unseen | region).sum())
        if paths_inside and abs(with_it - want) < abs(int(unseen.sum()) - want):
            unseen |= region
    return unseen


@dataclass(frozen=True)
class PathCounts:
    """Numbers of paths over all scans together; a split has fewer if there are no more."""

    train: int = 100
    """Paths of train."""
    val_seen: int = 20
    """Paths of val_seen, which are other paths in the regions of train."""
    val_unseen: int = 60
    """Paths of val_unseen."""
    joined: int = 0
    """Joined paths of each split, as in R4R; 0 writes none."""
    unseen_share: float = 0.25
    """Share of each scan's viewpoints that only val_unseen may enter; unused with --unseen."""
    seed: int = 0
    """Seed of random headings, directions, and choices between equally good paths."""

    def __post_init__(self) -> None:
        for name in ("train", "val_seen", "val_unseen", "joined"):
            if not 0 <= getattr(self, name) <= 1_000_000:
                raise InputError(f"--{name.replace('_', '-')} {getattr(self, name)} is invalid; give 0 to 1000000.")
        if not 0 < self.unseen_share < 1:
            raise InputError(f"--unseen-share {self.unseen_share} is out of range; give a share between 0 and 1.")


@dataclass(frozen=True, eq=False)
class Dataset:
    """The sampled tasks.

    splits   name -> its tasks
    joined   name -> its joined paths, {} if none were requested
    unseen   scan id -> viewpoint ids that only val_unseen enters
    empty    scan ids without any path
    lacking  split -> number of missing paths
    impassable  scan id -> what no path uses, {} if all of it is allowed
    """

    splits: Mapping[str, Sequence[Task]]
    joined: Mapping[str, Sequence[JoinedTask]]
    unseen: Mapping[str, tuple[str, ...]]
    empty: tuple[str, ...]
    lacking: Mapping[str, int]
    impassable: Mapping[str, Impassable] = field(default_factory=dict)


@dataclass(eq=False)
class _Scan:
    """One scan with its eligible paths; unseen (N,) are the viewpoints that only val_unseen enters."""

    id: str
    ways: PathGraph
    paths: EligiblePaths
    unseen: NDArray[np.bool_]
    sides: dict[bool, list[tuple[int, ...]]] = field(init=False)

    def __post_init__(self) -> None:
        of = {True: self.paths.inside(self.unseen), False: self.paths.inside(~self.unseen)}
        self.sides = {
            side: [self.paths.path(i) for i in np.flatnonzero(inside).tolist()] for side, inside in of.items()
        }
        self.meters = {self.paths.path(i): float(m) for i, m in enumerate(self.paths.meters)}


def sample_tasks(
    graphs: Iterable[NavGraph],
    unseen: Sequence[str],
    bounds: PathBounds,
    amounts: PathCounts,
    impassable: Mapping[str, Impassable] = MappingProxyType({}),
) -> Dataset:
    """Samples the tasks of all splits. The result depends only on the arguments.

    unseen      scans that only val_unseen enters; if empty, a region of every scan is unseen
    impassable  scan id -> what no path may use. Shortest paths are still those of the whole graph, as agents compute
                them

    Raises InputError if a requested split would be empty, or `unseen` names an unknown scan.
    """
    graphs = list(graphs)
    for name in unseen:
        if name not in (graph.scan for graph in graphs):
            known = scan_choices(graph.scan for graph in graphs)
            raise InputError(f"--unseen {name!r} is not one of the scans; choose from {known}.")
    random = Random(amounts.seed)
    scans = [_scan(graph, unseen, bounds, amounts, impassable.get(graph.scan)) for graph in graphs]
    wanted = {name: getattr(amounts, name) for name in SPLITS}
    seen = _sample_paths(scans, False, wanted["train"] + wanted["val_seen"], random)
    found = dict(
        zip(("train", "val_seen"), _split_train_and_val_seen(seen, wanted["train"], wanted["val_seen"], random))
    )
    found["val_unseen"] = _sample_paths(scans, True, wanted["val_unseen"], random)
    for name in SPLITS:
        if wanted[name] and not found[name]:
            raise InputError(_why_none(name, bounds, bool(impassable)))
    next_id, splits = 1, {}
    for name in SPLITS:
        splits[name] = [_task(next_id + k, *drawn, random) for k, drawn in enumerate(found[name])]
        next_id += len(splits[name])
    joined = {}
    for name in SPLITS if amounts.joined else ():
        ways = {scan.id: scan.ways for scan in scans}
        allowed = {scan.id: scan.unseen if name == "val_unseen" else ~scan.unseen for scan in scans}
        joined[name] = join_tasks(splits[name], ways, allowed, amounts.joined, next_id, random)
        next_id += len(joined[name])
    return Dataset(
        splits,
        joined,
        {scan.id: tuple(id for id, far in zip(scan.paths.ids, scan.unseen) if far) for scan in scans},
        tuple(scan.id for scan in scans if not len(scan.paths.rows)),
        {name: wanted[name] - len(splits[name]) for name in SPLITS if wanted[name] > len(splits[name])},
        impassable,
    )


def _scan(
    graph: NavGraph, unseen: Sequence[str], bounds: PathBounds, amounts: PathCounts, impassable: Impassable | None
) -> _Scan:
    ways = PathGraph.of(graph)
    paths = eligible_paths(ways, bounds)
    if impassable is not None:
        paths = paths.excluding(impassable.edges, impassable.ends)
    if unseen:
        return _Scan(graph.scan, ways, paths, np.full(len(ways.ids), graph.scan in unseen))
    return _Scan(graph.scan, ways, paths, unseen_viewpoints(graph, paths, amounts.unseen_share))


_Drawn = tuple[_Scan, tuple[int, ...]]


def _sample_paths(scans: Sequence[_Scan], side: bool, count: int, random: Random) -> list[_Drawn]:
    """Returns up to `count` paths of one side, from the scans in turn."""
    orders = [(scan, by_increasing_use(scan.sides[side], random)) for scan in scans]
    return list(islice(_in_turn(orders, side), count))


def _in_turn(orders: list[tuple[_Scan, Iterator[int]]], side: bool) -> Iterator[_Drawn]:
    while orders:
        left = []
        for scan, order in orders:
            i = next(order, None)
            if i is not None:
                yield scan, scan.sides[side][i]
                left.append((scan, order))
        orders = left


def _split_train_and_val_seen(
    drawn: list[_Drawn], train: int, val_seen: int, random: Random
) -> tuple[list[_Drawn], list[_Drawn]]:
    """Splits paths into train and val_seen, in the requested ratio if there are too few."""
    count = math.ceil(len(drawn) * val_seen / max(train + val_seen, 1))
    order = sorted(range(len(drawn)), key=lambda _: random.random())
    held = set(order[:count])
    return [d for i, d in enumerate(drawn) if i not in held], [drawn[i] for i in sorted(held)]


def _task(path_id: int, scan: _Scan, rows: tuple[int, ...], random: Random) -> Task:
    path = tuple(scan.paths.ids[i] for i in rows)
    path = path[::-1] if random.random() < 0.5 else path
    heading = round(2 * math.pi * random.random(), 3)
    return Task(path_id, scan.id, path, heading, (), round(scan.meters[rows], 2))


def _why_none(split: str, bounds: PathBounds, robot: bool) -> str:
    what = f"path of {bounds.fewest_edges} to {bounds.most_edges} edges and at least {bounds.least_meters:g} m"
    what += " with room for a robot" if robot else ""
    if split == "val_unseen":
        return (
            f"No region contains a {what} for val_unseen; give a larger --unseen-share, lower --fewest-edges or "
            "--least-meters, name whole scans with --unseen, or give --val-unseen 0."
        )
    flag = f"--{split.replace('_', '-')}"
    return (
        f"No {what} is left for {split}; lower --fewest-edges or --least-meters, give a smaller --unseen-share, or "
        f"{flag} 0."
    )


def replace_instructions(dataset: Dataset, texts: Mapping[int, Sequence[str]]) -> Dataset:
    """Gives every task the instructions of its path_id, if there are any; joined paths get those of their two parts."""
    updated: dict[int, Task] = {}
    for task in (task for tasks in dataset.splits.values() for task in tasks):
        updated[task.path_id] = replace(task, instructions=tuple(texts.get(task.path_id, task.instructions)))
    splits = {name: [updated[task.path_id] for task in tasks] for name, tasks in dataset.splits.items()}
    joined = {name: [_join_paths(task, updated) for task in tasks] for name, tasks in dataset.joined.items()}
    return replace(dataset, splits=splits, joined=joined)


def _join_paths(task: JoinedTask, updated: Mapping[int, Task]) -> JoinedTask:
    instructions = joined_instructions(updated[task.first_path_id], updated[task.second_path_id])
    return replace(task, instructions=instructions)


def by_increasing_use(paths: Sequence[Sequence[Hashable]], random: Random) -> Iterator[int]:
    """Yields the indices of all `paths`, each once, by increasing use.

    The use of a path is the mean number of earlier paths through its viewpoints, plus the mean number of earlier ends
    at its ends. `random` decides ties.
    """
    passed: Counter[Hashable] = Counter()
    ends: Counter[Hashable] = Counter()

    def use_of_path(path: Sequence[Hashable]) -> float:
        return sum(passed[v] for v in path) / len(path) + (ends[path[0]] + ends[path[-1]]) / 2

    # The use of a path only grows. If the path with the smallest stored use is up to date, it is the least used.
    waiting = [(0.0, random.random(), i) for i in range(len(paths))]
    heapq.heapify(waiting)
    while waiting:
        then, tie, i = heapq.heappop(waiting)
        now = use_of_path(paths[i])
        if now > then:
            heapq.heappush(waiting, (now, tie, i))
            continue
        passed.update(paths[i])
        ends.update((paths[i][0], paths[i][-1]))
        yield i


def join_tasks(
    tasks: Sequence[Task],
    ways: Mapping[str, PathGraph],
    allowed: Mapping[str, NDArray[np.bool_]],
    count: int,
    first_id: int,
    random: Random,
) -> list[JoinedTask]:
    """Returns up to `count` joined paths of the tasks of a split, spread over the building.

    ways      scan id -> its viewpoints and edges
    allowed   scan id -> (N,) bool, viewpoints that the split may enter
    first_id  path_id of the first joined path; the others follow
    """
    found = [joined for scan in ways for joined in _of_scan(tasks, scan, ways[scan], allowed[scan])]
    chosen = islice(by_increasing_use([[(task.scan, v) for v in task.path] for task in found], random), count)
    return [replace(found[i], path_id=first_id + k) for k, i in enumerate(chosen)]


def joined_instructions(first: Task, second: Task) -> tuple[str, ...]:
    """Combines every instruction of the first path with every instruction of the second."""
    return tuple(f"{a} {b}" for a in first.instructions for b in second.instructions)


def _of_scan(tasks: Sequence[Task], scan: str, ways: PathGraph, allowed: NDArray[np.bool_]) -> Iterator[JoinedTask]:
    row = {id: i for i, id in enumerate(ways.ids)}
    shortest = ShortestPaths(ways)

    @cache
    def tree(start: str) -> ShortestPathTree:
        return shortest.tree(row[start])

    mine = [task for task in tasks if task.scan == scan]
    for second in mine:
        start = tree(second.path[0])
        for first in mine:
            goal = row[first.path[-1]]
            if first is second or start.meters[goal] > NEAR:
                continue
            between = start.back_from(goal)
            if not allowed[between].all():
                continue
            path = (*first.path[:-1], *(ways.ids[i] for i in between), *second.path[1:])
            whole = tree(first.path[0])
            end = row[second.path[-1]]
            yield JoinedTask(
                path_id=0,
                scan=scan,
                path=path,
                heading=first.heading,
                instructions=joined_instructions(first, second),
                distance=round((first.distance or 0.0) + float(start.meters[goal]) + (second.distance or 0.0), 2),
                first_path_id=first.path_id,
                second_path_id=second.path_id,
                shortest_path=tuple(ways.ids[i] for i in reversed(whole.back_from(end))),
                shortest_path_distance=round(float(whole.meters[end]), 2),
            )
