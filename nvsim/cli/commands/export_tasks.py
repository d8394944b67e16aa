"""Sample the paths of a benchmark as R2R does, with instructions, and write them as R2R_train.json, R2R_val_seen.json
and R2R_val_unseen.json: shortest paths, spread over the building, val_unseen in regions that the others never enter."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsim.cli.arguments import Inline
from nvsim.endpoint.options import AskingOptions, OneEndpoint
from nvsim.errors import InputError
from nvsim.r2r.prompted.looking import Looking
from nvsim.r2r.tasks.eligible import Bounds
from nvsim.r2r.tasks.splitting import Amounts

if TYPE_CHECKING:
    from nvsim.graph.types import NavGraph
    from nvsim.r2r.instructions.generating import Told
    from nvsim.r2r.tasks.splitting import Dataset


@dataclass(frozen=True)
class Arguments:
    scans: Path | None = None
    """The folder of an export (with connectivity/ in it), or a folder of connectivity files with scans.txt."""
    project: Path | None = None
    """In place of --scans a project, whose graph is one scan, under the id that `nvsim export r2r` gives it."""
    out: Path = Path("tasks")
    """The folder to write to."""
    only: tuple[str, ...] = ()
    """Which scans; all that scans.txt lists when none is named."""
    unseen: tuple[str, ...] = ()
    """Scans that only val_unseen enters, whole; when none is named, a region of every scan."""
    instructions: int = 3
    """Instructions of each path, made here from turns, distances and slopes; 0 leaves them empty."""
    amounts: Inline[Amounts] = field(default_factory=Amounts)
    bounds: Inline[Bounds] = field(default_factory=Bounds)
    asked: Inline[OneEndpoint] = field(default_factory=OneEndpoint)
    asking: Inline[AskingOptions] = field(default_factory=AskingOptions)
    looking: Inline[Looking] = field(default_factory=Looking)
    prompt: Path | None = None
    """What the model at --endpoint is told; resources/prompts/instructions.txt when left out."""
    json: bool = False
    """Print what was written as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.cli.show import as_json, table
    from nvsim.r2r.instructions.generating import instruct
    from nvsim.r2r.tasks.exporting import export_tasks
    from nvsim.r2r.tasks.splitting import sample_tasks

    a = arguments
    if not 0 <= a.instructions <= 100:
        raise InputError(f"{a.instructions} instructions of a path cannot be made; give --instructions from 0 to 100.")
    graphs = _graphs(a)
    told = instruct(sample_tasks(graphs, a.unseen, a.bounds, a.amounts), graphs, a.instructions, a.amounts.seed)
    dataset = told.dataset
    about: dict[str, Any] = {"each": a.instructions, "paths": told.paths, "found_again": len(told.found)}
    if a.asked.endpoint is not None:
        from nvsim.cli.commands.export_tasks_asked import asked_instructions

        dataset, about["endpoint"] = asked_instructions(a, dataset, graphs)
    written = export_tasks(dataset, a.out, a.bounds, a.amounts, about)
    for warning in _warnings(dataset):
        print(f"warning: {warning}", file=sys.stderr)
    rows = _rows(dataset)
    if a.json:
        unseen = {scan: len(ids) for scan, ids in dataset.unseen.items()}
        files = [str(path) for path in written]
        print(as_json({"written": files, "splits": rows, "unseen": unseen, "instructions": about}))
    else:
        table(list(rows[0]), [[_text(value) for value in row.values()] for row in rows])
        if a.instructions:
            made = "instructions made here" if a.asked.endpoint is not None else "instructions"
            print(f"From the {made} alone a follower finds {_found(told)}.")
        if "endpoint" in about:
            print(
                f"{about['endpoint']['paths']} of {told.paths} paths have instructions of {about['endpoint']['model']}."
            )
        print("\n".join(f"Wrote {path}" for path in written))
    return 0


def _rows(dataset: Dataset) -> list[dict[str, Any]]:
    named = [(name, tasks) for name, tasks in dataset.splits.items()]
    named += [(f"{name}, joined", tasks) for name, tasks in dataset.joined.items()]
    rows = []
    for name, tasks in named:
        edges = [len(task.path) - 1 for task in tasks] or [0]
        metres = [task.distance or 0.0 for task in tasks] or [0.0]
        row = {
            "split": name,
            "paths": len(tasks),
            "scans": len({task.scan for task in tasks}),
            "viewpoints": len({(task.scan, id) for task in tasks for id in task.path}),
            "edges": [min(edges), round(sum(edges) / len(edges), 2), max(edges)],
            "metres": [min(metres), round(sum(metres) / len(metres), 2), max(metres)],
        }
        rows.append(row)
    return rows


def _found(told: Told) -> str:
    how = Counter(told.found.values())
    return (
        f"{len(told.found)} of {told.paths} paths again, {how['clock']} of them because they name the hours of a clock "
        f"and {how['degrees']} because they name degrees"
    )


def _text(value: object) -> str:
    return " / ".join(f"{v:g}" for v in value) if isinstance(value, list) else str(value)


def _warnings(dataset: Dataset) -> list[str]:
    from nvsim.r2r.observations.stub import SCAN

    found = [f"No path within the bounds lies in the scan {id}." for id in dataset.empty if id != SCAN]
    return found + [
        f"{split} has {fewer} paths fewer than asked for: no more fit." for split, fewer in dataset.lacking.items()
    ]


def _graphs(arguments: Arguments) -> list[NavGraph]:
    from nvsim.graph.connectivity import read_connectivity, scan_files

    if (arguments.scans is None) == (arguments.project is None):
        raise InputError("Give --scans, a folder of exported scans, or --project, one of the two.")
    if arguments.scans is not None:
        return [read_connectivity(path) for path in scan_files(arguments.scans, arguments.only).values()]
    if arguments.only:
        raise InputError("--only names scans of --scans; a project is one scan.")
    from dataclasses import replace

    from nvsim.project.project import Project
    from nvsim.project.stages.mapped import scan_name

    assert arguments.project is not None
    with Project.open(arguments.project) as project:
        return [replace(project.need_graph(), scan=scan_name(project))]
