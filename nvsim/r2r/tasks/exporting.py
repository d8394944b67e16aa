"""Writes the tasks of a dataset to a folder: a file for each split, and `tasks.json` with their settings."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from nvsim import __version__
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.atomic import as_input_error
from nvsim.files.opening import read_json
from nvsim.r2r.tasks.shortest import PathBounds
from nvsim.r2r.tasks.splitting import SPLITS, Dataset, PathCounts
from nvsim.r2r.tasks.task import write_tasks

RECORD = "tasks.json"
SURROUNDINGS = "surroundings.json"
GOALS = "goals"
BOXES = "reverie/BBoxes.json"
FORMAT = 1


def vlnce_files() -> list[str]:
    """Returns the paths of VLN-CE's files below the tasks folder."""
    return [f"vlnce/{name}/{name}{end}.json.gz" for name in SPLITS for end in ("", "_gt")]


def streamvln_files() -> list[str]:
    """Returns the paths of StreamVLN's files below the tasks folder."""
    return [f"streamvln/{name}/annotations.json" for name in SPLITS]


def rxr_files(episodes: bool = True) -> list[str]:
    """Returns the paths of RxR's files below the tasks folder, without the pose traces; with those of episodes."""
    found = [f"rxr/rxr_{name}_guide.jsonl.gz" for name in SPLITS]
    ends = ("guide", "guide_gt") if episodes else ()
    return found + [f"rxr/RxR_VLNCE_v0/{name}/{name}_{end}.json.gz" for name in SPLITS for end in ends]


def goal_files() -> list[str]:
    """Returns the paths of the files of goals below the tasks folder, without those of single viewpoints."""
    kinds = ("pointnav", "objectnav", "instance_imagenav")
    found = [f"{GOALS}/{kind}/{name}/{name}.json.gz" for kind in kinds for name in SPLITS]
    found += [f"{GOALS}/{remote}" for name in SPLITS for remote in (reverie_file(name), soon_file(name))]
    return [*found, f"{GOALS}/{BOXES}"]


def reverie_file(split: str) -> str:
    """Returns the path of the remote objects of REVERIE below the folder of goals."""
    return f"reverie/REVERIE_{split}.json"


def soon_file(split: str) -> str:
    """Returns the path of the remote objects of SOON below the folder of goals."""
    return f"soon/SOON_{split}.jsonl"


def export_tasks(
    dataset: Dataset,
    out: Path,
    bounds: PathBounds,
    amounts: PathCounts,
    instructions: Mapping[str, object],
    others: Sequence[str] = (),
) -> list[Path]:
    """Writes `R2R_<split>.json`, `R4R_<split>.json` for joined paths, and tasks.json, and returns their paths.

    Tasks files in `out` from an earlier run of NVSim are replaced. `instructions` is the entry of tasks.json about the
    instructions. `others` are further files, which the caller writes.

    Raises InputError if a tasks file exists that NVSim did not write, or if writing fails.
    """
    files = {out / f"R2R_{name}.json": dataset.splits[name] for name in SPLITS}
    files |= {out / f"R4R_{name}.json": tasks for name, tasks in dataset.joined.items()}
    before = refuse_foreign_files(out, [*(path.name for path in files), *others])
    about = {
        "format": FORMAT,
        "version": __version__,
        "files": [*(path.name for path in files), *others],
        "bounds": {name: value for name, value in asdict(bounds).items() if value != float("inf")},
        "amounts": asdict(amounts),
        "instructions": dict(instructions),
        "unseen": {scan: list(ids) for scan, ids in dataset.unseen.items()},
        "impassable": {scan: asdict(parts) for scan, parts in dataset.impassable.items()},
    }
    # Removes tasks of an earlier run first. Mixed with new ones, train could enter regions of val_unseen.
    for name in sorted(before):
        try:
            (out / name).unlink(missing_ok=True)
        except OSError as error:
            raise as_input_error(out / name, error) from error
    # Writes the record first. After an interrupted run, the next run then knows that NVSim wrote the files.
    atomic.write_text(out / RECORD, json.dumps(about, indent=1) + "\n")
    for path, tasks in files.items():
        write_tasks(path, tasks)
    return [*files, out / RECORD]


def refuse_foreign_files(out: Path, names: Sequence[str]) -> set[str]:
    """Returns the names of the tasks files in `out` that NVSim wrote. Raises InputError if one of `names` exists there
    and NVSim did not write it."""
    before = _written_before(out)
    for name in names:
        if name not in before and os.path.lexists(out / name):
            raise InputError(f"{out / name} exists, but NVSim did not write it; choose another --out.")
    return before


def _written_before(out: Path) -> set[str]:
    """Returns the names of the tasks files that the record in `out` lists."""
    if not os.path.lexists(out / RECORD):
        return set()
    about = read_json(out / RECORD, "a tasks record", "remove it and the tasks beside it, or choose another --out")
    listed = about.get("files") if isinstance(about, dict) else None
    names = {f"{kind}_{name}.json" for kind in ("R2R", "R4R") for name in SPLITS}
    names |= {SURROUNDINGS, *vlnce_files(), *streamvln_files(), *rxr_files(), *goal_files()}
    return names.intersection(name for name in listed if isinstance(name, str)) if isinstance(listed, list) else set()
