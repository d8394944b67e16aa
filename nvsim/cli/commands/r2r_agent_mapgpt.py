"""The part of `nvsim r2r agent mapgpt` that asks a model."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.cli.terminal import say

if TYPE_CHECKING:
    from nvsim.cli.commands.r2r_agent import Arguments


def run(a: Arguments, scans: Path, tasks: Path) -> int:
    """Runs the episodes of the file `tasks` in the exported `scans`."""
    from nvsim.cli.consent import agree
    from nvsim.cli.console import listening
    from nvsim.cli.show import as_json
    from nvsim.endpoint.answer import Kept
    from nvsim.endpoint.client import Client
    from nvsim.r2r.agents.benchmark import Benchmark
    from nvsim.r2r.metrics.submission import write_submission
    from nvsim.r2r.prompted.mapgpt import MapGpt, episodes_of, rehearsed, run_mapgpt
    from nvsim.r2r.prompted.mapgpt_episode import read_prompt
    from nvsim.r2r.prompted.views import ViewRenderer

    prompt, endpoint, budget = read_prompt(a.prompt), a.asked.address(), a.asked.budget(a.asking)
    benchmark = Benchmark.read(scans, tasks)
    episodes = episodes_of(benchmark.tasks, tasks)
    folder = a.out.with_name(f"{a.out.stem}.episodes")
    renderer = ViewRenderer(scans, a.looking)
    agent = MapGpt(renderer, a.looking, benchmark.graphs, prompt, a.rules)
    with listening(a.json) as listen:
        kept = Kept(a.asked.answers or folder / "answers")
        client = Client(endpoint, kept, budget, a.asking, listen)
        try:
            about = rehearsed(agent, client, episodes, folder)
            notes = [
                f"This estimate is for {len(episodes) - about.kept} episodes that go straight to their goals, from a "
                f"sample of them. An agent that gets lost asks more often: at most {a.rules.steps} times per episode, "
                f"{a.rules.most_images} images each, and up to three times as often if its answers are unusable. "
                "You can set a limit with --budget-tokens or --budget-money."
            ]
            client.may_send = agree([(endpoint, about, budget.prices)], notes, a.asking.yes)
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
        "price": budget.money,
        "asked": budget.asked,
        "answers_used_again": budget.used_again,
    }
    if a.json:
        say(as_json(figures))
    else:
        cost = "" if budget.money is None else f" for {budget.money:.4g}"
        spent = f"{budget.tokens_in:,} tokens in and {budget.tokens_out:,} out{cost}"
        say(
            f"{len(done)} episodes: {ends['stop']} stopped, {ends['steps']} ran out of steps, {ends['unanswered']} "
            f"ended without an answer; {spent}. Wrote {written}"
        )
    return 0
