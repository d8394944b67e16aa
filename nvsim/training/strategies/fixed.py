"""Strategy "none": training never adds or removes Gaussians."""

from __future__ import annotations

from nvsim.training.strategies.types import Model


class Fixed:
    """The strategy without densification."""

    def before_update(self, model: Model, step: int) -> None:
        """Does nothing."""

    def after_update(self, model: Model, step: int) -> None:
        """Does nothing."""
