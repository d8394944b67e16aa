"""The command that removes Gaussians from a project of splat files, and restores them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nvsim.cli import terminal
from nvsim.cli.arguments import Positional
from nvsim.cli.session import project_job
from nvsim.cli.terminal import as_json, print_lines
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Warning

if TYPE_CHECKING:
    from nvsim.project.project import Project

_VERB = "splat clean"
_WORDS = {"floater": "floaters, fog, and faint glass", "outside": "outside the building"}


@dataclass(frozen=True)
class SplatClean:
    """List the Gaussians of a project from splat files that should be removed, and why. With --apply, remove them; with
    --restore, restore all removed Gaussians. Then build the map again with `nvsim floors` and `nvsim map`.

    The splats are not changed, so that each removal can be undone. Views, maps, and exports leave the removed Gaussians
    out. The window shows the Gaussians before they are removed, and can remove any others (Edit > Clean splat).
    """

    project: Positional[Path]
    """A project from splat files."""
    apply: bool = False
    """Remove the listed Gaussians, in addition to those that are already removed."""
    restore: bool = False
    """Restore all removed Gaussians."""
    json: bool = False
    """Print the numbers as JSON, and events as JSON lines."""

    def run(self) -> int:
        """Runs the command. Raises InputError if both options are given or the project is not from splat files."""
        from nvsim.project.cleaning import read_whole_splat, removal_candidates, remove_gaussians
        from nvsim.project.project import Project

        if self.apply and self.restore:
            raise InputError("--apply removes Gaussians and --restore restores them; give one of them.")
        if self.restore:
            with project_job(self.project, _VERB, self.json) as (project, listen):
                whole = read_whole_splat(project)
                remove_gaussians(project, whole.rows, np.zeros_like(whole.removed))
                listen(Done(_VERB, f"{int(whole.removed.sum())} Gaussians restored", {}))
                _warn_of_outdated_results(project, listen)
            return 0
        with Project.open(self.project) as project:
            whole = read_whole_splat(project)
            found = removal_candidates(project, whole)
        counts = {reason: int((rows & ~whole.removed).sum()) for reason, rows in found.items()}
        if self.json:
            numbers: dict[str, int] = {"gaussians": len(whole.removed), "removed": int(whole.removed.sum())}
            print_lines(as_json(numbers | {str(reason): count for reason, count in counts.items()}))
        else:
            rows = [[_WORDS[reason], f"{count:,}"] for reason, count in counts.items()]
            title = f"{int(whole.removed.sum()):,} of {len(whole.removed):,} Gaussians are removed"
            terminal.table(["should be removed", "Gaussians"], rows, title)
        if self.apply:
            with project_job(self.project, _VERB, self.json) as (project, listen):
                remove_gaussians(project, whole.rows, np.any([whole.removed, *found.values()], axis=0))
                listen(Done(_VERB, f"{sum(counts.values())} Gaussians removed", {}))
                _warn_of_outdated_results(project, listen)
        return 0


def _warn_of_outdated_results(project: Project, listen: Listener) -> None:
    from nvsim.project.outdated import outdated_sentences

    if sentences := outdated_sentences(project):
        listen(Warning(" ".join(sentences), _VERB))
