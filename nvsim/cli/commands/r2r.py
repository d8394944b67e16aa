"""Commands for the programs of agents: train one, and run one with NVSim as its simulator."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.console import event_listener
from nvsim.cli.terminal import as_json, print_lines
from nvsim.errors import InputError
from nvsim.r2r.recurrent.config import LearningConfig, ModelConfig


@dataclass(frozen=True)
class R2RTrain:
    """Train the recurrent agent, after VLN↻BERT, on the train split of exported scans: by imitation, and then by
    rewards if requested. An interrupted training continues when you run it again. Its curves are in
    OUT/curves.jsonl."""

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

    def run(self) -> int:
        """Runs the command. Raises InputError if no scans are named."""
        from nvsim.r2r.recurrent.dataset import read_dataset
        from nvsim.r2r.recurrent.training import train_agent

        if not self.scans and self.project is None:
            raise InputError("There is nothing to train on; give --scans, one or more folders of exports.")
        scans = self.scans or (Path(os.path.abspath(self.project or "")).parent / "scans",)
        with event_listener(self.json) as listen:
            train_agent(read_dataset(scans, self.tasks, self.features), self.model, self.learning, self.out, listen)
        if not self.json:
            print_lines(f"Wrote {self.out}")
        return 0


@dataclass(frozen=True)
class R2RPython:
    """Run a program, such as an agent's training, so that its import of MatterSim gives NVSim's simulator.

    `nvsim r2r python -- python train.py --batch 8`: everything after the two hyphens belongs to the program.
    """

    program: Positional[tuple[str, ...]] = ()
    """The program and its arguments, after `--`."""
    replace: bool = False
    """Use NVSim's simulator even if a MatterSim is installed."""

    def run(self) -> int:
        """Replaces this process by the program, so that signals and exit codes are the program's. Raises InputError if
        no program is given or it cannot be run."""
        from nvsim.r2r.simulator.shim import environment_with_shim

        if not self.program:
            raise InputError("No program is given; write it after two hyphens: nvsim r2r python -- python train.py")
        environment = environment_with_shim(self.program, self.replace)
        try:
            os.execvpe(self.program[0], self.program, environment)
        except OSError as error:
            raise InputError(f"Cannot run {self.program[0]}: {error.strerror}; check its name.") from error


@dataclass(frozen=True)
class R2RPath:
    """Print the folder in which the module MatterSim is NVSim's simulator. Add it to PYTHONPATH of an agent's
    program."""

    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        from nvsim.r2r.simulator.shim import shim_folder

        folder = str(shim_folder())
        print_lines(as_json({"path": folder}) if self.json else folder)
        return 0
