"""Run an agent through the tasks of a split, and write its trajectories as the leaderboard takes them: shortest, which
follows the shortest path; random, as in R2R; random-paper, which goes ten times to any neighbour; recurrent, which
`nvsim r2r train` has trained; mapgpt, which asks a model at --endpoint where to go."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.terminal import say
from nvsim.endpoint.options import AskingOptions, OneEndpoint
from nvsim.errors import InputError
from nvsim.r2r.agents.table import Name
from nvsim.r2r.prompted.looking import Looking
from nvsim.r2r.prompted.mapgpt.rules import Rules

if TYPE_CHECKING:
    from nvsim.r2r.agents.benchmark import Benchmark
    from nvsim.r2r.metrics.submission import Trajectories


@dataclass(frozen=True)
class Arguments:
    agent: Positional[Name | Literal["recurrent", "mapgpt"]]
    """Which agent."""
    scans: Path
    """The folder of an export (with connectivity/ in it), or a folder of connectivity files with scans.txt."""
    out: Path
    """The file to write."""
    tasks: Path | None = None
    """A file of tasks, such as R2R_val_unseen.json."""
    split: str = ""
    """In place of --tasks a split, such as val_unseen, whose file is in tasks/ of the export."""
    checkpoint: Path | None = None
    """Of recurrent: the folder that `nvsim r2r train` wrote."""
    features: Path | None = None
    """Of recurrent: a file of features; the only one in features/ of the export when left out."""
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
    from nvsim.r2r.recurrent.folders import scans_in

    a, agent = arguments, arguments.agent
    if (a.tasks is None) == (not a.split):
        raise InputError("Give --tasks, a file of tasks, or --split, the name of one in the export; one of the two.")
    if agent != "recurrent" and (a.checkpoint is not None or a.features is not None):
        raise InputError(f"The agent {agent} takes neither --checkpoint nor --features; leave them out.")
    if agent != "mapgpt" and a.asked.endpoint is not None:
        raise InputError(f"The agent {agent} asks no model; leave --endpoint out, or run mapgpt.")
    scans = scans_in(a.scans)
    tasks = a.scans / "tasks" / f"R2R_{a.split}.json" if a.tasks is None else a.tasks
    if agent == "mapgpt":
        from nvsim.cli.commands.r2r_agent_mapgpt import run as run_asked

        return run_asked(a, scans, tasks)
    benchmark = Benchmark.read(scans, tasks)
    if agent == "recurrent":
        walked = _recurrent(a, benchmark)
    else:
        walked = run_agent(agent_of(agent, benchmark.graphs, a.seed), benchmark.tasks, benchmark.folder)
    written = write_submission(a.out, walked)
    say(as_json({"written": str(written), "trajectories": len(walked)}) if a.json else f"Wrote {written}")
    return 0


def _recurrent(arguments: Arguments, benchmark: Benchmark) -> Trajectories:
    a = arguments
    if a.checkpoint is None:
        raise InputError("The recurrent agent needs --checkpoint, the folder that `nvsim r2r train` wrote.")
    from nvsim.r2r.recurrent.agent import run_recurrent
    from nvsim.r2r.recurrent.folders import features_in

    return run_recurrent(a.checkpoint, benchmark, a.features or features_in(a.scans))
