"""Write the tasks that were accepted in a review, with the instructions that people wrote, as R2R_train.json and so on;
verdicts are those of the window, in reviewed/tasks_review.json beside the tasks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.terminal import say
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    tasks: Positional[tuple[Path, ...]]
    """The folder of tasks that was reviewed, or some of its files."""
    out: Path | None = None
    """The folder to write to; reviewed/ beside the tasks when left out."""
    unread: bool = False
    """Write tasks that nobody decided about too, so that only the rejected ones are left out."""
    json: bool = False
    """Print what was written as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.cli.show import as_json, table
    from nvsim.r2r.reviewing.folder import counts_of, export_reviewed, read_folder

    if not arguments.tasks:
        raise InputError("Name the folder of tasks that was reviewed.")
    folder = read_folder(*arguments.tasks)
    out = arguments.out or folder.review_file.parent
    written = export_reviewed(folder.entries, folder.review, out, arguments.unread)
    rows = counts_of(folder)
    if arguments.json:
        say(as_json({"written": [str(path) for path in written], "splits": rows}))
    else:
        table(list(rows[0]), [[str(value) for value in row.values()] for row in rows])
        say(*(f"Wrote {path}" for path in written))
    return 0
