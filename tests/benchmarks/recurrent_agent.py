"""Test whether the recurrent agent uses instructions: train it with and without them, and evaluate on unseen scans.

python -m tests.benchmarks.recurrent_agent FOLDER OUT [--seeds 0 1 2] [--also PROJECT_EXPORT ...] [--json]

FOLDER is an export with tasks/ and features/, in which the scans of val_unseen are not in train. For each seed, an
agent with instructions and one without (`--blind`) are trained equally. The best state of each on the held-out part of
train is kept. Both are evaluated on val_unseen, together with RANDOM. Success rates are means over seeds and
instructions. Intervals (95 %) are over paths; those of differences are over the differences of each path. --also names
further exports, such as that of a reconstructed building, on whose val_unseen these agents are evaluated. Finished
trainings are reused, and interrupted ones continue.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from numpy.typing import NDArray

from nvsim.cli.terminal import as_json, table
from nvsim.evaluation.interval import grouped_mean
from nvsim.events import Event, Metric
from nvsim.r2r.agents.baselines import random_agent
from nvsim.r2r.agents.benchmark import Agent, Benchmark, run_agent, scans_in
from nvsim.r2r.features.layouts import features_in
from nvsim.r2r.metrics.scores import Scores, score
from nvsim.r2r.recurrent.config import LearningConfig, ModelConfig
from nvsim.r2r.recurrent.dataset import read_dataset
from nvsim.r2r.recurrent.saved_agent import run_recurrent
from nvsim.r2r.recurrent.training import train_agent

KINDS = ("reads", "blind", "RANDOM")


@dataclass(frozen=True)
class Arguments:
    folder: tyro.conf.Positional[Path]
    out: tyro.conf.Positional[Path]
    seeds: tuple[int, ...] = (0, 1, 2)
    also: tuple[Path, ...] = ()
    json: bool = False
    model: tyro.conf.OmitArgPrefixes[ModelConfig] = field(default_factory=ModelConfig)
    learning: tyro.conf.OmitArgPrefixes[LearningConfig] = field(
        default_factory=lambda: LearningConfig(iterations=600, threads=1)
    )


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__, config=(tyro.conf.FlagCreatePairsOff,))
    torch.set_num_threads(arguments.learning.threads or torch.get_num_threads())
    folders = (arguments.folder, *arguments.also)
    found: dict[Path, dict[str, list[Scores]]] = {folder: {kind: [] for kind in KINDS} for folder in folders}
    for seed in arguments.seeds:
        for kind in ("blind", "reads"):
            agent = trained(arguments, kind, seed)
            for folder in folders:
                found[folder][kind].append(walked(folder, agent))
        for folder in folders:
            found[folder]["RANDOM"].append(walked(folder, random_agent(seed)))
        for folder in folders:
            shares = {kind: round(100 * float(found[folder][kind][-1].success.mean()), 1) for kind in KINDS}
            print(f"seed {seed}, {folder.name}: SR % {shares}", flush=True)
    figures = {str(folder): figures_of(found[folder]) for folder in folders}
    if arguments.json:
        print(as_json(figures))
        return
    for name, rows in figures.items():
        columns = ("SR %", "mean", "95 %", "SPL %", "of each seed")
        table(columns, [(kind, *map(str, row.values())) for kind, row in rows.items()], f"{name}, val_unseen")


def trained(arguments: Arguments, kind: str, seed: int) -> Path:
    out = arguments.out / f"{kind}-{seed}"
    model = replace(arguments.model, blind=kind == "blind")
    started = time.process_time()

    def listen(event: Event) -> None:
        if isinstance(event, Metric) and event.name == "success":
            spent = time.process_time() - started
            print(f"{out.name}, batch {event.step}: {event.value:.1%} held out, {spent:.0f} s", flush=True)

    train_agent(read_dataset([arguments.folder]), model, replace(arguments.learning, seed=seed), out, listen)
    return out


def walked(folder: Path, agent: Path | Agent) -> Scores:
    benchmark = Benchmark.read(scans_in(folder), folder / "tasks" / "R2R_val_unseen.json")
    if isinstance(agent, Path):
        trajectories = run_recurrent(agent, benchmark, features_in(folder))
    else:
        trajectories = run_agent(agent, benchmark.tasks, benchmark.folder)
    return score(benchmark.tasks, trajectories, benchmark.distances)


def figures_of(scores: dict[str, list[Scores]]) -> dict[str, dict[str, Any]]:
    """Metrics of each kind of agent, and the gain of the reading agent over the others."""
    paths = scores["reads"][0].path_ids
    success = {kind: np.mean([s.success for s in of], axis=0) for kind, of in scores.items()}
    rows = {}
    for kind, of in scores.items():
        rows[kind] = _row(success[kind], paths, [s.success for s in of], np.mean([s.spl.mean() for s in of]))
    for kind in KINDS[1:]:
        each = [a.success - b.success for a, b in zip(scores["reads"], scores[kind])]
        rows[f"reads - {kind}"] = _row(success["reads"] - success[kind], paths, each, None)
    return rows


def _row(
    values: NDArray[np.float64], paths: NDArray[np.int64], each: list[NDArray[np.float64]], spl: Any
) -> dict[str, Any]:
    low, high = grouped_mean(values, paths)
    return {
        "mean": round(100 * float(values.mean()), 1),
        "interval": f"{100 * low:.1f} to {100 * high:.1f}",
        "spl": "" if spl is None else round(100 * float(spl), 1),
        "seeds": " ".join(f"{100 * float(of.mean()):.1f}" for of in each),
    }


if __name__ == "__main__":
    main()
