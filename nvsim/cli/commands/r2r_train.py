"""Train the recurrent agent, after VLN↻BERT, on the train split of exported scans: by imitation and then, where asked
for, by rewards. A training that was killed goes on where it was; its curves are in OUT/curves.jsonl."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.console import listening
from nvsim.r2r.recurrent.config import LearningConfig, ModelConfig


@dataclass(frozen=True)
class Arguments:
    folders: Positional[tuple[Path, ...]]
    """Folders of exports, each with connectivity/, and tasks/ and features/ where the options do not name them."""
    out: Path = Path("agent")
    """The folder that becomes the agent."""
    tasks: tuple[Path, ...] = ()
    """A folder of tasks for each of the folders, when they are not in its tasks/."""
    features: tuple[Path, ...] = ()
    """A file of features, HDF5 or TSV, for each of the folders; the only one in its features/ when left out."""
    model: Inline[ModelConfig] = field(default_factory=ModelConfig)
    learning: Inline[LearningConfig] = field(default_factory=LearningConfig)
    json: bool = False
    """Print typed events, one JSON object a line."""


def run(arguments: Arguments) -> int:
    from nvsim.r2r.recurrent.dataset import read_dataset
    from nvsim.r2r.recurrent.training import train_agent

    a = arguments
    with listening(a.json) as listen:
        train_agent(read_dataset(a.folders, a.tasks, a.features), a.model, a.learning, a.out, listen)
    if not a.json:
        print(f"Wrote {a.out}")
    return 0
