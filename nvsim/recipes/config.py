"""What the training of the bundled networks can be told."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RecipeConfig:
    """captured and captures_share matter where projects are named."""

    steps: int = 3000
    """Updates of the network."""
    interiors: int = 160
    """Generated buildings to learn from."""
    views: int = 24
    """Images of each of them."""
    captured: int = 160
    """Photographs of each project, and renders of its models."""
    captures_share: float = 0.4
    """Share of the images of an update that are of projects, below 1."""
    batch: int = 8
    """Images an update looks at."""
    rate: float = 1.5e-3
    """The highest learning rate."""
    trunk_rate: float = 2e-4
    """The same of the trunk."""
    seed: int = 0
    save_every: int = 50
    """Steps between checkpoints."""
    threads: int = 1
    """Of the training; with another number the weights differ in their last digits."""
