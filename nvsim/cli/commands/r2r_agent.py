"""Commands that run agents on tasks and score their trajectories."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.terminal import as_json, print_lines
from nvsim.endpoint.options import AskingOptions, OneEndpoint
from nvsim.endpoint.request import StoredAnswers
from nvsim.errors import InputError
from nvsim.files.atomic import refuse_unwritable_file
from nvsim.r2r.agents.baselines import Name, agent_of
from nvsim.r2r.agents.benchmark import Benchmark, run_agent, scans_in, tasks_in
from nvsim.r2r.metrics.submission import check_submission, read_submission, write_submission
from nvsim.r2r.prompted.options import EpisodeLimits, ImageOptions

if TYPE_CHECKING:
    from nvsim.r2r.metrics.submission import Trajectories


@dataclass(frozen=True)
class R2RAgent:
    """Run an agent on the tasks of a split, and write its trajectories in the leaderboard's format. The agents are:
    shortest, which follows the shortest path; random, as in R2R; random-paper, which moves ten times to any neighbor;
    recurrent, trained by `nvsim r2r train`; and mapgpt, which asks a model at --endpoint for each move."""

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
    looking: Inline[ImageOptions] = field(default_factory=ImageOptions)
    rules: Inline[EpisodeLimits] = field(default_factory=EpisodeLimits)
    prompt: Path | None = None
    """File with the prompt of mapgpt. Default: nvsim_resources/prompts/mapgpt.txt."""
    json: bool = False
    """Print the written files as JSON."""

    def run(self) -> int:
        """Runs the command. Raises InputError if options are missing or contradict each other."""
        agent = self.agent
        if (self.tasks is None) == (not self.split):
            raise InputError("Give either --tasks (a task file) or --split (the name of one in the export).")
        if agent != "recurrent" and (self.checkpoint is not None or self.features is not None):
            raise InputError(f"The agent {agent} takes neither --checkpoint nor --features; drop these options.")
        if agent != "mapgpt" and self.asked.endpoint is not None:
            raise InputError(f"The agent {agent} asks no model; drop --endpoint, or run mapgpt.")
        refuse_unwritable_file(self.out)
        scans = scans_in(self.scans)
        tasks = tasks_in(self.scans, self.split) if self.tasks is None else self.tasks
        if agent == "mapgpt":
            return _run_mapgpt(self, scans, tasks)
        benchmark = Benchmark.read(scans, tasks)
        if agent == "recurrent":
            walked = _run_recurrent_agent(self, benchmark)
        else:
            walked = run_agent(agent_of(agent, benchmark.graphs, self.seed), benchmark.tasks, benchmark.folder)
        written = write_submission(self.out, walked)
        print_lines(
            as_json({"written": str(written), "trajectories": len(walked)}) if self.json else f"Wrote {written}"
        )
        return 0


def _run_recurrent_agent(arguments: R2RAgent, benchmark: Benchmark) -> Trajectories:
    a = arguments
    if a.checkpoint is None:
        raise InputError("The recurrent agent needs --checkpoint, the folder that `nvsim r2r train` wrote.")
    from nvsim.r2r.features.layouts import features_in
    from nvsim.r2r.recurrent.saved_agent import run_recurrent

    return run_recurrent(a.checkpoint, benchmark, a.features or features_in(a.scans))


def _run_mapgpt(a: R2RAgent, scans: Path, tasks: Path) -> int:
    """Runs the episodes of the file `tasks` in the exported `scans`."""
    from nvsim.cli.consent import ask_for_consent, exit_code
    from nvsim.cli.console import event_listener
    from nvsim.endpoint.client import Client
    from nvsim.r2r.prompted.mapgpt import MapGpt, episodes_of, estimate_episodes, run_mapgpt
    from nvsim.r2r.prompted.mapgpt_episode import read_prompt
    from nvsim.r2r.prompted.views import ViewRenderer

    prompt, endpoint, budget = read_prompt(a.prompt), a.asked.address(), a.asked.budget(a.asking)
    benchmark = Benchmark.read(scans, tasks)
    episodes = episodes_of(benchmark.tasks, tasks)
    folder = a.out.with_name(f"{a.out.stem}.episodes")
    renderer = ViewRenderer(scans, a.looking)
    agent = MapGpt(renderer, a.looking, benchmark.graphs, prompt, a.rules)
    with event_listener(a.json) as listen:
        kept = StoredAnswers(a.asked.answers or folder / "answers")
        client = Client(endpoint, kept, budget, a.asking, listen)
        try:
            about = estimate_episodes(agent, client, episodes, folder)
            notes = [
                f"This estimate is for {len(episodes) - about.kept} episodes that go straight to their goals, from a "
                f"sample of them. An agent that gets lost asks more often: at most {a.rules.steps} times per episode, "
                f"{a.rules.most_images} images each, and up to three times as often if its answers are unusable. "
                "You can set a limit with --budget-tokens or --budget-money."
            ]
            client.may_send = ask_for_consent([(endpoint, about, budget.prices)], notes, a.asking.yes)
            done = run_mapgpt(agent, client, episodes, folder, listen)
        finally:
            client.close()
            renderer.close()
    written = write_submission(a.out, {id: record.trajectory for id, record in done.items()})
    ends = Counter(record.ended for record in done.values())
    figures = {
        "written": str(written),
        "trajectories": len(done),
        "stopped": ends["stop"],
        "out_of_steps": ends["steps"],
        "unanswered": ends["unanswered"],
        "tokens_in": budget.tokens_in,
        "tokens_out": budget.tokens_out,
        "price": budget.cost,
        "asked": budget.asked,
        "answers_used_again": budget.used_again,
    }
    if a.json:
        print_lines(as_json(figures))
    else:
        cost = "" if budget.cost is None else f" for {budget.cost:.4g}"
        spent = f"{budget.tokens_in:,} tokens in and {budget.tokens_out:,} out{cost}"
        print_lines(
            f"{len(done)} episodes: {ends['stop']} stopped, {ends['steps']} ran out of steps, {ends['unanswered']} "
            f"ended without an answer; {spent}. Wrote {written}"
        )
    return exit_code([] if any(record.steps for record in done.values()) else [endpoint.model])


@dataclass(frozen=True)
class EvaluateR2R:
    """Score the trajectories of agents on tasks as R2R's evaluation does (NE, SR, OSR, SPL, PL; nDTW, SDTW, CLS), and
    print the paper's table of agents, with counts and 95 % intervals."""

    scans: Path
    """The folder of an export (which contains connectivity/), or a folder of connectivity files with scans.txt."""
    tasks: Path
    """A task file, such as R2R_val_unseen.json."""
    submission: tuple[Path, ...] = ()
    """Trajectory files in the leaderboard's format, one for each agent: [{"instr_id": "17_0", "trajectory": [[viewpoint
    id, heading, elevation], ...]}, ...]. Result files of VLN-DUET are read too, and the folder with the results of
    MapGPT."""
    agents: tuple[Name, ...] = ()
    """Baseline agents to run as well: shortest; random, as in R2R; random-paper, ten moves to any neighbor."""
    seed: int = 0
    """Random seed of the random agents."""
    json: bool = False
    """Print the results as JSON."""

    def run(self) -> int:
        """Runs the command. Raises InputError if there are no trajectories to score."""
        from nvsim.evaluation.navigation import figures_of, text_of
        from nvsim.r2r.metrics.scores import score

        if not self.submission and not self.agents:
            raise InputError("There is no agent to score; give trajectory files with --submission, or name --agents.")
        benchmark = Benchmark.read(scans_in(self.scans), self.tasks)
        agents = {}
        for name, (where, trajectories) in _trajectories(self, benchmark).items():
            check_submission(trajectories, benchmark.tasks, benchmark.distances, where)
            agents[name] = figures_of(score(benchmark.tasks, trajectories, benchmark.distances))
        if self.json:
            print_lines(as_json({"tasks": str(self.tasks), "scans": list(benchmark.graphs), "agents": agents}))
        else:
            print(text_of(agents), end="")
        return 0


def _trajectories(arguments: EvaluateR2R, benchmark: Benchmark) -> dict[str, tuple[object, Trajectories]]:
    """Name of an agent -> source of its trajectories, and the trajectories."""
    found: dict[str, tuple[object, Trajectories]] = {}
    for agent in arguments.agents:
        walked = run_agent(agent_of(agent, benchmark.graphs, arguments.seed), benchmark.tasks, benchmark.folder)
        found[agent.upper()] = f"the agent {agent}", walked
    for path in arguments.submission:
        name = str(path) if path.stem in found else path.stem
        found[name] = path, read_submission(path)
    return found
