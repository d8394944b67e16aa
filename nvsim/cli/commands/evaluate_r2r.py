"""Score the trajectories of agents on tasks as R2R's evaluation does (NE, SR, OSR, SPL, PL; nDTW, SDTW, CLS), and print
the paper's table of agents, with counts and 95 % intervals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.errors import InputError

if TYPE_CHECKING:
    from nvsim.r2r.metrics.submission import Trajectories


@dataclass(frozen=True)
class Arguments:
    scans: Path
    """The folder of an export (with connectivity/ in it), or a folder of connectivity files with scans.txt."""
    tasks: Path
    """A file of tasks, such as R2R_val_unseen.json."""
    submission: tuple[Path, ...] = ()
    """Files of trajectories as for the leaderboard, one for each agent: [{"instr_id": "17_0", "trajectory": [[viewpoint
    id, heading, elevation], ...]}, ...]."""
    json: bool = False
    """Print the figures as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.cli.show import as_json
    from nvsim.evaluation.navigation import figures_of, text_of
    from nvsim.graph.connectivity import read_connectivity, scan_files
    from nvsim.r2r.metrics.distances import Distances, check_tasks
    from nvsim.r2r.metrics.scores import score
    from nvsim.r2r.metrics.submission import check_submission
    from nvsim.r2r.tasks.task_files import read_tasks

    a = arguments
    tasks = read_tasks(a.tasks)
    if not tasks:
        raise InputError(f"{a.tasks} holds no path; export tasks with paths in this split.")
    files = scan_files(a.scans, list(dict.fromkeys(task.scan for task in tasks)))
    distances = {scan: Distances(read_connectivity(path)) for scan, path in files.items()}
    check_tasks(tasks, distances, a.tasks)
    agents = {}
    for name, (where, trajectories) in _trajectories(a).items():
        check_submission(trajectories, tasks, distances, where)
        agents[name] = figures_of(score(tasks, trajectories, distances))
    if a.json:
        print(as_json({"tasks": str(a.tasks), "scans": list(files), "agents": agents}))
    else:
        print(text_of(agents), end="")
    return 0


def _trajectories(arguments: Arguments) -> dict[str, tuple[object, Trajectories]]:
    """Name of an agent -> where its trajectories come from, and they."""
    from nvsim.r2r.metrics.submission import read_submission

    if not arguments.submission:
        raise InputError("There is nobody to score; give files of trajectories with --submission.")
    found: dict[str, tuple[object, Trajectories]] = {}
    for path in arguments.submission:
        name = str(path) if path.stem in found else path.stem
        found[name] = path, read_submission(path)
    return found
