"""Run an agent through the tasks of a split, and write its trajectories as the leaderboard takes them: shortest, which
follows the shortest path; random, as in R2R; random-paper, which goes ten times to any neighbour; mapgpt, which asks a
model at --endpoint where to go."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from nvsim.cli.arguments import Inline, Positional
from nvsim.endpoint.options import AskingOptions, OneEndpoint
from nvsim.errors import InputError
from nvsim.r2r.agents.table import Name
from nvsim.r2r.prompted.looking import Looking
from nvsim.r2r.prompted.mapgpt.rules import Rules


@dataclass(frozen=True)
class Arguments:
    agent: Positional[Name | Literal["mapgpt"]]
    """Which agent."""
    scans: Path
    """The folder of an export (with connectivity/ in it), or a folder of connectivity files with scans.txt."""
    tasks: Path
    """A file of tasks, such as R2R_val_unseen.json."""
    out: Path
    """The file to write."""
    seed: int = 0
    """Of the random agents."""
    asked: Inline[OneEndpoint] = field(default_factory=OneEndpoint)
    asking: Inline[AskingOptions] = field(default_factory=AskingOptions)
    looking: Inline[Looking] = field(default_factory=Looking)
    rules: Inline[Rules] = field(default_factory=Rules)
    prompt: Path | None = None
    """What the model of mapgpt is told; resources/prompts/mapgpt.txt when left out."""
    json: bool = False
    """Print what was written as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.cli.show import as_json
    from nvsim.r2r.agents.benchmark import Benchmark
    from nvsim.r2r.agents.running import run_agent
    from nvsim.r2r.agents.table import agent_of
    from nvsim.r2r.metrics.submission import write_submission

    a = arguments
    if a.agent == "mapgpt":
        from nvsim.cli.commands.r2r_agent_mapgpt import run as run_asked

        return run_asked(a)
    if a.asked.endpoint is not None:
        raise InputError(f"The agent {a.agent} asks no model; leave --endpoint out, or run mapgpt.")
    benchmark = Benchmark.read(a.scans, a.tasks)
    walked = run_agent(agent_of(a.agent, benchmark.graphs, a.seed), benchmark.tasks, benchmark.folder)
    written = write_submission(a.out, walked)
    print(as_json({"written": str(written), "trajectories": len(walked)}) if a.json else f"Wrote {written}")
    return 0
