"""Score the trajectories of agents on tasks as R2R's evaluation does (NE, SR, OSR, SPL, PL; nDTW, SDTW, CLS), and print
the paper's table of agents, with counts and 95 % intervals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.r2r.agents.baselines import Name

if TYPE_CHECKING:
    from nvsim.r2r.agents.benchmark import Benchmark
    from nvsim.r2r.metrics.submission import Trajectories


@dataclass(frozen=True)
class Arguments:
    scans: Path
    """The folder of an export (which contains connectivity/), or a folder of connectivity files with scans.txt."""
    tasks: Path
    """A task file, such as R2R_val_unseen.json."""
    submission: tuple[Path, ...] = ()
    """Trajectory files in the leaderboard's format, one for each agent: [{"instr_id": "17_0", "trajectory": [[viewpoint
    id, heading, elevation], ...]}, ...]."""
    agents: tuple[Name, ...] = ()
    """Baseline agents to run as well: shortest; random, as in R2R; random-paper, ten moves to any neighbor."""
    seed: int = 0
    """Random seed of the random agents."""
    json: bool = False
    """Print the results as JSON."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if there are no trajectories to score."""
    from nvsim.cli.show import as_json
    from nvsim.evaluation.navigation import figures_of, text_of
    from nvsim.r2r.agents.benchmark import Benchmark
    from nvsim.r2r.metrics.scores import score
    from nvsim.r2r.metrics.submission import check_submission

    a = arguments
    if not a.submission and not a.agents:
        raise InputError("There is no agent to score; give trajectory files with --submission, or name --agents.")
    benchmark = Benchmark.read(a.scans, a.tasks)
    agents = {}
    for name, (where, trajectories) in _trajectories(a, benchmark).items():
        check_submission(trajectories, benchmark.tasks, benchmark.distances, where)
        agents[name] = figures_of(score(benchmark.tasks, trajectories, benchmark.distances))
    if a.json:
        say(as_json({"tasks": str(a.tasks), "scans": list(benchmark.graphs), "agents": agents}))
    else:
        print(text_of(agents), end="")
    return 0


def _trajectories(arguments: Arguments, benchmark: Benchmark) -> dict[str, tuple[object, Trajectories]]:
    """Name of an agent -> source of its trajectories, and the trajectories."""
    from nvsim.r2r.agents.baselines import agent_of
    from nvsim.r2r.agents.benchmark import run_agent
    from nvsim.r2r.metrics.submission import read_submission

    found: dict[str, tuple[object, Trajectories]] = {}
    for agent in arguments.agents:
        walked = run_agent(agent_of(agent, benchmark.graphs, arguments.seed), benchmark.tasks, benchmark.folder)
        found[agent.upper()] = f"the agent {agent}", walked
    for path in arguments.submission:
        name = str(path) if path.stem in found else path.stem
        found[name] = path, read_submission(path)
    return found
