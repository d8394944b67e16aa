"""Train the recurrent agent, after VLN↻BERT, on the train split of exported scans: by imitation, and then by rewards if
requested. An interrupted training continues when you run it again. Its curves are in OUT/curves.jsonl."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli.arguments import Inline
from nvsim.cli.console import listening
from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.r2r.recurrent.config import LearningConfig, ModelConfig


@dataclass(frozen=True)
class Arguments:
    scans: tuple[Path, ...] = ()
    """Export folders. Each contains connectivity/ or scans/connectivity/, and tasks/ and features/ unless the options
    name them."""
    project: Path | None = None
    """Instead of --scans, a project with its export in a folder `scans` next to it. The project is not changed."""
    out: Path = Path("agent")
    """The output folder of the agent."""
    tasks: tuple[Path, ...] = ()
    """A task folder for each of --scans. Default: its tasks/."""
    features: tuple[Path, ...] = ()
    """A feature file, HDF5 or TSV, for each of --scans. Default: the only one in its features/."""
    model: Inline[ModelConfig] = field(default_factory=ModelConfig)
    learning: Inline[LearningConfig] = field(default_factory=LearningConfig)
    json: bool = False
    """Print events, one JSON object per line."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if no scans are named."""
    from nvsim.r2r.recurrent.dataset import read_dataset
    from nvsim.r2r.recurrent.training import train_agent

    a = arguments
    if not a.scans and a.project is None:
        raise InputError("There is nothing to train on; give --scans, one or more folders of exports.")
    scans = a.scans or (Path(os.path.abspath(a.project or "")).parent / "scans",)
    with listening(a.json) as listen:
        train_agent(read_dataset(scans, a.tasks, a.features), a.model, a.learning, a.out, listen)
    if not a.json:
        say(f"Wrote {a.out}")
    return 0
