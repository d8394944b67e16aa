"""Run an agent without a model through the tasks of a split, and write its trajectories as the leaderboard takes them:
shortest, which follows the shortest path; random, as in R2R; random-paper, which goes ten times to any neighbour."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.r2r.agents.table import Name


@dataclass(frozen=True)
class Arguments:
    agent: Positional[Name]
    """Which agent."""
    scans: Path
    """The folder of an export (with connectivity/ in it), or a folder of connectivity files with scans.txt."""
    tasks: Path
    """A file of tasks, such as R2R_val_unseen.json."""
    out: Path
    """The file to write."""
    seed: int = 0
    """Of the random agents."""
    json: bool = False
    """Print what was written as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.cli.show import as_json
    from nvsim.r2r.agents.benchmark import Benchmark
    from nvsim.r2r.agents.running import run_agent
    from nvsim.r2r.agents.table import agent_of
    from nvsim.r2r.metrics.submission import write_submission

    a = arguments
    benchmark = Benchmark.read(a.scans, a.tasks)
    walked = run_agent(agent_of(a.agent, benchmark.graphs, a.seed), benchmark.tasks, benchmark.folder)
    written = write_submission(a.out, walked)
    print(as_json({"written": str(written), "trajectories": len(walked)}) if a.json else f"Wrote {written}")
    return 0
