"""The weights of a small torch network in one flat vector, so that one optimiser call moves them all."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import torch
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


class Parameters:
    """Linear layers by name, as leaf tensors "NAME.weight" (out, in) and "NAME.bias" (out,) that look into `values`
    (count, 1) and send their gradients to `gradient` (count, 1), to which torch adds.

    layers     name -> (out, in)
    zero       names of the layers that start at zero; the others start uniformly within 1 / sqrt(in)
    generator  of the start
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
        """(..., out) of `x` (..., in), on the device of `x`; the gradients come back to `gradient` from there."""
        return torch.nn.functional.linear(x, self.on(x, f"{name}.weight"), self.on(x, f"{name}.bias"))

    def on(self, x: torch.Tensor, name: str) -> torch.Tensor:
        """A tensor on the device of `x`."""
        return self.tensors[name].to(x.device)

    def exported(self) -> dict[str, Float32]:
        """Copies without torch."""
        return {name: tensor.detach().numpy().copy() for name, tensor in self.tensors.items()}


def send_back(output: torch.Tensor, gradient: torch.Tensor) -> None:
    """Sends the `gradient` by an output, of the shape of both, to the leaves that it was made of. The same as
    output.backward(gradient) to the bit, which imports sympy when it is called for the first time: half a second of
    every process that trains."""
    (output * gradient).sum().backward()


def generator_of(seed: int, part: int) -> torch.Generator:
    """Random numbers of one network among several that are made from one seed."""
    return torch.Generator().manual_seed(seed * 16 + part)
