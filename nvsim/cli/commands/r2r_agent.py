"""Run an agent on the tasks of a split, and write its trajectories in the leaderboard's format. The agents are:
shortest, which follows the shortest path; random, as in R2R; random-paper, which moves ten times to any neighbor;
recurrent, trained by `nvsim r2r train`; and mapgpt, which asks a model at --endpoint for each move."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.terminal import say
from nvsim.endpoint.options import AskingOptions, OneEndpoint
from nvsim.errors import InputError
from nvsim.r2r.agents.baselines import Name
from nvsim.r2r.prompted.options import Looking, Rules

if TYPE_CHECKING:
    from nvsim.r2r.agents.benchmark import Benchmark
    from nvsim.r2r.metrics.submission import Trajectories


@dataclass(frozen=True)
class Arguments:
    agent: Positional[Name | Literal["recurrent", "mapgpt"]]
    """The agent to run."""
    scans: Path
    """The folder of an export (which contains connectivity/), or a folder of connectivity files with scans.txt."""
    out: Path
    """The output file."""
    tasks: Path | None = None
    """A task file, such as R2R_val_unseen.json."""
    split: str = ""
    """Instead of --tasks, a split such as val_unseen, whose file is in tasks/ of the export."""
    checkpoint: Path | None = None
    """For recurrent: the folder written by `nvsim r2r train`."""
    features: Path | None = None
    """For recurrent: a feature file. Default: the only one in features/ of the export."""
    seed: int = 0
    """Random seed of the random agents."""
    asked: Inline[OneEndpoint] = field(default_factory=OneEndpoint)
    asking: Inline[AskingOptions] = field(default_factory=AskingOptions)
    looking: Inline[Looking] = field(default_factory=Looking)
    rules: Inline[Rules] = field(default_factory=Rules)
    prompt: Path | None = None
    """File with the prompt of mapgpt. Default: resources/prompts/mapgpt.txt."""
    json: bool = False
    """Print the written files as JSON."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if options are missing or contradict each other."""
    from nvsim.cli.show import as_json
    from nvsim.r2r.agents.baselines import agent_of
    from nvsim.r2r.agents.benchmark import Benchmark, run_agent, scans_in
    from nvsim.r2r.metrics.submission import write_submission

    a, agent = arguments, arguments.agent
    if (a.tasks is None) == (not a.split):
        raise InputError("Give either --tasks (a task file) or --split (the name of one in the export).")
    if agent != "recurrent" and (a.checkpoint is not None or a.features is not None):
        raise InputError(f"The agent {agent} takes neither --checkpoint nor --features; drop these options.")
    if agent != "mapgpt" and a.asked.endpoint is not None:
        raise InputError(f"The agent {agent} asks no model; drop --endpoint, or run mapgpt.")
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
    from nvsim.r2r.features.layouts import features_in
    from nvsim.r2r.recurrent.saved_agent import run_recurrent

    return run_recurrent(a.checkpoint, benchmark, a.features or features_in(a.scans))
