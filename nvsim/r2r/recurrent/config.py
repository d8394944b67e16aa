"""Options of the recurrent agent's network and of its training."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from nvsim.errors import InputError

Way = Literal["path", "sampled", "mixed"]


@dataclass(frozen=True)
class ModelConfig:
    """The network of the agent."""

    width: int = 96
    """Size of a token and of the state."""
    heads: int = 4
    """Heads of every attention layer."""
    text_layers: int = 2
    """Layers that read the instruction."""
    step_layers: int = 2
    """Layers of each step of the agent."""
    longest: int = 80
    """Largest number of words of an instruction that are read, as in VLN↻BERT."""
    angle_size: int = 4
    """Size of an angle feature, sin and cos of heading and elevation, repeated: 128 in VLN↻BERT."""
    distances: bool = True
    """Give the agent the distances to candidates and of its moves. VLN↻BERT does not have them."""
    panorama: bool = False
    """Show the agent all 36 views in each step, in addition to the candidates."""
    blind: bool = False
    """Hide the instruction and its length. This is the baseline that an agent with instructions must beat."""
    dropout: float = 0.1
    """Share of the values that training drops between the layers of the instruction encoder."""
    feature_dropout: float = 0.3
    """Share of the views that training hides, so that the agent does not memorize a building."""

    def __post_init__(self) -> None:
        for name in ("width", "heads", "text_layers", "step_layers", "longest", "angle_size"):
            if not 1 <= getattr(self, name) <= 4096:
                raise InputError(f"--{_flag(name)} {getattr(self, name)} is out of range; give 1 to 4096.")
        if self.width % self.heads:
            raise InputError(f"--width {self.width} is not divisible by {self.heads}; give a multiple of --heads.")
        if self.angle_size % 4:
            raise InputError(f"--angle-size {self.angle_size} is not a multiple of 4; an angle needs four numbers.")
        for name in ("dropout", "feature_dropout"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"--{_flag(name)} {getattr(self, name)} is out of range; give 0 or more, below 1.")


@dataclass(frozen=True)
class LearningConfig:
    """Options of the training: it imitates the shortest path, and then can learn from rewards (A2C)."""

    iterations: int = 2000
    """Largest number of batches of imitation."""
    a2c_iterations: int = 0
    """Largest number of batches of A2C after imitation, which start from the best agent so far."""
    batch: int = 48
    """Instructions per batch."""
    rate: float = 1e-3
    """Learning rate of AdamW. It is reached after --warm-up batches and falls to a tenth along a cosine."""
    a2c_rate: float = 3e-5
    """Learning rate of A2C."""
    warm_up: int = 100
    """Batches in which the learning rate rises to --rate."""
    weight_decay: float = 0.01
    """Weight decay of AdamW."""
    way: Way = "mixed"
    """path: the agent follows the path of the task (teacher forcing). sampled: the agent samples actions from its own
    policy, and the teacher gives the shortest path to the goal at each viewpoint (student forcing, DAgger). mixed: half
    of each batch is path, half is sampled."""
    own_steps: int = 8
    """Largest number of steps of a sampled trajectory in training."""
    a2c_teacher: float = 0.2
    """Weight of the imitation loss along the path that is added to A2C's loss."""
    discount: float = 0.9
    """Discount factor of rewards per step."""
    entropy: float = 0.01
    """Weight of the entropy term of A2C."""
    steps: int = 15
    """Largest number of steps of a trajectory in evaluation."""
    held_out: float = 0.1
    """Share of the training scans (of the paths if there are fewer than three scans) that is held out from training.
    The best agent is the one with the highest success rate on them. Other splits are not read."""
    evaluate_every: int = 150
    """Batches between two evaluations on the held-out tasks."""
    patience: int = 8
    """Number of evaluations without a better agent after which imitation, or A2C, stops early."""
    seed: int = 0
    """Seed of the initial weights, the order of the tasks, dropout and sampled actions."""
    threads: int = 0
    """CPU threads; 0 for the default of PyTorch."""
    checkpoint_every: int = 100
    """Batches between two checkpoints, from which an interrupted training resumes."""

    def __post_init__(self) -> None:
        for name in ("iterations", "a2c_iterations"):
            if not 0 <= getattr(self, name) <= 10_000_000:
                raise InputError(f"--{_flag(name)} {getattr(self, name)} is out of range; give 0 to 10000000 batches.")
        if self.iterations + self.a2c_iterations == 0:
            raise InputError("There is nothing to train; give --iterations or --a2c-iterations of 1 or more.")
        for name in ("batch", "steps", "own_steps", "evaluate_every", "patience", "checkpoint_every"):
            if not 1 <= getattr(self, name) <= 1_000_000:
                raise InputError(f"--{_flag(name)} {getattr(self, name)} is out of range; give 1 to 1000000.")
        if not 0 < self.held_out < 1:
            raise InputError(f"--held-out {self.held_out} is out of range; give a share between 0 and 1.")
        for name in ("rate", "a2c_rate", "warm_up", "weight_decay", "a2c_teacher", "entropy"):
            if not 0 <= getattr(self, name) < math.inf:
                raise InputError(f"--{_flag(name)} {getattr(self, name)} is out of range; give 0 or more.")
        if not 0 <= self.discount <= 1:
            raise InputError(f"--discount {self.discount} is out of range; give 0 to 1.")
        if self.seed < 0 or self.threads < 0:
            raise InputError("--seed and --threads must be 0 or more.")


def _flag(name: str) -> str:
    return name.replace("_", "-")
