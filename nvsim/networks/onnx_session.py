"""A network that the user brings, opened with onnxruntime in a process of its own."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import psutil

from nvsim.errors import InputError
from nvsim.kernel_threads import allowed
from nvsim.networks.external_data import check_external_data
from nvsim.networks.onnx_server import Failed, Load, Loaded, Node, OnnxServer, Run
from nvsim.processes.child import Child, Limits

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
Signature = tuple[tuple[Node, ...], tuple[Node, ...]]
"""Inputs and outputs of a file."""
_SECONDS, _SECONDS_PER_MB = 10.0, 1.0
"""What a file may take to load: so long, and longer by its megabytes. To run it may take longer by those of its inputs
too. Networks that people use take a tenth of that on two busy cores."""
_MEMORY, _MEMORY_PER_BYTE, _MEMORY_PER_INPUT = 4 << 30, 10, 500
"""Bytes that a file may take, and more for each byte of the file and of its inputs."""
_SHARE = 0.8
"""Of the memory that is free, for any file."""


class DoesNotRun(InputError):
    """A network refuses its inputs. `reason` is why, in the words of onnxruntime."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path} is not a network that runs ({reason}); export it again.")
        self.reason = reason


class Session:
    """The network in the file at `path`, on the first of `providers` that can run it. May be used by any thread; one
    run at a time.

    inputs, outputs  of the file
    metadata         the file's own properties
    provider         that runs it

    Raises InputError for a file that cannot be loaded, that names files of weights which may not be opened, and that
    takes too much time or memory.
    """

    def __init__(self, path: Path, providers: Sequence[str] = ("CPUExecutionProvider",)) -> None:
        self._path, self._bytes = path, check_external_data(path)
        self._child: Child[Load | Run, Any] = Child(OnnxServer, str(path), "export it again, or use another network")
        weakref.finalize(self, self._child.release)
        found = self._child.ask(Load(path, tuple(providers), allowed()), self._limits(0))
        if isinstance(found, Failed):
            raise InputError(f"{path} cannot be loaded as an ONNX network ({found.reason}); export it again.")
        loaded: Loaded = found
        self.inputs, self.outputs, self.metadata = loaded.inputs, loaded.outputs, loaded.metadata
        self.provider = loaded.provider
        if loaded.provider not in providers:
            raise InputError(f"{path} cannot run on {providers[0]} here; install its libraries, or use the CPU.")

    def run(self, names: Sequence[str] | None, feed: Mapping[str, np.ndarray[Any, Any]]) -> list[Any]:
        """The outputs `names`, None for all, of inputs by their names. Raises DoesNotRun where the network refuses
        them, and InputError where it ends, takes too long or too much memory."""
        limits = self._limits(sum(value.nbytes for value in feed.values()))
        found = self._child.ask(Run(None if names is None else list(names), dict(feed)), limits)
        if isinstance(found, Failed):
            raise DoesNotRun(self._path, found.reason)
        return list(found)

    def _limits(self, given: int) -> Limits:
        """For the file and `given` bytes of its inputs."""
        memory = _MEMORY + _MEMORY_PER_BYTE * self._bytes + _MEMORY_PER_INPUT * given
        free = round(_SHARE * psutil.virtual_memory().available)
        return Limits(_SECONDS + _SECONDS_PER_MB * self._bytes / 1e6 * (1 + given / 1e6), min(memory, free))

    @property
    def signature(self) -> Signature:
        return self.inputs, self.outputs


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
