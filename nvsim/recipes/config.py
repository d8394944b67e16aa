"""Options of the training of the bundled networks."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RecipeConfig:
    """captured and captures_share only have an effect if projects are given."""

    steps: int = 3000
    """Number of training steps."""
    interiors: int = 160
    """Number of generated buildings in the training data."""
    views: int = 24
    """Images per generated building."""
    captured: int = 160
    """Maximum number of photographs per project, and of renders of its models."""
    captures_share: float = 0.4
    """Share of images from projects in a batch, below 1."""
    batch: int = 8
    """Images per batch."""
    rate: float = 1.5e-3
    """Highest learning rate."""
    trunk_rate: float = 2e-4
    """Highest learning rate of the trunk."""
    seed: int = 0
    """Random seed of the examples and of the initial weights."""
    save_every: int = 50
    """Steps between checkpoints."""
    threads: int = 1
    """Threads of the training; another number changes the last digits of the weights."""
