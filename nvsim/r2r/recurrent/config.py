"""What the recurrent agent is and how it is trained."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nvsim.errors import InputError

Way = Literal["path", "sampled", "mixed"]


@dataclass(frozen=True)
class ModelConfig:
    """The network of the agent."""

    width: int = 96
    """Numbers of a token and of the state."""
    heads: int = 4
    """Heads of every attention."""
    text_layers: int = 2
    """Layers that read the instruction."""
    step_layers: int = 2
    """Layers that every step of the agent goes through."""
    longest: int = 80
    """Words of an instruction that are read, as in VLN↻BERT."""
    angle_size: int = 4
    """Numbers that say an angle, sin and cos of heading and elevation over and over: 128 in VLN↻BERT."""
    distances: bool = True
    """Tell the agent how far candidates are and how far it went. VLN↻BERT is not told."""
    panorama: bool = False
    """Show the agent all 36 views in each step, beside the candidates."""
    blind: bool = False
    """Hide the instruction, not even its length is left: the twin that an agent which reads must beat."""
    dropout: float = 0.1
    """Share of the numbers that training drops between the layers of the instruction."""
    feature_dropout: float = 0.3
    """Share of the views that training hides, so that a building is not known by heart."""

    def __post_init__(self) -> None:
        for name in ("width", "heads", "text_layers", "step_layers", "longest", "angle_size"):
            if not 1 <= getattr(self, name) <= 4096:
                raise InputError(f"--{_flag(name)} {getattr(self, name)} makes no network; give 1 to 4096.")
        if self.width % self.heads:
            raise InputError(f"--width {self.width} cannot be cut into {self.heads} heads; give a multiple of --heads.")
        if self.angle_size % 4:
            raise InputError(f"--angle-size {self.angle_size} is no multiple of 4; an angle takes four numbers.")
        for name in ("dropout", "feature_dropout"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"--{_flag(name)} {getattr(self, name)} is no share; give one from 0 to below 1.")


@dataclass(frozen=True)
class LearningConfig:
    """How the agent is trained: it imitates the shortest path, and then, if asked for, learns from rewards (A2C)."""

    iterations: int = 2000
    """Batches of imitation, at most."""
    a2c_iterations: int = 0
    """Batches of A2C after imitation, from the best agent so far."""
    batch: int = 48
    """Instructions of a batch."""
    rate: float = 1e-3
    """Learning rate of AdamW, reached after --warm-up batches and falling to a tenth along a cosine."""
    a2c_rate: float = 3e-5
    """Learning rate of A2C."""
    warm_up: int = 100
    """Batches."""
    weight_decay: float = 0.01
    """Of AdamW."""
    way: Way = "mixed"
    """path: along the path of the task (teacher forcing). sampled: along the agent's own trajectory, drawn from what it
    would do, while the teacher says at each viewpoint where the shortest path to the goal leads (student forcing,
    DAgger). mixed: half of each batch so, half so."""
    own_steps: int = 8
    """Of a trajectory of its own in training, at most."""
    a2c_teacher: float = 0.2
    """Weight of the loss along the path beside A2C's."""
    discount: float = 0.9
    """Of later rewards, a step."""
    entropy: float = 0.01
    """Weight of the entropy that A2C keeps up."""
    steps: int = 15
    """Of a trajectory when it is tried, at most."""
    held_out: float = 0.1
    """Share of the training scans (of the paths, where there are fewer than three scans) that the agent is not trained
    on: the best agent is the one with the most successes there. No other split is opened."""
    evaluate_every: int = 150
    """Batches between two tries on what is held out."""
    patience: int = 8
    """Tries without a better agent after which imitation, or A2C, ends early."""
    seed: int = 0
    """Of the first weights, the order of the tasks, dropout and sampled actions."""
    threads: int = 0
    """Cores; 0 for all."""
    checkpoint_every: int = 100
    """Batches between two checkpoints, from which a killed training goes on."""

    def __post_init__(self) -> None:
        for name in ("iterations", "a2c_iterations"):
            if not 0 <= getattr(self, name) <= 10_000_000:
                raise InputError(f"--{_flag(name)} {getattr(self, name)} is no number of batches; give 0 on.")
        if self.iterations + self.a2c_iterations == 0:
            raise InputError("There is nothing to train; give --iterations or --a2c-iterations of 1 or more.")
        for name in ("batch", "steps", "own_steps", "evaluate_every", "patience", "checkpoint_every"):
            if not 1 <= getattr(self, name) <= 1_000_000:
                raise InputError(f"--{_flag(name)} {getattr(self, name)} is too few or too many; give 1 on.")
        if not 0 < self.held_out < 1:
            raise InputError(f"--held-out {self.held_out} is no share; give one between 0 and 1.")
        if self.seed < 0 or self.threads < 0:
            raise InputError("--seed and --threads are whole numbers from 0 on.")


def _flag(name: str) -> str:
    return name.replace("_", "-")
