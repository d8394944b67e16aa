"""What the agent is trained on: the train split of exported folders, and which part of it is held out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from random import Random

from nvsim.errors import InputError
from nvsim.files.regular import read_json
from nvsim.r2r.agents.benchmark import Benchmark
from nvsim.r2r.features.feature_reading import Key, made_by
from nvsim.r2r.recurrent.folders import features_in, scans_in
from nvsim.r2r.recurrent.walking import Episode
from nvsim.r2r.recurrent.words import Vocabulary
from nvsim.r2r.recurrent.world import World
from nvsim.r2r.recurrent.world_reading import Source
from nvsim.r2r.tasks.exporting import RECORD
from nvsim.r2r.tasks.task import Task

_WHOLE_SCANS = 3
"""So many scans or more, and whole ones are held out."""


@dataclass(frozen=True, eq=False)
class Dataset:
    """tasks    of the train splits, path_ids unique
    sources   one for each folder
    closed    viewpoints of val_unseen in the same scans: an agent that explores may not enter them
    """

    tasks: Sequence[Task]
    sources: Sequence[Source]
    closed: frozenset[Key]

    @cached_property
    def backbone(self) -> str:
        """What made the features, "" where no file says it. Raises InputError where two say another."""
        found = {name: source.features for source in self.sources if (name := made_by(source.features))}
        if len(found) > 1:
            (one, first), (other, second), *_ = found.items()
            raise InputError(
                f"{first} holds features of {one}, and {second} those of {other}; an agent needs all of one network."
            )
        return next(iter(found), "")


def read_dataset(folders: Sequence[Path], tasks: Sequence[Path] = (), features: Sequence[Path] = ()) -> Dataset:
    """The train splits of exports.

    folders    exports, each with connectivity/ in it, or in a folder `scans`
    tasks      a folder of tasks for each; `tasks` in the export where none is given
    features   a file of features for each; the only one in `features` in the export where none is given

    Raises InputError where one of them is missing, or has no instruction.
    """
    for name, given in (("tasks", tasks), ("features", features)):
        if given and len(given) != len(folders):
            raise InputError(f"--{name} names {len(given)} for {len(folders)} folders; give one for each, or none.")
    found: list[Task] = []
    sources: list[Source] = []
    closed: set[Key] = set()
    for i, folder in enumerate(folders):
        at = tasks[i] if tasks else folder / "tasks"
        benchmark = Benchmark.read(scans_in(folder), at / "R2R_train.json")
        found += benchmark.tasks
        sources.append(Source(benchmark.graphs, features[i] if features else features_in(folder)))
        closed |= {(scan, id) for scan, ids in _unseen(at).items() if scan in benchmark.graphs for id in ids}
    told = [replace(task, path_id=number) for number, task in enumerate(found) if task.instructions]
    if not told:
        raise InputError("No path of train has an instruction; export the tasks again, with --instructions 3.")
    return Dataset(told, sources, frozenset(closed))


def held_out(tasks: Sequence[Task], share: float, seed: int) -> tuple[list[Task], list[Task]]:
    """Tasks to train on, and those held out: whole scans, or paths of scans where there are few scans."""
    scans = sorted({task.scan for task in tasks})
    groups: list[object] = list(scans) if len(scans) >= _WHOLE_SCANS else [task.path_id for task in tasks]
    if len(groups) < 2:
        raise InputError("There is one path to train on, and none could be held out; export more tasks.")
    random = Random(f"{seed} held out")
    order = sorted(groups, key=lambda _: random.random())
    out = set(order[: min(max(1, math.ceil(share * len(groups))), len(groups) - 1)])
    group = (lambda task: task.scan) if len(scans) >= _WHOLE_SCANS else (lambda task: task.path_id)
    return [t for t in tasks if group(t) not in out], [t for t in tasks if group(t) in out]


def episodes_of(tasks: Sequence[Task], world: World, words: Vocabulary, longest: int) -> list[Episode]:
    """An episode for each instruction; a path without any is one, in which nothing is said.

    Raises InputError where an agent cannot walk a path: a step leads straight up, or where nobody may enter."""
    found = []
    for task in tasks:
        path = tuple(world.row[task.scan, id] for id in task.path)
        for a, b in pairwise(path):
            if b not in world.target[a]:
                raise InputError(
                    f"path_id {task.path_id} of the scan {task.scan}: no view leads from {world.keys[a][1]} to "
                    f"{world.keys[b][1]}, which lies straight above, or belongs to val_unseen; sample the tasks again."
                )
        for id, text in zip(task.instr_ids, task.instructions or ("",)):
            found.append(Episode(id, task, tuple(words.encoded(text, longest)), path))
    return found


def _unseen(tasks: Path) -> Mapping[str, Sequence[str]]:
    """scan -> viewpoints that the record of the tasks names as unseen; none where there is no record."""
    if not (tasks / RECORD).is_file():
        return {}
    about = read_json(tasks / RECORD, "the record of tasks", "export the tasks again")
    unseen = about.get("unseen", {}) if isinstance(about, dict) else {}
    if not isinstance(unseen, dict) or not all(
        isinstance(ids, list) and all(isinstance(id, str) for id in ids) for ids in unseen.values()
    ):
        raise InputError(f"{tasks / RECORD}: `unseen` does not list viewpoints of scans; export the tasks again.")
    return unseen
