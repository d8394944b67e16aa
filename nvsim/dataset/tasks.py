"""Make the tasks of scans and write their files: paths, landmarks, instructions, and episodes in continuous space."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.dataset.task_options import TaskOptions
from nvsim.errors import InputError
from nvsim.events import Listener, Log, Progress, Warning
from nvsim.files.atomic import refuse_unwritable_folder
from nvsim.graph.types import NavGraph
from nvsim.plain_text import count_text
from nvsim.r2r.instructions.generating import InstructedDataset, instruct
from nvsim.r2r.instructions.statistics import statistics_of
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.surroundings.layers import layers_of
from nvsim.r2r.surroundings.survey import surroundings_of
from nvsim.r2r.surroundings.visibility import has_depth, views_from_viewpoints
from nvsim.r2r.tasks.exporting import (
    GOALS,
    RECORD,
    SURROUNDINGS,
    export_tasks,
    goal_files,
    refuse_foreign_files,
    rxr_files,
    streamvln_files,
    vlnce_files,
)
from nvsim.r2r.tasks.splitting import SPLITS, Dataset, Impassable, sample_tasks

if TYPE_CHECKING:
    from nvsim.networks.installed import InstalledModel
    from nvsim.r2r.episodes.episode import Episode, Scene

MOST_INSTRUCTIONS = 100
STAGE = "tasks"
_SHOWN = 5  # edges or viewpoints that a warning names
Retell = Callable[[Dataset, Sequence[NavGraph]], tuple[Dataset, dict[str, Any]]]


@dataclass(frozen=True, eq=False)
class WrittenTasks:
    """Tasks that were made and written.

    instructed  the tasks with instructions, and those that the follower solves
    about       description of the instructions in tasks.json
    written     all written files
    walks       split -> paths with actions, {} if none were requested
    """

    instructed: InstructedDataset
    about: dict[str, Any]
    written: list[Path]
    walks: Mapping[str, Sequence[Episode]]

    @property
    def episodes(self) -> dict[str, int]:
        """Split -> number of paths with actions, {} if none were requested."""
        return {name: len(split) for name, split in self.walks.items()}


def check_options(options: TaskOptions) -> None:
    """Raises InputError if the number of instructions is out of range, RxR has no instructions, or the network that
    names objects is missing, unsuitable, or needed for nothing."""
    o = options
    if not 0 <= o.instructions <= MOST_INSTRUCTIONS:
        raise InputError(f"{o.instructions} instructions per path are not possible; give --instructions from 0 to 100.")
    if o.rxr and not o.instructions:
        raise InputError("RxR annotates instructions; give --instructions 1 or more, or drop --rxr.")
    if o.objects:
        _network_of_objects(o.objects)
        if not o.goals and not (o.landmarks and o.instructions):
            raise InputError("--objects names landmarks and goals, but neither is requested; leave it out.")


def _network_of_objects(name: str) -> InstalledModel:
    """The installed network that names objects. Raises InputError if it is missing or names none."""
    from nvsim.networks.description import FloorResult
    from nvsim.networks.installed import find_model, models_of

    def names_objects(model: InstalledModel | None) -> bool:
        result = None if model is None or model.description is None else model.description.result
        return isinstance(result, FloorResult) and bool(result.objects)

    suitable = [model for model in models_of("semantic") if names_objects(model)]
    model = find_model("semantic", name, "names of objects", suitable)
    if model is None or not names_objects(model):
        raise InputError(
            f"{name} names no objects; use a network with classes of furniture, such as segformer-b4-ade20k, or list "
            "the classes in its description ([result.objects])."
        )
    return model


def make_tasks(
    graphs: Sequence[NavGraph],
    scans: Path | None,
    out: Path,
    options: TaskOptions,
    listen: Listener,
    clouds: Mapping[str, NDArray[np.floating]] = MappingProxyType({}),
    retell: Retell | None = None,
) -> WrittenTasks:
    """Samples tasks of `graphs` and writes them into `out`.

    scans   export folder that contains the strips of the scans, None if there is none
    clouds  scan -> (N, 3) points on surfaces, meters, world, which robots must not touch; they supplement the strips
    retell  replaces the generated instructions, and returns their description for tasks.json

    Raises InputError if no path fits, if required strips are damaged or missing, or if the disk refuses. Before any
    work: if `out` cannot be written, or contains tasks that NVSim did not write.
    """
    o = options
    check_options(o)
    others = _other_files(o)
    refuse_unwritable_folder(out)
    kinds = ("R2R", "R4R") if o.amounts.joined else ("R2R",)
    refuse_foreign_files(out, [*(f"{kind}_{name}.json" for kind in kinds for name in SPLITS), *others])
    dataset = sample_tasks(graphs, o.unseen, o.bounds, o.amounts)
    used = {task.scan for tasks in dataset.splits.values() for task in tasks}
    if o.episodes:
        used = {graph.scan for graph in graphs if graph.scan not in dataset.empty}
    seen, scenes, targets = _looked_at([graph for graph in graphs if graph.scan in used], scans, o, clouds, listen)
    if scenes:
        dataset = sample_tasks(graphs, o.unseen, o.bounds, o.amounts, _impassable(graphs, scenes, listen))
    instructed = instruct(dataset, graphs, o.instructions, o.amounts.seed, seen, listen, o.register)
    about: dict[str, Any] = {"each": o.instructions, "paths": instructed.paths, "found_again": len(instructed.found)}
    about |= {"register": o.register, "landmarks_in": sorted(seen)}
    about |= {"objects": o.objects} if o.objects else {}
    if retell is not None:
        rewritten, about["endpoint"] = retell(instructed.dataset, graphs)
        instructed = replace(instructed, dataset=rewritten, places={})
    splits = instructed.dataset.splits.values()
    about["statistics"] = asdict(statistics_of([text for split in splits for t in split for text in t.instructions]))
    others = [SURROUNDINGS, *others] if seen else others
    episodes = _episodes(instructed, scenes, listen) if o.episodes else {}
    written = export_tasks(instructed.dataset, out, o.bounds, o.amounts, about, others)
    if seen:
        from nvsim.r2r.surroundings.survey import write_surroundings

        written.append(write_surroundings(out / SURROUNDINGS, seen))
    if o.vlnce:
        from nvsim.r2r.episodes.episode import write_vlnce

        written += write_vlnce(episodes, out / "vlnce")
    if o.streamvln:
        from nvsim.r2r.episodes.episode import write_streamvln

        written += write_streamvln(episodes, out / "streamvln")
    if o.goals:
        from nvsim.dataset.goals import write_goals

        written += write_goals(instructed.dataset.splits, targets, out / GOALS)
    if o.rxr:
        from nvsim.dataset import rxr
        from nvsim.r2r.episodes.episode import episodes_of

        coarse = episodes_of(instructed.dataset.splits, scenes, listen, rxr.TURN) if o.vlnce else {}
        written += rxr.write_rxr(instructed, graphs, coarse, out / "rxr", listen)
    return WrittenTasks(instructed, about, written, episodes)


def _other_files(o: TaskOptions) -> list[str]:
    """The names of the requested files beside R2R's and R4R's."""
    found = vlnce_files() if o.vlnce else []
    found += streamvln_files() if o.streamvln else []
    found += rxr_files(o.vlnce) if o.rxr else []
    return found + (goal_files() if o.goals else [])


def _looked_at(
    graphs: Sequence[NavGraph],
    scans: Path | None,
    options: TaskOptions,
    clouds: Mapping[str, NDArray[np.floating]],
    listen: Listener,
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """The surroundings, the free space, and the goals of each scan whose strips have depth. Raises InputError if
    episodes or goals are requested and a scan has no such strips."""
    from nvsim.dataset.goals import GoalScene
    from nvsim.r2r.episodes.targets import targets_of

    wants_words = options.landmarks and options.instructions > 0
    network = None
    if options.objects:
        from nvsim.perception.semantic_network import SemanticNetwork

        network = SemanticNetwork(_network_of_objects(options.objects).open())
    seen: dict[str, Any] = {}
    scenes: dict[str, Any] = {}
    targets: dict[str, Any] = {}
    for graph in graphs if options.strips or wants_words else ():
        if scans is None or not has_depth(ScanPlaces(scans, graph.scan), graph):
            if options.strips:
                raise InputError(
                    f"The scan {graph.scan} has no strips with depth, which show the free space; run `nvsim "
                    "export scan` first and name its folder with --scans."
                )
            why = f"The scan {graph.scan} has no strips with depth: its instructions name only turns and distances."
            listen(Log(why, STAGE))
            continue
        count = sum(v.included for v in graph.viewpoints.values())
        views = []
        for one in views_from_viewpoints(scans, graph, None if network is None else network.objects):
            views.append(one)
            listen(Progress("surroundings", len(views), count, graph.scan))
        storeys = list(layers_of(views, graph))
        if wants_words or options.goals:
            around = surroundings_of(graph, storeys, () if network is None else network.object_names)
            if wants_words:
                seen[graph.scan] = around
            if options.goals:
                targets[graph.scan] = GoalScene(graph, targets_of(graph, storeys, around, clouds.get(graph.scan)))
        if options.episodes:
            from nvsim.r2r.episodes.episode import Scene

            scenes[graph.scan] = Scene(graph, storeys, clouds.get(graph.scan))
    return seen, scenes, targets


def _impassable(graphs: Sequence[NavGraph], scenes: Mapping[str, Scene], listen: Listener) -> dict[str, Impassable]:
    """Returns the impassable parts of each scan, and warns about them."""
    found = {scan: scene.impassable() for scan, scene in scenes.items()}
    for graph in graphs:
        if graph.scan not in found:
            continue
        one, scene = found[graph.scan], scenes[graph.scan]
        climbing = sum(scene.uses_stairs(key) for key in one.edges)
        tight = [key for key in one.edges if not scene.uses_stairs(key)]
        ends = [id for id in one.ends if not scene.uses_stairs([id])]
        why = (
            [f"{count_text(climbing, 'edge')} on stairs, because actions are limited to one storey"] if climbing else []
        )
        if tight:
            named = _shortened_list([f"{a} to {b}" for a, b in tight])
            why.append(f"{count_text(len(tight), 'edge')} too narrow for a robot ({named})")
        if ends:
            why.append(f"{count_text(len(ends), 'start or goal')} without room for a robot ({_shortened_list(ends)})")
        if why:
            listen(Warning(f"Paths of {graph.scan} avoid {'; '.join(why)}; see {RECORD}", STAGE))
    return found


def _shortened_list(names: Sequence[str]) -> str:
    return ", ".join(names[:_SHOWN]) + (f", and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")


def _episodes(instructed: InstructedDataset, scenes: Mapping[str, Scene], listen: Listener) -> dict[str, list[Episode]]:
    from nvsim.r2r.episodes.episode import episodes_of

    episodes = episodes_of(instructed.dataset.splits, scenes, listen)
    lacking = instructed.paths - sum(len(split) for split in episodes.values())
    if lacking:
        why = "the search found no actions that stay close to the path and touch nothing"
        listen(Warning(f"{lacking} of {instructed.paths} paths have no episode: {why}", STAGE))
    return episodes
