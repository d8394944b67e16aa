"""List the edits of a project, or of a connectivity file that is open in a window or has unsaved edits. With --script,
write them as a script for `nvsim graph replay`."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say


@dataclass(frozen=True)
class Arguments:
    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    script: Path | None = None
    """Write the edits up to the current step as JSON lines into this file. An existing file is replaced only if it is a
    script."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.cli.graph_target import GraphTarget
    from nvsim.graph.scripts import script, write_script

    target = GraphTarget(arguments.graph)
    with target.journal() as journal:
        history = journal.history(target.read())
        steps, index, clean = history.steps, history.index, history.saved_index
        if arguments.script is not None:
            write_script(arguments.script, script(history))
    if arguments.json:
        rows = [{"text": s.text, "when": s.when, "edit": s.edit, "operation": s.operation} for s in steps]
        say(as_json({"steps": rows, "index": index, "saved": clean}))
        return 0
    for number, step in enumerate(steps):
        if step.changes or number == 0:
            when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(step.when))
            marks = " (saved)" if number == clean else ""
            say(f"{'>' if number == index else ' '} {number:4d}  {when}  {step.text}{marks}")
    if journal.notice:
        say(journal.notice)
    return 0
