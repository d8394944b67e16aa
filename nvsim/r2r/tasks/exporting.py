"""The tasks of a dataset in a folder: a file for each split, and `tasks.json`, which says how they were made."""

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
from nvsim.files.regular import read_json
from nvsim.r2r.tasks.eligible import Bounds
from nvsim.r2r.tasks.splitting import SPLITS, Amounts, Dataset
from nvsim.r2r.tasks.task_files import write_tasks

RECORD = "tasks.json"
SURROUNDINGS = "surroundings.json"
FORMAT = 1


def vlnce_files() -> list[str]:
    """Where VLN-CE's files lie below the folder of tasks."""
    return [f"vlnce/{name}/{name}{end}.json.gz" for name in SPLITS for end in ("", "_gt")]


def streamvln_files() -> list[str]:
    """The same of StreamVLN's."""
    return [f"streamvln/{name}/annotations.json" for name in SPLITS]


def export_tasks(
    dataset: Dataset,
    out: Path,
    bounds: Bounds,
    amounts: Amounts,
    instructions: Mapping[str, object],
    others: Sequence[str] = (),
) -> list[Path]:
    """Writes `R2R_<split>.json`, `R4R_<split>.json` where paths were joined, and tasks.json; returns their paths. Files
    of tasks that NVSim wrote into `out` before are replaced. `instructions` is what tasks.json says of them, `others`
    are files that come beside them, which the caller writes.

    Raises InputError where a file of tasks lies there that NVSim did not write, or the disk refuses.
    """
    files = {out / f"R2R_{name}.json": dataset.splits[name] for name in SPLITS}
    files |= {out / f"R4R_{name}.json": tasks for name, tasks in dataset.joined.items()}
    before = _written_before(out)
    for path in (*files, *(out / name for name in others)):
        if path.relative_to(out).as_posix() not in before and os.path.lexists(path):
            raise InputError(f"{path} is there and NVSim did not write it; choose another --out.")
    about = {
        "format": FORMAT,
        "version": __version__,
        "files": [*(path.name for path in files), *others],
        "bounds": {name: value for name, value in asdict(bounds).items() if value != float("inf")},
        "amounts": asdict(amounts),
        "instructions": dict(instructions),
        "unseen": {scan: list(ids) for scan, ids in dataset.unseen.items()},
    }
    # Tasks of an earlier run go before new ones come: together they might train where they must not.
    for name in sorted(before):
        try:
            (out / name).unlink(missing_ok=True)
        except OSError as error:
            raise as_input_error(out / name, error) from error
    # The record comes first: where a run is cut off between the files, the next one knows them for ours.
    atomic.write_text(out / RECORD, json.dumps(about, indent=1) + "\n")
    for path, tasks in files.items():
        write_tasks(path, tasks)
    return [*files, out / RECORD]


def _written_before(out: Path) -> set[str]:
    """Names of the files of tasks that the record in `out` lists."""
    if not os.path.lexists(out / RECORD):
        return set()
    about = read_json(out / RECORD, "the record of tasks", "remove it and the tasks beside it, or choose another --out")
    listed = about.get("files") if isinstance(about, dict) else None
    names = {f"{kind}_{name}.json" for kind in ("R2R", "R4R") for name in SPLITS}
    names |= {SURROUNDINGS, *vlnce_files(), *streamvln_files()}
    return names.intersection(name for name in listed if isinstance(name, str)) if isinstance(listed, list) else set()
