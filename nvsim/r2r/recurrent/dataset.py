"""The training data of the agent: the train split of exported folders, its held-out part, and its vocabulary."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from random import Random

from nvsim.errors import InputError
from nvsim.files.opening import read_json
from nvsim.r2r.agents.benchmark import Benchmark, scans_in, tasks_in
from nvsim.r2r.features.feature_files import Key, backbone_of_file
from nvsim.r2r.features.layouts import features_in
from nvsim.r2r.recurrent.rollout import Episode
from nvsim.r2r.recurrent.world import ExportFiles, World
from nvsim.r2r.tasks.exporting import RECORD
from nvsim.r2r.tasks.task import Task

PAD, BEGIN, END, UNKNOWN = "[pad]", "[begin]", "[end]", "[unknown]"
SPECIAL = (PAD, BEGIN, END, UNKNOWN)
_WORD = re.compile(r"[^\W\d_]+(?:['’][^\W\d_]+)*|\d+(?:\.\d+)?|[.,;:!?]")
_WHOLE_SCANS = 3
"""With this number of scans or more, whole scans are held out."""


def split_words(text: str) -> list[str]:
    """Splits a text into lower-case words, numbers, and punctuation marks."""
    return _WORD.findall(text.lower())


@dataclass(frozen=True)
class Vocabulary:
    """The vocabulary of an agent.

    words   the special tokens first; the number of a word is its index
    """

    words: tuple[str, ...]

    @staticmethod
    def of(texts: Iterable[str], least: int = 2) -> Vocabulary:
        """Returns the words that occur at least `least` times, by descending frequency, then alphabetically."""
        counts = Counter(word for text in texts for word in split_words(text))
        known = sorted((word for word, n in counts.items() if n >= least), key=lambda word: (-counts[word], word))
        return Vocabulary((*SPECIAL, *known))

    @cached_property
    def number(self) -> dict[str, int]:
        return {word: i for i, word in enumerate(self.words)}

    def encoded(self, text: str, longest: int) -> list[int]:
        """Returns the numbers of the begin token, up to `longest` words, and the end token."""
        unknown = self.number[UNKNOWN]
        inside = [self.number.get(word, unknown) for word in split_words(text)[:longest]]
        return [self.number[BEGIN], *inside, self.number[END]]


@dataclass(frozen=True, eq=False)
class Dataset:
    """Training data.

    tasks     of the train splits, with unique path_ids
    sources   one for each folder
    closed    viewpoints of val_unseen in these scans, which an agent in training must not enter
    """

    tasks: Sequence[Task]
    sources: Sequence[ExportFiles]
    closed: frozenset[Key]

    @cached_property
    def backbone(self) -> str:
        """Name of the features' backbone, "" if unknown. Raises InputError if two files have different ones."""
        found = {name: source.features for source in self.sources if (name := backbone_of_file(source.features))}
        if len(found) > 1:
            (one, first), (other, second), *_ = found.items()
            raise InputError(
                f"{first} has features of {one}, but {second} of {other}; an agent needs features of one network."
            )
        return next(iter(found), "")


def read_dataset(folders: Sequence[Path], tasks: Sequence[Path] = (), features: Sequence[Path] = ()) -> Dataset:
    """Reads the train splits of exports.

    folders    exports, each with connectivity/ in it, or in its folder `scans`
    tasks      a tasks folder for each export, or none for the folder `tasks` in each export
    features   a features file for each export, or none for the only file in the folder `features` of each export

    Raises InputError if one of them is missing, or no path has an instruction.
    """
    for name, given in (("tasks", tasks), ("features", features)):
        if given and len(given) != len(folders):
            raise InputError(f"--{name} has {len(given)} values for {len(folders)} folders; give one each, or none.")
    found: list[Task] = []
    sources: list[ExportFiles] = []
    closed: set[Key] = set()
    for i, folder in enumerate(folders):
        at = tasks[i] if tasks else tasks_in(folder, "train").parent
        benchmark = Benchmark.read(scans_in(folder), at / "R2R_train.json")
        found += benchmark.tasks
        sources.append(ExportFiles(benchmark.graphs, features[i] if features else features_in(folder)))
        closed |= {(scan, id) for scan, ids in _unseen(at).items() if scan in benchmark.graphs for id in ids}
    instructed = [replace(task, path_id=number) for number, task in enumerate(found) if task.instructions]
    if not instructed:
        raise InputError("No path of train has an instruction; export the tasks again, with --instructions 3.")
    return Dataset(instructed, sources, frozenset(closed))


def held_out(tasks: Sequence[Task], share: float, seed: int) -> tuple[list[Task], list[Task]]:
    """Splits tasks into training tasks and held-out tasks: whole scans, or paths if there are fewer than three scans.

    Raises InputError if there is only one path.
    """
    scans = sorted({task.scan for task in tasks})
    groups: list[object] = list(scans) if len(scans) >= _WHOLE_SCANS else [task.path_id for task in tasks]
    if len(groups) < 2:
        raise InputError("There is only one path, so none can be held out from training; export more tasks.")
    random = Random(f"{seed} held out")
    order = sorted(groups, key=lambda _: random.random())
    out = set(order[: min(max(1, math.ceil(share * len(groups))), len(groups) - 1)])
    group = (lambda task: task.scan) if len(scans) >= _WHOLE_SCANS else (lambda task: task.path_id)
    return [t for t in tasks if group(t) not in out], [t for t in tasks if group(t) in out]


def episodes_of(tasks: Sequence[Task], world: World, words: Vocabulary, longest: int) -> list[Episode]:
    """Returns an episode for each instruction. A path without instructions has one episode with an empty instruction.

    Raises InputError if an agent cannot follow a path: a step leads straight up or down, or to a closed viewpoint.
    """
    found = []
    for task in tasks:
        path = tuple(world.row[task.scan, id] for id in task.path)
        for a, b in pairwise(path):
            if b not in world.target[a]:
                raise InputError(
                    f"path_id {task.path_id} of the scan {task.scan}: no view leads from {world.keys[a][1]} to "
                    f"{world.keys[b][1]}, which is straight above or below, or in val_unseen; sample the tasks again."
                )
        for id, text in zip(task.instr_ids, task.instructions or ("",)):
            found.append(Episode(id, task, tuple(words.encoded(text, longest)), path))
    return found


def _unseen(tasks: Path) -> Mapping[str, Sequence[str]]:
    """Returns scan -> unseen viewpoints in the record of the tasks; empty if there is no record."""
    if not (tasks / RECORD).is_file():
        return {}
    about = read_json(tasks / RECORD, "a tasks record", "export the tasks again")
    unseen = about.get("unseen", {}) if isinstance(about, dict) else {}
    if not isinstance(unseen, dict) or not all(
        isinstance(ids, list) and all(isinstance(id, str) for id in ids) for ids in unseen.values()
    ):
        raise InputError(f"{tasks / RECORD}: `unseen` is not a list of viewpoints per scan; export the tasks again.")
    return unseen
