"""Adam in one sweep over a group of parameters (Kingma and Ba 2015), with a learning rate per column, and the weights
of a small network as one group.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.kernels import njit, prange

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
        return torch.nn.functional.linear(
            x, self.tensor_on_device(x, f"{name}.weight"), self.tensor_on_device(x, f"{name}.bias")
        )

    def tensor_on_device(self, x: torch.Tensor, name: str) -> torch.Tensor:
        """The tensor `name`, (out, in) or (out,), on the device of `x` (any shape)."""
        return self.tensors[name].to(x.device)

    def exported(self) -> dict[str, Float32]:
        """Copies of the parameters without torch, each with the shape of its tensor."""
        return {name: tensor.detach().numpy().copy() for name, tensor in self.tensors.items()}


def propagate_gradient(output: torch.Tensor, gradient: torch.Tensor) -> None:
    """Propagates the `gradient` of an `output`, of equal shape, to its leaves. The result is bit-identical to
    output.backward(gradient), whose first call imports sympy and so adds half a second to every training process."""
    (output * gradient).sum().backward()


def random_generator(seed: int, part: int) -> torch.Generator:
    """Random numbers of one network (`part`) of those made from one seed."""
    return torch.Generator().manual_seed(seed * 16 + part)


_F = np.float32
_ONE = _F(1)
BETA1, BETA2, EPS = 0.9, 0.999, 1e-15
CHUNK, BLOCK, LANES = 1 << 14, 1 << 12, 64  # whole vectors only: remaining values are processed one by one


@njit(parallel=True, cache=True, fastmath=True, error_model="numpy")
def _adam(
    values: Float32,  # (n,) all rows one after the other, changed
    gradient: Float32,  # (n,)
    first: Float32,  # (n,) moment, changed
    second: Float32,  # (n,) moment, changed
    rates: Float32,  # (block,) of some whole rows, which stay in the nearest cache
    factors: Float32,  # (5,)
) -> None:
    # factors: beta1, beta2, eps, the square root of the second moment's bias correction, and the factor of the rates,
    # which includes the correction of the first moment. A task has about CHUNK values.
    size, block = values.shape[0], rates.shape[0]
    beta1, beta2, eps, correction, scale = factors[0], factors[1], factors[2], factors[3], factors[4]
    per_task = max(CHUNK // block, 1) * block
    for task in prange((size + per_task - 1) // per_task):
        for begin in range(task * per_task, min(size, (task + 1) * per_task), block):
            end = min(size, begin + block)
            v, g = values[begin:end], gradient[begin:end]
            m, s = first[begin:end], second[begin:end]
            for i in range(end - begin):
                slope = g[i]
                mean = beta1 * m[i] + (_ONE - beta1) * slope
                square = beta2 * s[i] + (_ONE - beta2) * slope * slope
                m[i], s[i] = mean, square
                v[i] -= scale * rates[i] * mean / (np.sqrt(square) * correction + eps)


@dataclass(eq=False)
class ParameterGroup:
    """Parameters (N, ...) float32 with their gradient and both moments (N, ...). `rates` are per element, for as many
    whole rows as give BLOCK elements or more."""

    values: Float32
    gradient: Float32
    rates: Float32
    first: Float32
    second: Float32

    @staticmethod
    def of(values: Float32, rates: Float32 | float, gradient: Float32 | None = None) -> ParameterGroup:
        """A group with zero moments. `values` (N, ...) and `gradient` (N, ...) are kept, not copied."""
        columns = int(np.prod(values.shape[1:], dtype=int))
        rows = LANES * -(-BLOCK // (LANES * columns))
        spread = np.broadcast_to(np.asarray(rates, np.float32), (rows, columns)).copy().reshape(-1)
        gradient = np.zeros_like(values) if gradient is None else gradient
        return ParameterGroup(values, gradient, spread, np.zeros_like(values), np.zeros_like(values))

    def step(self, count: int, scale: float = 1.0) -> None:
        """Makes the `count`-th update (from 1) with all rates times `scale`."""
        factors = np.array([BETA1, BETA2, EPS, (1 - BETA2**count) ** -0.5, scale / (1 - BETA1**count)], np.float32)
        values, gradient = self.values.reshape(-1), self.gradient.reshape(-1)
        _adam(values, gradient, self.first.reshape(-1), self.second.reshape(-1), self.rates, factors)
