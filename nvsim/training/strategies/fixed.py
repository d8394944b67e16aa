"""Strategy "none": the Gaussians that training starts with are those it ends with."""

from __future__ import annotations

from nvsim.training.strategies.types import Model


class Fixed:
    def before_update(self, model: Model, step: int) -> None:
        """Does nothing."""

    def after_update(self, model: Model, step: int) -> None:
        """Does nothing."""
