"""A network that the user brings, opened with onnxruntime."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.regular import opened
from nvsim.kernel_threads import allowed

Provider = Literal["auto", "cpu", "cuda"]
_PROVIDERS = {
    "auto": ("CUDAExecutionProvider", "CPUExecutionProvider"),
    "cpu": ("CPUExecutionProvider",),
    "cuda": ("CUDAExecutionProvider",),
}
TYPES: dict[str, Any] = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
    "tensor(uint8)": np.uint8,
    "tensor(bool)": np.bool_,
}
"""What an input of the network takes, by onnxruntime's word for it."""


@dataclass(frozen=True)
class Node:
    """An input or an output of a file. A side of the shape is a number, a name, or None where it is open."""

    name: str
    type: str
    shape: tuple[int | str | None, ...]


Signature = tuple[tuple[Node, ...], tuple[Node, ...]]
"""Inputs and outputs of a file."""


def signature(opened: Any, path: Path) -> Signature:
    """Of the session `opened` from the file at `path`. Raises InputError for names that are no text."""
    with reading(path, "an ONNX network", "export it again"):
        inputs, outputs = (
            tuple(Node(n.name, n.type, tuple(n.shape if n.shape is not None else ())) for n in nodes)
            for nodes in (opened.get_inputs(), opened.get_outputs())
        )
        return inputs, outputs


def providers(wanted: Provider) -> list[str]:
    """What onnxruntime is to run on, the best first. Raises InputError where it can run on none of it."""
    import onnxruntime

    here = onnxruntime.get_available_providers()
    found = [name for name in _PROVIDERS[wanted] if name in here]
    if not found:
        raise InputError(
            f"This onnxruntime cannot run on {wanted if wanted != 'auto' else 'cpu or cuda'} (it has "
            f"{', '.join(here) or 'nothing'}); install onnxruntime{'-gpu' if wanted == 'cuda' else ''}."
        )
    return found


def session(path: Path, providers: Sequence[str] = ("CPUExecutionProvider",)) -> Any:
    """An `onnxruntime.InferenceSession` on the first of `providers` that can run it. Raises InputError for a file that
    cannot be loaded."""
    import onnxruntime

    with opened(path):
        pass  # a pipe is refused, and not waited for
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = allowed()
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=list(providers))
    except Exception as error:  # onnxruntime's classes share no base but this one
        raise InputError(f"{path} cannot be loaded as an ONNX network ({reason(error)}); export it again.") from error


def reason(error: Exception) -> str:
    """The first line of what onnxruntime says, without its prefix and the path."""
    line = (str(error).strip().splitlines() or [type(error).__name__])[0]
    said = line.split(" : ")[-1].split(" failed:")[-1].strip().rstrip(".")[:160]
    return "".join(c if c.isprintable() else "?" for c in said)
