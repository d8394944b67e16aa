"""Write the tasks that were accepted in a review, with the rewritten instructions, as R2R_train.json and so on. The
verdicts come from the window, which stores them in reviewed/tasks_review.json next to the tasks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.terminal import say
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    tasks: Positional[tuple[Path, ...]]
    """The folder of reviewed tasks, or some of its files."""
    out: Path | None = None
    """The output folder. Default: reviewed/ next to the tasks."""
    unread: bool = False
    """Also write tasks without a verdict, so that only rejected ones are skipped."""
    json: bool = False
    """Print the written files as JSON."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if no tasks are named."""
    from nvsim.cli.show import as_json, table
    from nvsim.r2r.reviewing import counts_of, export_reviewed, read_folder

    if not arguments.tasks:
        raise InputError("Name the folder of the reviewed tasks.")
    folder = read_folder(*arguments.tasks)
    own = folder.review_file.parent
    out = arguments.out or own
    is_own = out.expanduser().resolve() == own.resolve()
    written = export_reviewed(folder.entries, folder.review, out, arguments.unread, overwrite=is_own)
    rows = counts_of(folder)
    if arguments.json:
        say(as_json({"written": [str(path) for path in written], "splits": rows}))
    else:
        table(list(rows[0]), [[str(value) for value in row.values()] for row in rows])
        say(*(f"Wrote {path}" for path in written))
    return 0
