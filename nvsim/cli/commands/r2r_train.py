"""Train the recurrent agent, after VLN↻BERT, on the train split of exported scans: by imitation and then, where asked
for, by rewards. A training that was killed goes on where it was; its curves are in OUT/curves.jsonl."""

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
    """Folders of exports, each with connectivity/ or scans/connectivity/ in it, and with tasks/ and features/ where the
    options do not name them."""
    project: Path | None = None
    """In place of --scans a project, next to which a folder `scans` holds what it exported; nothing in it changes."""
    out: Path = Path("agent")
    """The folder that becomes the agent."""
    tasks: tuple[Path, ...] = ()
    """A folder of tasks for each of --scans, when they are not in its tasks/."""
    features: tuple[Path, ...] = ()
    """A file of features, HDF5 or TSV, for each of --scans; the only one in its features/ when left out."""
    model: Inline[ModelConfig] = field(default_factory=ModelConfig)
    learning: Inline[LearningConfig] = field(default_factory=LearningConfig)
    json: bool = False
    """Print typed events, one JSON object a line."""


def run(arguments: Arguments) -> int:
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
