"""Adam over tensors, with the arithmetic of `nvsim.training.optimizer` and a learning rate per column."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.training.optimizer import BETA1, BETA2, EPS

Float32 = NDArray[np.float32]


@dataclass(eq=False)
class CardGroup:
    """Parameters (N, ...) float32 as a leaf of torch's tape, with both moments; `rates` broadcast against a row."""

    values: torch.Tensor
    rates: torch.Tensor
    first: torch.Tensor
    second: torch.Tensor

    @staticmethod
    def of(values: Float32, rates: Float32 | float, device: str) -> CardGroup:
        """A group with zero moments; `values` (N, ...) are copied, `rates` are one for all or one per column."""
        moved = torch.tensor(values, dtype=torch.float32, device=device)
        per_column = torch.tensor(rates, dtype=torch.float32, device=device)
        if per_column.ndim > 0:
            per_column = per_column.view(moved.shape[1:])
        return CardGroup(moved.requires_grad_(), per_column, torch.zeros_like(moved), torch.zeros_like(moved))

    @property
    def gradient(self) -> torch.Tensor:
        """(N, ...) the gradient; zeros if the last view did not reach the group."""
        if self.values.grad is None:
            self.values.grad = torch.zeros_like(self.values)
        return self.values.grad

    @torch.no_grad()
    def step(self, count: int, scale: float = 1.0) -> None:
        """Makes the `count`-th update (from 1) with all rates times `scale`."""
        slope = self.gradient
        self.first.mul_(BETA1).add_(slope, alpha=1 - BETA1)
        self.second.mul_(BETA2).addcmul_(slope, slope, value=1 - BETA2)
        root = self.second.sqrt().mul_((1 - BETA2**count) ** -0.5).add_(EPS)
        self.values.sub_(self.first.div(root).mul_(self.rates * (scale / (1 - BETA1**count))))

    def replace(self, kept: torch.Tensor, born: Float32) -> None:
        """Keeps the rows `kept` (K,) with their moments, and appends the rows `born` (B, ...) with zero moments."""
        joining = torch.tensor(born, device=self.values.device)
        none = torch.zeros_like(joining)
        self.values = torch.cat([self.values.detach()[kept], joining]).requires_grad_()
        self.first, self.second = torch.cat([self.first[kept], none]), torch.cat([self.second[kept], none])
