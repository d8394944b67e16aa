"""What the training of the bundled networks can be told."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RecipeConfig:
    """steps      updates of the network
    interiors  generated buildings to learn from
    views      images of each of them
    batch      images an update looks at
    rate       the highest learning rate; of the trunk `trunk_rate`
    """

    steps: int = 4000
    interiors: int = 160
    views: int = 24
    batch: int = 8
    rate: float = 1.5e-3
    trunk_rate: float = 2e-4
    seed: int = 0
    captures_share: float = 0.35
    """Of the images from projects, where some are named."""
    save_every: int = 100
    """Steps between checkpoints."""
