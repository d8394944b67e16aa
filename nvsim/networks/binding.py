"""Match the tensors of a description with the inputs and outputs of an ONNX file.

They are matched by name, else by shape, but never by position, because exports of one network differ in order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from nvsim.errors import InputError
from nvsim.networks.description import Tensor
from nvsim.networks.onnx_session import Node


@dataclass(frozen=True)
class BoundTensor:
    tensor: Tensor
    node: Node


def bind_tensors(tensors: Sequence[Tensor], nodes: Sequence[Node], path: Path, inputs: bool) -> tuple[BoundTensor, ...]:
    """Each matched tensor of `tensors` with its input or output of the file at `path`.

    Two tensors may use one output. If several outputs could give one value, the first that exists is used.

    Raises InputError if a required tensor is missing or ambiguous, if a named one has another shape, or if the file has
    an input that is not in the description.
    """
    found: dict[int, Node] = {}

    def is_missing(i: int) -> bool:
        return i not in found and (inputs or not any(tensors[k].values == tensors[i].values for k in found))

    for i, tensor in enumerate(tensors):
        if not is_missing(i):
            continue
        named = next((n for name in tensor.names for n in nodes if n.name == name), None)
        if named is not None:
            if _exactness(tensor, named) is None:
                raise InputError(
                    f"{path}: {named.name} is {describe_nodes([named])}, but the description says "
                    f"{_describe_tensor(tensor)}; "
                    "correct the description, or export the file again."
                )
            found[i] = named
    while True:
        free = [n for n in nodes if n not in found.values()]
        chosen = next(
            ((i, n) for i, t in enumerate(tensors) if is_missing(i) and (n := _best_matching_node(t, free))), None
        )
        if chosen is None:
            break
        found[chosen[0]] = chosen[1]
    for i, tensor in enumerate(tensors):
        if is_missing(i) and not tensor.optional:
            raise InputError(
                f"{path} has no {'input' if inputs else 'output'} that matches {_describe_tensor(tensor)}; "
                f"it has {describe_nodes(nodes)}."
            )
    left = [n for n in nodes if n not in found.values()]
    if inputs and left:
        raise InputError(
            f"{path} also takes {describe_nodes(left)}, which its description does not list; add it there."
        )
    return tuple(BoundTensor(tensors[i], found[i]) for i in sorted(found))


def _best_matching_node(tensor: Tensor, nodes: Sequence[Node]) -> Node | None:
    """The node that matches the shape of a tensor best; None if there is none, or if several match equally well."""
    if tensor.shape is None:
        return None
    fits = [(exact, node) for node in nodes if (exact := _exactness(tensor, node)) is not None]
    most = max((exact for exact, _ in fits), default=0)
    best = [node for exact, node in fits if exact == most]
    return best[0] if len(best) == 1 else None


def _exactness(tensor: Tensor, node: Node) -> int | None:
    """The number of sides of a node that equal those of the tensor; None if a side, the rank, or the type differs."""
    is_float = node.type in ("tensor(float)", "tensor(float16)", "tensor(double)")
    if tensor.kind and (tensor.kind == "float") != is_float:
        return None
    if tensor.shape is None:
        return 0
    shape = node.shape
    if len(shape) != len(tensor.shape):
        return None
    said = [(wanted, side) for wanted, side in zip(tensor.shape, shape) if wanted]
    if any(isinstance(side, int) and side != wanted for wanted, side in said):
        return None
    return sum(side == wanted for wanted, side in said)


def _describe_tensor(tensor: Tensor) -> str:
    name = " or ".join(tensor.names)
    shape = "" if tensor.shape is None else "[" + ", ".join(str(n) if n else "?" for n in tensor.shape) + "]"
    return " ".join(filter(None, (name, tensor.kind, shape)))


def describe_nodes(nodes: Sequence[Node]) -> str:
    """The inputs or outputs of a file, as text for a message."""
    return ", ".join(f"{n.name} {n.type} {list(n.shape)}" for n in nodes) or "none"
