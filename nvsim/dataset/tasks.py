"""The tasks of scans, from sampling to files: paths, what is seen along them, instructions, and episodes in space."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.events import Listener, Log, Progress, Warning
from nvsim.graph.types import NavGraph
from nvsim.r2r.instructions.generating import Told, instruct
from nvsim.r2r.tasks.eligible import Bounds
from nvsim.r2r.tasks.exporting import SURROUNDINGS, export_tasks, streamvln_files, vlnce_files
from nvsim.r2r.tasks.splitting import Amounts, Dataset, sample_tasks

MOST_INSTRUCTIONS = 100
STAGE = "tasks"
Retell = Callable[[Dataset, Sequence[NavGraph]], tuple[Dataset, dict[str, Any]]]


@dataclass(frozen=True)
class TaskOptions:
    """unseen        scans that only val_unseen enters, whole
    instructions  of each path
    landmarks     whether they name what is seen
    vlnce, streamvln   whether these files are written too
    """

    unseen: tuple[str, ...] = ()
    instructions: int = 3
    landmarks: bool = True
    vlnce: bool = False
    streamvln: bool = False
    amounts: Amounts = field(default_factory=Amounts)
    bounds: Bounds = field(default_factory=Bounds)


@dataclass(frozen=True, eq=False)
class MadeTasks:
    """told      the tasks, and how many of them the follower finds
    about     what tasks.json says of the instructions
    written   all files
    episodes  split -> paths with actions, {} where none were asked for
    """

    told: Told
    about: dict[str, Any]
    written: list[Path]
    episodes: dict[str, int]


def make_tasks(
    graphs: Sequence[NavGraph],
    scans: Path | None,
    out: Path,
    options: TaskOptions,
    listen: Listener,
    clouds: Mapping[str, NDArray[np.floating]] = MappingProxyType({}),
    retell: Retell | None = None,
) -> MadeTasks:
    """Samples tasks of `graphs` and writes them into `out`.

    scans   the folder of the export in which the scans' strips lie, None where there is none
    clouds  scan -> (N, 3) points of surfaces, metres, world, that robots must not touch, where more is known than the
            strips show
    retell  who puts other instructions in the place of those made here, and says of them what tasks.json keeps

    Raises InputError where no path fits, strips are damaged or missing that are needed, or the disk refuses.
    """
    o = options
    if not 0 <= o.instructions <= MOST_INSTRUCTIONS:
        raise InputError(f"{o.instructions} instructions of a path cannot be made; give --instructions from 0 to 100.")
    dataset = sample_tasks(graphs, o.unseen, o.bounds, o.amounts)
    tasks = [task for tasks in dataset.splits.values() for task in tasks]
    used = {task.scan for task in tasks}
    seen, scenes = _looked_at([graph for graph in graphs if graph.scan in used], scans, o, clouds, listen)
    told = instruct(dataset, graphs, o.instructions, o.amounts.seed, seen, listen)
    about: dict[str, Any] = {"each": o.instructions, "paths": told.paths, "found_again": len(told.found)}
    about["landmarks_in"] = sorted(seen)
    if retell is not None:
        retold, about["endpoint"] = retell(told.dataset, graphs)
        told = replace(told, dataset=retold)
    others = [SURROUNDINGS] if seen else []
    episodes = _episodes(told, scenes, listen) if o.vlnce or o.streamvln else {}
    others += vlnce_files() if o.vlnce else []
    others += streamvln_files() if o.streamvln else []
    written = export_tasks(told.dataset, out, o.bounds, o.amounts, about, others)
    if seen:
        from nvsim.r2r.surroundings.surroundings_file import write_surroundings

        written.append(write_surroundings(out / SURROUNDINGS, seen))
    if o.vlnce:
        from nvsim.r2r.episodes.vlnce import write_vlnce

        written += write_vlnce(episodes, out / "vlnce")
    if o.streamvln:
        from nvsim.r2r.episodes.streamvln import write_streamvln

        written += write_streamvln(episodes, out / "streamvln")
    return MadeTasks(told, about, written, {name: len(split) for name, split in episodes.items()})


def _looked_at(
    graphs: Sequence[NavGraph],
    scans: Path | None,
    options: TaskOptions,
    clouds: Mapping[str, NDArray[np.floating]],
    listen: Listener,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What stands around in each scan that has strips with depth, and where robots have room in it."""
    from nvsim.r2r.observations.places import ScanPlaces
    from nvsim.r2r.surroundings.layers import layers_of
    from nvsim.r2r.surroundings.seen import has_depth, look_around
    from nvsim.r2r.surroundings.survey import surroundings_of

    wants_episodes = options.vlnce or options.streamvln
    wants_words = options.landmarks and options.instructions > 0
    seen: dict[str, Any] = {}
    scenes: dict[str, Any] = {}
    for graph in graphs if wants_episodes or wants_words else ():
        if scans is None or not has_depth(ScanPlaces(scans, graph.scan), graph):
            if wants_episodes:
                raise InputError(
                    f"The scan {graph.scan} has no strips with depth, which say where a robot has room; run `nvsim "
                    "export scan` first and name its folder with --scans."
                )
            why = f"The scan {graph.scan} has no strips with depth: its instructions name turns and distances alone."
            listen(Log(why, STAGE))
            continue
        count = sum(v.included for v in graph.viewpoints.values())
        views = []
        for one in look_around(scans, graph):
            views.append(one)
            listen(Progress("surroundings", len(views), count, graph.scan))
        storeys = list(layers_of(views, graph))
        if wants_words:
            seen[graph.scan] = surroundings_of(graph, storeys)
        if wants_episodes:
            from nvsim.r2r.episodes.episode import Scene

            scenes[graph.scan] = Scene(graph, storeys, clouds.get(graph.scan))
    return seen, scenes


def _episodes(told: Told, scenes: dict[str, Any], listen: Listener) -> dict[str, Any]:
    from nvsim.r2r.episodes.episode import episodes_of

    episodes = episodes_of(told.dataset.splits, scenes, listen)
    climbing = sum(scenes[task.scan].climbs(task) for tasks in told.dataset.splits.values() for task in tasks)
    tight = told.paths - sum(map(len, episodes.values())) - climbing
    why = [f"{climbing} lead over stairs, and actions are sought on one storey alone"] if climbing else []
    why += [f"{tight} leave a robot no room"] if tight else []
    if why:
        listen(Warning(f"{climbing + tight} of {told.paths} paths have no episode: {'; '.join(why)}", STAGE))
    return episodes
