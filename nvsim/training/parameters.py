"""The weights of a small torch network in one flat vector, so that one optimizer call updates them all."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import torch
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


class Parameters:
    """Linear layers by name, as leaf tensors "NAME.weight" (out, in) and "NAME.bias" (out,). These are views of
    `values` (count, 1), and torch adds their gradients to `gradient` (count, 1).

    layers     name -> (out, in)
    zero       names of the layers that start at zero; the others start uniformly within 1 / sqrt(in)
    generator  random numbers of the initial values
    """

    def __init__(
        self, layers: Mapping[str, tuple[int, int]], generator: torch.Generator, zero: Collection[str] = ()
    ) -> None:
        count = sum(rows * (columns + 1) for rows, columns in layers.values())
        self.values = np.zeros((count, 1), np.float32)
        self.gradient = np.zeros_like(self.values)
        self.tensors: dict[str, torch.Tensor] = {}
        at = 0
        for name, (rows, columns) in layers.items():
            bound = max(columns, 1) ** -0.5
            for kind, shape in (("weight", (rows, columns)), ("bias", (rows,))):
                end = at + int(np.prod(shape))
                tensor = torch.from_numpy(self.values[at:end, 0]).view(shape)
                if name not in zero:
                    tensor.uniform_(-bound, bound, generator=generator)
                tensor.requires_grad_()
                tensor.grad = torch.from_numpy(self.gradient[at:end, 0]).view(shape)
                self.tensors[f"{name}.{kind}"] = tensor
                at = end

    def linear(self, name: str, x: torch.Tensor) -> torch.Tensor:
        """(..., out) of `x` (..., in), on the device of `x`. Gradients are transferred back to `gradient`."""
        return torch.nn.functional.linear(x, self.on(x, f"{name}.weight"), self.on(x, f"{name}.bias"))

    def on(self, x: torch.Tensor, name: str) -> torch.Tensor:
        """The tensor `name`, (out, in) or (out,), on the device of `x` (any shape)."""
        return self.tensors[name].to(x.device)

    def exported(self) -> dict[str, Float32]:
        """Copies without torch."""
        return {name: tensor.detach().numpy().copy() for name, tensor in self.tensors.items()}


def send_back(output: torch.Tensor, gradient: torch.Tensor) -> None:
    """Propagates the `gradient` of an `output`, of equal shape, to its leaves. The result is bit-identical to
    output.backward(gradient), whose first call imports sympy and so adds half a second to every training process."""
    (output * gradient).sum().backward()


def generator_of(seed: int, part: int) -> torch.Generator:
    """Random numbers of one network (`part`) of those made from one seed."""
    return torch.Generator().manual_seed(seed * 16 + part)
